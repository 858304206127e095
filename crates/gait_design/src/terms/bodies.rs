//! What terms read of the rigid bodies at a point.

use nalgebra::{SMatrix, Vector3};

/// The rigid bodies of a program at its points, as they were evaluated last.
pub(crate) trait Bodies {
    /// The motion of a leg's toe.
    fn toe(&self, point: usize, leg: usize) -> Toe<'_>;
    /// The inverse dynamics of one of the bodies.
    fn dynamics(&self, point: usize, body: usize) -> InverseDynamics<'_>;
    /// A toe's Jacobian by the coordinates of its own body, column by column: its transpose maps the ground force into
    /// the body's dynamics.
    fn force_jacobian(&self, point: usize, leg: usize) -> &[[f64; 3]];
}

/// A toe's motion, m and s; derivatives by the program's coordinates, column by column.
pub(crate) struct Toe<'a> {
    pub position: &'a Vector3<f64>,
    pub velocity: &'a Vector3<f64>,
    pub acceleration: &'a Vector3<f64>,
    pub jacobian: &'a [[f64; 3]],
    pub dvelocity_dq: &'a [[f64; 3]],
    pub dacceleration_dq: &'a [[f64; 3]],
    pub dacceleration_dv: &'a [[f64; 3]],
}

/// D q̈ + H − Jᵀ λ of a body's own coordinates, N and N m, and its derivatives by the program's, column by column.
pub(crate) struct InverseDynamics<'a> {
    pub tau: &'a [f64],
    pub dtau_dq: &'a [f64],
    pub dtau_dv: &'a [f64],
    pub mass_matrix: &'a [f64],
}

/// What [`Toe`] shows, by so many coordinates.
#[derive(Clone, Debug)]
pub(crate) struct ToeMotion<const COORDINATES: usize> {
    pub position: Vector3<f64>,
    pub velocity: Vector3<f64>,
    pub acceleration: Vector3<f64>,
    pub jacobian: SMatrix<f64, 3, COORDINATES>,
    pub dvelocity_dq: SMatrix<f64, 3, COORDINATES>,
    pub dacceleration_dq: SMatrix<f64, 3, COORDINATES>,
    pub dacceleration_dv: SMatrix<f64, 3, COORDINATES>,
}

impl<const COORDINATES: usize> Default for ToeMotion<COORDINATES> {
    fn default() -> Self {
        let (vector, matrix) = (Vector3::zeros(), SMatrix::zeros());
        Self {
            position: vector,
            velocity: vector,
            acceleration: vector,
            jacobian: matrix,
            dvelocity_dq: matrix,
            dacceleration_dq: matrix,
            dacceleration_dv: matrix,
        }
    }
}

impl<const COORDINATES: usize> ToeMotion<COORDINATES> {
    pub fn view(&self) -> Toe<'_> {
        Toe {
            position: &self.position,
            velocity: &self.velocity,
            acceleration: &self.acceleration,
            jacobian: &self.jacobian.data.0,
            dvelocity_dq: &self.dvelocity_dq.data.0,
            dacceleration_dq: &self.dacceleration_dq.data.0,
            dacceleration_dv: &self.dacceleration_dv.data.0,
        }
    }
}
