use crate::clock::{monotonic_now, sleep_until};
use std::time::Duration;

/// Wakes at start + k · period on the monotonic clock. A cycle that takes too long costs the wakes that it overlaps and
/// no more: the grid stays.
#[derive(Debug)]
pub struct Periodic {
    start: Duration,
    period: Duration,
    index: u64,
}

/// One wake.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Wake {
    /// When it was due.
    pub due: Duration,
    /// When it came.
    pub at: Duration,
    /// Wakes that were missed since the last one because it took too long.
    pub missed: u64,
}

impl Wake {
    /// How late it came.
    pub fn latency(&self) -> Duration {
        self.at.saturating_sub(self.due)
    }
}

impl Periodic {
    /// A grid that begins now.
    ///
    /// # Panics
    ///
    /// If the period is zero.
    pub fn new(period: Duration) -> Self {
        Self::starting_at(monotonic_now(), period)
    }

    fn starting_at(start: Duration, period: Duration) -> Self {
        assert!(!period.is_zero(), "a period of zero");
        Self { start, period, index: 0 }
    }

    /// The period.
    pub fn period(&self) -> Duration {
        self.period
    }

    /// Sleeps until the next instant of the grid.
    pub fn wait(&mut self) -> Wake {
        let (due, missed) = self.next(monotonic_now());
        sleep_until(due);
        Wake { due, at: monotonic_now(), missed }
    }

    /// The next instant of the grid at time `now`, and how many lie between it and the last one.
    fn next(&mut self, now: Duration) -> (Duration, u64) {
        let period_ns = self.period.as_nanos();
        // Instants already past, the one due now among them, cannot be kept any more, save the very next one: waking
        // for it late by less than a period is better than not at all.
        let past = now.saturating_sub(self.start).as_nanos() / period_ns;
        let next = (self.index + 1).max(past as u64);
        let missed = next - self.index - 1;
        self.index = next;
        let due_ns = period_ns * u128::from(next);
        let due = self.start + Duration::new((due_ns / 1_000_000_000) as u64, (due_ns % 1_000_000_000) as u32);
        (due, missed)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: Duration = Duration::from_millis(1);

    #[test]
    fn the_grid_stays_whatever_the_cycles_take() {
        let start = Duration::from_secs(5);
        let mut p = Periodic::starting_at(start, MS);
        assert_eq!(p.next(start + MS / 10), (start + MS, 0));
        // Slightly late: the next instant is taken late rather than skipped.
        assert_eq!(p.next(start + 2 * MS + MS / 10), (start + 2 * MS, 0));
        // Far too late: instants 3 and 4 are lost.
        assert_eq!(p.next(start + 5 * MS + MS / 2), (start + 5 * MS, 2));
        assert_eq!(p.next(start + 5 * MS + MS / 2), (start + 6 * MS, 0));
    }

    #[test]
    fn an_hour_of_a_third_of_a_millisecond_has_no_drift() {
        let mut p = Periodic::starting_at(Duration::ZERO, Duration::from_nanos(333_333));
        let mut due = Duration::ZERO;
        for _ in 0..10_800_000_u64 {
            (due, _) = p.next(due);
        }
        assert_eq!(due.as_nanos(), 333_333 * 10_800_000);
    }

    #[test]
    fn it_wakes_when_it_is_due_and_not_before() {
        let mut p = Periodic::new(Duration::from_millis(2));
        for _ in 0..50 {
            let wake = p.wait();
            assert!(wake.at >= wake.due);
        }
    }
}
