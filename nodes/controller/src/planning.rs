//! The thread that asks the planner for gaits for the command, and may wait for it.

use crate::command_gait::{CommandGaits, Task};
use crate::services::Services;
use ros::{Client, Node};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;
use tandem_msgs::text::{SENTENCE_CHARS, printable};
use tandem_msgs::{GenerateGait, GenerateGaitRequest};

/// How often it looks at the command.
const LOOK_PERIOD: Duration = Duration::from_millis(100);
/// A planner that has not answered within this counts as none; a gait takes it milliseconds.
const PATIENCE: Duration = Duration::from_secs(3);

/// Begins the thread, where gaits are planned for the command; it ends by itself after `stop`. Nobody waits for it: it
/// may be waiting for an answer.
///
/// # Errors
/// No client of the planner, or no thread.
pub fn begin(
    node: &Node,
    gaits: Option<Arc<CommandGaits>>,
    services: &Arc<Services>,
    stop: &Arc<AtomicBool>,
) -> anyhow::Result<()> {
    let Some(gaits) = gaits else { return Ok(()) };
    let (services, stop) = (Arc::clone(services), Arc::clone(stop));
    let planner: Client<GenerateGait> = node.client("generate_gait")?;
    std::thread::Builder::new().name("planning".into()).spawn(move || {
        while !stop.load(Ordering::Acquire) {
            match gaits.next() {
                Some(Task::Plan(request)) => ask(&planner, &gaits, *request),
                Some(Task::GoBack(gait)) => match services.load(&gait) {
                    Ok(what) => tracing::info!("the walk is over: {what} again"),
                    Err(reason) => tracing::error!("the walk is over, and its gait is not loaded again: {reason}"),
                },
                None => {}
            }
            std::thread::sleep(LOOK_PERIOD);
        }
    })?;
    Ok(())
}

/// The gait itself comes on its topic, as every gait does.
fn ask(planner: &Client<GenerateGait>, gaits: &CommandGaits, request: GenerateGaitRequest) {
    let speed_m_s = request.speed_m_s.0.first().copied().unwrap_or(f64::NAN);
    tracing::info!("cmd_vel is far from the gait's own speed: asking the planner for {speed_m_s:.2} m/s");
    let reason = match planner.call(request, PATIENCE) {
        Ok(answer) if answer.success => return,
        Ok(answer) => format!("the planner has none for {speed_m_s:.2} m/s: {}", answer.message),
        Err(error) => error.to_string(),
    };
    let reason = printable(&reason, SENTENCE_CHARS);
    if gaits.fail(&reason) {
        tracing::warn!("no gait for cmd_vel, the walk goes on with the one that it has: {reason}");
    }
}
