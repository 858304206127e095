//! The wall clock as ROS 2 stamps it.

use std::time::{SystemTime, UNIX_EPOCH};

use tandem_msgs::builtin_interfaces::Time;

/// Time since 1970 by the machine's clock.
#[must_use]
pub fn wall_time() -> Time {
    let since = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
    Time::from_nanoseconds(i64::try_from(since.as_nanos()).unwrap_or(i64::MAX))
}
