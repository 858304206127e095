//! How far two stance toes are apart when a domain begins. That they stay so is said by accelerations.

use super::{At, Layout, Names, Place, Rows, Sink, Term};

/// One row: the squared distance between two stance toes, m².
pub(crate) struct ToeDistance<L> {
    pub place: Place<L>,
    pub legs: [usize; 2],
    pub squared_m2: [f64; 2],
}

impl<L: Layout> Term for ToeDistance<L> {
    fn bounds(&self, bounds: &mut Vec<[f64; 2]>) {
        bounds.push(self.squared_m2);
    }

    fn values(&self, at: &At, rows: &mut [f64]) {
        let [from, to] = self.legs.map(|leg| at.bodies.toe(self.place.index, leg));
        rows[0] = (to.position - from.position).norm_squared();
    }

    fn derivatives(&self, at: &At, rows: &mut Rows<impl Sink>) {
        let [from, to] = self.legs.map(|leg| at.bodies.toe(self.place.index, leg));
        let between = (to.position - from.position) * 2.0;
        let [a, b] = self.legs.map(|leg| L::JOINTS_OF[leg]);
        // A leg that follows the other has the same coordinates.
        let others = if b == a { b..b } else { b..b + 3 };
        for c in (3..6).chain(a..a + 3).chain(others) {
            let slope = (0..3).map(|k| between[k] * (to.jacobian[c][k] - from.jacobian[c][k])).sum();
            rows.put(0, self.place.q(c), slope);
        }
    }

    fn name(&self, _: usize, _: &Names) -> String {
        format!("squared distance between the stance toes{}", self.place.step)
    }
}
