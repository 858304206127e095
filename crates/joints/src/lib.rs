//! The joint interface: what the controller, the buses and the simulator exchange about the twelve joints of a
//! quadruped.
//!
//! - [`JointState`]: what the drives measured, and when.
//! - [`JointCommand`]: what the drives are to do, with the law that every drive evaluates.
//! - [`InertialState`]: what an inertial unit on the base measured, and when.
//! - [`CommandRange`]: the largest numbers that such commands carry.
//! - [`Fault`], [`FaultSet`], [`FaultReport`]: what went wrong, by name.
//! - [`Mirror`]: the left–right symmetry.
//! - [`resolution`]: how finely states are taken and commands are sent.
//!
//! Legs are 0 front-left, 1 rear-left, 2 front-right, 3 rear-right; joints 12-vectors in the order leg × (hip roll, hip
//! pitch, knee).
//!
//! This crate depends on no other of the workspace, reads no clock and allocates only in [`FaultReport::message`].

pub mod bits;
mod command;
mod fault;
mod inertial;
mod mirror;
pub mod resolution;
mod state;

/// Legs of a quadruped.
pub const LEGS: usize = 4;
/// Joints of a leg: hip roll, hip pitch, knee.
pub const JOINTS_PER_LEG: usize = 3;
/// Actuated joints in all.
pub const JOINTS: usize = LEGS * JOINTS_PER_LEG;
/// The legs in topics and files.
pub const LEG_NAMES: [&str; LEGS] = ["front_left", "rear_left", "front_right", "rear_right"];
/// The legs for people.
pub const LEG_LABELS: [&str; LEGS] = ["front left", "rear left", "front right", "rear right"];

pub use command::{CommandRange, JointCommand};
pub use fault::{Fault, FaultReport, FaultSet, Severity};
pub use inertial::{InertialState, Tilt, is_unit_length};
pub use mirror::{Mirror, mirrored_vector};
pub use state::JointState;
