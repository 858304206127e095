//! Where a transition's solve starts, and what its cost stays near: the gait's own steps, bent where they begin and end
//! to what is asked for there; the body glides from state to state.

use super::TransitionRequest;
use crate::full_order::schedule::COEFFICIENTS;
use crate::full_order::start::put_point;
use crate::full_order::{FullOrderProgram, State};
use crate::planar::PlanarMotion;
use gait::{Coefficients, JOINTS, StepSide};
use rigid_body::Data;
use robot::Robot;

/// The program's unknowns. `robot` is on the slope.
pub(super) fn of_the_steps(program: &FullOrderProgram, robot: &Robot, transition: &TransitionRequest) -> Vec<f64> {
    let schedule = &program.schedule;
    let t = transition.request.step_duration_s;
    let [from, to] = transition.ends();
    let own = State::start_of(robot, &transition.steps);
    let mut polynomials = StepSide::BOTH.map(|side| transition.steps.planned_coefficients(side));
    for j in 0..JOINTS {
        let ([first, second], joint) = (&mut polynomials, 6 + j);
        add(&mut first[j], bend(from.q[joint] - own.q[joint], from.v[joint] - own.v[joint], t), false);
        add(&mut second[j], bend(to.q[joint] - own.q[joint], own.v[joint] - to.v[joint], t), true);
    }
    let mut x = vec![0.0; schedule.unknowns];
    x[schedule.t()] = t;
    let mut data = Data::new(&robot.model);
    for (step, polynomials) in polynomials.iter().enumerate() {
        for j in 0..JOINTS {
            for k in 0..COEFFICIENTS {
                x[schedule.alpha(step, k, j)] = polynomials[j][k];
            }
        }
        for place in schedule.places_of(step) {
            let base = glide(transition, [&from, &to], place.time / schedule.duration());
            put_point(program, robot, &mut data, place, t * place.share, base, |j, k| polynomials[j][k], &mut x);
        }
    }
    x
}

/// The degree-5 Bézier coefficients of δ (1 − s)² (1 + 2 s) + δ̇ T s (1 − s)²: from a difference and its rate to none
/// of either.
fn bend(difference: f64, rate: f64, t: f64) -> Coefficients {
    // The cubic's, raised twice by a degree.
    let cubic = [difference, difference + rate * t / 3.0];
    let quartic = [cubic[0], 0.25 * cubic[0] + 0.75 * cubic[1], 0.5 * cubic[1]];
    let quintic =
        [quartic[0], 0.2 * quartic[0] + 0.8 * quartic[1], 0.4 * quartic[1] + 0.6 * quartic[2], 0.6 * quartic[2]];
    [quintic[0], quintic[1], quintic[2], quintic[3], 0.0, 0.0]
}

/// Adds a bend; one at the end runs backward.
fn add(to: &mut Coefficients, bend: Coefficients, at_the_end: bool) {
    for (k, by) in bend.into_iter().enumerate() {
        to[if at_the_end { COEFFICIENTS - 1 - k } else { k }] += by;
    }
}

/// The base and its rates at a share of the way between two states: x, y and yaw along the planar motion, everything
/// else by the cubic through both.
fn glide(transition: &TransitionRequest, [from, to]: [&State; 2], share: f64) -> [[f64; 6]; 2] {
    let motion = PlanarMotion::of(&transition.request);
    let duration_s = 2.0 * transition.request.step_duration_s;
    let end = motion.displacement_m(duration_s);
    let (s, r) = (share, 1.0 - share);
    let value = [r * r * (1.0 + 2.0 * s), s * s * (1.0 + 2.0 * r), s * r * r, -s * s * r];
    let slope = [-6.0 * s * r, 6.0 * s * r, r * (r - 2.0 * s), s * (s - 2.0 * r)];
    let mut base = [[0.0; 6]; 2];
    for i in 0..6 {
        let ahead = if i < 2 { end[i] } else { 0.0 };
        let ends = [from.q[i], to.q[i] + ahead, from.v[i] * duration_s, to.v[i] * duration_s];
        let sum = |weights: [f64; 4]| -> f64 { weights.iter().zip(ends).map(|(w, end)| w * end).sum() };
        base[0][i] = sum(value);
        base[1][i] = sum(slope) / duration_s;
    }
    base
}
