//! Time.

messages! { "builtin_interfaces";
    /// A point in time.
    #[derive(Copy, Eq, Hash, PartialOrd, Ord)]
    Time {
        /// Whole seconds, rounded down.
        sec: i32,
        /// Nanoseconds beyond them, 0 to 999 999 999.
        nanosec: u32,
    }
    /// A span of time.
    #[derive(Copy, Eq, Hash, PartialOrd, Ord)]
    Duration {
        /// Whole seconds, rounded down.
        sec: i32,
        /// Nanoseconds beyond them, 0 to 999 999 999.
        nanosec: u32,
    }
}

const NANOSECONDS_PER_SECOND: i64 = 1_000_000_000;

impl Time {
    /// From nanoseconds since the clock's zero. Seconds beyond the range of 32 bits saturate.
    #[must_use]
    pub fn from_nanoseconds(nanoseconds: i64) -> Self {
        let seconds = nanoseconds.div_euclid(NANOSECONDS_PER_SECOND);
        match i32::try_from(seconds) {
            Ok(sec) => Time { sec, nanosec: nanoseconds.rem_euclid(NANOSECONDS_PER_SECOND) as u32 },
            Err(_) if seconds < 0 => Time { sec: i32::MIN, nanosec: 0 },
            Err(_) => Time { sec: i32::MAX, nanosec: 999_999_999 },
        }
    }

    /// Nanoseconds since the clock's zero.
    #[must_use]
    pub fn nanoseconds(self) -> i64 {
        i64::from(self.sec) * NANOSECONDS_PER_SECOND + i64::from(self.nanosec)
    }

    /// Seconds since the clock's zero.
    #[must_use]
    pub fn seconds(self) -> f64 {
        f64::from(self.sec) + f64::from(self.nanosec) * 1e-9
    }
}

#[cfg(test)]
mod tests {
    use super::Time;

    #[test]
    fn nanoseconds_go_there_and_back() {
        for nanoseconds in [0, 1, 999_999_999, 1_000_000_000, -1, -1_500_000_000] {
            let time = Time::from_nanoseconds(nanoseconds);
            assert_eq!(time.nanoseconds(), nanoseconds);
            assert!(time.nanosec < 1_000_000_000);
        }
        assert_eq!(Time::from_nanoseconds(i64::MAX).sec, i32::MAX);
        assert_eq!(Time::from_nanoseconds(i64::MIN).sec, i32::MIN);
    }
}
