//! ROS 2 node: walks a gait with the paper's PD law, in balance where that is asked for.
//!
//! The node has five parts that meet only through wait-free buffers:
//!
//! - the **cycle** ([`cycle`]): a thread of its own, real-time where the system grants it, that runs
//!   [`control::Controller::step`] and nothing else; no lock, no allocation, no logging, no publishing;
//! - the **services** ([`services`]): callbacks and services on the middleware's threads, which turn messages into
//!   values, refuse what is wrong with them, and put the rest into the buffers;
//! - the **gaits for the command** ([`command_gait`]), where they are asked for, and the thread that asks the planner
//!   for them ([`planning`]);
//! - the **recording** ([`recording`]): the thread that records every cycle into a bag, where that is asked for;
//! - the **publishers** ([`publishers`]): a thread that publishes the cycle's output.
//!
//! Who starts and ends them is [`work`], the node's side of ROS 2's lifecycle.
//!
//! The cycle sees the joints as a [`joint_bus::JointBus`], whether they are on CAN or behind topics ([`dds_bus`]).
//!
//! [`ports`] is the one place where messages and the controller's own types meet.

pub mod body_pose;
pub mod command_gait;
pub mod config;
pub mod cycle;
pub mod dds_bus;
pub mod drive;
pub mod drive_reports;
pub mod emergency_stop;
pub mod foot_contacts;
pub mod inputs;
pub mod lease;
pub mod messages;
pub mod odometry;
pub mod others;
pub mod parameters;
pub mod planning;
pub mod ports;
pub mod publishers;
pub mod record_root;
pub mod recording;
pub mod services;
pub mod timing;
pub mod work;
