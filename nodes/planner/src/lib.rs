//! ROS 2 node: generates decomposed gaits on request.
//!
//! A thin shell around `gait_design`: `ports` turns requests and answers from and into messages, `planner` plans,
//! `main` offers the service `generate_gait` and the latched topic `gait`.

pub mod planner;
pub mod ports;
