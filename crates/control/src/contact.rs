//! Which feet carry weight, by the torques that the drives report.
//!
//! Quasi-static: a leg that does not accelerate keeps g(θ) = τ + Jᵀ f, so that the ground's force on its toe is
//! f = J⁻ᵀ (g(θ) − τ), with the torso's roll and pitch in g. Of f the vertical part is taken, filtered, and held
//! against two bounds: a swinging leg's own inertia is in it.

use crate::{JOINTS, of_leg};
use gait::LEGS;
use nalgebra::{Matrix3, Rotation3, Vector3};
use rigid_body::{Data, rnea};
use robot::{LegKinematics, Robot, RobotError};

/// The forces are filtered over this, s.
const FILTER_S: f64 = 0.006;
/// Shares of the robot's weight at which a foot has landed, and has lifted off.
const LANDED: f64 = 0.10;
const LIFTED: f64 = 0.05;
/// Along a leg that is nearly straight torques say little about the force: nothing is divided by less, m.
const SMALLEST_LEVER_M: f64 = 0.02;

/// Which feet carry weight.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Contacts {
    /// Whether the foot carries weight.
    pub touches: [bool; LEGS],
    /// Vertical force of the ground on the toe, N.
    pub force_n: [f64; LEGS],
}

/// The estimate, and what it is made with.
#[derive(Debug)]
pub struct ContactEstimator {
    robot: Robot,
    legs: [LegKinematics; LEGS],
    data: Data,
    weight_n: f64,
    contacts: Contacts,
}

impl ContactEstimator {
    /// Nothing was seen yet.
    ///
    /// # Errors
    /// [`RobotError::LegShape`] for legs whose kinematics are not known.
    pub fn new(robot: &Robot) -> Result<Self, RobotError> {
        let model = &robot.model;
        Ok(Self {
            legs: LegKinematics::all(robot)?,
            data: Data::new(model),
            weight_n: model.total_mass() * model.gravity.norm(),
            robot: robot.clone(),
            contacts: Contacts::default(),
        })
    }

    /// What the torques say, `dt_s` after those before. `tilt_rad`: roll and pitch of the torso. Values that are not
    /// finite change nothing.
    pub fn step(
        &mut self,
        position_rad: &[f64; JOINTS],
        torque_nm: &[f64; JOINTS],
        tilt_rad: [f64; 2],
        dt_s: f64,
    ) -> &Contacts {
        let forces_n = self.forces_n(position_rad, torque_nm, tilt_rad);
        let share = (dt_s / FILTER_S).clamp(0.0, 1.0);
        for (leg, new_n) in forces_n.into_iter().enumerate().filter(|(_, force_n)| force_n.is_finite()) {
            let (force_n, touches) = (&mut self.contacts.force_n[leg], &mut self.contacts.touches[leg]);
            *force_n += share * (new_n - *force_n);
            *touches = *force_n > self.weight_n * if *touches { LIFTED } else { LANDED };
        }
        &self.contacts
    }

    /// The vertical forces on the toes, N.
    fn forces_n(
        &mut self,
        position_rad: &[f64; JOINTS],
        torque_nm: &[f64; JOINTS],
        [roll_rad, pitch_rad]: [f64; 2],
    ) -> [f64; LEGS] {
        let mut q = [0.0; 6 + JOINTS];
        (q[3], q[4]) = (roll_rad, pitch_rad);
        q[6..].copy_from_slice(position_rad);
        let still = [0.0; 6 + JOINTS];
        let weight = rnea(&self.robot.model, &mut self.data, &q, &still, &still, &[]);
        let up = Rotation3::from_euler_angles(roll_rad, pitch_rad, 0.0).inverse() * Vector3::z();
        std::array::from_fn(|leg| {
            let jacobian = self.legs[leg].toe(&of_leg(position_rad, leg)).jacobian;
            let by_ground = Vector3::from_fn(|k, _| weight[6 + 3 * leg + k] - torque_nm[3 * leg + k]);
            toe_force_n(&jacobian, &by_ground).dot(&up)
        })
    }
}

/// The force f on a toe of which the joints bear the torques Jᵀ f, N, torso axes.
pub(crate) fn toe_force_n(jacobian: &Matrix3<f64>, torque_nm: &Vector3<f64>) -> Vector3<f64> {
    let square = jacobian * jacobian.transpose() + Matrix3::identity() * SMALLEST_LEVER_M.powi(2);
    // Positive definite, unless something is not a number.
    square.cholesky().map_or(Vector3::repeat(f64::NAN), |square| square.solve(&(jacobian * torque_nm)))
}
