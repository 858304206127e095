//! The friction pyramid inside the cone: μ/√2 λ_z ∓ λ_along ≥ 0 along two axes that turn with the planar motion, at the
//! pace of the T asked for. So the rows are linear, and the pyramid is the same in every stride.

use super::{At, NOT_NEGATIVE, Names, Place, Rows, Term};
use crate::full_order::schedule::at;
use crate::program::three;
use nalgebra::Matrix2;

/// At a point; rows are the four faces of each stance toe, N.
pub(super) struct Friction {
    place: Place,
    stance: Vec<usize>,
    face: f64,
    /// The pyramid's axes in the world, as columns.
    axes: Matrix2<f64>,
    suffix: String,
}

impl Friction {
    pub fn new(place: Place, stance: Vec<usize>, friction: f64, axes: Matrix2<f64>, suffix: String) -> Self {
        Self { place, stance, face: friction / std::f64::consts::SQRT_2, axes, suffix }
    }
}

impl Term for Friction {
    fn bounds(&self) -> Vec<[f64; 2]> {
        vec![NOT_NEGATIVE; 4 * self.stance.len()]
    }

    fn values(&self, at: &At, rows: &mut [f64]) {
        for k in 0..self.stance.len() {
            let force = three(&at.x[self.place.column..], at::LAMBDA + 3 * k);
            for axis in 0..2 {
                let along = self.axes.column(axis).dot(&force.xy());
                rows[4 * k + 2 * axis] = self.face * force.z - along;
                rows[4 * k + 2 * axis + 1] = self.face * force.z + along;
            }
        }
    }

    fn derivatives(&self, _: &At, rows: &mut Rows) {
        for k in 0..self.stance.len() {
            let force = self.place.column + at::LAMBDA + 3 * k;
            for axis in 0..2 {
                for (side, sign) in [-1.0, 1.0].into_iter().enumerate() {
                    let row = 4 * k + 2 * axis + side;
                    rows.put(row, force + 2, self.face);
                    for (component, share) in self.axes.column(axis).iter().enumerate() {
                        if *share != 0.0 {
                            rows.put(row, force + component, sign * share);
                        }
                    }
                }
            }
        }
    }

    fn name(&self, row: usize, names: &Names) -> String {
        format!("friction of {}{}", names.toe(self.stance[row / 4]), self.suffix)
    }
}
