//! The constraints that programs are made of. Each is one file here, with its bounds, values, derivatives and names;
//! what only one program has is in that program's folder.
//!
//! A term does not know whose program it is in: a [`Place`] says where a point's unknowns lie, [`Bodies`] what the rigid
//! bodies do there. The decomposition is a reduction of the unknowns ([`Layout::joints_of`]): the joints of the rear
//! legs are those of the front legs across.

mod bodies;
pub(crate) mod collocation;
pub(crate) mod dynamics;
pub(crate) mod friction;
mod names;
mod place;
pub(crate) mod polynomials;
mod rows;
pub(crate) mod stance;
pub(crate) mod start;
pub(crate) mod swing;
pub(crate) mod switch;
pub(crate) mod touchdown;

pub(crate) use bodies::{Bodies, InverseDynamics, Toe, ToeMotion};
pub(crate) use names::Names;
pub(crate) use place::{COEFFICIENTS, Layout, Place, Step};
pub(crate) use rows::{Rows, Sink};
use std::ops::Range;

/// What constraints are evaluated at.
pub(crate) struct At<'a> {
    /// The unknowns.
    pub x: &'a [f64],
    /// T's column among them.
    pub t_column: usize,
    /// Dynamics and toes at every point.
    pub bodies: &'a dyn Bodies,
}

impl At<'_> {
    /// T, s.
    pub fn t(&self) -> f64 {
        self.x[self.t_column]
    }
}

/// A constraint at a point, over an interval or where domains meet: rows that are named, bounded, evaluated and
/// differentiated here, in one order.
pub(crate) trait Term {
    /// Adds (lower, upper) of every row.
    fn bounds(&self, bounds: &mut Vec<[f64; 2]>);
    /// Every row's value.
    fn values(&self, at: &At, rows: &mut [f64]);
    /// Every row's derivatives; which there are must not depend on `at`.
    fn derivatives(&self, at: &At, rows: &mut Rows);
    /// Whether its rows join what happens at different times: they are not solved along the schedule
    /// ([`nlp::Order`]), but left to the end.
    fn is_tie(&self) -> bool {
        false
    }
    /// What a row is, for people.
    fn name(&self, row: usize, names: &Names) -> String;
}

/// Where something is equal to 0.
pub(crate) const EQUAL: [f64; 2] = [0.0, 0.0];
const FREE: [f64; 2] = [f64::NEG_INFINITY, f64::INFINITY];
const NOT_NEGATIVE: [f64; 2] = [0.0, f64::INFINITY];

/// The constraints of a program, with where their rows are.
#[derive(Default)]
pub(crate) struct Terms {
    terms: Vec<(Range<usize>, Box<dyn Term + Send>)>,
    bounds: Vec<[f64; 2]>,
}

impl Terms {
    pub fn add(&mut self, term: impl Term + Send + 'static) {
        let first = self.bounds.len();
        term.bounds(&mut self.bounds);
        self.terms.push((first..self.bounds.len(), Box::new(term)));
    }

    /// Lower (0) or upper (1) bounds of every row.
    pub fn bounds(&self, side: usize) -> impl Iterator<Item = f64> {
        self.bounds.iter().map(move |row| row[side])
    }

    /// Rows that are left to the end ([`Term::is_tie`]).
    pub fn ties(&self) -> Vec<usize> {
        self.terms.iter().filter(|(_, term)| term.is_tie()).flat_map(|(rows, _)| rows.clone()).collect()
    }

    pub fn values(&self, at: &At, values: &mut [f64]) {
        for (rows, term) in &self.terms {
            term.values(at, &mut values[rows.clone()]);
        }
    }

    pub fn derivatives(&self, at: &At, sink: &mut Sink) {
        for (rows, term) in &self.terms {
            term.derivatives(at, &mut Rows::new(rows.start, sink));
        }
    }

    pub fn name(&self, row: usize, names: &Names) -> String {
        let index = self.terms.partition_point(|(rows, _)| rows.end <= row);
        let (rows, term) = &self.terms[index];
        term.name(row - rows.start, names)
    }
}
