//! Stance toes do not accelerate: J q̈ + J̇ q̇ = 0.

use super::{At, EQUAL, Names, Place, Rows, Term, coordinates_of};
use crate::full_order::schedule::at;

/// At a point; rows are x, y, z of each stance toe, m/s².
pub(super) struct AtRest {
    place: Place,
    stance: Vec<usize>,
    suffix: String,
}

impl AtRest {
    pub fn new(place: Place, stance: Vec<usize>, suffix: String) -> Self {
        Self { place, stance, suffix }
    }
}

impl Term for AtRest {
    fn bounds(&self) -> Vec<[f64; 2]> {
        vec![EQUAL; 3 * self.stance.len()]
    }

    fn values(&self, at: &At, rows: &mut [f64]) {
        for (k, &leg) in self.stance.iter().enumerate() {
            for axis in 0..3 {
                rows[3 * k + axis] = at.points[self.place.index].toes[leg].acceleration[axis];
            }
        }
    }

    fn derivatives(&self, at: &At, rows: &mut Rows) {
        let p = self.place.column;
        for (k, &leg) in self.stance.iter().enumerate() {
            let toe = &at.points[self.place.index].toes[leg];
            for axis in 0..3 {
                for c in coordinates_of(leg) {
                    if c >= 3 {
                        rows.put(3 * k + axis, p + at::Q + c, toe.dacceleration_dq[(axis, c)]);
                        rows.put(3 * k + axis, p + at::V + c, toe.dacceleration_dv[(axis, c)]);
                    }
                    if c >= 3 || c == axis {
                        rows.put(3 * k + axis, p + at::A + c, toe.jacobian[(axis, c)]);
                    }
                }
            }
        }
    }

    fn name(&self, row: usize, names: &Names) -> String {
        format!("{} at rest{}", names.toe(self.stance[row / 3]), self.suffix)
    }
}
