//! Swing toes land at rest: a soft touchdown, which has no impulse.

use super::{At, EQUAL, Names, Place, Rows, Term, coordinates_of};
use crate::full_order::schedule::{Step, at};

/// Where a domain ends; rows are x, y, z of each landing toe's velocity, m/s.
pub(super) struct SoftTouchdown {
    place: Place,
    landing: Vec<usize>,
    step: Step,
}

impl SoftTouchdown {
    pub fn new(place: Place, landing: Vec<usize>, step: Step) -> Self {
        Self { place, landing, step }
    }
}

impl Term for SoftTouchdown {
    fn bounds(&self) -> Vec<[f64; 2]> {
        vec![EQUAL; 3 * self.landing.len()]
    }

    fn values(&self, at: &At, rows: &mut [f64]) {
        for (k, &leg) in self.landing.iter().enumerate() {
            for axis in 0..3 {
                rows[3 * k + axis] = at.points[self.place.index].toes[leg].velocity[axis];
            }
        }
    }

    fn derivatives(&self, at: &At, rows: &mut Rows) {
        let p = self.place.column;
        for (k, &leg) in self.landing.iter().enumerate() {
            let toe = &at.points[self.place.index].toes[leg];
            for axis in 0..3 {
                for c in coordinates_of(leg) {
                    if c >= 3 {
                        rows.put(3 * k + axis, p + at::Q + c, toe.dvelocity_dq[(axis, c)]);
                    }
                    if c >= 3 || c == axis {
                        rows.put(3 * k + axis, p + at::V + c, toe.jacobian[(axis, c)]);
                    }
                }
            }
        }
    }

    fn is_tie(&self) -> bool {
        true
    }

    fn name(&self, row: usize, names: &Names) -> String {
        format!("soft touchdown of {}{}", names.toe(self.landing[row / 3]), self.step)
    }
}
