//! How high the swing toes are.

use super::{At, Names, Place, Rows, Term, coordinates_of};
use crate::full_order::schedule::at;
use crate::limits::Limits;

/// At a point; rows are the swing toes, m.
pub(super) struct Height {
    place: Place,
    swing: Vec<usize>,
    height_m: [f64; 2],
    suffix: String,
}

impl Height {
    pub fn new(place: Place, swing: Vec<usize>, limits: &Limits, suffix: String) -> Self {
        Self { place, swing, height_m: limits.swing_height_m(place.point, place.points), suffix }
    }
}

impl Term for Height {
    fn bounds(&self) -> Vec<[f64; 2]> {
        vec![self.height_m; self.swing.len()]
    }

    fn values(&self, at: &At, rows: &mut [f64]) {
        for (k, &leg) in self.swing.iter().enumerate() {
            rows[k] = at.points[self.place.index].toes[leg].position.z;
        }
    }

    fn derivatives(&self, at: &At, rows: &mut Rows) {
        for (k, &leg) in self.swing.iter().enumerate() {
            for c in coordinates_of(leg).filter(|c| *c >= 2) {
                let slope = at.points[self.place.index].toes[leg].jacobian[(2, c)];
                rows.put(k, self.place.column + at::Q + c, slope);
            }
        }
    }

    fn name(&self, row: usize, names: &Names) -> String {
        format!("height of {}{}", names.toe(self.swing[row]), self.suffix)
    }
}
