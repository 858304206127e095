//! The quadruped as two bipeds coupled by a connection wrench, and its recomposition.
//!
//! Source: Ma and Ames, *From Bipedal Walking to Quadrupedal Locomotion: Full-Body Dynamics
//! Decomposition for Rapid Gait Generation* (2020), section II. The paper's letters are kept; where
//! the printed equations have misprints the corrected ones are implemented, and the tests pin that the
//! printed ones fail. `docs/dynamics.md` lists the corrections.
//!
//! Legs are 0 front-left, 1 rear-left, 2 front-right, 3 rear-right. The front biped f has legs 0 and
//! 2, the rear biped r legs 1 and 3:
//!
//! > q = (q_b, θ0, θ1, θ2, θ3), q_f = (q_b, θ0, θ2), q_r = (q_b, θ1, θ3).
//!
//! - [`ContactDynamics`]: the whole robot with any toes on the ground (eq. 1), and plastic impact
//!   (eq. 2).
//! - [`Bipeds`]: the pair of bipeds with the connection wrench λc (eqs. 3–7), its impact, and the
//!   closed-loop bipeds CL-Dyn-f and CL-Dyn-r.
//! - [`Pairing`]: the signed permutation M and offset b by which the rear biped follows the front one.
//! - [`simulation`]: the whole robot as a hybrid system, integrated with step-size control.

mod bipeds;
mod contact;
mod elimination;
mod error;
mod pairing;
pub mod simulation;

pub use bipeds::{Bipeds, ClosedLoop, PairImpact, PairMotion, Side};
pub use contact::{ContactDynamics, ContactMotion, Impact};
pub use error::DynamicsError;
pub use pairing::Pairing;
