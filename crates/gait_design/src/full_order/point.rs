//! The whole robot at a point: dynamics and toes, with their derivatives.

use super::schedule::{DOF, at};
use crate::program::three;
use rigid_body::{Data, last_point_kinematics, last_point_kinematics_derivatives, rnea, rnea_derivatives};
use robot::Robot;

/// A toe's motion with its derivatives.
#[derive(Clone)]
pub(super) struct Toe {
    pub position: nalgebra::Vector3<f64>,
    pub velocity: nalgebra::Vector3<f64>,
    pub acceleration: nalgebra::Vector3<f64>,
    pub jacobian: nalgebra::Matrix3xX<f64>,
    pub dvelocity_dq: nalgebra::Matrix3xX<f64>,
    pub dacceleration_dq: nalgebra::Matrix3xX<f64>,
    pub dacceleration_dv: nalgebra::Matrix3xX<f64>,
}

/// Inverse dynamics and toes for a point's q, q̇, q̈ and ground forces.
#[derive(Clone)]
pub(super) struct Point {
    /// D q̈ + H − Jᵀ λ.
    pub tau: nalgebra::DVector<f64>,
    pub dtau_dq: nalgebra::DMatrix<f64>,
    pub dtau_dv: nalgebra::DMatrix<f64>,
    pub mass: nalgebra::DMatrix<f64>,
    pub toes: [Toe; 4],
}

impl Point {
    pub fn new() -> Self {
        let toe = Toe {
            position: nalgebra::Vector3::zeros(),
            velocity: nalgebra::Vector3::zeros(),
            acceleration: nalgebra::Vector3::zeros(),
            jacobian: nalgebra::Matrix3xX::zeros(DOF),
            dvelocity_dq: nalgebra::Matrix3xX::zeros(DOF),
            dacceleration_dq: nalgebra::Matrix3xX::zeros(DOF),
            dacceleration_dv: nalgebra::Matrix3xX::zeros(DOF),
        };
        let square = nalgebra::DMatrix::zeros(DOF, DOF);
        Self {
            tau: nalgebra::DVector::zeros(DOF),
            dtau_dq: square.clone(),
            dtau_dv: square.clone(),
            mass: square,
            toes: std::array::from_fn(|_| toe.clone()),
        }
    }

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
            self.mass.copy_from(&data.mass_matrix);
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
