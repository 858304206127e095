//! A swing toe lands at rest: a soft touchdown, which has no impulse.

use super::{At, EQUAL, Layout, Names, Place, Rows, Sink, Term};
use std::ops::Range;

/// Where a domain ends; rows are components of a landing toe's velocity, m/s.
pub(crate) struct SoftTouchdown<L> {
    pub place: Place<L>,
    pub leg: usize,
    pub axes: Range<usize>,
}

impl<L: Layout> Term for SoftTouchdown<L> {
    fn bounds(&self, bounds: &mut Vec<[f64; 2]>) {
        bounds.resize(bounds.len() + self.axes.len(), EQUAL);
    }

    fn values(&self, at: &At, rows: &mut [f64]) {
        let velocity = at.bodies.toe(self.place.index, self.leg).velocity;
        rows.copy_from_slice(&velocity.as_slice()[self.axes.clone()]);
    }

    fn derivatives(&self, at: &At, rows: &mut Rows<impl Sink>) {
        let toe = at.bodies.toe(self.place.index, self.leg);
        for (row, axis) in self.axes.clone().enumerate() {
            for c in self.place.coordinates_of(self.leg) {
                if c >= 3 {
                    rows.put(row, self.place.q(c), toe.dvelocity_dq[c][axis]);
                }
                if c >= 3 || c == axis {
                    rows.put(row, self.place.v(c), toe.jacobian[c][axis]);
                }
            }
        }
    }

    fn is_tie(&self) -> bool {
        true
    }

    fn name(&self, row: usize, names: &Names) -> String {
        format!("soft touchdown of {}{}{}", names.toe(self.leg), names.axis(self.axes.start + row), self.place.step)
    }
}
