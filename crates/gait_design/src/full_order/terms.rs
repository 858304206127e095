//! The full-order program's terms: domains × what holds in each, and the links between them.

mod arrival;
mod centred;
mod foothold;
mod tracking_law;

use super::schedule::{Closure, DOF, Schedule, at};
use crate::limits::Limits;
use crate::planar::PlanarMotion;
use crate::terms::dynamics::{Body, Dynamics};
use crate::terms::friction::Friction;
use crate::terms::polynomials::{Begins, Prescribed};
use crate::terms::switch::{Link, Switch};
use crate::terms::{Place, Terms, collocation, stance, start, swing, touchdown};
use robot::Robot;

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

static WHOLE: Body = Body { index: 0, name: None, legs: &[0, 1, 2, 3], torques: at::U, wrench: None };

/// The terms of a schedule.
pub(super) fn of(asked: &Asked) -> Terms {
    let schedule = asked.schedule;
    let mut terms = Terms::default();
    for place in schedule.places() {
        at_a_point(&mut terms, asked, place);
    }
    for domain in 0..schedule.domains.len() {
        for three in schedule.places_of(domain).windows(3).step_by(2) {
            terms.add(collocation::Collocation::new(three.try_into().expect("windows of three")));
        }
    }
    for domain in 0..schedule.domains.len() {
        where_it_begins(&mut terms, asked, domain);
    }
    for domain in 0..schedule.domains.len() {
        where_it_ends(&mut terms, asked, domain);
    }
    if schedule.closure == Closure::Moved {
        terms.add(centred::Centred::new(schedule, asked.motion));
    }
    terms
}

fn at_a_point(terms: &mut Terms, asked: &Asked, place: &Place) {
    let schedule = asked.schedule;
    let d = &schedule.domains[place.domain];
    let mut forces = schedule.forces(place);
    terms.add(Dynamics::new(*place, &WHOLE, 0..DOF, std::array::from_fn(|_| forces.next())));
    if asked.joints_prescribed {
        terms.add(Prescribed::new(*place, &d.redundant_joints));
    } else {
        terms.add(tracking_law::TrackingLaw::new(*place, asked.robot));
    }
    for &leg in &d.stance {
        terms.add(stance::AtRest::new(*place, leg));
    }
    let axes = asked.motion.rotation(place.time * asked.nominal_t_s);
    for force in schedule.forces(place) {
        terms.add(Friction::new(*place, force, asked.friction, axes));
    }
    for &leg in &d.swing {
        terms.add(swing::Height::new(*place, leg, asked.limits.swing_height_m(place.point, place.points)));
    }
}

fn where_it_begins(terms: &mut Terms, asked: &Asked, domain: usize) {
    let (schedule, first) = (asked.schedule, asked.schedule.places_of(domain)[0]);
    let d = &schedule.domains[domain];
    // Where a given state begins, its toes are where they are.
    if domain > 0 || !schedule.is_between() {
        for leg in schedule.newly_standing(&asked.robot.mirror, domain) {
            terms.add(start::OnTheFloor::new(first, leg));
        }
        if schedule.has_footholds() {
            terms.add(foothold::Footholds::new(first, d.footholds.clone(), asked.limits));
        } else {
            let legs = [d.stance[0], d.stance[1]];
            terms.add(start::ToeDistance::new(first, legs, asked.limits.toe_distance_squared_m2));
        }
    }
    if asked.joints_prescribed {
        terms.add(Begins::new(first));
    }
}

fn where_it_ends(terms: &mut Terms, asked: &Asked, domain: usize) {
    let (schedule, motion, duration) = (asked.schedule, asked.motion, asked.schedule.duration());
    let end = *schedule.places_of(domain).last().expect("a domain has points");
    let next = (domain + 1) % schedule.domains.len();
    let link = match &schedule.closure {
        _ if domain + 1 < schedule.domains.len() => Link::Joined,
        Closure::Mirrored => Link::Mirrored { mirror: asked.robot.mirror, motion, duration },
        Closure::Moved => Link::Moved { motion, duration },
        Closure::Between(states) => return terms.add(arrival::Arrival::new(asked, end, &states[1])),
    };
    terms.add(Switch::new(end, schedule.places_of(next)[0], link));
    for leg in schedule.landing(&asked.robot.mirror, domain) {
        terms.add(touchdown::SoftTouchdown::new(end, leg, 0..3));
    }
}
