//! Where the unknowns lie that a term reads.

use gait::{LEGS, bezier};
use robot::Mirror;

/// Coefficients of a polynomial.
pub(crate) const COEFFICIENTS: usize = bezier::DEGREE + 1;

/// A program's coordinates, and where they lie among a point's unknowns.
#[derive(Debug)]
pub(crate) struct Layout {
    /// The base's six and then joints, which have a polynomial each.
    pub coordinates: usize,
    /// First of each leg's three joints among the coordinates. A leg that follows another has the other's.
    pub joints_of: [usize; LEGS],
    /// Where q, q̇ and q̈ begin among a point's unknowns.
    pub q: usize,
    pub v: usize,
    pub a: usize,
    /// Which coordinate of the other side a coordinate of the mirrored robot is, and with which sign.
    pub mirrored: fn(&Mirror, usize) -> (usize, f64),
}

/// A Hermite–Simpson point.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Place {
    pub layout: &'static Layout,
    /// Counted through all domains: a switch has two, the last of one and the first of the next.
    pub index: usize,
    /// First of its unknowns.
    pub column: usize,
    pub domain: usize,
    /// Counted within its domain.
    pub point: usize,
    /// Points of its domain.
    pub points: usize,
    /// Share of its domain that has passed.
    pub phase: f64,
    /// Duration of its domain over T.
    pub share: f64,
    /// Time since the schedule began, over T.
    pub time: f64,
    /// For names.
    pub step: Step,
}

impl Place {
    /// Column of a coordinate.
    pub fn q(&self, coordinate: usize) -> usize {
        self.column + self.layout.q + coordinate
    }

    /// Column of a coordinate's velocity.
    pub fn v(&self, coordinate: usize) -> usize {
        self.column + self.layout.v + coordinate
    }

    /// Column of a coordinate's acceleration.
    pub fn a(&self, coordinate: usize) -> usize {
        self.column + self.layout.a + coordinate
    }

    /// Joints among the coordinates.
    pub fn joints(&self) -> usize {
        self.layout.coordinates - 6
    }

    /// Column of coefficient `k` of a joint's polynomial in its domain.
    pub fn alpha(&self, k: usize, joint: usize) -> usize {
        (self.domain * COEFFICIENTS + k) * self.joints() + joint
    }

    /// Σ_k α_k basis_k of a joint.
    pub fn polynomial(&self, x: &[f64], joint: usize, basis: &[f64; COEFFICIENTS]) -> f64 {
        (0..COEFFICIENTS).map(|k| x[self.alpha(k, joint)] * basis[k]).sum()
    }

    /// The coordinates that move a leg's toe: the base's and its joints'.
    pub fn coordinates_of(&self, leg: usize) -> impl Iterator<Item = usize> + use<> {
        let first = self.layout.joints_of[leg];
        (0..6).chain(first..first + 3)
    }
}

/// Which point, for people.
impl std::fmt::Display for Place {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "point {} of {}{}", self.point + 1, self.points, self.step)
    }
}

/// " of step 2", where there is more than one.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Step(pub Option<usize>);

impl std::fmt::Display for Step {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        self.0.map_or(Ok(()), |number| write!(f, " of step {number}"))
    }
}
