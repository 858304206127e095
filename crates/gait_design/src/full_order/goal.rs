//! Which numbers say that a state is reached where a domain ends.

use crate::terms::Names;

/// One of them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Part {
    /// A coordinate.
    Position { coordinate: usize },
    /// A coordinate's rate.
    Rate { coordinate: usize },
    /// x or y of a toe from the body.
    Toe { leg: usize, axis: usize },
}

/// z, roll, pitch, yaw; the base's six rates; of each landing leg three joints and their rates; of each departing toe
/// x and y.
pub(super) fn parts(departing: &[usize], landing: &[usize]) -> impl Iterator<Item = Part> {
    let position = |coordinate| Part::Position { coordinate };
    let rate = |coordinate| Part::Rate { coordinate };
    let joints = |leg: usize| 6 + 3 * leg..9 + 3 * leg;
    let base = (2..6).map(position).chain((0..6).map(rate));
    let landed = landing.iter().flat_map(move |&leg| joints(leg).map(position).chain(joints(leg).map(rate)));
    let toes = departing.iter().flat_map(|&leg| (0..2).map(move |axis| Part::Toe { leg, axis }));
    base.chain(landed).chain(toes)
}

/// What a part is, for people; legs depart and land.
pub(super) fn what([departing, landing]: [&[usize]; 2], index: usize, names: &Names) -> String {
    match parts(departing, landing).nth(index).expect("a part's index") {
        Part::Position { coordinate } => names.coordinate(coordinate),
        Part::Rate { coordinate } => format!("the velocity of {}", names.coordinate(coordinate)),
        Part::Toe { leg, axis } => format!("{} of {} from the body", ["x", "y"][axis], names.toe(leg)),
    }
}

impl Part {
    /// Its unit.
    pub fn unit(self) -> &'static str {
        match self {
            Self::Position { coordinate: 0..3 } | Self::Toe { .. } => "m",
            Self::Position { .. } => "rad",
            Self::Rate { coordinate: 0..3 } => "m/s",
            Self::Rate { .. } => "rad/s",
        }
    }

    /// By how much it may be missed: a gait that begins so far from its first state returns to itself.
    pub fn allowed(self) -> f64 {
        match self {
            Self::Position { coordinate: 0..3 } | Self::Toe { .. } => 0.005,
            Self::Position { .. } => 0.01,
            Self::Rate { coordinate: 0..3 } => 0.02,
            Self::Rate { coordinate: 3..6 } => 0.05,
            Self::Rate { .. } => 0.1,
        }
    }
}
