//! The dynamics of a rigid body system (paper eq. 1): D q̈ + H − Jᵀ λ − B u = 0; of a biped (paper II-C), with the
//! wrench λc that the other one's half of the torso has on its own.

use super::{At, EQUAL, Layout, Names, Place, Rows, Sink, Term};
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
pub(crate) struct Dynamics<L> {
    pub place: Place<L>,
    pub body: &'static Body,
    pub coordinates: Range<usize>,
    /// Legs that stand, and where their forces begin.
    pub forces: [Option<(usize, usize)>; LEGS],
}

impl<L: Layout> Dynamics<L> {
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

impl<L: Layout> Term for Dynamics<L> {
    fn bounds(&self, bounds: &mut Vec<[f64; 2]>) {
        bounds.resize(bounds.len() + self.coordinates.len(), EQUAL);
    }

    fn values(&self, at: &At, rows: &mut [f64]) {
        let tau = at.bodies.dynamics(self.place.index, self.body.index).tau;
        rows.copy_from_slice(&tau[self.coordinates.clone()]);
        let (base, joints) = rows.split_at_mut(6_usize.saturating_sub(self.coordinates.start));
        for (rows, first) in [(base, self.coordinates.start), (joints, self.coordinates.start.max(6))] {
            if let Some((column, sign)) = self.actuation(first) {
                rows.iter_mut().zip(&at.x[column..]).for_each(|(row, u)| *row += sign * u);
            }
        }
    }

    fn derivatives(&self, at: &At, rows: &mut Rows<impl Sink>) {
        let d = at.bodies.dynamics(self.place.index, self.body.index);
        let forces = self
            .forces
            .map(|force| force.map(|(leg, first)| (leg, first, at.bodies.force_jacobian(self.place.index, leg))));
        for (row, i) in self.coordinates.clone().enumerate() {
            // Two legs meet only in the base.
            let felt = match self.leg(i) {
                Some(leg) => L::JOINTS_OF[leg]..L::JOINTS_OF[leg] + 3,
                None => 6..L::COORDINATES,
            };
            for columns in [0..6, felt] {
                for c in columns {
                    let entry = L::COORDINATES * c + i;
                    rows.put(row, self.place.q(c), d.dtau_dq[entry]);
                    rows.put(row, self.place.v(c), d.dtau_dv[entry]);
                    rows.put(row, self.place.a(c), d.mass_matrix[entry]);
                }
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
