//! The tracking law (paper IV) about polynomials B that are the reference: u = kp (B − q) + kd (Ḃ − q̇), times T / kp.

use crate::full_order::schedule::{Place, at};
use crate::terms::{At, COEFFICIENTS, EQUAL, Names, Rows, Sink, Term};
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

    /// Columns of a joint's u, q, q̇.
    fn columns(&self, joint: usize) -> [usize; 3] {
        [self.place.column + at::U + joint, self.place.q(6 + joint), self.place.v(6 + joint)]
    }
}

impl Term for TrackingLaw {
    fn bounds(&self, bounds: &mut Vec<[f64; 2]>) {
        bounds.extend([EQUAL; JOINTS]);
    }

    fn values(&self, at: &At, rows: &mut [f64]) {
        let t = at.t() * self.place.share;
        let [value, slope] = [&self.value, &self.slope].map(|basis| self.place.polynomials(at.x, basis));
        for j in 0..JOINTS {
            let ((kp, kd), [u, q, v]) = (self.gains(j), self.columns(j).map(|column| at.x[column]));
            rows[j] = t * (u / kp - value[j] + q) - kd / kp * (slope[j] - t * v);
        }
    }

    fn derivatives(&self, at: &At, rows: &mut Rows<impl Sink>) {
        let (share, t) = (self.place.share, at.t() * self.place.share);
        let value = self.place.polynomials(at.x, &self.value);
        for j in 0..JOINTS {
            let ((kp, kd), columns) = (self.gains(j), self.columns(j));
            let [u, q, v] = columns.map(|column| at.x[column]);
            for (column, value) in columns.into_iter().zip([t / kp, t, kd / kp * t]) {
                rows.put(j, column, value);
            }
            rows.put(j, at.t_column, (u / kp - value[j] + q + kd / kp * v) * share);
            for k in 0..COEFFICIENTS {
                rows.put(j, self.place.alpha(k, j), -t * self.value[k] - kd / kp * self.slope[k]);
            }
        }
    }

    fn name(&self, row: usize, names: &Names) -> String {
        format!("tracking law of {}, {}", names.joint(row), self.place)
    }
}
