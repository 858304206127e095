//! ROS 2 node: MuJoCo (crate `simulator`) behind DDS topics; and the trial of the balanced law.

pub mod bridge;
pub mod config;
pub mod inbox;
pub mod parameters;
pub mod ports;
pub mod trial;
pub mod work;

// The trial's words for the parts of the simulator.
pub use ::simulator;
use ::simulator::measure;
