//! The tracking law (paper IV) about polynomials B that are the reference: u = kp (B − q) + kd (Ḃ − q̇), times T / kp.

use crate::full_order::schedule::at;
use crate::terms::{At, COEFFICIENTS, EQUAL, Names, Place, Rows, Term};
use gait::{Coefficients, JOINTS, bezier};
use robot::Robot;

/// At a point; rows are joints, rad s.
pub(super) struct TrackingLaw {
    place: Place,
    kp_nm_per_rad: [f64; 3],
    kd_nm_s_per_rad: [f64; 3],
    value: Coefficients,
    slope: Coefficients,
}

impl TrackingLaw {
    pub fn new(place: Place, robot: &Robot) -> Self {
        Self {
            place,
            kp_nm_per_rad: robot.gains.kp_nm_per_rad,
            kd_nm_s_per_rad: robot.gains.kd_nm_s_per_rad,
            value: bezier::basis(place.phase),
            slope: bezier::basis_first_derivative(place.phase),
        }
    }

    /// A joint's kp and kd.
    fn gains(&self, joint: usize) -> (f64, f64) {
        (self.kp_nm_per_rad[joint % 3], self.kd_nm_s_per_rad[joint % 3])
    }

    /// Column of a joint's torque.
    fn torque(&self, joint: usize) -> usize {
        self.place.column + at::U + joint
    }

    /// A joint's u, q, q̇.
    fn joint(&self, at: &At, joint: usize) -> (f64, f64, f64) {
        (at.x[self.torque(joint)], at.x[self.place.q(6 + joint)], at.x[self.place.v(6 + joint)])
    }
}

impl Term for TrackingLaw {
    fn bounds(&self, bounds: &mut Vec<[f64; 2]>) {
        bounds.extend([EQUAL; JOINTS]);
    }

    fn values(&self, at: &At, rows: &mut [f64]) {
        let t = at.t() * self.place.share;
        for j in 0..JOINTS {
            let ((kp, kd), (u, q, v)) = (self.gains(j), self.joint(at, j));
            let [value, slope] = [&self.value, &self.slope].map(|basis| self.place.polynomial(at.x, j, basis));
            rows[j] = t * (u / kp - value + q) - kd / kp * (slope - t * v);
        }
    }

    fn derivatives(&self, at: &At, rows: &mut Rows) {
        let (share, t) = (self.place.share, at.t() * self.place.share);
        for j in 0..JOINTS {
            let ((kp, kd), (u, q, v)) = (self.gains(j), self.joint(at, j));
            let value = self.place.polynomial(at.x, j, &self.value);
            rows.put(j, self.torque(j), t / kp);
            rows.put(j, self.place.q(6 + j), t);
            rows.put(j, self.place.v(6 + j), kd / kp * t);
            rows.put(j, at.t_column, (u / kp - value + q + kd / kp * v) * share);
            for k in 0..COEFFICIENTS {
                rows.put(j, self.place.alpha(k, j), -t * self.value[k] - kd / kp * self.slope[k]);
            }
        }
    }

    fn name(&self, row: usize, names: &Names) -> String {
        format!("tracking law of {}, {}", names.joint(row), self.place)
    }
}
