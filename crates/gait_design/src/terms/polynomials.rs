//! Joints on their polynomials (paper II-A): y ≡ 0, as T² θ̈ − B̈(s) = 0 at every point, and y = 0, T ẏ = 0 where a
//! domain begins.

use super::{At, COEFFICIENTS, EQUAL, FREE, Layout, Names, Place, Rows, Sink, Term};
use crate::limits::keeps_stance_roll;
use gait::{Coefficients, JOINTS, bezier};

/// At a point; rows are joints, rad.
pub(crate) struct Prescribed<L> {
    place: Place<L>,
    /// Joints whose rows are left out here: the fixed distances of the stance toes say the same.
    free: [bool; JOINTS],
    basis: Coefficients,
}

impl<L: Layout> Prescribed<L> {
    /// `redundant_joints` are free at most points.
    pub fn new(place: Place<L>, redundant_joints: &[usize]) -> Self {
        let mut free = [false; JOINTS];
        if !keeps_stance_roll(place.point, place.points) {
            redundant_joints.iter().for_each(|&j| free[j] = true);
        }
        Self { place, free, basis: bezier::basis_second_derivative(place.phase) }
    }
}

impl<L: Layout> Term for Prescribed<L> {
    fn bounds(&self, bounds: &mut Vec<[f64; 2]>) {
        bounds.extend((0..L::JOINTS).map(|j| if self.free[j] { FREE } else { EQUAL }));
    }

    fn values(&self, at: &At, rows: &mut [f64]) {
        let t = at.t() * self.place.share;
        let accelerations = &at.x[self.place.a(6)..];
        for ((row, a), polynomial) in rows.iter_mut().zip(accelerations).zip(self.place.polynomials(at.x, &self.basis))
        {
            *row = t * t * a - polynomial;
        }
    }

    fn derivatives(&self, at: &At, rows: &mut Rows<impl Sink>) {
        let (share, t) = (self.place.share, at.t() * self.place.share);
        for j in 0..L::JOINTS {
            let acceleration = self.place.a(6 + j);
            rows.put(j, acceleration, t * t);
            rows.put(j, at.t_column, 2.0 * t * at.x[acceleration] * share);
            for k in 0..COEFFICIENTS {
                rows.put(j, self.place.alpha(k, j), -self.basis[k]);
            }
        }
    }

    fn name(&self, row: usize, names: &Names) -> String {
        format!("{} on its polynomial, {}", names.joint(row), self.place)
    }
}

/// Where a domain begins: y and then T ẏ of every joint, rad.
pub(crate) struct Begins<L> {
    place: Place<L>,
    value: Coefficients,
    slope: Coefficients,
}

impl<L: Layout> Begins<L> {
    pub fn new(place: Place<L>) -> Self {
        Self { place, value: bezier::basis(0.0), slope: bezier::basis_first_derivative(0.0) }
    }
}

impl<L: Layout> Term for Begins<L> {
    fn bounds(&self, bounds: &mut Vec<[f64; 2]>) {
        bounds.resize(bounds.len() + 2 * L::JOINTS, EQUAL);
    }

    fn values(&self, at: &At, rows: &mut [f64]) {
        let (t, joints) = (at.t() * self.place.share, L::JOINTS);
        let [value, slope] = [&self.value, &self.slope].map(|basis| self.place.polynomials(at.x, basis));
        for j in 0..joints {
            rows[j] = at.x[self.place.q(6 + j)] - value[j];
            rows[joints + j] = t * at.x[self.place.v(6 + j)] - slope[j];
        }
    }

    fn derivatives(&self, at: &At, rows: &mut Rows<impl Sink>) {
        let (share, joints) = (self.place.share, L::JOINTS);
        let t = at.t() * share;
        for j in 0..joints {
            rows.put(j, self.place.q(6 + j), 1.0);
            rows.put(j, self.place.alpha(0, j), -self.value[0]);
            let (row, velocity) = (joints + j, self.place.v(6 + j));
            rows.put(row, velocity, t);
            rows.put(row, at.t_column, at.x[velocity] * share);
            rows.put(row, self.place.alpha(0, j), -self.slope[0]);
            rows.put(row, self.place.alpha(1, j), -self.slope[1]);
        }
    }

    fn name(&self, row: usize, names: &Names) -> String {
        let joints = L::JOINTS;
        let on = if names.apart && row >= joints { "with its polynomial's velocity" } else { "on its polynomial" };
        format!("{} starts {on}{}", names.joint(row % joints), self.place.step)
    }
}
