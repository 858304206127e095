//! The multipliers against a reference that shares nothing with them but the touchdown: differences of the
//! constrained dynamics in all 36 coordinates and matrix exponentials.

use crate::stability::{mirror, stability_in_steps, touchdown};
use crate::tests::{as_steps, go_on, vision60};
use crate::verification::step_of;
use crate::*;
use decomposition::ContactDynamics;
use nalgebra::DMatrix;

const DOF: usize = 18;
/// Step of the difference quotients, rad or m, and per second.
const DIFFERENCE: f64 = 1e-6;
/// Parts of an interval in which the reference takes the flow as constant: its error falls with the square.
const PARTS: usize = 16;

fn generator(robot: &Robot, gait: &Gait, stance: [usize; 2], point: &PlanPoint) -> DMatrix<f64> {
    let stance = stance.map(|leg| robot.legs[leg].toe);
    let mut dynamics = ContactDynamics::new(&robot.model, stance.len());
    let mut g = DMatrix::zeros(2 * DOF, 2 * DOF);
    for column in 0..2 * DOF {
        let mut at = |change: f64| {
            let mut state = [point.q, point.v];
            state[column / DOF][column % DOF] += change;
            let [q, v] = state;
            let mut tau = [0.0; DOF];
            for j in 0..12 {
                let (dq, dv) = (q[6 + j] - point.q[6 + j], v[6 + j] - point.v[6 + j]);
                tau[6 + j] = point.torque_nm[j] - gait.gains.kp[j] * dq - gait.gains.kd[j] * dv;
            }
            dynamics.motion(&robot.model, &q, &v, &tau, &stance).unwrap().acceleration.clone()
        };
        let difference = (at(DIFFERENCE) - at(-DIFFERENCE)) / (2.0 * DIFFERENCE);
        g.view_mut((DOF, column), (DOF, 1)).copy_from(&difference);
    }
    for i in 0..DOF {
        g[(i, DOF + i)] = 1.0;
    }
    g
}

/// The flow over a step, taken as constant over so many parts of an interval.
fn flow(generators: &[DMatrix<f64>], step_duration_s: f64, parts: usize) -> DMatrix<f64> {
    let mut flow = DMatrix::identity(2 * DOF, 2 * DOF);
    let h = 2.0 * step_duration_s / (generators.len() - 1) as f64 / parts as f64;
    for three in generators.windows(3).step_by(2) {
        for part in 0..parts {
            let s = (part as f64 + 0.5) / parts as f64;
            let weights = [(1.0 - s) * (1.0 - 2.0 * s), 4.0 * s * (1.0 - s), s * (2.0 * s - 1.0)];
            let middle = &three[0] * weights[0] + &three[1] * weights[1] + &three[2] * weights[2];
            flow = (middle * h).exp() * flow;
        }
    }
    flow
}

/// Moduli of the step's map, the three nearest to 1, which are x, y and yaw, left out; largest first.
fn reference_moduli(robot: &Robot, plan: &Plan, points: &[PlanPoint]) -> Vec<f64> {
    let (_, stance, swing) = step_of(points);
    let generators: Vec<_> = points.iter().map(|p| generator(robot, &plan.gait, stance, p)).collect();
    let [coarse, fine] = [PARTS / 2, PARTS].map(|parts| flow(&generators, plan.gait.step_duration_s, parts));
    // The error falls with the square of the parts' length.
    let flow = (fine * 4.0 - coarse) / 3.0;
    let map = mirror(robot) * touchdown(robot, stance, swing, points.last().unwrap()) * flow;
    let mut moduli: Vec<f64> = map.complex_eigenvalues().iter().map(|m| m.norm()).collect();
    for _ in 0..3 {
        let nearest = (0..moduli.len()).min_by(|a, b| (moduli[*a] - 1.0).abs().total_cmp(&(moduli[*b] - 1.0).abs()));
        moduli.swap_remove(nearest.unwrap());
    }
    moduli.sort_by(|a, b| b.total_cmp(a));
    moduli
}

#[test]
fn multipliers_are_exact_to_1e_5_against_a_fine_reference_of_another_make() {
    let robot = vision60();
    for name in behaviours() {
        for half_width_m in [0.25, 0.31] {
            let request = GaitRequest { half_width_m, ..as_steps(name, &robot) };
            let coarse = plan(&robot, &request, &PlanOptions::default(), go_on).unwrap();
            let found = stability(&robot, &coarse.gait, &coarse.points, &[]).unwrap().spectral_radius();
            let steps = stability_in_steps(&robot, &coarse.gait, &coarse.points, &[], 20).unwrap().spectral_radius();
            // Balanced at four times as many points: there the reference's dynamics are the plan's.
            let mut options = PlanOptions { warm_start: Some(coarse.warm_start), ..PlanOptions::default() };
            options.program.points = 41;
            let fine = plan(&robot, &request, &options, go_on).unwrap();
            let ours = stability(&robot, &fine.gait, &fine.points, &[]).unwrap();
            let reference = reference_moduli(&robot, &fine, &fine.points);
            println!(
                "{name} {half_width_m}: {found:.6}, {:.1e} from more steps, {:.1e} from 41 points, which are {:.1e} from the reference",
                found - steps,
                found - ours.spectral_radius(),
                ours.spectral_radius() - reference[0]
            );
            assert!((found - steps).abs() < 1e-5, "{name}: {found}, with more steps {steps}");
            // Another optimum: its cost is a sum over other points.
            assert!((found - ours.spectral_radius()).abs() < 4e-3, "{name}: {found} against {reference:?}");
            for (m, expected) in ours.multipliers.iter().zip(&reference).take(6) {
                assert!((m.norm() - expected).abs() < 1e-5, "{name}: {:?} against {reference:?}", ours.multipliers);
            }
        }
    }
}

#[test]
fn the_five_gaits_are_called_stable() {
    let robot = vision60();
    for behaviour in behaviours() {
        let request = GaitRequest::named(behaviour, &robot).unwrap();
        let certificate = plan(&robot, &request, &PlanOptions::default(), go_on).unwrap().gait.certificate;
        assert!(certificate.is_some_and(|c| c.stable), "{behaviour}: {certificate:?}");
    }
}

/// Backward gaits whose map contracts and that fall, or walk at another speed, in the simulator (docs/planning.md):
/// step duration s, half-width m, height m, clearance m, speed m/s. And gaits that walk their plan.
#[test]
fn a_gait_that_skims_the_floor_before_it_lands_is_not_called_stable() {
    let robot = vision60();
    for (walks, step_duration_s, half_width_m, height_m, clearance_m, speed_m_s) in [
        (false, 0.353, 0.25, 0.55, 0.10, -0.50),
        (false, 0.25, 0.31, 0.55, 0.10, -0.65),
        (false, 0.30, 0.25, 0.55, 0.10, -0.45),
        (false, 0.294, 0.339, 0.481, 0.117, -0.55),
        (false, 0.304, 0.312, 0.595, 0.139, -0.48),
        (true, 0.25, 0.31, 0.55, 0.10, 0.65),
        (true, 0.202, 0.31, 0.55, 0.11, 0.0),
        (true, 0.273, 0.295, 0.483, 0.073, -0.42),
        (true, 0.245, 0.308, 0.507, 0.058, -0.27),
    ] {
        let own = as_steps("amble", &robot);
        let request = GaitRequest { step_duration_s, half_width_m, height_m, clearance_m, speed_m_s, ..own };
        let certificate = plan(&robot, &request, &PlanOptions::default(), go_on).unwrap().gait.certificate.unwrap();
        println!("{request:?}: {certificate:?}");
        assert!(certificate.largest_multiplier < 1.0, "{request:?}: {certificate:?}");
        assert_eq!(certificate.stable, walks, "{request:?}: {certificate:?}");
    }
}

/// It contracts by 0.87 a step and lands from above, and in the simulator it falls after 2 to 3 s: in each step a
/// disturbance grows twelvefold first.
#[test]
fn a_gait_whose_steps_are_so_long_that_it_falls_is_not_called_stable() {
    let robot = vision60();
    let own = as_steps("amble", &robot);
    for (walks, step_duration_s, half_width_m, height_m) in [(false, 0.52, 0.38, 0.5), (true, 0.2, 0.31, 0.55)] {
        let request =
            GaitRequest { step_duration_s, half_width_m, height_m, clearance_m: 0.18, speed_m_s: -0.05, ..own.clone() };
        let plan = plan(&robot, &request, &PlanOptions::default(), go_on).unwrap();
        let (certificate, longest_m) = (plan.gait.certificate.unwrap(), 0.036 * robot.nominal.height_m);
        let growth = stability(&robot, &plan.gait, &plan.points, &plan.second_points).unwrap().step_growth;
        println!("{request:?}: {certificate:?}, growth {growth}");
        assert!(certificate.largest_multiplier < 1.0 && certificate.landing_run_m <= longest_m, "{certificate:?}");
        assert_eq!(growth <= MOST_STEP_GROWTH, walks, "{growth}");
        assert_eq!(certificate.stable, walks, "{certificate:?}");
    }
}

#[test]
fn open_durations_and_widths_are_chosen_for_the_smallest_multiplier_and_all_else_is_kept() {
    let robot = vision60();
    for name in ["gait1", "gait3", "amble"] {
        let own = as_steps(name, &robot);
        let options = PlanOptions::default();
        let multiplier = |plan: &Plan| plan.gait.certificate.unwrap().largest_multiplier;
        let before = multiplier(&plan(&robot, &own, &options, go_on).unwrap());
        let mut last = before;
        for (step_duration, half_width) in [(false, false), (true, false), (true, true)] {
            let stable = plan_stable(&robot, &own, Open { step_duration, half_width }, &options, go_on).unwrap();
            let request: GaitRequest = serde_json::from_value(stable.gait.request.clone()).unwrap();
            println!(
                "{name}: {:.3}, T {}, half-width {}",
                multiplier(&stable),
                request.step_duration_s,
                request.half_width_m
            );
            let kept = GaitRequest {
                step_duration_s: if step_duration { request.step_duration_s } else { own.step_duration_s },
                half_width_m: if half_width { request.half_width_m } else { own.half_width_m },
                ..own.clone()
            };
            assert_eq!(request, kept);
            assert!(multiplier(&stable) <= last + 1e-6, "{name}: {} after {last}", multiplier(&stable));
            last = multiplier(&stable);
        }
        assert!(last < 0.8, "{name}: {last}");
        let cancelled = plan_stable(&robot, &own, Open { step_duration: true, half_width: true }, &options, |_| {
            ControlFlow::Break(())
        });
        assert!(matches!(cancelled, Err(PlanError::NotConverged { status: Status::Cancelled, .. })));
    }
}

#[test]
fn a_step_that_is_not_finite_is_an_error_and_not_a_search_for_eigenvalues_without_end() {
    let robot = vision60();
    let request = as_steps("amble", &robot);
    let mut plan = plan(&robot, &request, &PlanOptions::default(), go_on).unwrap();
    plan.gait.gains.kp = [1e300; 12];
    let error = stability(&robot, &plan.gait, &plan.points, &plan.second_points).unwrap_err();
    assert!(matches!(error, decomposition::DynamicsError::NotFinite { .. }), "{error}");
}

#[test]
fn what_the_solver_calls_a_solution_the_controller_walks() {
    for status in [Status::Converged, Status::Acceptable, Status::IterationLimit, Status::Cancelled] {
        let (name, is_solution) = (status.to_string(), status.is_solution());
        let summary =
            gait::SolverSummary { status: name, iterations: 1, solve_time_s: 0.0, max_violation: 0.0, objective: 0.0 };
        assert_eq!(summary.is_solution(), is_solution, "{status}");
    }
}
