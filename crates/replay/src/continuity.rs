//! Whether a recording is whole in time.

use std::path::Path;
use std::time::Duration;

use bag::Bag;
use tandem_msgs::ControlCycle;

use crate::cycle::control_cycle;
use crate::{ReplayError, names};

/// The cycles of a recording, looked at one after the other: what is missing between them, and the longest hole. A hole with missing
/// cycles was made by the recorder (a disk that was too slow); one without, by a controller that did not run.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Continuity {
    /// Cycles seen.
    pub cycles: u64,
    /// Cycles that are missing between the first and the last.
    pub missing: u64,
    /// Longest time from one cycle to the next.
    pub longest: Duration,
    /// On the controller's clock, when that began.
    pub longest_from: Duration,
    last: Option<(Duration, u64)>,
}

impl Continuity {
    /// The next cycle: its time on the controller's clock, and its number. Gives the time and the missing cycles since the one before.
    pub fn cycle(&mut self, now: Duration, index: u64) -> (Duration, u64) {
        self.cycles += 1;
        let Some((before, last)) = self.last.replace((now, index)) else { return (Duration::ZERO, 0) };
        let (hole, missing) = (now.saturating_sub(before), index.saturating_sub(last).saturating_sub(1));
        self.missing += missing;
        if hole > self.longest {
            (self.longest, self.longest_from) = (hole, before);
        }
        (hole, missing)
    }
}

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
