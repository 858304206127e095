//! How high a toe is.

use super::{At, EQUAL, Layout, Names, Place, Rows, Sink, Term};

/// Which toe's, m.
pub(crate) enum Of {
    /// One that newly stands, where a domain begins: on the floor. That it stays there is said by accelerations.
    Stance,
    /// One that swings: between these.
    Swing([f64; 2]),
}

/// At a point; one row, m.
pub(crate) struct Height<L> {
    pub place: Place<L>,
    pub leg: usize,
    pub of: Of,
}

impl<L: Layout> Term for Height<L> {
    fn bounds(&self, bounds: &mut Vec<[f64; 2]>) {
        bounds.push(match self.of {
            Of::Stance => EQUAL,
            Of::Swing(height_m) => height_m,
        });
    }

    fn values(&self, at: &At, rows: &mut [f64]) {
        rows[0] = at.bodies.toe(self.place.index, self.leg).position.z;
    }

    fn derivatives(&self, at: &At, rows: &mut Rows<impl Sink>) {
        let toe = at.bodies.toe(self.place.index, self.leg);
        for c in self.place.coordinates_of(self.leg).filter(|c| *c >= 2) {
            rows.put(0, self.place.q(c), toe.jacobian[c][2]);
        }
    }

    fn is_tie(&self) -> bool {
        matches!(self.of, Of::Stance)
    }

    fn name(&self, _: usize, names: &Names) -> String {
        let toe = names.toe(self.leg);
        match self.of {
            Of::Stance => format!("{toe} on the floor{}", self.place.step),
            Of::Swing(_) => format!("height of {toe}, {}", self.place),
        }
    }
}
