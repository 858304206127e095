//! A stance toe does not accelerate: J q̈ + J̇ q̇ = 0.

use super::{At, EQUAL, Names, Place, Rows, Term};

/// At a point; rows are x, y, z of a toe, m/s².
pub(crate) struct AtRest {
    place: Place,
    leg: usize,
}

impl AtRest {
    pub fn new(place: Place, leg: usize) -> Self {
        Self { place, leg }
    }
}

impl Term for AtRest {
    fn bounds(&self, bounds: &mut Vec<[f64; 2]>) {
        bounds.extend([EQUAL; 3]);
    }

    fn values(&self, at: &At, rows: &mut [f64]) {
        rows.copy_from_slice(at.bodies.toe(self.place.index, self.leg).acceleration.as_slice());
    }

    fn derivatives(&self, at: &At, rows: &mut Rows) {
        let toe = at.bodies.toe(self.place.index, self.leg);
        for axis in 0..3 {
            for c in self.place.coordinates_of(self.leg) {
                if c >= 3 {
                    rows.put(axis, self.place.q(c), toe.dacceleration_dq[c][axis]);
                    rows.put(axis, self.place.v(c), toe.dacceleration_dv[c][axis]);
                }
                // The base's translation moves a toe along its own axis only.
                if c >= 3 || c == axis {
                    rows.put(axis, self.place.a(c), toe.jacobian[c][axis]);
                }
            }
        }
    }

    fn name(&self, _: usize, names: &Names) -> String {
        format!("{} at rest, {}", names.toe(self.leg), self.place)
    }
}
