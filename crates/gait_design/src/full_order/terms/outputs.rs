//! Joints on their polynomials (paper II-A, y ≡ 0), as T² θ̈ − B̈(s) = 0.

use super::{At, EQUAL, FREE, Names, Place, Rows, Term};
use crate::full_order::schedule::{COEFFICIENTS, alpha, at};
use crate::limits::keeps_stance_roll;
use gait::{Coefficients, JOINTS, bezier};

/// At a point; rows are joints, rad.
pub(super) struct PrescribedJoints {
    place: Place,
    /// Their rows are left out at most points: the fixed distances of the stance toes say the same.
    redundant_joints: Vec<usize>,
    basis: Coefficients,
    suffix: String,
}

impl PrescribedJoints {
    pub fn new(place: Place, redundant_joints: Vec<usize>, suffix: String) -> Self {
        Self { place, redundant_joints, basis: bezier::basis_second_derivative(place.phase), suffix }
    }
}

impl Term for PrescribedJoints {
    fn bounds(&self) -> Vec<[f64; 2]> {
        let mut bounds = vec![EQUAL; JOINTS];
        if !keeps_stance_roll(self.place.point, self.place.points) {
            self.redundant_joints.iter().for_each(|&j| bounds[j] = FREE);
        }
        bounds
    }

    fn values(&self, at: &At, rows: &mut [f64]) {
        let t = at.t() * self.place.share;
        for j in 0..JOINTS {
            let polynomial: f64 = (0..COEFFICIENTS).map(|k| at.x[alpha(self.place.domain, k, j)] * self.basis[k]).sum();
            rows[j] = t * t * at.x[self.place.column + at::A + 6 + j] - polynomial;
        }
    }

    fn derivatives(&self, at: &At, rows: &mut Rows) {
        let (share, t) = (self.place.share, at.t() * self.place.share);
        for j in 0..JOINTS {
            let acceleration = self.place.column + at::A + 6 + j;
            rows.put(j, acceleration, t * t);
            rows.put(j, at.t_column, 2.0 * t * at.x[acceleration] * share);
            for k in 0..COEFFICIENTS {
                rows.put(j, alpha(self.place.domain, k, j), -self.basis[k]);
            }
        }
    }

    fn name(&self, row: usize, names: &Names) -> String {
        format!("{} on its polynomial{}", names.joint(row), self.suffix)
    }
}
