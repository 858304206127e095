//! The workspace of every algorithm.

use nalgebra::{DMatrix, DVector, Matrix3, Vector3};

use crate::body::{ArticulatedBody, Body};
use crate::limbs::{LimbWork, with_limbs};
use crate::model::Model;
use crate::point::PointKinematics;

/// Where the last forward pass left its results.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Pass {
    /// In `Data::bodies`.
    Tree,
    /// In `Data::limbs`, and in `Data::bodies` for the torso and the legs marked.
    Limbs { exported: [bool; 4] },
}

/// Workspace and results of every algorithm, for one [`Model`].
#[derive(Debug, Clone)]
pub struct Data {
    pub(crate) bodies: Vec<Body>,
    /// The fast algorithms' workspace, where the model has that structure.
    pub(crate) limbs: Option<LimbWork>,
    /// Where the last forward pass left its results.
    pub(crate) pass: Pass,
    /// All zeros.
    pub(crate) zero: Vec<f64>,
    /// Torques of `aba` with the point forces' share.
    pub(crate) drive: Vec<f64>,
    /// The reference point in the world.
    pub(crate) origin: Vector3<f64>,
    pub(crate) articulated: Vec<ArticulatedBody>,
    /// Generalised forces, dof; written by `rnea`, `bias_forces` and `rnea_derivatives`.
    pub tau: DVector<f64>,
    /// Generalised accelerations, dof; written by `aba`.
    pub acceleration: DVector<f64>,
    /// M(q), dof × dof, symmetric and full; written by `crba` and `rnea_derivatives`. It is ∂τ/∂a.
    pub mass_matrix: DMatrix<f64>,
    /// ∂τ/∂q, dof × dof; written by `rnea_derivatives`.
    pub dtau_dq: DMatrix<f64>,
    /// ∂τ/∂v, dof × dof; written by `rnea_derivatives`.
    pub dtau_dv: DMatrix<f64>,
    /// Result of the point functions.
    pub point: PointKinematics,
}

impl Data {
    /// All the memory that the algorithms need for this model.
    pub fn new(model: &Model) -> Self {
        let n = model.dof();
        Self {
            bodies: vec![Body::ZERO; n],
            limbs: model.limbs.as_ref().map(LimbWork::new),
            pass: Pass::Tree,
            zero: vec![0.0; n],
            drive: vec![0.0; n],
            origin: Vector3::zeros(),
            articulated: vec![ArticulatedBody::ZERO; n],
            tau: DVector::zeros(n),
            acceleration: DVector::zeros(n),
            mass_matrix: DMatrix::zeros(n, n),
            dtau_dq: DMatrix::zeros(n, n),
            dtau_dv: DMatrix::zeros(n, n),
            point: PointKinematics::zeros(n),
        }
    }
}

impl Data {
    /// Brings a body and those above it into `bodies`, wherever the last pass left them.
    #[inline(always)]
    pub(crate) fn bring(&mut self, model: &Model, body: usize) {
        let Pass::Limbs { exported } = &mut self.pass else { return };
        let (Some(limbs), Some(work)) = (&model.limbs, &self.limbs) else { return };
        with_limbs!(limbs, work, |m, d| {
            let leg = m.leg_of(body).unwrap_or(0);
            if !exported[leg] {
                exported[leg] = true;
                d.export(m, leg, &mut self.bodies, &mut self.origin);
            }
        });
    }

    /// Rotation of a body, and its position in the world.
    pub(crate) fn pose(&self, model: &Model, body: usize) -> (Matrix3<f64>, Vector3<f64>) {
        match (&self.pass, &model.limbs, &self.limbs) {
            (Pass::Limbs { .. }, Some(limbs), Some(work)) => {
                with_limbs!(limbs, work, |m, d| d.pose(m, body))
            }
            _ => (self.bodies[body].rotation, self.origin + self.bodies[body].position),
        }
    }
}
