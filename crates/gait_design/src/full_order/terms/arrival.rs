//! The state that a transition is to reach, anywhere on the floor. The landing legs' joints stand in place of a soft
//! touchdown: with the body's pose and rates they put the toes on the floor, at rest. The departing toes stand already;
//! where they do, from the body, is theirs to reach.
//!
//! Every row may be missed by an unknown of its own, m, which costs: q_i − q*_i − m = 0 and q̇_i − q̇*_i − m = 0 of
//! single coordinates, and of a toe at p, with the body at b, (p − b)_xy − (p* − b*)_xy − m = 0.

use super::Asked;
use crate::full_order::goal::{Part, parts, what};
use crate::full_order::schedule::{Domain, Place};
use crate::full_order::state::State;
use crate::terms::{At, EQUAL, Names, Rows, Sink, Term};
use nalgebra::Vector2;

/// At a schedule's end; rows in the order of their parts, m, rad, m/s, rad/s.
pub(super) struct Arrival {
    place: Place,
    last: Domain,
    /// First of what is missed.
    missed: usize,
    /// Of every row.
    targets: Vec<f64>,
}

impl Arrival {
    pub fn new(asked: &Asked, place: Place, state: &State) -> Self {
        let last = asked.schedule.domains[place.domain].clone();
        let toes = state.toes_m(asked.robot);
        let target = |part: Part| match part {
            Part::Position { coordinate } => state.q[coordinate],
            Part::Rate { coordinate } => state.v[coordinate],
            Part::Toe { leg, axis } => toes[leg][axis] - state.q[axis],
        };
        let targets = parts(&last.stance, &last.swing).map(target).collect();
        Self { place, last, missed: asked.schedule.missed().start, targets }
    }
}

impl Term for Arrival {
    fn bounds(&self, bounds: &mut Vec<[f64; 2]>) {
        bounds.resize(bounds.len() + self.targets.len(), EQUAL);
    }

    fn values(&self, at: &At, rows: &mut [f64]) {
        let (place, x) = (&self.place, at.x);
        for (row, part) in parts(&self.last.stance, &self.last.swing).enumerate() {
            let value = match part {
                Part::Position { coordinate } => x[place.q(coordinate)],
                Part::Rate { coordinate } => x[place.v(coordinate)],
                Part::Toe { leg, axis } => {
                    let body = Vector2::new(x[place.q(0)], x[place.q(1)]);
                    (at.bodies.toe(place.index, leg).position.xy() - body)[axis]
                }
            };
            rows[row] = value - self.targets[row] - at.x[self.missed + row];
        }
    }

    fn derivatives(&self, at: &At, rows: &mut Rows<impl Sink>) {
        let place = &self.place;
        for (row, part) in parts(&self.last.stance, &self.last.swing).enumerate() {
            match part {
                Part::Position { coordinate } => rows.put(row, place.q(coordinate), 1.0),
                Part::Rate { coordinate } => rows.put(row, place.v(coordinate), 1.0),
                // By x and y of the body nothing changes.
                Part::Toe { leg, axis } => {
                    for c in place.coordinates_of(leg).filter(|c| *c >= 3) {
                        rows.put(row, place.q(c), at.bodies.toe(place.index, leg).jacobian[c][axis]);
                    }
                }
            }
            rows.put(row, self.missed + row, -1.0);
        }
    }

    fn is_tie(&self) -> bool {
        true
    }

    fn name(&self, row: usize, names: &Names) -> String {
        format!("{} at the end", what([&self.last.stance, &self.last.swing], row, names))
    }
}
