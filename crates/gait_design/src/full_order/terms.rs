//! The full-order program's terms: domains × what holds in each, and the links between them.

mod arrival;
mod centred;
mod foothold;
mod tracking_law;

use super::schedule::{Closure, DOF, Place, Schedule, at};
use crate::limits::Limits;
use crate::planar::PlanarMotion;
use crate::request::GaitRequest;
use crate::terms::friction::face;
use crate::terms::{
    AtRest, Begins, Body, Collocation, Dynamics, Friction, Height, Of, Prescribed, SoftTouchdown, Switch, Terms,
    ToeDistance,
};
use robot::Robot;

/// What the constraints are made of.
pub(super) struct Asked<'a> {
    pub robot: &'a Robot,
    pub schedule: &'a Schedule,
    pub limits: &'a Limits,
    pub request: &'a GaitRequest,
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
            terms.add(Collocation { places: three.try_into().expect("windows of three") });
        }
    }
    for domain in 0..schedule.domains.len() {
        where_it_begins(&mut terms, asked, domain);
    }
    for domain in 0..schedule.domains.len() {
        where_it_ends(&mut terms, asked, domain);
    }
    if schedule.closure == Closure::Moved {
        terms.add(centred::Centred::new(schedule, PlanarMotion::of(asked.request)));
    }
    terms
}

fn at_a_point(terms: &mut Terms, asked: &Asked, place: &Place) {
    let schedule = asked.schedule;
    let d = &schedule.domains[place.domain];
    let mut forces = schedule.forces(place);
    let forces = std::array::from_fn(|_| forces.next());
    terms.add(Dynamics { place: *place, body: &WHOLE, coordinates: 0..DOF, forces });
    if asked.joints_prescribed {
        terms.add(Prescribed::new(*place, &d.redundant_joints));
    } else {
        terms.add(tracking_law::TrackingLaw::new(*place, asked.robot));
    }
    for &leg in &d.stance {
        terms.add(AtRest { place: *place, leg });
    }
    let axes = PlanarMotion::of(asked.request).rotation(place.time * asked.request.step_duration_s);
    for (leg, force) in schedule.forces(place) {
        terms.add(Friction { place: *place, leg, force, face: face(asked.request.friction), axes });
    }
    for &leg in &d.swing {
        let of = Of::Swing(asked.limits.swing_height_m(place.point, place.points));
        terms.add(Height { place: *place, leg, of });
    }
}

fn where_it_begins(terms: &mut Terms, asked: &Asked, domain: usize) {
    let (schedule, first) = (asked.schedule, asked.schedule.places_of(domain)[0]);
    let d = &schedule.domains[domain];
    // Where a given state begins, its toes are where they are.
    if domain > 0 || !schedule.is_between() {
        for leg in schedule.newly_standing(&asked.robot.mirror, domain) {
            terms.add(Height { place: first, leg, of: Of::Stance });
        }
        if schedule.has_footholds() {
            terms.add(foothold::Footholds::new(first, d.footholds.clone(), asked.limits));
        } else {
            let legs = [d.stance[0], d.stance[1]];
            terms.add(ToeDistance { place: first, legs, squared_m2: asked.limits.toe_distance_squared_m2 });
        }
    }
    if asked.joints_prescribed {
        terms.add(Begins::new(first));
    }
}

fn where_it_ends(terms: &mut Terms, asked: &Asked, domain: usize) {
    let schedule = asked.schedule;
    let end = *schedule.places_of(domain).last().expect("a domain has points");
    let next = (domain + 1) % schedule.domains.len();
    let closes = next == 0;
    if let Closure::Between(states) = &schedule.closure
        && closes
    {
        return terms.add(arrival::Arrival::new(asked, end, &states[1]));
    }
    let mirror = (closes && schedule.closure == Closure::Mirrored).then_some(asked.robot.mirror);
    let moved = closes.then(|| (PlanarMotion::of(asked.request), schedule.duration()));
    terms.add(Switch { end, next: schedule.places_of(next)[0], mirror, moved });
    for leg in schedule.landing(&asked.robot.mirror, domain) {
        terms.add(SoftTouchdown { place: end, leg, axes: 0..3 });
    }
}
