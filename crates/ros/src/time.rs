//! Time as ROS 2 stamps it: the machine's clock, or the simulation's.

use std::sync::Arc;
use std::sync::atomic::{AtomicI64, Ordering};
use std::time::{SystemTime, UNIX_EPOCH};

use tandem_msgs::builtin_interfaces::Time;

/// Time since 1970 by the machine's clock.
#[must_use]
pub fn wall_time() -> Time {
    let since = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
    Time::from_nanoseconds(i64::try_from(since.as_nanos()).unwrap_or(i64::MAX))
}

/// A node's clock, for threads that do not hold the node.
#[derive(Clone, Debug, Default)]
pub struct Clock {
    /// Simulated time, ns; None: wall time.
    simulated: Option<Arc<AtomicI64>>,
}

impl Clock {
    /// A clock that shows what is stored in the number, ns.
    pub(crate) fn simulated(time_ns: &Arc<AtomicI64>) -> Self {
        Clock { simulated: Some(Arc::clone(time_ns)) }
    }

    /// Simulated time where the parameter `use_sim_time` says so (0 until a clock is received), else the machine's.
    /// Wait-free.
    #[must_use]
    pub fn now(&self) -> Time {
        match &self.simulated {
            Some(time) => Time::from_nanoseconds(time.load(Ordering::Relaxed)),
            None => wall_time(),
        }
    }
}
