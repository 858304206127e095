//! ROS 2 node: generates decomposed gaits on request.
//!
//! A thin shell around `gait_design`: `ports` turns requests and answers from and into messages, `planner` plans,
//! `work` is the managed node that offers the service and the action `generate_gait` and the latched topic `gait`.

pub mod parameters;
pub mod planner;
pub mod ports;
pub mod work;
