//! A controller's run written into a bag; crate `replay` runs it again to the bit and reads it for a report.
//!
//! [`RunRecorder`] writes what the controller's step saw and gave in every cycle, with the configuration and the gaits,
//! beside the topics that ROS tools know.
//!
//! | topic | type | when |
//! |---|---|---|
//! | `joint_states` | sensor_msgs/JointState | for every new state; stamp: the state's own |
//! | `joint_command` | tandem_msgs/JointCommand | every cycle; stamp: that of the state it answers |
//! | `control_cycle` | tandem_msgs/ControlCycle | every cycle: what the step saw besides |
//! | `controller_state` | tandem_msgs/ControllerState | at 50 Hz and when the mode changes |
//! | `gait_file` | std_msgs/String | a gait file as JSON, when it is handed to the controller |
//! | `controller_config` | std_msgs/String | the controller's configuration as JSON, once |
//! | `controller_snapshot` | std_msgs/String | the controller's memory as JSON, where a recording begins later |
//! | `robot_description` | std_msgs/String | the URDF, once |
//! | `odom`, `ground_force/LEG` | nav_msgs/Odometry, geometry_msgs/WrenchStamped | where known |
//!
//! # Invariants
//!
//! - Recording never waits: see [`recorder::Recorder::push`]. It allocates, so a control thread hands its cycles over
//!   through a wait-free buffer and the other side records them.
//! - Nothing here reads a bag or draws: the controller's program links neither SQLite nor pictures for it.

mod continuity;
pub mod names;
mod run;

pub use continuity::Continuity;
pub use run::{BodySample, RunInfo, RunRecorder};
