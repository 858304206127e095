//! A quadruped's gait as the tracking law sees it: Bézier polynomials of the twelve joints over one step, the left–right
//! mirror that gives the next step, and the file that carries both (Ma & Ames 2020, II-C and IV).
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
mod file;

pub use bezier::Coefficients;
pub use certificate::Certificate;
pub use file::{FILE_FORMAT, FILE_VERSION, FILE_VERSION_TWO_STEPS, MAX_FILE_BYTES};
pub use joints::{JOINTS, JOINTS_PER_LEG, LEG_LABELS, LEG_NAMES, LEGS};

/// Which of the two steps of a stride.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StepSide {
    /// Legs 1 and 2 stand: the step that the gait's coefficients describe.
    First,
    /// Legs 0 and 3 stand: the left–right mirror of the first, or the gait's own second step.
    Mirrored,
}

impl StepSide {
    /// The side of step number `index`, counted from 0.
    pub fn of_step(index: u64) -> Self {
        if index.is_multiple_of(2) { Self::First } else { Self::Mirrored }
    }

    /// The side of the next step.
    pub fn other(self) -> Self {
        match self {
            Self::First => Self::Mirrored,
            Self::Mirrored => Self::First,
        }
    }
}

/// The left–right mirror: joint k of leg i in the next step is `sign[k]` times joint k of leg `leg[i]` in this one.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Mirror {
    /// For each leg, the leg it is mirrored from.
    pub leg: [usize; LEGS],
    /// Sign of hip roll, hip pitch, knee.
    pub sign: [f64; JOINTS_PER_LEG],
}

impl Mirror {
    /// The mirrored joint vector.
    pub fn apply(&self, joints: &[f64; JOINTS]) -> [f64; JOINTS] {
        std::array::from_fn(|row| {
            let (from, sign) = self.source(row);
            sign * joints[from]
        })
    }

    /// For joint `row`: the joint it is mirrored from and the sign.
    pub fn source(&self, row: usize) -> (usize, f64) {
        let (leg, joint) = (row / JOINTS_PER_LEG, row % JOINTS_PER_LEG);
        (self.leg[leg] * JOINTS_PER_LEG + joint, self.sign[joint])
    }
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

/// What the solver said of the gait.
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

/// The second step of a gait whose two steps are no mirror images of each other, as on a sideways slope: legs 0 and 3 stand.
/// Its joints are the robot's own, in the same order as the first step's, not mirrored.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SecondStep {
    /// Planned joints over the second step, rad.
    pub coefficients_rad: [Coefficients; JOINTS],
    /// What the tracking law follows in the second step, rad.
    pub reference_coefficients_rad: [Coefficients; JOINTS],
}

/// Longest name of a gait or its robot, in characters.
pub const MAX_NAME_CHARS: usize = 128;

/// A gait that has passed every check of [`Gait::from_json`] or [`Gait::validate`].
#[derive(Clone, Debug, PartialEq)]
pub struct Gait {
    /// Name of the robot it was planned for.
    pub robot: String,
    /// Name of the behaviour.
    pub name: String,
    /// Joint names, legs 0..3 × (hip roll, hip pitch, knee).
    pub joint_names: [String; JOINTS],
    /// T, s.
    pub step_duration_s: f64,
    /// How far the base moves forward in a step, m.
    pub step_length_m: f64,
    /// Planned joints over the first step, rad.
    pub coefficients_rad: [Coefficients; JOINTS],
    /// The mirror that gives the next step.
    pub mirror: Mirror,
    /// The next step's own polynomials, where the mirror does not give them.
    pub second_step: Option<SecondStep>,
    /// State at the start of the first step.
    pub initial: InitialState,
    /// What the tracking law follows, rad: the compensated reference, which makes the bare law give the planned torque on
    /// the planned motion. Belongs to `kp` and `kd`.
    pub reference_coefficients_rad: [Coefficients; JOINTS],
    /// Position gains, N m / rad.
    pub kp: [f64; JOINTS],
    /// Velocity gains, N m s / rad.
    pub kd: [f64; JOINTS],
    /// Torque bound that the plan keeps, N m.
    pub torque_limit_nm: [f64; JOINTS],
    /// The request that was planned, as data.
    pub request: serde_json::Value,
    /// What the solver said.
    pub solver: SolverSummary,
    /// How it stands by itself; none of a gait that was not planned but interpolated, or planned before there were
    /// certificates.
    pub certificate: Option<Certificate>,
}

/// Why a gait was refused.
#[derive(Debug, thiserror::Error)]
pub enum GaitError {
    /// The text is not JSON, or lacks a field, or has one too many.
    #[error("gait file: not readable: {0}. Is it whole? Plan it again with `tandem plan`")]
    Syntax(String),
    /// Longer than any gait.
    #[error("gait file: {found} bytes long, at most {MAX_FILE_BYTES} are read: this is not a gait file")]
    Size {
        /// Its length.
        found: usize,
    },
    /// Another kind of file.
    #[error("gait file: format is \"{found}\", expected \"{FILE_FORMAT}\": this is not a gait file")]
    Format {
        /// What the file says.
        found: String,
    },
    /// A version this software does not read.
    #[error(
        "gait file: version is {found}, expected {FILE_VERSION} or {FILE_VERSION_TWO_STEPS}: plan the gait again with this version's `tandem plan`"
    )]
    Version {
        /// What the file says.
        found: u64,
    },
    /// A value that no gait can have.
    #[error("gait \"{gait}\": {field} {problem}")]
    Value {
        /// The gait's name.
        gait: String,
        /// Which field.
        field: String,
        /// What is wrong and what was expected.
        problem: String,
    },
    /// Planned for another robot.
    #[error("gait \"{gait}\" was planned for robot \"{found}\", this robot is \"{expected}\": plan it for this robot")]
    Robot {
        /// The gait's name.
        gait: String,
        /// Robot named in the gait.
        found: String,
        /// The robot here.
        expected: String,
    },
}

impl From<serde_json::Error> for GaitError {
    fn from(e: serde_json::Error) -> Self {
        Self::Syntax(e.to_string())
    }
}

impl Gait {
    /// What the tracking law follows at phase `s` ∈ [0, 1] of a step: positions rad, velocities rad/s. Does not allocate.
    pub fn reference(&self, side: StepSide, s: f64) -> ([f64; JOINTS], [f64; JOINTS]) {
        let second = self.second_step.as_ref().map(|second| &second.reference_coefficients_rad);
        self.evaluate(&self.reference_coefficients_rad, second, side, s)
    }

    /// The planned joints at phase `s` ∈ [0, 1] of a step: positions rad, velocities rad/s. Does not allocate.
    pub fn planned(&self, side: StepSide, s: f64) -> ([f64; JOINTS], [f64; JOINTS]) {
        let second = self.second_step.as_ref().map(|second| &second.coefficients_rad);
        self.evaluate(&self.coefficients_rad, second, side, s)
    }

    /// The planned joints' polynomials in the step of `side`, rad. Does not allocate.
    pub fn planned_coefficients(&self, side: StepSide) -> [Coefficients; JOINTS] {
        match (side, &self.second_step) {
            (StepSide::First, _) => self.coefficients_rad,
            (StepSide::Mirrored, Some(second)) => second.coefficients_rad,
            (StepSide::Mirrored, None) => std::array::from_fn(|row| {
                let (from, sign) = self.mirror.source(row);
                self.coefficients_rad[from].map(|c| sign * c)
            }),
        }
    }

    fn evaluate(
        &self,
        first: &[Coefficients; JOINTS],
        second: Option<&[Coefficients; JOINTS]>,
        side: StepSide,
        s: f64,
    ) -> ([f64; JOINTS], [f64; JOINTS]) {
        let (value, slope) = (bezier::basis(s), bezier::basis_first_derivative(s));
        let at = |coefficients: &[Coefficients; JOINTS]| {
            let position = std::array::from_fn(|j| bezier::combine(&coefficients[j], &value));
            let velocity = std::array::from_fn(|j| bezier::combine(&coefficients[j], &slope) / self.step_duration_s);
            (position, velocity)
        };
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

    fn refuse(&self, field: impl Into<String>, problem: impl Into<String>) -> GaitError {
        GaitError::Value { gait: self.name.clone(), field: field.into(), problem: problem.into() }
    }

    /// Checks every value: finite, in range, and each step's end meeting the next one's start.
    pub fn validate(&self) -> Result<(), GaitError> {
        let finite = |field: &str, values: &[f64]| match values.iter().position(|v| !v.is_finite()) {
            Some(i) => Err(self.refuse(format!("{field}[{i}]"), format!("is {}, expected a finite number", values[i]))),
            None => Ok(()),
        };
        for (field, text) in [("name", &self.name), ("robot", &self.robot)] {
            if text.chars().count() > MAX_NAME_CHARS || text.contains(char::is_control) {
                return Err(self.refuse(field, format!("is {} bytes long, expected at most {MAX_NAME_CHARS} characters, none of them a control character", text.len())));
            }
        }
        let t = self.step_duration_s;
        if !(0.02..=10.0).contains(&t) {
            return Err(self.refuse("step_duration_s", format!("is {t}, expected 0.02 to 10 s")));
        }
        finite("step_length_m", &[self.step_length_m])?;
        finite("coefficients_rad", self.coefficients_rad.as_flattened())?;
        finite("reference_coefficients_rad", self.reference_coefficients_rad.as_flattened())?;
        if let Some(second) = &self.second_step {
            finite("second_step.coefficients_rad", second.coefficients_rad.as_flattened())?;
            finite("second_step.reference_coefficients_rad", second.reference_coefficients_rad.as_flattened())?;
        }
        let i = &self.initial;
        finite("initial.base_position_m", &i.base_position_m)?;
        finite("initial.base_quaternion_xyzw", &i.base_quaternion_xyzw)?;
        finite("initial.base_linear_velocity_world", &i.base_linear_velocity_world)?;
        finite("initial.base_angular_velocity_body", &i.base_angular_velocity_body)?;
        finite("initial.joint_position_rad", &i.joint_position_rad)?;
        finite("initial.joint_velocity_rad_s", &i.joint_velocity_rad_s)?;
        let norm = i.base_quaternion_xyzw.iter().map(|v| v * v).sum::<f64>().sqrt();
        if (norm - 1.0).abs() > 1e-6 {
            return Err(self.refuse("initial.base_quaternion_xyzw", format!("has norm {norm}, expected 1")));
        }
        for (field, values) in [("gains.kp", &self.kp), ("gains.kd", &self.kd)] {
            if let Some(j) = values.iter().position(|v| !(0.0..=1e5).contains(v)) {
                return Err(self.refuse(format!("{field}[{j}]"), format!("is {}, expected 0 to 1e5", values[j])));
            }
        }
        if let Some(j) = self.torque_limit_nm.iter().position(|v| !(*v > 0.0 && v.is_finite())) {
            return Err(self.refuse(
                format!("torque_limit_nm[{j}]"),
                format!("is {}, expected a positive number", self.torque_limit_nm[j]),
            ));
        }
        let mut seen = [false; LEGS];
        for (leg, &from) in self.mirror.leg.iter().enumerate() {
            if from >= LEGS || std::mem::replace(&mut seen[from], true) {
                return Err(self.refuse(
                    "mirror.leg",
                    format!("{:?} at leg {leg}: expected a permutation of 0 to 3", self.mirror.leg),
                ));
            }
            if self.mirror.leg[from] != leg {
                return Err(self.refuse(
                    "mirror.leg",
                    format!("{:?}: mirroring twice must give the same leg again", self.mirror.leg),
                ));
            }
        }
        if self.mirror.sign.iter().any(|s| s.abs() != 1.0) {
            return Err(self.refuse("mirror.sign", format!("{:?}: expected 1 or -1", self.mirror.sign)));
        }
        for (a, name) in self.joint_names.iter().enumerate() {
            if name.is_empty() || self.joint_names[..a].contains(name) {
                return Err(
                    self.refuse(format!("joint_names[{a}]"), format!("is \"{name}\": expected twelve different names"))
                );
            }
        }
        self.check_certificate().and_then(|()| self.check_continuity())
    }

    /// A jump of the planned joints at a switch would be a blow to the drives.
    fn check_continuity(&self) -> Result<(), GaitError> {
        const JUMP_RAD: f64 = 0.02;
        let (start, _) = self.planned(StepSide::First, 0.0);
        for (side, field) in
            [(StepSide::First, "coefficients_rad"), (StepSide::Mirrored, "second_step.coefficients_rad")]
        {
            let (end, _) = self.planned(side, 1.0);
            let (next, _) = self.planned(side.other(), 0.0);
            for j in 0..JOINTS {
                if (end[j] - next[j]).abs() > JUMP_RAD {
                    return Err(self.refuse(
                        field,
                        format!(
                            "let {} jump by {:.3} rad at the switch of steps, expected at most {JUMP_RAD}",
                            self.joint_names[j],
                            end[j] - next[j]
                        ),
                    ));
                }
            }
        }
        for j in 0..JOINTS {
            let initial = self.initial.joint_position_rad[j];
            if (start[j] - initial).abs() > JUMP_RAD {
                return Err(self.refuse(
                    format!("initial.joint_position_rad[{j}]"),
                    format!("is {initial}, the planned step starts at {}", start[j]),
                ));
            }
        }
        Ok(())
    }
}
