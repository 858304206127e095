//! Joints on their polynomials (paper II-A): y ≡ 0, as T² θ̈ − B̈(s) = 0 at every point, and y = 0, T ẏ = 0 where a
//! domain begins.

use super::{At, COEFFICIENTS, EQUAL, FREE, Names, Place, Rows, Term};
use crate::limits::keeps_stance_roll;
use gait::{Coefficients, JOINTS, bezier};

/// At a point; rows are joints, rad.
pub(crate) struct Prescribed {
    place: Place,
    /// Joints whose rows are left out here: the fixed distances of the stance toes say the same.
    free: [bool; JOINTS],
    basis: Coefficients,
}

impl Prescribed {
    /// `redundant_joints` are free at most points.
    pub fn new(place: Place, redundant_joints: &[usize]) -> Self {
        let mut free = [false; JOINTS];
        if !keeps_stance_roll(place.point, place.points) {
            redundant_joints.iter().for_each(|&j| free[j] = true);
        }
        Self { place, free, basis: bezier::basis_second_derivative(place.phase) }
    }
}

impl Term for Prescribed {
    fn bounds(&self, bounds: &mut Vec<[f64; 2]>) {
        bounds.extend((0..self.place.joints()).map(|j| if self.free[j] { FREE } else { EQUAL }));
    }

    fn values(&self, at: &At, rows: &mut [f64]) {
        let t = at.t() * self.place.share;
        for (j, row) in rows.iter_mut().enumerate() {
            let polynomial = self.place.polynomial(at.x, j, &self.basis);
            *row = t * t * at.x[self.place.a(6 + j)] - polynomial;
        }
    }

    fn derivatives(&self, at: &At, rows: &mut Rows) {
        let (share, t) = (self.place.share, at.t() * self.place.share);
        for j in 0..self.place.joints() {
            let acceleration = self.place.a(6 + j);
            rows.put(j, acceleration, t * t);
            rows.put(j, at.t_column, 2.0 * t * at.x[acceleration] * share);
            for k in 0..COEFFICIENTS {
                rows.put(j, self.place.alpha(k, j), -self.basis[k]);
            }
        }
    }

    fn name(&self, row: usize, names: &Names) -> String {
        format!("{} on its polynomial, {}", names.joint(row), self.place)
    }
}

/// Where a domain begins: y and then T ẏ of every joint, rad.
pub(crate) struct Begins {
    place: Place,
    value: Coefficients,
    slope: Coefficients,
}

impl Begins {
    pub fn new(place: Place) -> Self {
        Self { place, value: bezier::basis(0.0), slope: bezier::basis_first_derivative(0.0) }
    }
}

impl Term for Begins {
    fn bounds(&self, bounds: &mut Vec<[f64; 2]>) {
        bounds.resize(bounds.len() + 2 * self.place.joints(), EQUAL);
    }

    fn values(&self, at: &At, rows: &mut [f64]) {
        let (t, joints) = (at.t() * self.place.share, self.place.joints());
        for j in 0..joints {
            rows[j] = at.x[self.place.q(6 + j)] - self.place.polynomial(at.x, j, &self.value);
            rows[joints + j] = t * at.x[self.place.v(6 + j)] - self.place.polynomial(at.x, j, &self.slope);
        }
    }

    fn derivatives(&self, at: &At, rows: &mut Rows) {
        let (share, joints) = (self.place.share, self.place.joints());
        let t = at.t() * share;
        for j in 0..joints {
            rows.put(j, self.place.q(6 + j), 1.0);
            rows.put(j, self.place.alpha(0, j), -self.value[0]);
            let (row, velocity) = (joints + j, self.place.v(6 + j));
            rows.put(row, velocity, t);
            rows.put(row, at.t_column, at.x[velocity] * share);
            rows.put(row, self.place.alpha(0, j), -self.slope[0]);
            rows.put(row, self.place.alpha(1, j), -self.slope[1]);
        }
    }

    fn name(&self, row: usize, names: &Names) -> String {
        format!("{} starts on its polynomial{}", names.joint(row % self.place.joints()), self.place.step)
    }
}
