//! Steps from a state: their derivatives, where they begin and end, how often they are found.

use super::*;
use crate::tests::{go_on, noise, vision60};
use crate::tests_derivatives::agrees_with_central_differences;
use crate::{StepLaw, simulate_planned_step};

fn gait_of_request(robot: &Robot, request: &GaitRequest) -> Gait {
    crate::plan(robot, request, &PlanOptions::default(), go_on).unwrap().gait
}

fn named(robot: &Robot, name: &str) -> Gait {
    gait_of_request(robot, &GaitRequest::named(name, robot).unwrap())
}

/// Where a gait begins, its body faster to the left than it should be.
fn thrown(robot: &Robot, gait: &Gait, lateral_m_s: f64) -> State {
    let mut state = State::start_of(robot, gait);
    state.v[1] += lateral_m_s;
    state.with_stance_at_rest(robot).unwrap()
}

#[test]
fn the_jacobian_agrees_with_central_differences() {
    let robot = vision60();
    let gait = named(&robot, "amble");
    let options = TransitionOptions {
        program: ProgramSettings { points: 5, ..TransitionOptions::default().program },
        ..TransitionOptions::default()
    };
    let mut transition = TransitionRequest::from_state(&robot, thrown(&robot, &gait, 0.2), &gait).unwrap();
    transition.request.yaw_rate_rad_s = 0.4;
    let mut program = program(&robot, &transition, &options).unwrap();
    let mut x = start::of_the_steps(&program, &robot, &transition);
    let mut random = noise(11);
    for v in &mut x {
        *v += 0.05 * random() * v.abs().max(1.0);
    }
    agrees_with_central_differences(&mut program, x);
}

#[test]
fn both_eliminations_find_the_same_transition() {
    let robot = vision60();
    let (amble, gait1) = (named(&robot, "amble"), named(&robot, "gait1"));
    for asked in [
        TransitionRequest::from_rest(&robot, &amble).unwrap(),
        TransitionRequest::between(&robot, &amble, &gait1).unwrap(),
        TransitionRequest::from_state(&robot, thrown(&robot, &amble, 0.25), &amble).unwrap(),
    ] {
        let [along, whole] = [SubproblemSolver::Condensed, SubproblemSolver::Eliminated].map(|subproblem| {
            let options = TransitionOptions { subproblem, ..TransitionOptions::default() };
            plan_transition(&robot, &asked, &options, go_on).unwrap()
        });
        let program = program(&robot, &asked, &TransitionOptions::default()).unwrap();
        assert!(elimination(&program, 1e3).is_some(), "the quick one is the one that is used");
        let [a, b] = [&along, &whole].map(|transition| transition.solver.objective);
        assert!((a / b - 1.0).abs() < 1e-5, "{a} and {b}");
        for (a, b) in along.points.iter().flatten().zip(whole.points.iter().flatten()) {
            let apart = a.q.iter().zip(&b.q).fold(0.0_f64, |most, (a, b)| most.max((a - b).abs()));
            assert!(apart < 1e-3, "{apart}");
        }
    }
}

#[test]
fn a_solve_starts_with_steps_that_begin_and_end_as_asked() {
    let robot = vision60();
    let (amble, gait1) = (named(&robot, "amble"), named(&robot, "gait1"));
    let transition = TransitionRequest::between(&robot, &amble, &gait1).unwrap();
    let program = program(&robot, &transition, &TransitionOptions::default()).unwrap();
    let x = start::of_the_steps(&program, &robot, &transition);
    let points = [0, 1].map(|step| program.plan_points(&x, step));
    let (first, last) = (&points[0][0], points[1].last().unwrap());
    let (from, to) = (State::start_of(&robot, &amble), State::start_of(&robot, &gait1));
    for i in 0..18 {
        // x and y are moved. Polynomials meet their joints at switches to within the solver's tolerance.
        if i >= 2 {
            assert!((first.q[i] - from.q[i]).abs() < 1e-4, "{i}: {} and {}", first.q[i], from.q[i]);
            assert!((last.q[i] - to.q[i]).abs() < 1e-4, "{i}: {} and {}", last.q[i], to.q[i]);
        }
        assert!((first.v[i] - from.v[i]).abs() < 2e-3, "{i}: {} and {}", first.v[i], from.v[i]);
        assert!((last.v[i] - to.v[i]).abs() < 2e-3, "{i}: {} and {}", last.v[i], to.v[i]);
    }
}

#[test]
fn a_transition_begins_where_it_is_asked_to_and_reaches_the_gait() {
    let robot = vision60();
    let (amble, gait1) = (named(&robot, "amble"), named(&robot, "gait1"));
    let turning = gait_of_request(
        &robot,
        &GaitRequest {
            step_duration_s: 0.22,
            clearance_m: 0.08,
            yaw_rate_rad_s: 0.4,
            ..GaitRequest::named("amble", &robot).unwrap()
        },
    );
    for transition in [
        TransitionRequest::from_rest(&robot, &gait1),
        TransitionRequest::from_rest(&robot, &amble),
        TransitionRequest::from_rest(&robot, &turning),
        TransitionRequest::between(&robot, &gait1, &amble),
        TransitionRequest::to_rest(&robot, &amble),
        TransitionRequest::from_state(&robot, thrown(&robot, &amble, 0.3), &amble),
        TransitionRequest::from_state(&robot, thrown(&robot, &gait1, -0.3), &gait1),
    ] {
        let transition = transition.unwrap();
        let planned = plan_transition(&robot, &transition, &TransitionOptions::default(), go_on).unwrap();
        println!("{:?}, T {}, {:?}", planned.solver, planned.steps[0].duration_s, planned.missed);
        let [from, to] = transition.ends();
        let (first, last) = (&planned.points[0][0], planned.points[1].last().unwrap());
        assert_eq!((first.q, first.v), (from.q, from.v));
        let share = planned.steps[0].duration_s / transition.request.step_duration_s;
        assert!((0.8 - 1e-9..=1.2 + 1e-9).contains(&share), "{share}");
        for i in 0..18 {
            assert!(i < 2 || (last.q[i] - to.q[i]).abs() < 0.01, "{i}: {} and {}", last.q[i], to.q[i]);
            assert!((last.v[i] - to.v[i]).abs() < 0.1, "{i}: {} and {}", last.v[i], to.v[i]);
        }
        follows(&robot, &transition, &planned);
    }
}

/// The full-order model, started where the transition is, follows both of its steps.
fn follows(robot: &Robot, transition: &TransitionRequest, planned: &Transition) {
    let [first, second] = &planned.steps;
    let gait = Gait {
        step_duration_s: first.duration_s,
        coefficients_rad: first.planned_rad,
        second_step: Some(SecondStep {
            coefficients_rad: second.planned_rad,
            reference_coefficients_rad: second.reference_rad,
        }),
        ..transition.steps.clone()
    };
    for points in &planned.points {
        let followed = simulate_planned_step(robot, &gait, points, StepLaw::Linearising).unwrap();
        assert!(followed.follows_plan(), "{followed:?}");
    }
}

/// Twenty, drawn as `launch-scripts/bench transitions` draws its 200.
#[test]
fn random_transitions_are_found_in_few_iterations() {
    let robot = vision60();
    let mut random = noise(5);
    let mut between_0_and_1 = || 0.5 * (random() + 1.0);
    let (mut found, mut iterations) = (0, Vec::new());
    for number in 0..20 {
        let mut draw = || {
            let own = GaitRequest::named("amble", &robot).unwrap();
            let request = GaitRequest {
                step_duration_s: 0.18 + 0.17 * between_0_and_1(),
                speed_m_s: -0.2 + 0.7 * between_0_and_1(),
                clearance_m: 0.06 + 0.09 * between_0_and_1(),
                half_width_m: 0.28 + 0.08 * between_0_and_1(),
                ..own
            };
            gait_of_request(&robot, &request)
        };
        let (from, to) = (draw(), draw());
        let transition = match number % 4 {
            0 => TransitionRequest::from_rest(&robot, &to),
            1 => TransitionRequest::between(&robot, &from, &to),
            2 => TransitionRequest::to_rest(&robot, &from),
            _ => {
                let error_m_s = 0.3 * (2.0 * between_0_and_1() - 1.0);
                TransitionRequest::from_state(&robot, thrown(&robot, &to, error_m_s), &to)
            }
        };
        match plan_transition(&robot, &transition.unwrap(), &TransitionOptions::default(), go_on) {
            Ok(planned) => {
                found += 1;
                iterations.push(planned.solver.iterations);
            }
            Err(error) => println!("{number}: {error}"),
        }
    }
    let mean = f64::from(iterations.iter().sum::<u32>()) / f64::from(found);
    println!("{found} of 20, {mean} iterations: {iterations:?}");
    assert!(found >= 19 && mean <= 8.0 && iterations.iter().all(|i| *i <= 15));
}

#[test]
fn what_no_transition_can_begin_at_or_reach_is_named() {
    let robot = vision60();
    let gait = named(&robot, "amble");
    let begun = |change: &dyn Fn(&mut State)| {
        let mut state = State::start_of(&robot, &gait);
        change(&mut state);
        let transition = TransitionRequest::from_state(&robot, state, &gait).unwrap();
        plan_transition(&robot, &transition, &TransitionOptions::default(), go_on)
    };
    let named = |change: &dyn Fn(&mut State)| begun(change).unwrap_err().to_string();
    let floats = named(&|state| state.q[2] += 0.02);
    assert!(floats.contains("the rear left toe is 0.0200 m above the floor"), "{floats}");
    let slides = named(&|state| state.v[0] += 0.2);
    assert!(slides.contains("the rear left toe moves at 0.2") && slides.contains("with_stance_at_rest"), "{slides}");
    let no_number = named(&|state| state.v[7] = f64::NAN);
    assert!(no_number.contains("the velocity of front left hip pitch is NaN"), "{no_number}");
    let straight = State {
        q: [0.0; 18],
        v: [0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
    };
    let error = straight.with_stance_at_rest(&robot).unwrap_err().to_string();
    assert!(error.contains("bring the rear left toe to rest"), "{error}");
    let transition = TransitionRequest::from_state(&robot, thrown(&robot, &gait, 1.2), &gait).unwrap();
    let error = plan_transition(&robot, &transition, &TransitionOptions::default(), go_on).unwrap_err().to_string();
    println!("{error}");
    assert!(error.contains("misses"), "{error}");
    let options = TransitionOptions { step_duration_tolerance: 0.6, ..TransitionOptions::default() };
    let error = plan_transition(&robot, &transition, &options, go_on).unwrap_err().to_string();
    assert!(error.contains("step_duration_tolerance is 0.6, expected 0 to 0.5"), "{error}");
    let older = Gait { request: serde_json::json!({"behaviour": "amble"}), ..gait.clone() };
    let error = TransitionRequest::from_rest(&robot, &older).unwrap_err().to_string();
    assert!(error.contains("request is not one that steps can be planned for"), "{error}");
}
