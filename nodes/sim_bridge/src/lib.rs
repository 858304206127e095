//! ROS 2 node: MuJoCo behind DDS topics; the simulator itself as a library, and what is measured of a walk.

pub mod bridge;
pub mod config;
pub mod drives;
pub mod inbox;
pub mod measure;
pub mod pictures;
pub mod ports;
pub mod simulator;
pub mod trial;
pub mod walk;
pub mod work;
