//! The dynamics of a rigid body system (paper eq. 1): D q̈ + H − Jᵀ λ − B u = 0; of a biped (paper II-C), with the
//! wrench λc that the other one's half of the torso has on its own.

use super::{At, EQUAL, Names, Place, Rows, Term};
use gait::LEGS;
use std::ops::Range;

/// A rigid body system whose dynamics a program has.
pub(crate) struct Body {
    /// Among the program's.
    pub index: usize,
    /// Whose dynamics they are, where the program has more than one.
    pub name: Option<&'static str>,
    /// The legs whose joints are its own coordinates, after the base's six.
    pub legs: &'static [usize],
    /// Where its torques begin among a point's unknowns.
    pub torques: usize,
    /// Where the wrench on its base begins among a point's unknowns, and its sign in the rows.
    pub wrench: Option<(usize, f64)>,
}

/// At a point; rows are some of the body's own coordinates, N and N m.
pub(crate) struct Dynamics {
    place: Place,
    body: &'static Body,
    coordinates: Range<usize>,
    /// Legs that stand, and where their forces begin.
    forces: [Option<(usize, usize)>; LEGS],
}

impl Dynamics {
    pub fn new(
        place: Place,
        body: &'static Body,
        coordinates: Range<usize>,
        forces: [Option<(usize, usize)>; LEGS],
    ) -> Self {
        Self { place, body, coordinates, forces }
    }

    /// The leg of one of the body's coordinates; none of the base's.
    fn leg(&self, coordinate: usize) -> Option<usize> {
        coordinate.checked_sub(6).map(|joint| self.body.legs[joint / 3])
    }

    /// Column of the torque or the wrench of a coordinate, and its sign.
    fn actuation(&self, coordinate: usize) -> Option<(usize, f64)> {
        match coordinate.checked_sub(6) {
            Some(joint) => Some((self.place.column + self.body.torques + joint, -1.0)),
            None => self.body.wrench.map(|(first, sign)| (self.place.column + first + coordinate, sign)),
        }
    }
}

impl Term for Dynamics {
    fn bounds(&self, bounds: &mut Vec<[f64; 2]>) {
        bounds.resize(bounds.len() + self.coordinates.len(), EQUAL);
    }

    fn values(&self, at: &At, rows: &mut [f64]) {
        let tau = at.bodies.dynamics(self.place.index, self.body.index).tau;
        for (row, i) in rows.iter_mut().zip(self.coordinates.clone()) {
            *row = self.actuation(i).map_or(tau[i], |(column, sign)| tau[i] + sign * at.x[column]);
        }
    }

    fn derivatives(&self, at: &At, rows: &mut Rows) {
        let d = at.bodies.dynamics(self.place.index, self.body.index);
        let forces = self
            .forces
            .map(|force| force.map(|(leg, first)| (leg, first, at.bodies.force_jacobian(self.place.index, leg))));
        for (row, i) in self.coordinates.clone().enumerate() {
            // Two legs meet only in the base.
            let felt = match self.leg(i) {
                Some(leg) => self.place.layout.joints_of[leg]..self.place.layout.joints_of[leg] + 3,
                None => 6..self.place.layout.coordinates,
            };
            for c in (0..6).chain(felt) {
                let entry = d.tau.len() * c + i;
                rows.put(row, self.place.q(c), d.dtau_dq[entry]);
                rows.put(row, self.place.v(c), d.dtau_dv[entry]);
                rows.put(row, self.place.a(c), d.mass_matrix[entry]);
            }
            for (leg, first, jacobian) in forces.iter().flatten() {
                if self.leg(i).is_none_or(|own| own == *leg) {
                    for axis in 0..3 {
                        rows.put(row, first + axis, -jacobian[i][axis]);
                    }
                }
            }
            if let Some((column, sign)) = self.actuation(i) {
                rows.put(row, column, sign);
            }
        }
    }

    fn name(&self, row: usize, names: &Names) -> String {
        let i = self.coordinates.start + row;
        match (self.leg(i), self.body.name) {
            (Some(leg), _) => format!("dynamics of {}, {}", names.joint_of(leg, i % 3), self.place),
            (None, Some(whose)) => format!("{whose} dynamics, {}, {}", names.base(i), self.place),
            (None, None) => format!("dynamics of {}, {}", names.base(i), self.place),
        }
    }
}
