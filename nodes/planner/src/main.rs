//! tandem_planner: the service `generate_gait` and the latched topic `gait`. Parameters and topics: docs/interfaces.md.

use std::ops::ControlFlow;
use std::path::Path;
use std::process::ExitCode;
use std::sync::Arc;
use std::time::Duration;

use anyhow::{Context, bail};
use robot::Robot;
use ros::{Arguments, GoalEnd, Node, Publisher, Qos, ServeOptions};
use tandem_msgs::{Gait, GenerateGait, GenerateGaitAction, GenerateGaitResponse};
use tandem_planner::planner::Planner;
use tandem_planner::ports;

fn main() -> ExitCode {
    match run() {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("tandem_planner: {error:#}");
            ExitCode::FAILURE
        }
    }
}

fn run() -> anyhow::Result<()> {
    let (arguments, rest) = Arguments::from_process()?;
    if let Some(unknown) = rest.get(1) {
        bail!("argument \"{unknown}\" is not known; parameters are given as --ros-args -p NAME:=VALUE");
    }
    let node = Node::start("planner", &arguments)?;
    let folder = node
        .parameter("robot", "config/robots/vision60".to_string())
        .description("Folder of the robot's description; looked for from the working folder, then above the program.")
        .read_only()
        .declare()?;
    let time_limit_s = node
        .parameter("time_limit_s", 20.0)
        .description("A solve that takes longer is given up, s.")
        .range(0.1, 600.0)
        .read_only()
        .declare()?;
    let waiting = node
        .parameter("waiting_requests", 8_i64)
        .description("How many requests may wait behind the one that is planned; more are answered with status busy.")
        .range(0, 1000)
        .read_only()
        .declare()?;
    let find_nearest = node
        .parameter("find_nearest", true)
        .description("Answer a request that cannot be planned with the nearest one that can; takes a few solves.")
        .read_only()
        .declare()?;
    node.warn_of_unused_parameters();

    let folder = ros::find(Path::new(&folder.get()))?;
    let robot = Robot::load(&folder).with_context(|| format!("robot folder {}", folder.display()))?;
    let planner = Arc::new(Planner::new(robot, Duration::from_secs_f64(time_limit_s.get()), find_nearest.get()));

    let for_action = Arc::clone(&planner);
    let gaits = node.publisher::<Gait>("gait", Qos::latched())?;
    let by_service = gaits.clone();
    let waiting = usize::try_from(waiting.get())?;
    let busy = move |_: &_| ports::failure(ports::BUSY, format!("{waiting} requests wait already: ask again later"));
    node.serve_with::<GenerateGait>("generate_gait", ServeOptions::bounded(waiting, busy), move |request| {
        let (mut response, gait) = planner.generate(&request, |iteration, elapsed| {
            tracing::debug!(
                "{}: iteration {} after {elapsed:?}: cost {:.6e}, violation {:.1e}",
                request.behaviour,
                iteration.number,
                iteration.objective,
                iteration.max_violation
            );
            ControlFlow::Continue(())
        });
        announce(&request.behaviour, &mut response, gait, &by_service);
        response
    })?;
    node.serve_action::<GenerateGaitAction>("generate_gait", waiting, move |request, goal| {
        let (mut response, gait) = for_action.generate(&request, |iteration, elapsed| {
            goal.feedback(ports::feedback(iteration, elapsed));
            if goal.is_cancelled() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
        });
        announce(&request.behaviour, &mut response, gait, &gaits);
        let end = match (response.success, goal.is_cancelled()) {
            (true, _) => GoalEnd::Succeeded,
            (false, true) => GoalEnd::Cancelled,
            (false, false) => GoalEnd::Aborted,
        };
        (end, response)
    })?;
    tracing::info!("ready");
    let stop = node.stop();
    node.run();
    if stop.was_suspended() {
        anyhow::bail!("the process had been stopped and went on; start it again");
    }
    Ok(())
}

/// Says what came of a request, and publishes its gait if there is one; the answer then carries the gait's stamp.
fn announce(behaviour: &str, response: &mut GenerateGaitResponse, gait: Option<Gait>, gaits: &Publisher<Gait>) {
    if let Some(mut gait) = gait {
        tracing::info!("planned {}", response.message);
        gait.header.stamp = ros::wall_time();
        response.gait_stamp = gait.header.stamp;
        if let Err(error) = gaits.publish(gait) {
            tracing::error!("{error}");
        }
    } else {
        tracing::warn!("{behaviour:?} was not planned: {}: {}", response.status, response.message);
    }
}
