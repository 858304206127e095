//! A stance toe does not accelerate: J q̈ + J̇ q̇ = 0.

use super::{At, EQUAL, Layout, Names, Place, Rows, Sink, Term};

/// At a point; rows are x, y, z of a toe, m/s².
pub(crate) struct AtRest<L> {
    pub place: Place<L>,
    pub leg: usize,
}

impl<L: Layout> Term for AtRest<L> {
    fn bounds(&self, bounds: &mut Vec<[f64; 2]>) {
        bounds.extend([EQUAL; 3]);
    }

    fn values(&self, at: &At, rows: &mut [f64]) {
        rows.copy_from_slice(at.bodies.toe(self.place.index, self.leg).acceleration.as_slice());
    }

    fn derivatives(&self, at: &At, rows: &mut Rows<impl Sink>) {
        let toe = at.bodies.toe(self.place.index, self.leg);
        for axis in 0..3 {
            // The base's translation moves a toe along its own axis only.
            let moves = |c: &usize| *c >= 3 || *c == axis;
            for c in self.place.coordinates_of(self.leg).filter(moves) {
                if c >= 3 {
                    rows.put(axis, self.place.q(c), toe.dacceleration_dq[c][axis]);
                    rows.put(axis, self.place.v(c), toe.dacceleration_dv[c][axis]);
                }
                if !L::ACCELERATIONS_LAST {
                    rows.put(axis, self.place.a(c), toe.jacobian[c][axis]);
                }
            }
            for c in self.place.coordinates_of(self.leg).filter(|c| L::ACCELERATIONS_LAST && moves(c)) {
                rows.put(axis, self.place.a(c), toe.jacobian[c][axis]);
            }
        }
    }

    fn name(&self, row: usize, names: &Names) -> String {
        format!("{} at rest{}, {}", names.toe(self.leg), names.axis(row), self.place)
    }
}
