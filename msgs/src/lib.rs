//! Tandem's ROS 2 interfaces and the standard ones that it uses, as Rust types.
//!
//! The types serialise with serde in the order of their fields, which is what CDR (the wire format of DDS) needs. They
//! know nothing of DDS: the crate `ros` sends and receives them, the crate `bag` writes and reads them.
//!
//! The `.msg`, `.srv` and `.action` files beside this crate are what other ROS 2 programs build against. A test
//! (`tests/definitions.rs`) compares every field of the Rust types with them, and the end-to-end tests compare the
//! standard types with rclpy's own.
//!
//! Units and frames are those of REP 103 (SI, x forward, y left, z up); quaternions are (x, y, z, w).

mod interface;
#[macro_use]
mod macros;

pub mod action_msgs;
pub mod builtin_interfaces;
mod carried;
pub mod diagnostic_msgs;
mod gait_error;
mod gait_message;
pub mod geometry_msgs;
pub mod lifecycle_msgs;
pub mod nav_msgs;
pub mod rcl_interfaces;
pub mod rosgraph_msgs;
pub mod sensor_msgs;
mod sha256;
pub mod std_msgs;
pub mod std_srvs;
pub mod tandem_msgs;
pub mod text;
pub mod tf2_msgs;
mod type_hash;
pub mod unique_identifier_msgs;
pub mod visualization_msgs;

pub use gait_error::{GAIT_VERSION, GaitMessageError};
pub use gait_message::Gait;
pub use interface::{Action, Covariance, Field, FieldType, Message, Optional, Service, TooMany, definition};
pub use tandem_msgs::*;
pub use type_hash::TypeHash;
