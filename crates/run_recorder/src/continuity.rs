//! Whether a recording is whole in time.

use std::time::Duration;

/// The cycles of a recording, looked at one after the other: what is missing between them, and the longest hole. A hole
/// with missing cycles was made by the recorder (a disk that was too slow); one without, by a controller that did not
/// run.
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
    /// The next cycle: its time on the controller's clock, and its number. Gives the time and the missing cycles since
    /// the one before.
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
