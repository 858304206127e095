//! The tracking law (paper IV) about polynomials B that are the reference: u = kp (B − q) + kd (Ḃ − q̇), times T / kp.

use super::{At, EQUAL, Names, Place, Rows, Term};
use crate::full_order::schedule::{COEFFICIENTS, alpha, at};
use gait::{Coefficients, JOINTS, bezier};
use robot::Robot;

/// At a point; rows are joints, rad s.
pub(super) struct TrackingLaw {
    place: Place,
    kp_nm_per_rad: [f64; 3],
    kd_nm_s_per_rad: [f64; 3],
    value: Coefficients,
    slope: Coefficients,
    suffix: String,
}

impl TrackingLaw {
    pub fn new(place: Place, robot: &Robot, suffix: String) -> Self {
        Self {
            place,
            kp_nm_per_rad: robot.gains.kp_nm_per_rad,
            kd_nm_s_per_rad: robot.gains.kd_nm_s_per_rad,
            value: bezier::basis(place.phase),
            slope: bezier::basis_first_derivative(place.phase),
            suffix,
        }
    }

    /// A joint's kp and kd.
    fn gains(&self, joint: usize) -> (f64, f64) {
        (self.kp_nm_per_rad[joint % 3], self.kd_nm_s_per_rad[joint % 3])
    }

    fn polynomial(&self, at: &At, joint: usize, basis: &Coefficients) -> f64 {
        (0..COEFFICIENTS).map(|k| at.x[alpha(self.place.domain, k, joint)] * basis[k]).sum()
    }

    /// A joint's u, q, q̇.
    fn joint(&self, at: &At, joint: usize) -> (f64, f64, f64) {
        let p = &at.x[self.place.column..];
        (p[at::U + joint], p[at::Q + 6 + joint], p[at::V + 6 + joint])
    }
}

impl Term for TrackingLaw {
    fn bounds(&self) -> Vec<[f64; 2]> {
        vec![EQUAL; JOINTS]
    }

    fn values(&self, at: &At, rows: &mut [f64]) {
        let t = at.t() * self.place.share;
        for j in 0..JOINTS {
            let ((kp, kd), (u, q, v)) = (self.gains(j), self.joint(at, j));
            let (value, slope) = (self.polynomial(at, j, &self.value), self.polynomial(at, j, &self.slope));
            rows[j] = t * (u / kp - value + q) - kd / kp * (slope - t * v);
        }
    }

    fn derivatives(&self, at: &At, rows: &mut Rows) {
        let (share, t, p) = (self.place.share, at.t() * self.place.share, self.place.column);
        for j in 0..JOINTS {
            let ((kp, kd), (u, q, v)) = (self.gains(j), self.joint(at, j));
            let value = self.polynomial(at, j, &self.value);
            rows.put(j, p + at::U + j, t / kp);
            rows.put(j, p + at::Q + 6 + j, t);
            rows.put(j, p + at::V + 6 + j, kd / kp * t);
            rows.put(j, at.t_column, (u / kp - value + q + kd / kp * v) * share);
            for k in 0..COEFFICIENTS {
                rows.put(j, alpha(self.place.domain, k, j), -t * self.value[k] - kd / kp * self.slope[k]);
            }
        }
    }

    fn name(&self, row: usize, names: &Names) -> String {
        format!("tracking law of {}{}", names.joint(row), self.suffix)
    }
}
