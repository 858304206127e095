//! The motion of a point.

use nalgebra::{Matrix3xX, Vector3};

/// Motion of a frame's origin in world axes, with its derivatives.
#[derive(Debug, Clone)]
pub struct PointKinematics {
    /// Position, m.
    pub position: Vector3<f64>,
    /// Velocity J v, m/s.
    pub velocity: Vector3<f64>,
    /// Classical acceleration J a + J̇ v, m/s².
    pub acceleration: Vector3<f64>,
    /// J = ∂position/∂q = ∂velocity/∂v = ∂acceleration/∂a, 3 × dof.
    pub jacobian: Matrix3xX<f64>,
    /// ∂velocity/∂q = J̇, 3 × dof; written by the derivative functions only.
    pub dvelocity_dq: Matrix3xX<f64>,
    /// ∂acceleration/∂q, 3 × dof; written by the derivative functions only.
    pub dacceleration_dq: Matrix3xX<f64>,
    /// ∂acceleration/∂v = 2 J̇, 3 × dof; written by the derivative functions only.
    pub dacceleration_dv: Matrix3xX<f64>,
}

impl PointKinematics {
    /// All zeros, for so many coordinates.
    pub(crate) fn zeros(dof: usize) -> Self {
        Self {
            position: Vector3::zeros(),
            velocity: Vector3::zeros(),
            acceleration: Vector3::zeros(),
            jacobian: Matrix3xX::zeros(dof),
            dvelocity_dq: Matrix3xX::zeros(dof),
            dacceleration_dq: Matrix3xX::zeros(dof),
            dacceleration_dv: Matrix3xX::zeros(dof),
        }
    }
}
