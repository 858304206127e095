//! A controller's run in a bag: recording it, running it again to the bit, reading it for a report.
//!
//! [`RunRecorder`] writes what the controller's step saw and said in every cycle, with the configuration and the gaits, beside
//! the topics that ROS tools know. [`verify()`] feeds a recorded run to [`control::Controller::step`] again and compares every
//! command with the recorded one. [`read_run`] gives the samples that crate `report` draws.
//!
//! | topic | type | when |
//! |---|---|---|
//! | `joint_states` | sensor_msgs/JointState | for every new state; stamp: the state's own |
//! | `joint_command` | tandem_msgs/JointCommand | every cycle; stamp: that of the state it answers |
//! | `control_cycle` | tandem_msgs/ControlCycle | every cycle: what the step saw besides |
//! | `controller_state` | tandem_msgs/ControllerState | at 50 Hz and when the mode changes |
//! | `gait_file` | std_msgs/String | a gait file as JSON, when it is handed to the controller |
//! | `controller_config` | std_msgs/String | the controller's configuration as JSON, once |
//! | `controller_snapshot` | std_msgs/String | the controller's memory as JSON, where a recording begins later than the controller |
//! | `robot_description` | std_msgs/String | the URDF, once |
//! | `odom`, `ground_force/LEG` | nav_msgs/Odometry, geometry_msgs/WrenchStamped | where the base and the ground forces are known |
//!
//! # Invariants
//!
//! - Recording never waits: see [`bag::Recorder::push`]. It allocates, so a control thread hands its cycles over through a
//!   wait-free buffer and the other side records them.
//! - A bag that lacks a cycle is never called verified.

mod continuity;
mod cycle;
mod error;
mod names;
mod read;
mod record;
mod skeleton;
mod verify;

pub use continuity::{Continuity, continuity};
pub use error::ReplayError;
pub use read::{BehaviourRun, read_run};
pub use record::{BodySample, RunInfo, RunRecorder};
pub use skeleton::skeleton;
pub use verify::{Difference, Verification, verify};
