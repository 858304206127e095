//! Simulated time.

use crate::builtin_interfaces::Time;

messages! { "rosgraph_msgs";
    /// The simulation's time.
    #[derive(Copy)]
    Clock {
        /// Simulated time.
        clock: Time,
    }
}
