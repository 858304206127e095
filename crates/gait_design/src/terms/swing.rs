//! How high a swing toe is.

use super::{At, Names, Place, Rows, Term};

/// At a point; one row, m.
pub(crate) struct Height {
    place: Place,
    leg: usize,
    height_m: [f64; 2],
}

impl Height {
    pub fn new(place: Place, leg: usize, height_m: [f64; 2]) -> Self {
        Self { place, leg, height_m }
    }
}

impl Term for Height {
    fn bounds(&self, bounds: &mut Vec<[f64; 2]>) {
        bounds.push(self.height_m);
    }

    fn values(&self, at: &At, rows: &mut [f64]) {
        rows[0] = at.bodies.toe(self.place.index, self.leg).position.z;
    }

    fn derivatives(&self, at: &At, rows: &mut Rows) {
        put_height(&self.place, self.leg, at, rows);
    }

    fn name(&self, _: usize, names: &Names) -> String {
        format!("height of {}, {}", names.toe(self.leg), self.place)
    }
}

/// The derivatives of a toe's height, which is a term's only row.
pub(super) fn put_height(place: &Place, leg: usize, at: &At, rows: &mut Rows) {
    let toe = at.bodies.toe(place.index, leg);
    for c in place.coordinates_of(leg).filter(|c| *c >= 2) {
        rows.put(0, place.q(c), toe.jacobian[c][2]);
    }
}
