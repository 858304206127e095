//! Joint states and commands between the middleware's threads and the control cycle: plain numbers, nothing on the
//! heap.

use control::{JOINTS, JointCommand};
use std::time::Duration;

/// What a message of joint states says.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StateMessage {
    /// Its stamp.
    pub stamp: Duration,
    /// When it came in, on the monotonic clock.
    pub wall: Duration,
    /// Whether it has the joint. A joint that no message has any more grows stale.
    pub named: [bool; JOINTS],
    /// rad.
    pub position_rad: [f64; JOINTS],
    /// rad/s.
    pub velocity_rad_s: [f64; JOINTS],
    /// N m, where the message has it.
    pub torque_nm: Option<[f64; JOINTS]>,
}

/// A command on its way to the topic.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CommandMessage {
    /// The stamp of the joint state that it answers.
    pub stamp: Duration,
    /// The command.
    pub command: JointCommand,
    /// Whether the drives are to be on; the command is limp if not.
    pub drives_on: bool,
}
