use std::time::Duration;

/// Buckets per doubling.
const PER_DOUBLING: usize = 8;
const BUCKETS: usize = PER_DOUBLING * 40;

/// A histogram of durations from 1 ns to about 18 minutes with buckets of equal ratio (an eighth of a doubling: at most
/// 13 % wide). Recording neither allocates nor locks; it is a few instructions.
#[derive(Clone, Debug)]
pub struct Histogram {
    counts: [u64; BUCKETS],
    total: u64,
    sum_ns: u64,
    max: Duration,
}

impl Default for Histogram {
    fn default() -> Self {
        Self { counts: [0; BUCKETS], total: 0, sum_ns: 0, max: Duration::ZERO }
    }
}

impl Histogram {
    /// Counts one duration.
    pub fn record(&mut self, duration: Duration) {
        let ns = u64::try_from(duration.as_nanos()).unwrap_or(u64::MAX);
        self.counts[bucket(ns)] += 1;
        self.total += 1;
        self.sum_ns = self.sum_ns.saturating_add(ns);
        self.max = self.max.max(duration);
    }

    /// How many were counted.
    pub fn count(&self) -> u64 {
        self.total
    }

    /// The longest.
    pub fn max(&self) -> Duration {
        self.max
    }

    /// The mean; zero of none.
    pub fn mean(&self) -> Duration {
        Duration::from_nanos(self.sum_ns.checked_div(self.total).unwrap_or(0))
    }

    /// The duration that a share `q` ∈ [0, 1] of all does not exceed, to the bucket's upper edge; zero of none.
    pub fn quantile(&self, q: f64) -> Duration {
        let wanted = (q.clamp(0.0, 1.0) * self.total as f64).ceil().max(1.0) as u64;
        let mut seen = 0;
        for (n, count) in self.counts.iter().enumerate() {
            seen += count;
            if seen >= wanted && self.total > 0 {
                return Duration::from_nanos(upper_edge_ns(n)).min(self.max);
            }
        }
        Duration::ZERO
    }

    /// Forgets everything.
    pub fn clear(&mut self) {
        *self = Self::default();
    }
}

fn bucket(ns: u64) -> usize {
    let ns = ns.max(1);
    let doubling = ns.ilog2() as usize;
    // The three bits below the leading one.
    let within = if doubling >= 3 { (ns >> (doubling - 3)) & 7 } else { (ns << (3 - doubling)) & 7 };
    (doubling * PER_DOUBLING + within as usize).min(BUCKETS - 1)
}

fn upper_edge_ns(bucket: usize) -> u64 {
    let (doubling, within) = (bucket / PER_DOUBLING, (bucket % PER_DOUBLING) as u64);
    // Nine to sixteen eighths of the doubling.
    ((1_u64 << doubling) * (within + 9)) / 8
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_are_within_a_bucket_of_the_truth() {
        let mut h = Histogram::default();
        assert_eq!(h.quantile(0.5), Duration::ZERO);
        assert_eq!(h.mean(), Duration::ZERO);
        for us in 1..=1000 {
            h.record(Duration::from_micros(us));
        }
        assert_eq!(h.count(), 1000);
        assert_eq!(h.max(), Duration::from_millis(1));
        for q in [0.01, 0.5, 0.9, 0.99, 1.0] {
            let (got, truth) = (h.quantile(q).as_secs_f64(), 1e-3 * q);
            assert!(got >= truth * 0.999 && got <= truth * 1.13, "{q}: {got} for {truth}");
        }
        let mean = h.mean().as_secs_f64();
        assert!((mean - 500.5e-6).abs() < 1e-9);
        h.clear();
        assert_eq!(h.count(), 0);
    }

    #[test]
    fn every_duration_lies_below_its_buckets_edge_and_above_the_one_before() {
        let mut ns = 1_u64;
        while ns < 1 << 38 {
            let b = bucket(ns);
            assert!(ns <= upper_edge_ns(b), "{ns} in {b}");
            assert!(ns < 16 || ns >= upper_edge_ns(b - 1), "{ns} in {b}");
            ns += 1 + ns / 7;
        }
        assert_eq!(bucket(0), 0);
        assert_eq!(bucket(u64::MAX), BUCKETS - 1);
    }
}
