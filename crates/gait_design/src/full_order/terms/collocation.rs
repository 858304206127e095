//! Hermite–Simpson defects of q and q̇ over an interval of length h (paper III).

use super::{At, EQUAL, Names, Place, Rows, Term};
use crate::full_order::schedule::{DOF, Step, at};

/// What is integrated, and its rate.
const INTEGRATED: [(usize, usize); 2] = [(at::Q, at::V), (at::V, at::A)];

/// Over an interval's three points; of q and then of q̇: the middle's defects, the end's.
pub(super) struct Collocation {
    places: [Place; 3],
    step: Step,
}

impl Collocation {
    pub fn new(places: [Place; 3], step: Step) -> Self {
        Self { places, step }
    }

    /// h over T.
    fn length(&self) -> f64 {
        2.0 * self.places[0].share / (self.places[0].points - 1) as f64
    }
}

impl Term for Collocation {
    fn bounds(&self) -> Vec<[f64; 2]> {
        vec![EQUAL; 4 * DOF]
    }

    fn values(&self, at: &At, rows: &mut [f64]) {
        let h = 2.0 * (at.t() * self.places[0].share) / (self.places[0].points - 1) as f64;
        let p = self.places.map(|place| &at.x[place.column..]);
        for (block, (value, slope)) in INTEGRATED.into_iter().enumerate() {
            for i in 0..DOF {
                let [x0, x1, x2] = p.map(|p| p[value + i]);
                let [f0, f1, f2] = p.map(|p| p[slope + i]);
                rows[2 * DOF * block + i] = x1 - (x0 + x2) / 2.0 - h / 8.0 * (f0 - f2);
                rows[2 * DOF * block + DOF + i] = x2 - x0 - h / 6.0 * (f0 + 4.0 * f1 + f2);
            }
        }
    }

    fn derivatives(&self, at: &At, rows: &mut Rows) {
        let per_t = self.length();
        let h = per_t * at.t();
        let p = self.places.map(|place| place.column);
        for (block, (value, slope)) in INTEGRATED.into_iter().enumerate() {
            for i in 0..DOF {
                let [f0, f1, f2] = p.map(|p| at.x[p + slope + i]);
                let row = 2 * DOF * block + i;
                rows.put(row, p[0] + value + i, -0.5);
                rows.put(row, p[1] + value + i, 1.0);
                rows.put(row, p[2] + value + i, -0.5);
                rows.put(row, p[0] + slope + i, -h / 8.0);
                rows.put(row, p[2] + slope + i, h / 8.0);
                rows.put(row, at.t_column, -per_t / 8.0 * (f0 - f2));
                let row = row + DOF;
                rows.put(row, p[0] + value + i, -1.0);
                rows.put(row, p[2] + value + i, 1.0);
                rows.put(row, p[0] + slope + i, -h / 6.0);
                rows.put(row, p[1] + slope + i, -4.0 * h / 6.0);
                rows.put(row, p[2] + slope + i, -h / 6.0);
                rows.put(row, at.t_column, -per_t / 6.0 * (f0 + 4.0 * f1 + f2));
            }
        }
    }

    fn name(&self, _: usize, _: &Names) -> String {
        format!("Hermite–Simpson defect, interval {}{}", self.places[0].point / 2 + 1, self.step)
    }
}
