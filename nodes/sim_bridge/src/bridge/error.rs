//! Why the bridge ends before it is asked to.

use ros::{PublishError, RosError};
use simulator::SimulatorError;

/// Why the bridge ends before it is asked to.
#[derive(Debug, thiserror::Error)]
pub enum BridgeError {
    /// The middleware.
    #[error(transparent)]
    Ros(#[from] RosError),
    /// The simulator.
    #[error(transparent)]
    Simulator(#[from] SimulatorError),
    /// No command answered a joint state in time.
    #[error(
        "lockstep: no command with stamp {stamp_s:.6} s came on {topic} within {waited_s} s{detail}. Is the controller running, \
         in lockstep mode, with the same ROS_DOMAIN_ID and namespace?"
    )]
    NoAnswer {
        /// The stamp waited for, s.
        stamp_s: f64,
        /// The topic.
        topic: String,
        /// How long, s.
        waited_s: f64,
        /// What came instead.
        detail: String,
    },
    /// A publisher failed in lockstep, where nothing may be lost.
    #[error("lockstep: {0}")]
    Publish(#[from] PublishError),
}
