//! ROS 2 node: MuJoCo behind DDS topics; the simulator itself as a library, and what is measured of a walk.

pub mod measure;
pub mod simulator;
