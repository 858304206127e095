//! Tandem's ROS 2 messages and services, and the standard messages it uses, as Rust types.
