//! How often, in how many iterations and in what time steps from a state are planned on the Vision 60, one
//! `name = value` line each; `launch-scripts/bench transitions` runs it on one core.
//!
//! bench_transitions COUNT
//!
//! In turn from rest to a gait, from gait to gait, from a gait to rest, and to a gait from its own start with an error
//! of up to 0.3 m/s of the body's lateral velocity. Gaits are drawn at random, the same ones every time.

use gait::Gait;
use gait_design::{
    GaitRequest, PlanError, PlanOptions, State, TransitionError, TransitionOptions, TransitionRequest, plan,
    plan_transition,
};
use robot::Robot;
use std::ops::ControlFlow;
use std::path::Path;
use std::time::Instant;

/// Largest error of the body's lateral velocity, m/s.
const LATERAL_ERROR_M_S: f64 = 0.3;

fn main() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config/robots/vision60");
    let robot = Robot::load(&folder).expect("the robot's folder belongs to the project");
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let count = match &arguments[..] {
        [count] => count.parse::<usize>().ok().filter(|count| *count > 0),
        _ => None,
    };
    let Some(count) = count else {
        eprintln!("usage: bench_transitions COUNT, a number of at least 1");
        std::process::exit(2);
    };
    measure(&robot, count);
}

fn measure(robot: &Robot, count: usize) {
    let mut between_0_and_1 = random();
    let (mut converged, mut iterations, mut times_ms) = (0, Vec::new(), Vec::new());
    for number in 0..count {
        let asked = draw(robot, number, &mut between_0_and_1);
        let start = Instant::now();
        let planned = plan_transition(robot, &asked, &TransitionOptions::default(), |_| ControlFlow::Continue(()));
        times_ms.push(1e3 * start.elapsed().as_secs_f64());
        match planned {
            Ok(planned) => {
                converged += 1;
                iterations.push(planned.solver.iterations);
            }
            Err(error) => {
                // Refused by what they do between the points, not by the solver.
                converged += usize::from(matches!(error, TransitionError::Plan(PlanError::Unverified(_))));
                println!("transition_{number}_refused = {error}");
            }
        }
    }
    times_ms.sort_by(f64::total_cmp);
    println!("transitions = {count}");
    println!("transitions_converged = {converged}");
    println!("transitions_planned = {}", iterations.len());
    println!(
        "transition_iterations_mean = {:.2}",
        f64::from(iterations.iter().sum::<u32>()) / iterations.len().max(1) as f64
    );
    println!("transition_iterations_most = {}", iterations.iter().max().copied().unwrap_or(0));
    println!("transition_ms = {:.1}", times_ms[count / 2]);
    println!("transition_worst_ms = {:.1}", times_ms[count - 1]);
}

fn draw(robot: &Robot, number: usize, between_0_and_1: &mut impl FnMut() -> f64) -> TransitionRequest {
    let [from, to] = std::array::from_fn(|_| gait(robot, between_0_and_1));
    let transition = match number % 4 {
        0 => TransitionRequest::from_rest(robot, &to),
        1 => TransitionRequest::between(robot, &from, &to),
        2 => TransitionRequest::to_rest(robot, &from),
        _ => {
            let mut state = State::start_of(robot, &to);
            state.v[1] += LATERAL_ERROR_M_S * (2.0 * between_0_and_1() - 1.0);
            let state = state.with_stance_at_rest(robot).expect("such a push leaves the legs slow enough");
            TransitionRequest::from_state(robot, state, &to)
        }
    };
    transition.expect("planned gaits hold their requests")
}

/// The next random gait that there is.
fn gait(robot: &Robot, between_0_and_1: &mut impl FnMut() -> f64) -> Gait {
    loop {
        let mut request = GaitRequest::named("amble", robot).expect("a behaviour's own name");
        request.step_duration_s = 0.18 + 0.17 * between_0_and_1();
        request.speed_m_s = -0.2 + 0.7 * between_0_and_1();
        request.clearance_m = 0.06 + 0.09 * between_0_and_1();
        request.height_m = 0.52 + 0.06 * between_0_and_1();
        request.half_width_m = 0.28 + 0.08 * between_0_and_1();
        if let Ok(plan) = plan(robot, &request, &PlanOptions::default(), |_| ControlFlow::Continue(())) {
            return plan.gait;
        }
    }
}

/// Numbers between 0 and 1, the same ones every time (Knuth's MMIX generator).
fn random() -> impl FnMut() -> f64 {
    let mut state = 1_u64;
    move || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 11) as f64 / (1_u64 << 53) as f64
    }
}
