//! A quadruped's gait as the tracking law sees it: Bézier polynomials of the twelve joints over one step, the
//! left–right mirror that gives the next step, and the file that carries both (Ma & Ames 2020, II-C and IV).
//!
//! Legs are 0 front-left, 1 rear-left, 2 front-right, 3 rear-right; joints 12-vectors in the order leg × (hip roll, hip
//! pitch, knee). In the first step legs 1 and 2 stand and legs 0 and 3 swing.
//!
//! ```
//! # fn show(json: &str) -> Result<(), gait::GaitError> {
//! let gait = gait::Gait::from_json(json)?;
//! let (position, velocity) = gait.reference(gait::StepSide::First, 0.5);
//! println!("half way, the first joint is to be at {} rad moving at {} rad/s", position[0], velocity[0]);
//! # Ok(()) }
//! ```

pub mod bezier;
mod certificate;
mod domain;
mod domain_checks;
mod error;
mod file;
mod schedule;
mod types;
mod validate;
mod version;

pub use bezier::Coefficients;
pub use domain::Domain;
pub use domain_checks::{MAX_CYCLE_DOMAINS, MAX_LEAD_DOMAINS};
pub use error::GaitError;
pub use joints::{JOINTS, JOINTS_PER_LEG, LEG_LABELS, LEG_NAMES, LEGS, Mirror};
pub use schedule::StepSide;
pub use types::{Certificate, Gains, Gait, InitialState, SecondStep, SolverSummary};
pub use validate::{MAX_NAME_CHARS, SHORTEST_DOMAIN_S};
pub use version::{FILE_FORMAT, FILE_VERSION, FILE_VERSION_DOMAINS, FILE_VERSION_TWO_STEPS, MAX_FILE_BYTES};

impl Gait {
    /// What the tracking law follows at phase `s` ∈ [0, 1] of a step: positions rad, velocities rad/s. Does not
    /// allocate.
    pub fn reference(&self, side: StepSide, s: f64) -> ([f64; JOINTS], [f64; JOINTS]) {
        let second = self.second_step.as_ref().map(|second| &second.reference_coefficients_rad);
        self.evaluate(&self.reference_coefficients_rad, second, side, s)
    }

    /// The planned joints at phase `s` ∈ [0, 1] of a step: positions rad, velocities rad/s. Does not allocate.
    pub fn planned(&self, side: StepSide, s: f64) -> ([f64; JOINTS], [f64; JOINTS]) {
        let second = self.second_step.as_ref().map(|second| &second.coefficients_rad);
        self.evaluate(&self.coefficients_rad, second, side, s)
    }

    fn evaluate(
        &self,
        first: &[Coefficients; JOINTS],
        second: Option<&[Coefficients; JOINTS]>,
        side: StepSide,
        s: f64,
    ) -> ([f64; JOINTS], [f64; JOINTS]) {
        let at = |coefficients| domain::evaluate(coefficients, self.step_duration_s, s);
        match (side, second) {
            (StepSide::First, _) => at(first),
            (StepSide::Mirrored, Some(second)) => at(second),
            (StepSide::Mirrored, None) => {
                let (position, velocity) = at(first);
                (self.mirror.apply(&position), self.mirror.apply(&velocity))
            }
        }
    }

    /// Planned forward speed, m/s.
    pub fn speed_m_s(&self) -> f64 {
        self.step_length_m / self.step_duration_s
    }

    /// Refuses a gait that belongs to another robot: `robot` is this robot's name, `joint_names` its joints.
    pub fn check_robot(&self, robot: &str, joint_names: &[String; JOINTS]) -> Result<(), GaitError> {
        if self.robot != robot {
            return Err(GaitError::Robot {
                gait: self.name.clone(),
                found: self.robot.clone(),
                expected: robot.into(),
            });
        }
        for (j, (found, expected)) in self.joint_names.iter().zip(joint_names).enumerate() {
            if found != expected {
                return Err(self.refuse(
                    format!("joint_names[{j}]"),
                    format!("is \"{found}\", the robot's is \"{expected}\": plan the gait for this robot"),
                ));
            }
        }
        Ok(())
    }
}
