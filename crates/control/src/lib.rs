//! The controller of a walking quadruped, as one pure function of its input: [`Controller::step`].
//!
//! The law is the paper's (Ma & Ames 2020, section IV): τ = kp (B̃(t) − q) + kd (dB̃/dt − q̇), t counted from the last
//! switch, the gait mirrored at each switch, switches at t = T, no other term. B̃ is the gait's compensated reference:
//! the planned joints B, shifted so that the law gives the planned torque on the planned motion. The command that goes
//! out says the same with the planned joints as its position, q_des = B, and the shift as a torque,
//! τ_ff = kp (B̃ − B) + kd (dB̃/dt − Ḃ): B̃ jumps where a leg takes the weight over, B does not, and so limits on
//! position and velocity mean what they say.
//!
//! Around the law: standing up, starting, stopping, sitting down ([`transition()`] is the table of what may follow
//! what), limits that are applied last, and faults that latch.
//!
//! A step goes through the parts in this order, each with a memory of its own ([`Snapshot`] is all of them):
//!
//! | part | what it knows |
//! |---|---|
//! | `interface` | what a step is given and what it says |
//! | `watch` | what was measured, and for how long what is not as it should be; gives faults |
//! | `day` | mode, latched faults, what is wanted; `transition` is its table |
//! | `motion` | ramps and the gait, whose `gait_clock` owns T and the phase; gives events |
//! | `law` | from a place in the gait to what is asked of the drives |
//! | `limits` | what may be sent |
//!
//! This crate reads no clock, file or environment, knows no ROS, and allocates nothing in a step.

mod balance_config;
mod balancing;
mod body_pose;
mod body_range;
mod commanded;
mod config;
mod contact;
mod controller;
mod course;
mod day;
mod gait_clock;
mod interface;
mod law;
mod lift;
mod limits;
mod memory;
mod motion;
mod posing;
mod postures;
mod prepared_domain;
mod prepared_gait;
mod progress;
mod ramp;
pub mod setting;
mod step;
mod tilted;
mod transition;
mod watch;

/// A joint that has moved by less than this has stood still, rad.
const STILL_RAD: f64 = 0.02;

pub use body_pose::{BodyPose, BodyPoseAnswer};
pub use body_range::BodyRange;
pub use config::{Config, ConfigError, DriveMode, Posture};
pub use contact::{ContactEstimator, Contacts};
pub use controller::Controller;
pub use gait_clock::may_follow;
pub use interface::{DampingReason, Input, MAX_REQUESTS, Output, Request};
// What the interface is made of.
pub use estimator::Health;
pub use joints::{
    Fault, FaultReport, FaultSet, InertialState, JOINTS, JointCommand, JointState, Severity, Tilt, is_unit_length,
    resolution,
};
pub use law::balanced;
pub use law::balanced::{Velocity, VelocityCommand};
pub use memory::{Snapshot, SnapshotVersion1};
pub use prepared_gait::{GaitName, Instant, PreparedGait};
pub use step::Step;
pub use tilted::Tilted;
pub use transition::{Event, Guards, Mode, Refusal, transition};

/// The three joints of a leg.
pub(crate) fn of_leg(joints: &[f64; JOINTS], leg: usize) -> [f64; 3] {
    [joints[3 * leg], joints[3 * leg + 1], joints[3 * leg + 2]]
}
