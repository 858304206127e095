//! A planner that plans again: few iterations, and nothing left of the request before.

use super::*;
use crate::tests::{as_steps, go_on, noise, vision60};

#[test]
fn replanning_takes_few_iterations_wherever_it_comes_from() {
    let robot = vision60();
    let mut planner = Planner::new(&robot);
    let mut request = as_steps("amble", &robot);
    let mut options = PlanOptions::default();
    options.warm_start = Some(planner.plan(&request, &options, go_on).unwrap().warm_start);
    let mut most = 0;
    for number in 0..48 {
        let (faster, higher) = (number / 8 % 2 == 1, number / 4 % 2 == 1);
        if number % 2 == 0 {
            request.speed_m_s += if faster { 0.1 } else { -0.1 };
        } else {
            request.clearance_m += if higher { 0.02 } else { -0.02 };
        }
        let plan = planner.plan(&request, &options, go_on).unwrap();
        most = most.max(plan.gait.solver.iterations);
        options.warm_start = Some(plan.warm_start);
    }
    assert!(most <= 9, "a replan took {most} iterations");
}

#[test]
fn a_planner_s_gait_does_not_depend_on_the_requests_before() {
    let robot = vision60();
    let mut planner = Planner::new(&robot);
    let options = PlanOptions::default();
    let uphill = GaitRequest { slope_rad: 0.1, ..as_steps("amble", &robot) };
    for request in [
        as_steps("gait3", &robot),
        uphill,
        GaitRequest { half_width_m: 0.24, ..as_steps("gait3", &robot) },
        as_steps("gait3", &robot),
    ] {
        let kept = planner.plan(&request, &options, go_on).unwrap().gait;
        let fresh = plan(&robot, &request, &options, go_on).unwrap().gait;
        assert_eq!(kept.to_json(), fresh.to_json(), "{request:?}");
    }
    // A request that is refused leaves nothing behind.
    let request = as_steps("amble", &robot);
    let before = planner.plan(&request, &options, go_on).unwrap().gait.to_json();
    planner.plan(&GaitRequest { height_m: 0.7, ..request.clone() }, &options, go_on).unwrap_err();
    planner.plan(&request, &options, |_| ControlFlow::Break(())).unwrap_err();
    assert_eq!(planner.plan(&request, &options, go_on).unwrap().gait.to_json(), before);
}

#[test]
fn a_planner_that_remembers_takes_half_the_iterations_to_the_same_optimum() {
    let robot = vision60();
    let (mut forgetful, mut planner) = (Planner::new(&robot), Planner::with_memory(&robot));
    let options = PlanOptions::default();
    let mut request = as_steps("amble", &robot);
    let mut r = noise(3);
    let (mut iterations, mut cold) = (0, 0);
    for number in 0..60 {
        request.speed_m_s = 0.3 + 0.2 * r();
        request.clearance_m = 0.105 + 0.025 * r();
        let remembered = planner.plan(&request, &options, go_on).unwrap();
        let fresh = forgetful.plan(&request, &options, go_on).unwrap();
        let (a, b) = (&remembered.gait.solver, &fresh.gait.solver);
        // Each may be 1e-8 above the optimum.
        assert!((a.objective - b.objective).abs() < 5e-8, "{request:?}: {} and {}", a.objective, b.objective);
        if number >= 20 {
            iterations += a.iterations;
            cold += b.iterations;
        }
    }
    println!("{iterations} iterations with memory, {cold} without");
    assert!(2 * iterations <= cold + 8, "{iterations} iterations with memory, {cold} without");

    // What is far from all that is remembered has a gait, too, and what has none is refused in the same words.
    let far = GaitRequest { height_m: 0.45, ..as_steps("gait3", &robot) };
    let objective = planner.plan(&far, &options, go_on).unwrap().gait.solver.objective;
    assert!((objective - forgetful.plan(&far, &options, go_on).unwrap().gait.solver.objective).abs() < 5e-8);
    let weak = GaitRequest { torque_limit_nm: [5.0; 3], ..far };
    let refusal = |planner: &mut Planner| planner.plan(&weak, &options, go_on).unwrap_err().to_string();
    assert_eq!(refusal(&mut planner), refusal(&mut forgetful));
}
