//! The whole robot at a point: dynamics and toes, with their derivatives.

use super::schedule::{DOF, at};
use crate::program::three;
use crate::terms::{Bodies, InverseDynamics, Toe, ToeMotion};
use gait::LEGS;
use nalgebra::{SMatrix, SVector};
use rigid_body::{Data, last_point_kinematics, last_point_kinematics_derivatives, rnea, rnea_derivatives};
use robot::Robot;

/// Inverse dynamics and toes for a point's q, q̇, q̈ and ground forces.
#[derive(Clone, Default)]
pub(super) struct Point {
    /// D q̈ + H − Jᵀ λ.
    tau: SVector<f64, DOF>,
    dtau_dq: SMatrix<f64, DOF, DOF>,
    dtau_dv: SMatrix<f64, DOF, DOF>,
    mass_matrix: SMatrix<f64, DOF, DOF>,
    toes: [ToeMotion<DOF>; LEGS],
}

impl Bodies for Vec<Point> {
    fn toe(&self, point: usize, leg: usize) -> Toe<'_> {
        self[point].toes[leg].view()
    }

    fn dynamics(&self, point: usize, _: usize) -> InverseDynamics<'_> {
        let point = &self[point];
        InverseDynamics {
            tau: point.tau.as_slice(),
            dtau_dq: point.dtau_dq.as_slice(),
            dtau_dv: point.dtau_dv.as_slice(),
            mass_matrix: point.mass_matrix.as_slice(),
        }
    }

    fn force_jacobian(&self, point: usize, leg: usize) -> &[[f64; 3]] {
        self.toe(point, leg).jacobian
    }
}

impl Point {
    /// For a point's unknowns; `stance` are the legs whose forces are among them. Derivatives are written where they
    /// are wanted, and stay as they were elsewhere.
    pub fn evaluate(&mut self, robot: &Robot, data: &mut Data, unknowns: &[f64], stance: &[usize], derivatives: bool) {
        let model = &robot.model;
        let (q, v, a) = (&unknowns[at::Q..at::V], &unknowns[at::V..at::A], &unknowns[at::A..at::U]);
        let mut forces = [(robot.legs[0].toe, nalgebra::Vector3::zeros()); 4];
        for (k, &leg) in stance.iter().enumerate() {
            forces[k] = (robot.legs[leg].toe, three(unknowns, at::LAMBDA + 3 * k));
        }
        let forces = &forces[..stance.len()];
        if derivatives {
            rnea_derivatives(model, data, q, v, a, forces);
            self.dtau_dq.copy_from(&data.dtau_dq);
            self.dtau_dv.copy_from(&data.dtau_dv);
            self.mass_matrix.copy_from(&data.mass_matrix);
            self.tau.copy_from(&data.tau);
        } else {
            self.tau.copy_from(rnea(model, data, q, v, a, forces));
        }
        for (leg, toe) in self.toes.iter_mut().enumerate() {
            let frame = robot.legs[leg].toe;
            let k = if derivatives {
                last_point_kinematics_derivatives(model, data, frame)
            } else {
                last_point_kinematics(model, data, frame)
            };
            (toe.position, toe.velocity, toe.acceleration) = (k.position, k.velocity, k.acceleration);
            if derivatives {
                toe.jacobian.copy_from(&k.jacobian);
                toe.dvelocity_dq.copy_from(&k.dvelocity_dq);
                toe.dacceleration_dq.copy_from(&k.dacceleration_dq);
                toe.dacceleration_dv.copy_from(&k.dacceleration_dv);
            }
        }
    }
}
