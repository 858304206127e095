//! What a gait consists of: the one list of each type's fields. The gait's file (file.rs) is made from it, and the list
//! of the message's fields (`msgs/src/gait_message.rs`) does not build without each of them.

use joints::{JOINTS, Mirror};

use crate::bezier::Coefficients;
use crate::domain::Domain;

/// Defines a type and its file, which holds `format`, `version` and then the type's fields in their order.
macro_rules! gait_type {
    (
        $(#[$meta:meta])*
        $name:ident in $file:ident { $( $(#[doc = $doc:literal])+ $(#[serde($($form:tt)+)])? $field:ident: $type:ty, )+ }
    ) => {
        $(#[$meta])*
        #[derive(Clone, Debug, PartialEq)]
        pub struct $name { $( $(#[doc = $doc])+ pub $field: $type, )+ }

        #[derive(serde::Serialize, serde::Deserialize)]
        #[serde(deny_unknown_fields)]
        pub(crate) struct $file {
            pub format: String,
            pub version: u64,
            $( $(#[serde($($form)+)])? pub $field: $type, )+
        }

        impl $file {
            pub fn new(format: String, version: u64, $name { $($field),+ }: $name) -> Self {
                Self { format, version, $($field),+ }
            }

            pub fn content(self) -> $name {
                let Self { format: _, version: _, $($field),+ } = self;
                $name { $($field),+ }
            }
        }
    };
}

gait_type! {
    /// A gait that has passed every check of [`Gait::from_json`] or [`Gait::validate`].
    Gait in GaitFile {
        /// Name of the robot it was planned for.
        robot: String,
        /// Name of the behaviour.
        name: String,
        /// Joint names, legs 0..3 × (hip roll, hip pitch, knee).
        joint_names: [String; JOINTS],
        /// T, s.
        step_duration_s: f64,
        /// How far the base moves forward in a step, m.
        step_length_m: f64,
        /// Degree of every joint's polynomials: [`DEGREE`](crate::bezier::DEGREE).
        bezier_degree: usize,
        /// Planned joints over the first step, rad.
        coefficients_rad: [Coefficients; JOINTS],
        /// The mirror that gives the next step.
        mirror: Mirror,
        /// The next step's own polynomials, where the mirror does not give them.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        second_step: Option<SecondStep>,
        /// What is walked once before the first step, as from standing; most gaits have none.
        #[serde(default, skip_serializing_if = "Vec::is_empty")]
        lead: Vec<Domain>,
        /// What is walked over and over in place of the two steps, after the lead; none: the two steps are. Of a gait
        /// with a cycle `coefficients_rad` and `reference_coefficients_rad` are its first domain's, and T is the
        /// request's: the cycle takes a whole number of T.
        #[serde(default, skip_serializing_if = "Vec::is_empty")]
        cycle: Vec<Domain>,
        /// State at the start of the first step.
        initial: InitialState,
        /// What the tracking law follows, rad: the compensated reference, which makes the bare law give the planned
        /// torque on the planned motion. Belongs to the gains.
        reference_coefficients_rad: [Coefficients; JOINTS],
        /// The tracking law's gains.
        gains: Gains,
        /// Torque bound that the plan keeps, N m.
        torque_limit_nm: [f64; JOINTS],
        /// The request that was planned, as data.
        request: serde_json::Value,
        /// What the solver reported.
        solver: SolverSummary,
        /// How it stands by itself; none of a gait that was not planned but interpolated, or planned before there were
        /// certificates.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        certificate: Option<Certificate>,
    }
}

/// The gains of the tracking law.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Gains {
    /// Position gains, N m / rad.
    pub kp: [f64; JOINTS],
    /// Velocity gains, N m s / rad.
    pub kd: [f64; JOINTS],
}

/// State of the robot at the start of the first step.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub struct InitialState {
    /// Base origin above the floor, m, world frame.
    pub base_position_m: [f64; 3],
    /// Base orientation, world from base, (x, y, z, w).
    pub base_quaternion_xyzw: [f64; 4],
    /// Velocity of the base origin, m/s, world frame.
    pub base_linear_velocity_world: [f64; 3],
    /// Angular velocity of the base, rad/s, base frame.
    pub base_angular_velocity_body: [f64; 3],
    /// Joint positions, rad.
    pub joint_position_rad: [f64; JOINTS],
    /// Joint velocities, rad/s.
    pub joint_velocity_rad_s: [f64; JOINTS],
}

/// What the solver reported of the gait.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SolverSummary {
    /// `converged`, or `acceptable` where the last gains stalled.
    pub status: String,
    /// Iterations of the nonlinear program's solver.
    pub iterations: u32,
    /// Wall time of the solve, s.
    pub solve_time_s: f64,
    /// Largest violation of any constraint, in the constraint's own unit.
    pub max_violation: f64,
    /// The whole cost.
    pub objective: f64,
}

/// The second step of a gait whose two steps are no mirror images of each other, as on a sideways slope: legs 0 and 3
/// stand. Its joints are the robot's own, in the same order as the first step's, not mirrored.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SecondStep {
    /// Planned joints over the second step, rad.
    pub coefficients_rad: [Coefficients; JOINTS],
    /// What the tracking law follows in the second step, rad.
    pub reference_coefficients_rad: [Coefficients; JOINTS],
}

/// The certificate of a gait: what its step's linearised map says of small disturbances, and whether the touchdown by
/// the clock that the map takes for granted can be had.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Certificate {
    /// Hermite–Simpson points of the program that the plan came from: more than were asked for where it was solved
    /// again.
    pub points: u32,
    /// Largest modulus of the step-to-step map's multipliers under the tracking law, or of the stride's where the
    /// second step is no mirror image: below 1 a small disturbance shrinks while toes land by the clock.
    pub largest_multiplier: f64,
    /// How far from its place a swing toe would meet a floor that is 1 % of the nominal height higher, m. A toe that
    /// skims the floor before it lands is held back by it, and touchdown is not by the clock.
    pub landing_run_m: f64,
    /// Whether both say that the gait stands by itself, and no disturbance grows far within a step before it shrinks.
    pub stable: bool,
}
