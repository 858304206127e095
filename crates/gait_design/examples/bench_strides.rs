//! Times of plans over two steps on the Vision 60, one `name = value` line each; `launch-scripts/bench planner` runs it
//! on one core.
//!
//! bench_strides times | one

use gait_design::{GaitRequest, Plan, PlanOptions, plan};
use robot::Robot;
use std::hint::black_box;
use std::ops::ControlFlow;
use std::path::Path;
use std::time::Instant;

/// Rounds of every timing; the median of the rounds is what counts.
const ROUNDS: usize = 5;

/// Speed ahead and to the left, m/s, and yaw rate, rad/s, of ambles with steps of 0.22 s that lift their toes by 8 cm.
const MOTIONS: [[f64; 3]; 8] = [
    [0.0, 0.0, 0.4],
    [0.0, 0.2, 0.0],
    [0.35, 0.0, 0.4],
    [0.35, 0.1, 0.4],
    [0.5, 0.0, 0.2],
    [0.5, 0.2, 0.6],
    [-0.2, 0.1, -0.2],
    [0.2, -0.1, -0.6],
];

fn request(robot: &Robot, [speed_m_s, lateral_speed_m_s, yaw_rate_rad_s]: [f64; 3]) -> GaitRequest {
    let own = GaitRequest::named("amble", robot).expect("a behaviour's own name");
    let steps = GaitRequest { step_duration_s: 0.22, clearance_m: 0.08, ..own };
    GaitRequest { speed_m_s, lateral_speed_m_s, yaw_rate_rad_s, ..steps }
}

fn solve(robot: &Robot, request: &GaitRequest, options: &PlanOptions) -> Plan {
    plan(robot, request, options, |_| ControlFlow::Continue(())).expect("the benchmark's requests have gaits")
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

fn mean(values: impl ExactSizeIterator<Item = f64>) -> f64 {
    let count = values.len() as f64;
    values.sum::<f64>() / count
}

fn main() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config/robots/vision60");
    let robot = Robot::load(&folder).expect("the robot's folder belongs to the project");
    let options = PlanOptions::default();
    match std::env::args().nth(1).as_deref() {
        Some("times") => times(&robot, &options),
        Some("one") => {
            let plan = solve(&robot, &request(&robot, MOTIONS[2]), &options);
            let solver = &plan.gait.solver;
            println!("{} iterations, {} points, cost {:.12}", solver.iterations, plan.points.len(), solver.objective);
            for i in &plan.log {
                println!("{i:?}");
            }
        }
        _ => {
            eprintln!("usage: bench_strides times | one");
            std::process::exit(2);
        }
    }
}

fn times(robot: &Robot, options: &PlanOptions) {
    let (mut cold, mut iterations) = (Vec::new(), Vec::new());
    for motion in MOTIONS {
        let request = request(robot, motion);
        let times = (0..ROUNDS).map(|_| {
            let start = Instant::now();
            black_box(solve(robot, black_box(&request), options));
            1e3 * start.elapsed().as_secs_f64()
        });
        cold.push(median(times.collect()));
        let plan = solve(robot, &request, options);
        println!(
            "# {motion:?} {} {} {:.10} {:.2}",
            plan.gait.solver.iterations,
            plan.points.len(),
            plan.gait.solver.objective,
            cold.last().unwrap()
        );
        iterations.push(f64::from(plan.gait.solver.iterations));
    }
    println!("stride_cold_ms = {:.2}", mean(cold.into_iter()));
    println!("stride_cold_iterations_mean = {:.2}", mean(iterations.into_iter()));
}
