//! A controller's run in a bag, as crate [`run_recorder`] writes it: run again to the bit, or read for a report.
//!
//! [`verify()`] feeds a recorded run to [`control::Controller::step`] again and compares every command with the
//! recorded one. [`read_run`] gives the samples that crate `report` draws, [`read_balance`] what the balanced law saw
//! and did.
//!
//! # Invariants
//!
//! - A bag that lacks a cycle is never called verified.

mod balance;
mod continuity;
mod cycle;
mod error;
mod read;
mod skeleton;
mod verify;

pub use balance::read_balance;
pub use continuity::continuity;
pub use error::ReplayError;
pub use read::{BehaviourRun, read_run};
pub use skeleton::skeleton;
pub use verify::{Difference, Verification, verify};
