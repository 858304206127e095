//! What a simulator is made with, and why it cannot be.

use crate::{MUJOCO_VERSION, Terrain, Variation, setting};

/// Why the simulator cannot be built or started.
#[derive(Debug, thiserror::Error)]
pub enum SimulatorError {
    /// The library that was found is not the one that the bindings were made for.
    #[error("MuJoCo's library is {found}, expected {MUJOCO_VERSION}: run launch-scripts/setup again")]
    Version {
        /// The version that the library says it is.
        found: String,
    },
    /// The URDF holds something that the simulator cannot use.
    #[error("robot description: {0}")]
    Urdf(String),
    /// An option is out of its range.
    #[error("simulator option: {0}")]
    Option(String),
    /// MuJoCo refused the model that we wrote.
    #[error("MuJoCo refused the robot's model: {0}")]
    Model(String),
    /// The gait belongs to another robot.
    #[error(transparent)]
    Gait(#[from] gait::GaitError),
}

/// What can be set when the simulator is built.
#[derive(Clone, Debug, PartialEq)]
pub struct SimulatorOptions {
    /// Physics step, s.
    pub timestep_s: f64,
    /// Coefficient of sliding friction between toes and ground.
    pub friction: f64,
    /// The ground.
    pub terrain: Terrain,
    /// Names the random terrain and start noise.
    pub seed: u64,
    /// Standard deviation of the offset of every joint at a reset, rad.
    pub joint_noise_rad: f64,
    /// Simulated time after which a command is too old and the drives damp, s.
    pub command_timeout_s: f64,
    /// What the simulated robot differs by from its description.
    pub variation: Variation,
    /// Pictures with shadows and smooth edges (about ten times slower to draw; the motion is the same).
    pub fine_pictures: bool,
}

impl Default for SimulatorOptions {
    fn default() -> Self {
        Self {
            timestep_s: setting::TIMESTEP_S.default,
            friction: setting::FRICTION.default,
            terrain: Terrain::Flat,
            seed: 0,
            joint_noise_rad: setting::JOINT_NOISE_RAD.default,
            command_timeout_s: setting::COMMAND_TIMEOUT_S.default,
            variation: Variation::default(),
            fine_pictures: false,
        }
    }
}

impl SimulatorOptions {
    pub(crate) fn check(&self) -> Result<(), SimulatorError> {
        for (setting, value) in [
            (setting::TIMESTEP_S, self.timestep_s),
            (setting::FRICTION, self.friction),
            (setting::JOINT_NOISE_RAD, self.joint_noise_rad),
            (setting::COMMAND_TIMEOUT_S, self.command_timeout_s),
        ] {
            setting.check(value).map_err(|wrong| SimulatorError::Option(format!("{} {wrong}", setting.name)))?;
        }
        let limits = [
            ("variation.payload_kg", self.variation.payload_kg, 0.0, 1e3),
            ("variation.mass_scale", self.variation.mass_scale, 0.1, 10.0),
            ("variation.stiffness_scale", self.variation.stiffness_scale, 0.1, 10.0),
        ];
        for (name, value, low, high) in limits {
            if !(low..=high).contains(&value) {
                return Err(SimulatorError::Option(format!("{name} is {value}, expected {low} to {high}")));
            }
        }
        self.terrain.problem().map_or(Ok(()), |problem| Err(SimulatorError::Option(problem)))
    }
}

/// A posture that the robot can be put down in.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Posture {
    /// Legs at the robot's stand angles, toes on the ground.
    Stand,
    /// Legs folded, toes on the ground.
    Sit,
}

/// A force on the base for a time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Push {
    /// Simulated time at which it begins, s.
    pub start_s: f64,
    /// How long it lasts, s.
    pub duration_s: f64,
    /// Force in world axes at the base's origin, N.
    pub force_n: [f64; 3],
}
