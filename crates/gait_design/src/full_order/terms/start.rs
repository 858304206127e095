//! What holds where a domain begins: stance toes on the floor and at their distance, joints on their polynomials. That
//! they stay there is said by accelerations.

use super::{At, EQUAL, Names, Place, Rows, Term, coordinates_of};
use crate::full_order::schedule::{COEFFICIENTS, Step, alpha, at};
use crate::limits::Limits;
use gait::{Coefficients, JOINTS, bezier};

/// Rows are the stance toes' heights, m.
pub(super) struct OnTheFloor {
    place: Place,
    stance: Vec<usize>,
    step: Step,
}

impl OnTheFloor {
    pub fn new(place: Place, stance: Vec<usize>, step: Step) -> Self {
        Self { place, stance, step }
    }
}

impl Term for OnTheFloor {
    fn bounds(&self) -> Vec<[f64; 2]> {
        vec![EQUAL; self.stance.len()]
    }

    fn values(&self, at: &At, rows: &mut [f64]) {
        for (k, &leg) in self.stance.iter().enumerate() {
            rows[k] = at.points[self.place.index].toes[leg].position.z;
        }
    }

    fn derivatives(&self, at: &At, rows: &mut Rows) {
        for (k, &leg) in self.stance.iter().enumerate() {
            for c in coordinates_of(leg).filter(|c| *c >= 2) {
                let slope = at.points[self.place.index].toes[leg].jacobian[(2, c)];
                rows.put(k, self.place.column + at::Q + c, slope);
            }
        }
    }

    fn is_tie(&self) -> bool {
        true
    }

    fn name(&self, row: usize, names: &Names) -> String {
        format!("{} on the floor{}", names.toe(self.stance[row]), self.step)
    }
}

/// One row: the squared distance between two stance toes, m².
pub(super) struct ToeDistance {
    place: Place,
    legs: [usize; 2],
    squared_m2: [f64; 2],
    step: Step,
}

impl ToeDistance {
    pub fn new(place: Place, legs: [usize; 2], limits: &Limits, step: Step) -> Self {
        Self { place, legs, squared_m2: limits.toe_distance_squared_m2, step }
    }
}

impl Term for ToeDistance {
    fn bounds(&self) -> Vec<[f64; 2]> {
        vec![self.squared_m2]
    }

    fn values(&self, at: &At, rows: &mut [f64]) {
        let [a, b] = self.legs.map(|leg| &at.points[self.place.index].toes[leg]);
        rows[0] = (b.position - a.position).norm_squared();
    }

    fn derivatives(&self, at: &At, rows: &mut Rows) {
        let [a, b] = self.legs;
        let [from, to] = self.legs.map(|leg| &at.points[self.place.index].toes[leg]);
        let between = (to.position - from.position) * 2.0;
        for c in (3..6).chain(6 + 3 * a..9 + 3 * a).chain(6 + 3 * b..9 + 3 * b) {
            let slope = (to.jacobian.column(c) - from.jacobian.column(c)).dot(&between);
            rows.put(0, self.place.column + at::Q + c, slope);
        }
    }

    fn name(&self, _: usize, _: &Names) -> String {
        format!("squared distance between the stance toes{}", self.step)
    }
}

/// y = 0 and T ẏ = 0 of every joint, rad.
pub(super) struct OnPolynomials {
    place: Place,
    value: Coefficients,
    slope: Coefficients,
    step: Step,
}

impl OnPolynomials {
    pub fn new(place: Place, step: Step) -> Self {
        Self { place, value: bezier::basis(0.0), slope: bezier::basis_first_derivative(0.0), step }
    }
}

impl Term for OnPolynomials {
    fn bounds(&self) -> Vec<[f64; 2]> {
        vec![EQUAL; 2 * JOINTS]
    }

    fn values(&self, at: &At, rows: &mut [f64]) {
        let (t, p) = (at.t() * self.place.share, &at.x[self.place.column..]);
        for j in 0..JOINTS {
            let sum = |basis: &Coefficients| {
                (0..COEFFICIENTS).map(|k| at.x[alpha(self.place.domain, k, j)] * basis[k]).sum::<f64>()
            };
            rows[j] = p[at::Q + 6 + j] - sum(&self.value);
            rows[JOINTS + j] = t * p[at::V + 6 + j] - sum(&self.slope);
        }
    }

    fn derivatives(&self, at: &At, rows: &mut Rows) {
        let (share, p, domain) = (self.place.share, self.place.column, self.place.domain);
        let t = at.t() * share;
        for j in 0..JOINTS {
            rows.put(j, p + at::Q + 6 + j, 1.0);
            rows.put(j, alpha(domain, 0, j), -self.value[0]);
            let row = JOINTS + j;
            rows.put(row, p + at::V + 6 + j, t);
            rows.put(row, at.t_column, at.x[p + at::V + 6 + j] * share);
            rows.put(row, alpha(domain, 0, j), -self.slope[0]);
            rows.put(row, alpha(domain, 1, j), -self.slope[1]);
        }
    }

    fn name(&self, row: usize, names: &Names) -> String {
        format!("{} starts on its polynomial{}", names.joint(row % JOINTS), self.step)
    }
}
