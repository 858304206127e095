//! The friction pyramid inside the cone: μ/√2 λ_z ∓ λ_along ≥ 0 along two axes that turn with the planar motion, at the
//! pace of the T asked for. So the rows are linear, and the pyramid is the same in every stride.

use super::{At, Layout, NOT_NEGATIVE, Names, Place, Rows, Sink, Term};
use nalgebra::{Matrix2, Vector2};

/// At a point; rows are the four faces of a stance toe, N.
pub(crate) struct Friction<L> {
    pub place: Place<L>,
    pub leg: usize,
    /// Where the toe's force begins.
    pub force: usize,
    /// [`face`] of the friction coefficient.
    pub face: f64,
    /// The pyramid's axes in the world, as columns.
    pub axes: Matrix2<f64>,
}

/// μ/√2: the pyramid inside the cone.
pub(crate) fn face(friction: f64) -> f64 {
    friction / std::f64::consts::SQRT_2
}

impl<L: Layout> Term for Friction<L> {
    fn bounds(&self, bounds: &mut Vec<[f64; 2]>) {
        bounds.extend([NOT_NEGATIVE; 4]);
    }

    fn values(&self, at: &At, rows: &mut [f64]) {
        let [x, y, z] = [0, 1, 2].map(|axis| at.x[self.force + axis]);
        for axis in 0..2 {
            let along = self.axes.column(axis).dot(&Vector2::new(x, y));
            rows[2 * axis] = self.face * z - along;
            rows[2 * axis + 1] = self.face * z + along;
        }
    }

    fn derivatives(&self, _: &At, rows: &mut Rows<impl Sink>) {
        for axis in 0..2 {
            for (side, sign) in [-1.0, 1.0].into_iter().enumerate() {
                let row = 2 * axis + side;
                rows.put(row, self.force + 2, self.face);
                for (component, share) in self.axes.column(axis).iter().enumerate() {
                    if *share != 0.0 {
                        rows.put(row, self.force + component, sign * share);
                    }
                }
            }
        }
    }

    fn name(&self, _: usize, names: &Names) -> String {
        format!("friction of {}, {}", names.toe(self.leg), self.place)
    }
}
