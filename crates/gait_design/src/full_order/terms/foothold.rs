//! Where legs land: x and y of each toe that newly stands, about its foothold.

use crate::full_order::schedule::{Foothold, Place};
use crate::limits::Limits;
use crate::terms::{At, Names, Rows, Sink, Term};

/// Where a domain begins; rows are x and y of each toe, m.
pub(super) struct Footholds {
    place: Place,
    footholds: Vec<Foothold>,
    tolerance_m: f64,
}

impl Footholds {
    pub fn new(place: Place, footholds: Vec<Foothold>, limits: &Limits) -> Self {
        Self { place, footholds, tolerance_m: limits.foothold_tolerance_m }
    }
}

impl Term for Footholds {
    fn bounds(&self, bounds: &mut Vec<[f64; 2]>) {
        let about = |middle: f64| [middle - self.tolerance_m, middle + self.tolerance_m];
        bounds.extend(self.footholds.iter().flat_map(|foothold| foothold.place_m.map(about)));
    }

    fn values(&self, at: &At, rows: &mut [f64]) {
        for (k, foothold) in self.footholds.iter().enumerate() {
            let position = at.bodies.toe(self.place.index, foothold.leg).position;
            rows[2 * k..2 * k + 2].copy_from_slice(&position.as_slice()[..2]);
        }
    }

    fn derivatives(&self, at: &At, rows: &mut Rows<impl Sink>) {
        for (k, foothold) in self.footholds.iter().enumerate() {
            let jacobian = at.bodies.toe(self.place.index, foothold.leg).jacobian;
            for axis in 0..2 {
                for c in self.place.coordinates_of(foothold.leg).filter(|c| *c >= 3 || *c == axis) {
                    rows.put(2 * k + axis, self.place.q(c), jacobian[c][axis]);
                }
            }
        }
    }

    fn name(&self, row: usize, names: &Names) -> String {
        format!(
            "{} of {} at its foothold{}",
            ["x", "y"][row % 2],
            names.toe(self.footholds[row / 2].leg),
            self.place.step
        )
    }
}
