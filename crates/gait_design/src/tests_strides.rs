//! The full-order program eliminated along its steps, beside the elimination that knows no order.

use crate::tests::{as_steps, go_on, vision60};
use crate::{GaitRequest, Plan, PlanOptions, Planner, Reference, SubproblemSolver, plan, plan_full_order};

/// A short-stepped amble that steps aside and turns.
pub(crate) fn moved(speed_m_s: f64, lateral_speed_m_s: f64, yaw_rate_rad_s: f64) -> GaitRequest {
    let own = GaitRequest::named("amble", &vision60()).unwrap();
    let steps = GaitRequest { step_duration_s: 0.22, clearance_m: 0.08, ..own };
    GaitRequest { speed_m_s, lateral_speed_m_s, yaw_rate_rad_s, ..steps }
}

fn by(subproblem: SubproblemSolver) -> PlanOptions {
    PlanOptions { subproblem, ..PlanOptions::default() }
}

/// Turning, aside, on a slope across, leaning to a side, and a step with its mirror image.
#[test]
fn both_eliminations_find_the_same_gait() {
    let robot = vision60();
    let amble = as_steps("amble", &robot);
    for request in [
        moved(0.35, 0.1, 0.4),
        moved(-0.2, 0.2, 0.0),
        GaitRequest { sideways_slope_rad: 0.1, ..amble.clone() },
        GaitRequest { torso_roll_rad: 0.1, ..amble.clone() },
        GaitRequest { torso_pitch_rad: 0.1, ..amble.clone() },
        amble,
    ] {
        let [along, sparse] = [SubproblemSolver::Condensed, SubproblemSolver::Eliminated].map(|subproblem| {
            plan_full_order(&robot, &request, &by(subproblem), go_on).unwrap_or_else(|e| panic!("{request:?}: {e}"))
        });
        let [a, b] = [&along, &sparse].map(|plan| plan.gait.solver.objective);
        assert!((a / b - 1.0).abs() < 1e-8, "{request:?}: {a} and {b}");
        assert_eq!(along.points.len(), sparse.points.len(), "{request:?}");
        let furthest = |a: &[f64], b: &[f64]| a.iter().zip(b).fold(0.0_f64, |most, (a, b)| most.max((a - b).abs()));
        for (a, b) in [(&along.points, &sparse.points), (&along.second_points, &sparse.second_points)] {
            for (a, b) in a.iter().zip(b) {
                assert!(furthest(&a.q, &b.q) < 1e-5, "{request:?}: {:?} and {:?}", a.q, b.q);
                assert!(
                    furthest(&a.torque_nm, &b.torque_nm) < 1e-2,
                    "{request:?}: {:?}, {:?}",
                    a.torque_nm,
                    b.torque_nm
                );
            }
        }
    }
}

fn coefficients(plan: &Plan) -> Vec<f64> {
    let second = plan.gait.second_step.as_ref().expect("a stride");
    plan.gait.coefficients_rad.iter().chain(&second.coefficients_rad).flatten().copied().collect()
}

/// A planner keeps how it eliminates, from one request to the next of whatever kind.
#[test]
fn a_stride_does_not_depend_on_the_requests_before_it() {
    let robot = vision60();
    let mut planner = Planner::new(&robot);
    let requests = [moved(0.2, 0.1, 0.2), moved(0.2, 0.1, 0.0), moved(0.3, 0.0, -0.4), moved(0.2, 0.1, 0.2)];
    for request in requests {
        let after_others = planner.plan(&request, &PlanOptions::default(), go_on).unwrap();
        let alone = plan(&robot, &request, &PlanOptions::default(), go_on).unwrap();
        assert_eq!(coefficients(&after_others), coefficients(&alone), "{request:?}");
    }
}

/// One whose polynomials depart from its joints on the grid asked for.
#[test]
fn a_stride_that_takes_a_finer_grid_starts_from_the_coarse_one_s_solution() {
    let robot = vision60();
    let request = moved(0.5, 0.2, 0.6);
    let refined = plan(&robot, &request, &PlanOptions::default(), go_on).unwrap();
    assert_eq!(refined.points.len(), 21);
    let mut options = PlanOptions::default();
    options.program.points = 21;
    let fine = plan(&robot, &request, &options, go_on).unwrap();
    let [a, b] = [&refined, &fine].map(|plan| plan.gait.solver.objective);
    assert!((a / b - 1.0).abs() < 1e-6, "{a} and {b}");
    assert!(refined.log.len() < fine.log.len(), "{} and {} iterations", refined.log.len(), fine.log.len());
}

/// A planner that remembers starts a stride from those before it.
#[test]
fn remembered_strides_save_iterations_and_cost_the_same() {
    let robot = vision60();
    let mut planner = Planner::with_memory(&robot);
    for (k, j) in (0..4).flat_map(|k| (0..4).map(move |j| (k, j))) {
        let request = moved(0.1 + 0.1 * f64::from(k), 0.1, -0.3 + 0.2 * f64::from(j));
        planner.plan(&request, &PlanOptions::default(), go_on).unwrap();
    }
    let request = moved(0.26, 0.1, 0.02);
    let warm = planner.plan(&request, &PlanOptions::default(), go_on).unwrap();
    let cold = plan(&robot, &request, &PlanOptions::default(), go_on).unwrap();
    let [a, b] = [&warm, &cold].map(|plan| plan.gait.solver.objective);
    assert!((a / b - 1.0).abs() < 1e-6, "{a} and {b}");
    assert!(
        warm.gait.solver.iterations < cold.gait.solver.iterations,
        "{:?}, {:?}",
        warm.gait.solver,
        cold.gait.solver
    );
}

/// Over a step and a stride, from the same start.
#[test]
fn both_eliminations_find_the_same_gait_with_the_reference_in_the_program() {
    let robot = vision60();
    let amble = as_steps("amble", &robot);
    for request in [GaitRequest { sideways_slope_rad: 0.1, ..amble.clone() }, amble] {
        let [along, sparse] = [SubproblemSolver::Condensed, SubproblemSolver::Eliminated].map(|subproblem| {
            let options = PlanOptions { reference: Reference::InProgram, ..by(subproblem) };
            plan(&robot, &request, &options, go_on).unwrap_or_else(|e| panic!("{request:?}: {e}"))
        });
        let [a, b] = [&along, &sparse].map(|plan| plan.gait.solver.objective);
        assert!((a / b - 1.0).abs() < 1e-6, "{request:?}: {a} and {b}");
    }
}
