//! The program's constraints. Each is one file here, with its bounds, values, derivatives and names.

mod arrival;
mod centred;
mod collocation;
mod dynamics;
mod foothold;
mod friction;
mod outputs;
mod stance;
mod start;
mod swing;
mod switch;
mod touchdown;
mod tracking_law;

use super::names::Names;
use super::point::Point;
use super::schedule::{Closure, Place, Schedule};
use crate::limits::Limits;
use crate::planar::PlanarMotion;
use crate::program::Sink;
use robot::Robot;

/// What constraints are evaluated at.
pub(super) struct At<'a> {
    /// The unknowns.
    pub x: &'a [f64],
    /// T's column among them.
    pub t_column: usize,
    /// Dynamics and toes at every point.
    pub points: &'a [Point],
}

impl At<'_> {
    /// T, s.
    pub fn t(&self) -> f64 {
        self.x[self.t_column]
    }
}

/// A constraint at a point, over an interval or where domains meet: rows that are named, bounded, evaluated and
/// differentiated here, in one order.
pub(super) trait Term {
    /// (lower, upper) of every row.
    fn bounds(&self) -> Vec<[f64; 2]>;
    /// Every row's value.
    fn values(&self, at: &At, rows: &mut [f64]);
    /// Every row's derivatives; which there are must not depend on `at`.
    fn derivatives(&self, at: &At, rows: &mut Rows);
    /// Whether its rows join what happens at different times: they are not solved along the schedule
    /// ([`super::order`]), but left to the end.
    fn is_tie(&self) -> bool {
        false
    }
    /// What a row is, for people.
    fn name(&self, row: usize, names: &Names) -> String;
}

/// Takes the derivatives of a term's rows, counted from its first.
pub(super) struct Rows<'a> {
    first: usize,
    sink: &'a mut dyn Sink,
}

impl Rows<'_> {
    pub fn put(&mut self, row: usize, column: usize, value: f64) {
        self.sink.put(self.first + row, column, value);
    }
}

/// Where something is equal to 0.
pub(super) const EQUAL: [f64; 2] = [0.0, 0.0];
const FREE: [f64; 2] = [f64::NEG_INFINITY, f64::INFINITY];
const NOT_NEGATIVE: [f64; 2] = [0.0, f64::INFINITY];

/// A leg's coordinates: the base's and its joints'.
fn coordinates_of(leg: usize) -> impl Iterator<Item = usize> {
    (0..6).chain(6 + 3 * leg..9 + 3 * leg)
}

/// The constraints of a program, with where their rows begin.
pub(super) struct Terms(Vec<(usize, Box<dyn Term + Send>)>);

/// What the constraints are made of.
pub(super) struct Asked<'a> {
    pub robot: &'a Robot,
    pub schedule: &'a Schedule,
    pub limits: &'a Limits,
    pub motion: PlanarMotion,
    /// T asked for, s: where axes turn along, they do so at its pace.
    pub nominal_t_s: f64,
    /// Friction coefficient.
    pub friction: f64,
    /// Whether the polynomials are the joints' own, and not the reference that they follow.
    pub joints_prescribed: bool,
}

impl Terms {
    /// Domains × what holds in each, and the links between them.
    pub fn of(asked: &Asked) -> Self {
        let schedule = asked.schedule;
        let mut terms = Self(Vec::new());
        for place in schedule.places() {
            terms.at_a_point(asked, place);
        }
        for domain in 0..schedule.domains.len() {
            for three in schedule.places_of(domain).windows(3).step_by(2) {
                let [a, b, c] = three else { unreachable!("windows of three") };
                terms.add(collocation::Collocation::new([*a, *b, *c], schedule.step_of(domain)));
            }
        }
        for (domain, d) in schedule.domains.iter().enumerate() {
            let (first, step) = (schedule.places_of(domain)[0], schedule.step_of(domain));
            // Where a given state begins, its toes are where they are.
            if domain > 0 || !schedule.is_between() {
                terms.add(start::OnTheFloor::new(first, schedule.newly_standing(&asked.robot.mirror, domain), step));
                if schedule.has_footholds() {
                    terms.add(foothold::Footholds::new(first, d.footholds.clone(), asked.limits, step));
                } else {
                    terms.add(start::ToeDistance::new(first, [d.stance[0], d.stance[1]], asked.limits, step));
                }
            }
            if asked.joints_prescribed {
                terms.add(start::OnPolynomials::new(first, step));
            }
        }
        for domain in 0..schedule.domains.len() {
            let end = *schedule.places_of(domain).last().expect("a domain has points");
            let step = schedule.step_of(domain);
            if domain + 1 == schedule.domains.len()
                && let Closure::Between(states) = &schedule.closure
            {
                terms.add(arrival::Arrival::new(asked, end, &states[1]));
            } else {
                terms.add(switch::Switch::new(asked, end));
                terms.add(touchdown::SoftTouchdown::new(end, schedule.landing(&asked.robot.mirror, domain), step));
            }
        }
        if schedule.closure == Closure::Moved {
            terms.add(centred::Centred::new(schedule, asked.motion));
        }
        terms
    }

    fn at_a_point(&mut self, asked: &Asked, place: &Place) {
        let d = &asked.schedule.domains[place.domain];
        let suffix = format!(", point {} of {}{}", place.point + 1, place.points, asked.schedule.step_of(place.domain));
        self.add(dynamics::Dynamics::new(*place, d.stance.clone(), suffix.clone()));
        if asked.joints_prescribed {
            self.add(outputs::PrescribedJoints::new(*place, d.redundant_joints.clone(), suffix.clone()));
        } else {
            self.add(tracking_law::TrackingLaw::new(*place, asked.robot, suffix.clone()));
        }
        let axes = asked.motion.rotation(place.time * asked.nominal_t_s);
        self.add(stance::AtRest::new(*place, d.stance.clone(), suffix.clone()));
        self.add(friction::Friction::new(*place, d.stance.clone(), asked.friction, axes, suffix.clone()));
        self.add(swing::Height::new(*place, d.swing.clone(), asked.limits, suffix));
    }

    fn add(&mut self, term: impl Term + Send + 'static) {
        self.0.push((self.rows(), Box::new(term)));
    }

    /// Rows of all terms.
    pub fn rows(&self) -> usize {
        self.0.last().map_or(0, |(first, term)| first + term.bounds().len())
    }

    /// (lower, upper) of every row.
    pub fn bounds(&self) -> Vec<[f64; 2]> {
        self.0.iter().flat_map(|(_, term)| term.bounds()).collect()
    }

    /// Rows that are left to the end ([`Term::is_tie`]).
    pub fn ties(&self) -> Vec<usize> {
        let ties = self.0.iter().filter(|(_, term)| term.is_tie());
        ties.flat_map(|(first, term)| *first..first + term.bounds().len()).collect()
    }

    pub fn values(&self, at: &At, values: &mut [f64]) {
        for (first, term) in &self.0 {
            term.values(at, &mut values[*first..]);
        }
    }

    pub fn derivatives(&self, at: &At, sink: &mut dyn Sink) {
        for (first, term) in &self.0 {
            term.derivatives(at, &mut Rows { first: *first, sink: &mut *sink });
        }
    }

    pub fn name(&self, row: usize, names: &Names) -> String {
        let index = self.0.partition_point(|(first, _)| *first <= row) - 1;
        let (first, term) = &self.0[index];
        term.name(row - first, names)
    }
}
