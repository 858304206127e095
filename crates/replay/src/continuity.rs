//! Whether a recording is whole in time.

use std::path::Path;
use std::time::Duration;

use bag::Bag;
use run_recorder::{Continuity, names};
use tandem_msgs::ControlCycle;

use crate::ReplayError;
use crate::cycle::control_cycle;

/// When a cycle was, on the controller's clock.
pub(crate) fn cycle_time(cycle: &ControlCycle) -> Result<Duration, &'static str> {
    let stamp = &cycle.header.stamp;
    Ok(Duration::new(u64::try_from(stamp.sec).map_err(|_| "a negative time")?, stamp.nanosec))
}

/// How whole a bag's cycles are; none for a bag without cycles.
///
/// # Errors
/// [`ReplayError::Bag`] if a message cannot be read, [`ReplayError::BadMessage`] for a cycle at a negative time.
pub fn continuity(bag: &Bag) -> Result<Option<Continuity>, ReplayError> {
    let cycles = bag.topics().iter().position(|topic| {
        names::is(&topic.name, names::CONTROL_CYCLE) && topic.type_name == "tandem_msgs/msg/ControlCycle"
    });
    let Some(cycles) = cycles else { return Ok(None) };
    let topic = &bag.topics()[cycles];
    let mut found = Continuity::default();
    for message in bag.messages()? {
        let message = message?;
        if message.topic == cycles {
            let cycle = control_cycle(topic, &message.data)?;
            let now = cycle_time(&cycle).map_err(|problem| ReplayError::BadMessage {
                path: Path::new(bag.path()).to_owned(),
                topic: topic.name.clone(),
                time_s: message.stamp_ns as f64 * 1e-9,
                problem: problem.into(),
            })?;
            found.cycle(now, cycle.index);
        }
    }
    Ok((found.cycles > 0).then_some(found))
}
