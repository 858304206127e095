//! The robot in MuJoCo, the walks that it makes there and what is measured of them: no ROS, no clock, no file but
//! pictures. One thread, one seed, one trajectory.
//!
//! The model is written from the project's own robot description and steps at 0.5 ms with the implicit-in-velocity
//! integrator. The drives are part of it: at every physics step they evaluate τ = kp (q_des − q) + kd (q̇_des − q̇) +
//! τ_ff (Ma & Ames 2020, section IV) from the last command, limited to what the drives can give, as the robot's own
//! drives do. A command that is not finite, or that is too old, leaves the joints damped (kp = 0).
//!
//! - [`Simulator`]: the robot and its drives, step by step.
//! - [`drives`]: emulated drives at the far end of the robot's buses instead.
//! - [`walk`]: the controller's own step and the simulator in one process.
//! - [`measure`]: speed, drift, torques and posture of a walk; [`pictures`]: tiles and the animation.

mod description;
pub mod drives;
mod fall;
pub mod measure;
mod meshes;
mod options;
mod picture;
pub mod pictures;
mod random;
pub mod setting;
mod simulator;
mod staircase;
mod state;
mod terrain;
mod variation;
pub mod walk;

pub use fall::Fall;
pub use options::{Posture, Push, SimulatorError, SimulatorOptions};
pub use picture::{Camera, Image, PictureError, Renderer};
pub use random::Random;
pub use simulator::Simulator;
pub use staircase::StaircaseError;
pub use state::RobotState;
pub use terrain::Terrain;
pub use variation::Variation;

/// The MuJoCo release that the bindings were made for.
pub const MUJOCO_VERSION: &str = "3.17.0";
/// Acceleration of free fall, m/s².
pub const GRAVITY_M_S2: f64 = 9.81;
