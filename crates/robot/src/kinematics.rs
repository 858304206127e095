//! Where a leg's toe is, and which joint angles put it somewhere.

use nalgebra::{Matrix3, Vector3};
use rigid_body::{Data, frame_position, point_kinematics};

use crate::{Robot, RobotError};

/// A toe this close to its target is there.
const REACHED_M: f64 = 1e-10;

impl Robot {
    /// The toe's centre from the leg's hip-roll joint, m, in torso axes, for joint angles in radians.
    /// Allocates a workspace: for setting things up, not for a control cycle.
    ///
    /// # Panics
    ///
    /// If the leg is not 0 to 3.
    pub fn toe_from_hip(&self, leg: usize, joints_rad: &[f64; 3]) -> Vector3<f64> {
        self.toe_from_hip_in(&mut Data::new(&self.model), leg, joints_rad)
    }

    /// [`Self::toe_from_hip`] in a workspace of this robot's model.
    pub(crate) fn toe_from_hip_in(&self, data: &mut Data, leg: usize, joints_rad: &[f64; 3]) -> Vector3<f64> {
        let q = self.posture(leg, joints_rad);
        rigid_body::forward_kinematics(&self.model, data, &q, &[0.0; 18], &[0.0; 18]);
        frame_position(&self.model, data, self.legs[leg].toe) - self.hip(data, leg)
    }

    /// Coordinates with these angles of one leg, all else at zero.
    fn posture(&self, leg: usize, joints_rad: &[f64; 3]) -> [f64; 18] {
        let mut q = [0.0; 18];
        q[6 + 3 * leg..9 + 3 * leg].copy_from_slice(joints_rad);
        q
    }

    fn hip(&self, data: &Data, leg: usize) -> Vector3<f64> {
        let hip = self.model.frame_id(self.model.link_name(6 + 3 * leg)).expect("the hip is a link");
        frame_position(&self.model, data, hip)
    }

    /// Joint angles in radians that put the toe's centre at `target` from the leg's hip-roll joint,
    /// m, in torso axes, within the leg's position limits: the solution on the side of the standing
    /// posture. Newton's method with damping, so that it serves any leg. Allocates a workspace.
    ///
    /// # Errors
    ///
    /// [`RobotError::OutOfReach`] if no joint angles within the limits were found.
    ///
    /// # Panics
    ///
    /// If the leg is not 0 to 3.
    pub fn joints_for_toe(&self, leg: usize, target: &Vector3<f64>) -> Result<[f64; 3], RobotError> {
        let mut data = Data::new(&self.model);
        let about = &self.legs[leg];
        let mut joints = about.stand_rad;
        let (mut toe, mut jacobian) = self.toe_and_jacobian(&mut data, leg, &joints);
        let mut damping = 1e-4;
        for _ in 0..200 {
            let miss = target - toe;
            if miss.norm() < REACHED_M {
                return Ok(joints);
            }
            let normal = jacobian.transpose() * jacobian + Matrix3::identity() * damping;
            let step = match normal.cholesky() {
                Some(factor) => factor.solve(&jacobian.tr_mul(&miss)),
                None => break,
            };
            let trial = std::array::from_fn(|k| {
                (joints[k] + step[k]).clamp(about.position_min_rad[k], about.position_max_rad[k])
            });
            let (trial_toe, trial_jacobian) = self.toe_and_jacobian(&mut data, leg, &trial);
            // Levenberg's rule: trust the linear model more after every success.
            if (target - trial_toe).norm() < miss.norm() {
                (joints, toe, jacobian) = (trial, trial_toe, trial_jacobian);
                damping = (damping * 0.1).max(1e-15);
            } else {
                damping *= 10.0;
            }
        }
        Err(RobotError::OutOfReach { leg: about.name.clone(), target: (*target).into(), miss_m: (target - toe).norm() })
    }

    fn toe_and_jacobian(&self, data: &mut Data, leg: usize, joints_rad: &[f64; 3]) -> (Vector3<f64>, Matrix3<f64>) {
        let (q, zero) = (self.posture(leg, joints_rad), [0.0; 18]);
        let point = point_kinematics(&self.model, data, &q, &zero, &zero, self.legs[leg].toe);
        let (toe, jacobian) = (point.position, point.jacobian.fixed_columns::<3>(6 + 3 * leg).into());
        (toe - self.hip(data, leg), jacobian)
    }
}
