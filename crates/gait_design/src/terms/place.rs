//! Where the unknowns lie that a term reads.

use gait::{JOINTS, LEGS, bezier};
use robot::Mirror;
use std::marker::PhantomData;

/// Coefficients of a polynomial.
pub(crate) const COEFFICIENTS: usize = bezier::DEGREE + 1;

/// Which of the robot's coordinates a coordinate of its mirror image is, and with which sign.
pub(crate) type Mirrored = fn(&Mirror, usize) -> (usize, f64);

/// A program's coordinates, and where they lie among a point's unknowns. A type, for its numbers are those of the
/// innermost loops.
pub(crate) trait Layout: Copy + std::fmt::Debug + Send + 'static {
    /// The base's six and then joints, which have a polynomial each.
    const COORDINATES: usize;
    /// The joints among them.
    const JOINTS: usize = Self::COORDINATES - 6;
    /// First of each leg's three joints among the coordinates. A leg that follows another has the other's.
    const JOINTS_OF: [usize; LEGS];
    /// Where q, q̇ and q̈ begin among a point's unknowns.
    const Q: usize;
    const V: usize;
    const A: usize;
    const MIRRORED: Mirrored;
    /// Where a stance toe's accelerations are in its rows: sums over a row are rounded in the order of its entries.
    const ACCELERATIONS_LAST: bool;
}

/// A Hermite–Simpson point.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Place<L> {
    pub layout: PhantomData<L>,
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

impl<L: Layout> Place<L> {
    /// Column of a coordinate.
    pub fn q(&self, coordinate: usize) -> usize {
        self.column + L::Q + coordinate
    }

    /// Column of a coordinate's velocity.
    pub fn v(&self, coordinate: usize) -> usize {
        self.column + L::V + coordinate
    }

    /// Column of a coordinate's acceleration.
    pub fn a(&self, coordinate: usize) -> usize {
        self.column + L::A + coordinate
    }

    /// Column of coefficient `k` of a joint's polynomial in its domain.
    pub fn alpha(&self, k: usize, joint: usize) -> usize {
        (self.domain * COEFFICIENTS + k) * L::JOINTS + joint
    }

    /// Σ_k α_k basis_k of every joint.
    #[inline]
    pub fn polynomials(&self, x: &[f64], basis: &[f64; COEFFICIENTS]) -> [f64; JOINTS] {
        let mut sums = [0.0; JOINTS];
        for (k, basis) in basis.iter().enumerate() {
            let coefficients = &x[self.alpha(k, 0)..][..L::JOINTS];
            for (sum, coefficient) in sums.iter_mut().zip(coefficients) {
                *sum += coefficient * basis;
            }
        }
        sums
    }

    /// The coordinates that move a leg's toe: the base's and its joints'.
    pub fn coordinates_of(&self, leg: usize) -> impl Iterator<Item = usize> + use<L> {
        let first = L::JOINTS_OF[leg];
        (0..6).chain(first..first + 3)
    }
}

/// Which point, for people.
impl<L> std::fmt::Display for Place<L> {
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
