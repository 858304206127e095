//! How the loop keeps its time.

use realtime::Histogram;
use std::time::Duration;

/// How the loop kept its time: median, 99th percentile and maximum.
#[derive(Clone, Copy, Debug, Default)]
pub struct Timing {
    /// Lateness of wakes since it began.
    pub latency: [Duration; 3],
    /// Lateness of wakes since the report before.
    pub recent_latency: [Duration; 3],
    /// Computing time of a cycle since it began.
    pub compute: [Duration; 3],
    /// Computing time of a cycle since the report before.
    pub recent_compute: [Duration; 3],
}

/// Durations since the beginning, and since the last report.
#[derive(Default)]
pub struct Durations {
    all: Histogram,
    recent: Histogram,
}

impl Durations {
    /// One more.
    pub fn record(&mut self, duration: Duration) {
        self.all.record(duration);
        self.recent.record(duration);
    }

    /// Median, 99th percentile and maximum since the beginning and since the last report.
    pub fn report(&mut self) -> ([Duration; 3], [Duration; 3]) {
        let of = |h: &Histogram| [h.quantile(0.5), h.quantile(0.99), h.max()];
        let report = (of(&self.all), of(&self.recent));
        self.recent.clear();
        report
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_recent_begins_anew_with_every_report() {
        let mut durations = Durations::default();
        durations.record(Duration::from_millis(3));
        let slow = [Duration::from_millis(3); 3];
        assert_eq!(durations.report(), (slow, slow));
        durations.record(Duration::from_millis(1));
        let (all, recent) = durations.report();
        assert_eq!((all[2], recent), (slow[0], [Duration::from_millis(1); 3]));
    }
}
