//! The full-order dynamics (paper eq. 1): D q̈ + H − Jᵀ λ − B u = 0.

use super::{At, EQUAL, Names, Place, Rows, Term};
use crate::full_order::schedule::{DOF, at};
use gait::JOINTS;

/// At a point; rows are coordinates, N and N m.
pub(super) struct Dynamics {
    place: Place,
    stance: Vec<usize>,
    suffix: String,
}

impl Dynamics {
    pub fn new(place: Place, stance: Vec<usize>, suffix: String) -> Self {
        Self { place, stance, suffix }
    }
}

impl Term for Dynamics {
    fn bounds(&self) -> Vec<[f64; 2]> {
        vec![EQUAL; DOF]
    }

    fn values(&self, at: &At, rows: &mut [f64]) {
        let tau = &at.points[self.place.index].tau;
        let u = &at.x[self.place.column + at::U..];
        for i in 0..DOF {
            rows[i] = tau[i] - if i < 6 { 0.0 } else { u[i - 6] };
        }
    }

    fn derivatives(&self, at: &At, rows: &mut Rows) {
        let (point, p) = (&at.points[self.place.index], self.place.column);
        for i in 0..DOF {
            for c in 0..DOF {
                // Two legs meet only in the base.
                if i < 6 || c < 6 || (i - 6) / 3 == (c - 6) / 3 {
                    rows.put(i, p + at::Q + c, point.dtau_dq[(i, c)]);
                    rows.put(i, p + at::V + c, point.dtau_dv[(i, c)]);
                    rows.put(i, p + at::A + c, point.mass[(i, c)]);
                }
            }
            for (k, &leg) in self.stance.iter().enumerate() {
                if i < 6 || (i - 6) / 3 == leg {
                    for axis in 0..3 {
                        rows.put(i, p + at::LAMBDA + 3 * k + axis, -point.toes[leg].jacobian[(axis, i)]);
                    }
                }
            }
        }
        for j in 0..JOINTS {
            rows.put(6 + j, p + at::U + j, -1.0);
        }
    }

    fn name(&self, row: usize, names: &Names) -> String {
        format!("dynamics of {}{}", names.coordinate(row), self.suffix)
    }
}
