//! Where stance toes are when a domain begins: on the floor and at their distance. That they stay there is said by
//! accelerations.

use super::swing::put_height;
use super::{At, EQUAL, Names, Place, Rows, Term};

/// One row: a stance toe's height, m.
pub(crate) struct OnTheFloor {
    place: Place,
    leg: usize,
}

impl OnTheFloor {
    pub fn new(place: Place, leg: usize) -> Self {
        Self { place, leg }
    }
}

impl Term for OnTheFloor {
    fn bounds(&self, bounds: &mut Vec<[f64; 2]>) {
        bounds.push(EQUAL);
    }

    fn values(&self, at: &At, rows: &mut [f64]) {
        rows[0] = at.bodies.toe(self.place.index, self.leg).position.z;
    }

    fn derivatives(&self, at: &At, rows: &mut Rows) {
        put_height(&self.place, self.leg, at, rows);
    }

    fn is_tie(&self) -> bool {
        true
    }

    fn name(&self, _: usize, names: &Names) -> String {
        format!("{} on the floor{}", names.toe(self.leg), self.place.step)
    }
}

/// One row: the squared distance between two stance toes, m².
pub(crate) struct ToeDistance {
    place: Place,
    legs: [usize; 2],
    squared_m2: [f64; 2],
}

impl ToeDistance {
    pub fn new(place: Place, legs: [usize; 2], squared_m2: [f64; 2]) -> Self {
        Self { place, legs, squared_m2 }
    }
}

impl Term for ToeDistance {
    fn bounds(&self, bounds: &mut Vec<[f64; 2]>) {
        bounds.push(self.squared_m2);
    }

    fn values(&self, at: &At, rows: &mut [f64]) {
        let [from, to] = self.legs.map(|leg| at.bodies.toe(self.place.index, leg));
        rows[0] = (to.position - from.position).norm_squared();
    }

    fn derivatives(&self, at: &At, rows: &mut Rows) {
        let [from, to] = self.legs.map(|leg| at.bodies.toe(self.place.index, leg));
        let between = (to.position - from.position) * 2.0;
        let [a, b] = self.legs.map(|leg| self.place.layout.joints_of[leg]);
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
