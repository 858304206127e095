//! The constraints that programs are made of. Each is one file here, with its bounds, values, derivatives and names;
//! what only one program has is in that program's folder.
//!
//! A term does not know whose program it is in: a [`Place`] says where a point's unknowns lie, [`Bodies`] what the
//! rigid bodies do there. The decomposition is a reduction of the unknowns ([`Layout::JOINTS_OF`]): the joints of the
//! rear legs are those of the front legs across.

mod bodies;
mod collocation;
mod distance;
mod dynamics;
pub(crate) mod friction;
mod height;
mod names;
mod place;
mod polynomials;
mod rows;
mod stance;
mod switch;
mod touchdown;

use nlp::Pattern;
use rows::{Places, Steepest, Values};
use std::ops::Range;

pub(crate) use bodies::{Bodies, InverseDynamics, Toe, ToeMotion};
pub(crate) use collocation::Collocation;
pub(crate) use distance::ToeDistance;
pub(crate) use dynamics::{Body, Dynamics};
pub(crate) use friction::Friction;
pub(crate) use height::{Height, Of};
pub(crate) use names::Names;
pub(crate) use place::{COEFFICIENTS, Layout, Mirrored, Place, Step};
pub(crate) use polynomials::{Begins, Prescribed};
pub(crate) use rows::{Rows, Sink};
pub(crate) use stance::AtRest;
pub(crate) use switch::Switch;
pub(crate) use touchdown::SoftTouchdown;

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
    fn derivatives(&self, at: &At, rows: &mut Rows<impl Sink>)
    where
        Self: Sized;
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

/// A term with its derivatives for each sink: a call for every nonzero would take longer than the nonzero.
trait AnyTerm: Term + Send {
    fn places(&self, at: &At, rows: &mut Rows<Places>);
    fn jacobian(&self, at: &At, rows: &mut Rows<Values>);
    fn steepest(&self, at: &At, rows: &mut Rows<Steepest>);
}

impl<T: Term + Send> AnyTerm for T {
    fn places(&self, at: &At, rows: &mut Rows<Places>) {
        self.derivatives(at, rows);
    }

    fn jacobian(&self, at: &At, rows: &mut Rows<Values>) {
        self.derivatives(at, rows);
    }

    fn steepest(&self, at: &At, rows: &mut Rows<Steepest>) {
        self.derivatives(at, rows);
    }
}

/// The constraints of a program, with where their rows are.
#[derive(Default)]
pub(crate) struct Terms {
    terms: Vec<(Range<usize>, Box<dyn AnyTerm>)>,
    bounds: Vec<[f64; 2]>,
}

impl Terms {
    pub fn add(&mut self, term: impl Term + Send + 'static) {
        let first = self.bounds.len();
        term.bounds(&mut self.bounds);
        self.terms.push((first..self.bounds.len(), Box::new(term)));
    }

    /// The same, where the term's rows are to begin at `row`.
    ///
    /// # Panics
    ///
    /// If the rows before end elsewhere.
    pub fn add_at(&mut self, row: usize, term: impl Term + Send + 'static) {
        assert_eq!(self.bounds.len(), row, "the terms before have other rows than the program's layout says");
        self.add(term);
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

    /// Where the nonzeros of ∂g/∂x are.
    pub fn pattern(&self, at: &At) -> Pattern {
        let mut places = Places(Vec::new());
        self.each(&mut places, |term, rows| term.places(at, rows));
        Pattern(places.0)
    }

    /// The values of ∂g/∂x on its pattern.
    pub fn jacobian(&self, at: &At, values: &mut [f64]) {
        self.each(&mut Values(values.iter_mut()), |term, rows| term.jacobian(at, rows));
    }

    /// The size of the largest entry of ∂g/∂x in every row.
    pub fn steepest(&self, at: &At) -> Vec<f64> {
        let mut steepest = vec![0.0; self.bounds.len()];
        self.each(&mut Steepest(&mut steepest), |term, rows| term.steepest(at, rows));
        steepest
    }

    fn each<S: Sink>(&self, sink: &mut S, put: impl Fn(&dyn AnyTerm, &mut Rows<S>)) {
        for (rows, term) in &self.terms {
            put(&**term, &mut Rows { first: rows.start, sink: &mut *sink });
        }
    }

    pub fn name(&self, row: usize, names: &Names) -> String {
        let index = self.terms.partition_point(|(rows, _)| rows.end <= row);
        let (rows, term) = &self.terms[index];
        term.name(row - rows.start, names)
    }
}

#[cfg(test)]
impl Terms {
    /// Fails unless every row is bounded, named, written and differentiated by its own term.
    pub fn check(&self, at: &At, names: &Names) {
        for (rows, term) in &self.terms {
            let mut bounds = Vec::new();
            term.bounds(&mut bounds);
            assert_eq!(bounds.len(), rows.len(), "{}: bounds", term.name(0, names));
            let mut values = vec![f64::NAN; rows.len()];
            term.values(at, &mut values);
            let mut places = Places(Vec::new());
            term.places(at, &mut Rows { first: 0, sink: &mut places });
            assert!(places.0.iter().all(|place| place.0 < rows.len()), "{}: another's row", term.name(0, names));
            for (row, value) in values.iter().enumerate() {
                let name = term.name(row, names);
                assert!(!name.is_empty() && value.is_finite(), "{name} is {value}");
                assert!(places.0.iter().any(|place| place.0 == row), "{name}: it has no derivative");
            }
        }
    }
}
