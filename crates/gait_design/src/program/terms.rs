//! The decomposed program's terms, of the first step: toes 1 and 2 stand, toes 0 and 3 swing.
//!
//! The rear biped's coordinates are the front one's (q_r = A q_f), so its dynamics are rows on the same unknowns; the
//! wrench λc joins the two. Of the rear swing toe's touchdown z is left: the paired legs move alike along x and y.

use super::{DOF, layout as at, rows};
use crate::biped::{FRONT, FRONT_STANCE, FRONT_SWING, REAR, REAR_STANCE, REAR_SWING};
use crate::limits::Limits;
use crate::planar::PlanarMotion;
use crate::request::GaitRequest;
use crate::terms::friction::face;
use crate::terms::{
    AtRest, Begins, Body, Collocation, Dynamics, Friction, Height, Layout, Mirrored, Of, Place, Prescribed,
    SoftTouchdown, Step, Switch, Terms, ToeDistance,
};
use gait::LEGS;
use nalgebra::Matrix2;
use robot::Mirror;
use std::marker::PhantomData;
use std::ops::Range;

/// The front biped's coordinates. Legs 1 and 3 follow legs 2 and 0.
#[derive(Clone, Copy, Debug)]
struct FrontBiped;

impl Layout for FrontBiped {
    const COORDINATES: usize = DOF;
    const JOINTS_OF: [usize; LEGS] = [6, 9, 9, 6];
    const Q: usize = at::Q;
    const V: usize = at::V;
    const A: usize = at::A;
    const MIRRORED: Mirrored = Mirror::biped_coordinate_source;
    const ACCELERATIONS_LAST: bool = true;
}

static FRONT_BIPED: Body = Body {
    index: 0,
    name: Some("front biped's"),
    legs: &FRONT,
    torques: at::U_FRONT,
    wrench: Some((at::LAMBDA_C, 1.0)),
};

static REAR_BIPED: Body =
    Body { index: 1, name: Some("rear biped's"), legs: &REAR, torques: at::U_REAR, wrench: Some((at::LAMBDA_C, -1.0)) };

/// The terms of a request, their rows where [`rows`] has them.
pub(super) fn of(request: &GaitRequest, limits: &Limits, mirror: Mirror, points: usize) -> Terms {
    let mut terms = Terms::default();
    let place = |point: usize| place(point, points);
    for point in 0..points {
        at_a_point(&mut terms, request, limits, place(point));
    }
    for interval in 0..points / 2 {
        let places = [0, 1, 2].map(|k| place(2 * interval + k));
        terms.add_at(rows::intervals(points) + rows::INTERVAL * interval, Collocation { places });
    }

    let (start, first) = (rows::first(points), place(0));
    terms.add_at(start + rows::BEGINS, Begins::new(first));
    terms.add_at(start + rows::FLOOR_2, Height { place: first, leg: FRONT_STANCE, of: Of::Stance });
    terms.add_at(start + rows::FLOOR_1, Height { place: first, leg: REAR_STANCE, of: Of::Stance });
    let (legs, squared_m2) = ([REAR_STANCE, FRONT_STANCE], limits.toe_distance_squared_m2);
    terms.add_at(start + rows::TOE_DISTANCE, ToeDistance { place: first, legs, squared_m2 });

    let (start, end) = (rows::boundary(points), place(points - 1));
    let moved = Some((PlanarMotion::straight(request.speed_m_s), 1.0));
    terms.add_at(start + rows::PERIODICITY, Switch { end, next: first, mirror: Some(mirror), moved });
    terms.add_at(start + rows::TOUCHDOWN_0, SoftTouchdown { place: end, leg: FRONT_SWING, axes: 0..3 });
    terms.add_at(start + rows::TOUCHDOWN_3, SoftTouchdown { place: end, leg: REAR_SWING, axes: 2..3 });
    terms
}

fn at_a_point(terms: &mut Terms, request: &GaitRequest, limits: &Limits, place: Place<FrontBiped>) {
    let r = rows::COUNT * place.point;
    let force_1 = (REAR_STANCE, place.column + at::LAMBDA_1);
    let force_2 = (FRONT_STANCE, place.column + at::LAMBDA_2);
    let of = |body: &'static Body, force: (usize, usize), coordinates: Range<usize>| Dynamics {
        place,
        body,
        coordinates,
        forces: [Some(force), None, None, None],
    };
    terms.add_at(r + rows::FRONT, of(&FRONT_BIPED, force_2, 0..DOF));
    terms.add_at(r + rows::REAR_BASE, of(&REAR_BIPED, force_1, 0..6));
    terms.add_at(r + rows::OUTPUT, Prescribed::new(place, &[super::STANCE_ROLL]));
    terms.add_at(r + rows::TOE_2, AtRest { place, leg: FRONT_STANCE });
    terms.add_at(r + rows::TOE_1, AtRest { place, leg: REAR_STANCE });
    let (face, axes) = (face(request.friction), Matrix2::identity());
    for (k, (leg, force)) in [force_1, force_2].into_iter().enumerate() {
        terms.add_at(r + rows::FRICTION + 4 * k, Friction { place, leg, force, face, axes });
    }
    for (k, leg) in [FRONT_SWING, REAR_SWING].into_iter().enumerate() {
        let of = Of::Swing(limits.swing_height_m(place.point, place.points));
        terms.add_at(r + rows::SWING + k, Height { place, leg, of });
    }
    terms.add_at(r + rows::REAR_TORQUE, of(&REAR_BIPED, force_1, 6..DOF));
}

fn place(point: usize, points: usize) -> Place<FrontBiped> {
    let phase = point as f64 / (points - 1) as f64;
    Place {
        layout: PhantomData,
        index: point,
        column: at::point(point),
        domain: 0,
        point,
        points,
        phase,
        share: 1.0,
        time: phase,
        step: Step(None),
    }
}

#[cfg(test)]
mod tests {
    use super::rows;
    use crate::tests::{as_steps, vision60};
    use crate::{ProgramSettings, guess, program_of};
    use nlp::{Evaluation, Problem};

    #[test]
    fn every_row_has_bounds_value_derivatives_and_the_name_of_its_place_from_one_term() {
        let (robot, request) = (vision60(), as_steps("amble", &vision60()));
        let mut program = program_of(&robot, &request, ProgramSettings::default()).unwrap();
        let x = guess::nominal(&robot, &mut program, &request).unwrap();
        program.evaluate(&x, &mut Evaluation::new(&program));
        program.terms.check(&program.at(&x), &program.names);
        for (row, name) in [
            (rows::TOE_1 + 2, "rear left toe at rest, z, point 1 of 11"),
            (rows::first(11) + 6, "front left hip roll starts with its polynomial's velocity"),
            (rows::first(11) + rows::FLOOR_1, "rear left toe on the floor"),
            (rows::boundary(11) + rows::TOUCHDOWN_0 + 1, "soft touchdown of the front left toe, y"),
            (rows::boundary(11) + rows::TOUCHDOWN_3, "soft touchdown of the rear right toe, z"),
        ] {
            assert_eq!(program.constraint_name(row), name);
        }
    }
}
