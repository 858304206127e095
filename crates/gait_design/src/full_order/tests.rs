//! The full-order program: its derivatives, and gaits that turn and step aside.

use super::*;
use crate::tests::{as_steps, go_on, noise, vision60};
use crate::tests_derivatives::agrees_with_central_differences;
use crate::tests_strides::moved;
use crate::{PlanOptions, StepLaw, between_points, guess, on_slope, program_of, simulate_planned_step};

/// A program of a request on a coarse grid, and unknowns near where its solve would start.
fn program_and_noisy_start(request: &GaitRequest, reference: Reference) -> (FullOrderProgram, Vec<f64>) {
    let settings = ProgramSettings { points: 5, ..ProgramSettings::default() };
    let (robot, straight) = (vision60(), as_steps("amble", &vision60()));
    let mut decomposed = program_of(&robot, &straight, settings.clone()).unwrap();
    let x = guess::nominal(&robot, &mut decomposed, &straight).unwrap();
    let robot = on_slope(&robot, request);
    let program = FullOrderProgram::new(&robot, request, Steps::of(request), &settings, &decomposed.limits, reference);
    let mut x = start::recomposed(&program, &decomposed, &x);
    let mut random = noise(7);
    for v in &mut x {
        *v += 0.05 * random() * v.abs().max(1.0);
    }
    (program, x)
}

/// Of a step, a stride, the reference inside the program, and strides that step aside and turn.
#[test]
fn the_jacobian_agrees_with_central_differences() {
    let amble = as_steps("amble", &vision60());
    let sideways_slope = GaitRequest { sideways_slope_rad: 0.1, ..amble.clone() };
    let aside = GaitRequest { lateral_speed_m_s: 0.2, ..amble.clone() };
    let turning = GaitRequest { yaw_rate_rad_s: -0.6, ..aside.clone() };
    for (request, reference) in [
        (&amble, Reference::Compensated),
        (&sideways_slope, Reference::Compensated),
        (&sideways_slope, Reference::InProgram),
        (&aside, Reference::Compensated),
        (&turning, Reference::Compensated),
        (&turning, Reference::InProgram),
    ] {
        let (mut program, x) = program_and_noisy_start(request, reference);
        agrees_with_central_differences(&mut program, x);
    }
}

/// Durations and grids of a schedule's domains are their own, and so is their number.
#[test]
fn the_jacobian_agrees_with_central_differences_over_unequal_domains() {
    let robot = vision60();
    let request = moved(0.3, 0.2, 0.6);
    let settings = ProgramSettings { points: 5, ..ProgramSettings::default() };
    let straight = as_steps("amble", &robot);
    let limits = program_of(&robot, &straight, settings.clone()).unwrap().limits;
    let steps = Schedule::of(&robot, Steps::of(&request), 5).domains;
    let [first, second] = [0, 1].map(|k| steps[k].clone());
    let long = schedule::Domain { share: 1.4, points: 7, ..first.clone() };
    let short = schedule::Domain { share: 0.6, ..second.clone() };
    for domains in [vec![long.clone(), short.clone()], vec![long, short, first, second]] {
        for reference in [Reference::Compensated, Reference::InProgram] {
            let schedule = Schedule::new(domains.clone(), schedule::Closure::Moved);
            let mut random = noise(3);
            let mut x: Vec<f64> = (0..schedule.unknowns).map(|_| 0.5 * random()).collect();
            x[schedule.t()] = 0.23;
            let mut program = FullOrderProgram::over(schedule, &robot, &request, &settings, &limits, reference);
            agrees_with_central_differences(&mut program, x);
        }
    }
}

#[test]
fn a_stride_that_turns_ends_where_its_motion_leads_and_keeps_its_limits() {
    let robot = vision60();
    for request in [moved(0.0, 0.0, 0.4), moved(0.0, 0.2, 0.0), moved(0.35, -0.1, -0.6)] {
        let plan = crate::plan(&robot, &request, &PlanOptions::default(), go_on).unwrap();
        println!("{:?}, {} points, {:?}", plan.gait.solver, plan.points.len(), plan.gait.certificate);
        for points in [&plan.points, &plan.second_points] {
            let followed = simulate_planned_step(&robot, &plan.gait, points, StepLaw::Linearising).unwrap();
            assert!(followed.follows_plan(), "{request:?}: {followed:?}");
            let between = between_points(&robot, &request, &plan.gait, points);
            assert!(between.is_kept(), "{request:?}: {between:?}");
        }
        // By hand: an arc of radius v / ω, or a straight line.
        let (start, end) = (&plan.points[0], plan.second_points.last().unwrap());
        let (t, w) = (2.0 * plan.gait.step_duration_s, request.yaw_rate_rad_s);
        let [vx, vy] = [request.speed_m_s, request.lateral_speed_m_s];
        let turned =
            |v: [f64; 2]| [(w * t).cos() * v[0] - (w * t).sin() * v[1], (w * t).sin() * v[0] + (w * t).cos() * v[1]];
        let arc = turned([vy / w, -vx / w]);
        let d = if w == 0.0 { [vx * t, vy * t] } else { [arc[0] - vy / w, arc[1] + vx / w] };
        let (p, v) = (turned([start.q[0], start.q[1]]), turned([start.v[0], start.v[1]]));
        for i in 0..18 {
            let (q, v) = match i {
                0 | 1 => (p[i] + d[i], v[i]),
                5 => (start.q[5] + w * t, start.v[5]),
                _ => (start.q[i], start.v[i]),
            };
            assert!((end.q[i] - q).abs() < 1e-4 && (end.v[i] - v).abs() < 1e-3, "{request:?}: coordinate {i}");
        }
    }
}

/// A hip roll at the end of its range, where polynomials depart from joints: the controller refuses what leaves it.
#[test]
fn a_stride_at_the_hip_rolls_range_has_polynomials_within_it() {
    let robot = vision60();
    let plan = crate::plan(&robot, &moved(0.35, 0.6, 0.0), &PlanOptions::default(), go_on).unwrap();
    let rolls = [0, 3, 6, 9];
    let most = |rad: f64, point: &PlanPoint| rolls.iter().fold(rad, |most, &j| most.max(point.q[6 + j].abs()));
    let reached = plan.points.iter().chain(&plan.second_points).fold(0.0, most);
    let end = robot.legs[0].position_max_rad[0];
    assert!(reached > end - 5e-3, "the hip rolls reach {reached}, {end} is what this test is about");
    for side in gait::StepSide::BOTH {
        for n in 0..=1000 {
            let (planned, _) = plan.gait.planned(side, f64::from(n) / 1000.0);
            assert!(rolls.iter().all(|&j| planned[j].abs() <= end), "{planned:?}");
        }
    }
}

/// To the left and to the right are one gait and its mirror image.
#[test]
fn turning_to_the_right_costs_what_turning_to_the_left_does() {
    let robot = vision60();
    let [left, right] = [(0.2, 0.1, 0.4), (0.2, -0.1, -0.4)]
        .map(|(x, y, w)| crate::plan(&robot, &moved(x, y, w), &PlanOptions::default(), go_on).unwrap());
    let [a, b] = [&left, &right].map(|plan| plan.gait.solver.objective);
    assert!((a / b - 1.0).abs() < 1e-5, "{a} and {b}");
    // The second step to the right is the mirror image of the first to the left.
    let image = gait::Gait { second_step: None, ..left.gait.clone() };
    let (own, mirrored) =
        (right.gait.planned(gait::StepSide::Mirrored, 0.5).0, image.planned(gait::StepSide::Mirrored, 0.5).0);
    for (a, b) in own.into_iter().zip(mirrored) {
        assert!((a - b).abs() < 5e-3, "{own:?} {mirrored:?}");
    }
}

#[test]
fn the_stride_s_map_of_a_turning_gait_has_its_neutral_multipliers_on_the_unit_circle() {
    let robot = vision60();
    let plan = crate::plan(&robot, &moved(0.35, 0.1, 0.6), &PlanOptions::default(), go_on).unwrap();
    let stability = crate::stability(&robot, &plan.gait, &plan.points, &plan.second_points).unwrap();
    println!("{:?}, largest {:?}", stability.neutral, &stability.multipliers[..4]);
    let turn_rad = 2.0 * 0.6 * plan.gait.step_duration_s;
    let mut angles: Vec<f64> = stability.neutral.iter().map(|m| m.arg()).collect();
    angles.sort_by(f64::total_cmp);
    // x and y turn back by a stride's yaw, yaw itself stays.
    for (angle, expected) in angles.iter().zip([-turn_rad, 0.0, turn_rad]) {
        assert!((angle - expected).abs() < 1e-3, "{:?}", stability.neutral);
    }
    assert!(stability.neutral.iter().all(|m| (m.norm() - 1.0).abs() < 1e-3), "{:?}", stability.neutral);
}

#[test]
fn what_cannot_be_asked_of_a_turning_gait_is_named() {
    let leg_length_m = crate::leg_length_m(&vision60());
    for (request, expected) in [
        (moved(0.2, 1.5, 0.0), "lateral_speed_m_s is 1.5, expected -1 to 1 m/s"),
        (moved(0.2, 0.0, f64::NAN), "yaw_rate_rad_s is NaN, expected -2 to 2 rad/s"),
        (GaitRequest { slope_rad: 0.1, ..moved(0.2, 0.0, 0.3) }, "yaw_rate_rad_s is 0.3 and slope_rad is 0.1"),
        (GaitRequest { sideways_slope_rad: -0.1, ..moved(0.0, 0.0, 0.3) }, "sideways_slope_rad is -0.1"),
    ] {
        let error = request.validate(leg_length_m).unwrap_err().to_string();
        assert!(error.contains(expected), "{error}");
    }
    assert!(GaitRequest { slope_rad: 0.1, ..moved(0.2, 0.1, 0.0) }.validate(leg_length_m).is_ok());
}

#[test]
fn a_straight_request_is_written_as_it_was_before_there_were_turning_ones() {
    let request = GaitRequest::named("gait1", &vision60()).unwrap();
    let written = serde_json::to_value(&request).unwrap();
    assert!(written.get("lateral_speed_m_s").is_none() && written.get("yaw_rate_rad_s").is_none(), "{written}");
    assert_eq!(serde_json::from_value::<GaitRequest>(written).unwrap(), request);
    let turning = moved(0.1, 0.2, 0.3);
    assert_eq!(serde_json::from_value::<GaitRequest>(serde_json::to_value(&turning).unwrap()).unwrap(), turning);
}

/// Of every row and unknown, in a step and in a stride; bounds, value and derivatives are of the term that names a row.
#[test]
fn every_row_and_every_unknown_has_a_name_of_its_own_place() {
    for request in [as_steps("amble", &vision60()), moved(0.1, 0.2, 0.3)] {
        for reference in [Reference::Compensated, Reference::InProgram] {
            let (mut program, x) = program_and_noisy_start(&request, reference);
            program.evaluate_points(&x, true);
            program.terms.check(&program.at(&x), &program.names);
            let rows = program.bounds().constraint_lower.len();
            let names: Vec<String> = (0..rows).map(|row| program.constraint_name(row)).collect();
            for (what, count) in [
                ("dynamics of base roll, point 3 of 5", 1),
                ("dynamics of front right knee, point 1 of 5", 1),
                ("the front right toe at rest, point 5 of 5", 3),
                ("the rear left toe at rest, point 5 of 5", 3),
                ("friction of the front right toe, point 2 of 5", 4),
                ("height of the front left toe, point 4 of 5", 1),
                ("Hermite–Simpson defect, interval 2", 72),
                ("soft touchdown of the front left toe", 3),
                ("periodicity of base yaw", 1),
                ("squared distance between the stance toes", 1),
            ] {
                let step = if program.schedule.domains.len() == 2 { " of step 1" } else { "" };
                let named = names.iter().filter(|name| **name == format!("{what}{step}")).count();
                assert_eq!(named, count, "{what}");
            }
            let unknowns: std::collections::BTreeSet<String> =
                (0..x.len()).map(|column| program.variable_name(column)).collect();
            // Three components of a force share a name.
            let forces = program.schedule.places().len() * 2;
            assert_eq!(unknowns.len(), x.len() - 2 * forces);
        }
    }
}
