//! Times of plans over two steps on the Vision 60, one `name = value` line each; `launch-scripts/bench planner` runs
//! it.
//!
//! bench_strides times | library THREADS | one
//!
//! `one` plans a single stride, for a profiler.

use gait_design::library::{Axis, Entry, Field, Grid, Library};
use gait_design::{GaitRequest, Plan, PlanOptions, Planner, plan};
use robot::Robot;
use std::hint::black_box;
use std::ops::ControlFlow;
use std::path::Path;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Instant;

/// Rounds of every timing; the fastest counts, since a longer solve is interrupted more often.
const ROUNDS: usize = 9;

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

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

fn main() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config/robots/vision60");
    let robot = Robot::load(&folder).expect("the robot's folder belongs to the project");
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    match arguments.iter().map(String::as_str).collect::<Vec<_>>()[..] {
        ["times"] => {
            cold(&robot);
            warm(&robot);
        }
        ["library", threads] => library(&robot, threads.parse().expect("a number of threads")),
        ["one"] => {
            let plan = solve(&robot, &request(&robot, MOTIONS[2]), &PlanOptions::default());
            let solver = &plan.gait.solver;
            println!("{} iterations, {} points, cost {:.12}", solver.iterations, plan.points.len(), solver.objective);
        }
        _ => {
            eprintln!("usage: bench_strides times | library THREADS | one");
            std::process::exit(2);
        }
    }
}

/// The fastest of several plans, ms.
fn fastest_ms(robot: &Robot, request: &GaitRequest) -> f64 {
    let times = (0..ROUNDS).map(|_| {
        let start = Instant::now();
        black_box(solve(robot, black_box(request), &PlanOptions::default()));
        1e3 * start.elapsed().as_secs_f64()
    });
    times.fold(f64::INFINITY, f64::min)
}

fn cold(robot: &Robot) {
    let amble = GaitRequest::named("amble", robot).expect("a behaviour's own name");
    let (mut times, mut ratios, mut iterations) = (Vec::new(), Vec::new(), Vec::new());
    for motion in MOTIONS {
        let request = request(robot, motion);
        let plan = solve(robot, &request, &PlanOptions::default());
        let ms = fastest_ms(robot, &request);
        // Right after, for the machine's speed changes.
        ratios.push(ms / fastest_ms(robot, &amble));
        times.push(ms);
        iterations.push(f64::from(plan.gait.solver.iterations));
        let ([x, y, turn], points) = (motion, plan.points.len());
        println!(
            "# {x} m/s, {y} m/s, {turn} rad/s: {} iterations, {points} points, {ms:.2} ms",
            plan.gait.solver.iterations
        );
    }
    println!("stride_cold_ms = {:.2}", median(times.clone()));
    println!("stride_cold_worst_ms = {:.2}", times.into_iter().fold(0.0, f64::max));
    println!("stride_cold_over_amble = {:.2}", median(ratios));
    println!("stride_cold_iterations_mean = {:.2}", mean(&iterations));
}

/// Numbers between 0 and 1, the same ones every time (Knuth's MMIX generator).
fn random() -> impl FnMut() -> f64 {
    let mut state = 1_u64;
    move || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 11) as f64 / (1_u64 << 53) as f64
    }
}

/// Motions at random by a planner that remembers: the first ones fill its memory, the last ones count.
fn warm(robot: &Robot) {
    const REMEMBERED: usize = 200;
    const COUNTED: usize = 60;
    let mut planner = Planner::with_memory(robot);
    let mut between_0_and_1 = random();
    let (mut times, mut iterations) = (Vec::new(), Vec::new());
    for number in 0..REMEMBERED + COUNTED {
        let mut either_way = |most: f64| most * (2.0 * between_0_and_1() - 1.0);
        let request = request(robot, [0.25 + either_way(0.25), either_way(0.2), either_way(0.4)]);
        let start = Instant::now();
        let plan = planner.plan(black_box(&request), &PlanOptions::default(), |_| ControlFlow::Continue(()));
        let plan = black_box(plan.expect("the benchmark's requests have gaits"));
        if number >= REMEMBERED {
            times.push(1e3 * start.elapsed().as_secs_f64());
            iterations.push(f64::from(plan.gait.solver.iterations));
        }
    }
    println!("stride_warm_ms = {:.2}", median(times));
    println!("stride_warm_iterations_mean = {:.2}", mean(&iterations));
}

/// Time to solve a library of 7 × 5 × 7 motions, a row of yaw rates to a thread at a time.
fn library(robot: &Robot, threads: usize) {
    let axis = |field, from: f64, step: f64, count: usize| {
        let values = (0..count).map(|k| from + step * k as f64);
        Axis { field, values: values.collect() }
    };
    let axes = vec![
        axis(Field::SpeedMS, -0.3, 0.15, 7),
        axis(Field::LateralSpeedMS, -0.2, 0.1, 5),
        axis(Field::YawRateRadS, -0.6, 0.2, 7),
    ];
    let grid = Grid::new(robot, request(robot, [0.0; 3]), axes).expect("the benchmark's grid is one");
    let (mut library, next_row) = (Library::new(robot, grid), AtomicUsize::new(0));
    let start = Instant::now();
    let solved = std::thread::scope(|scope| {
        let solve = || {
            let mut solved = Vec::new();
            loop {
                let row = next_row.fetch_add(1, Ordering::Relaxed);
                if row >= library.grid().rows() {
                    return solved;
                }
                library.solve_row(robot, row, |index, entry| {
                    solved.push((index, entry));
                    ControlFlow::Continue(())
                });
            }
        };
        let threads: Vec<_> = (0..threads).map(|_| scope.spawn(solve)).collect();
        threads.into_iter().flat_map(|thread| thread.join().expect("no row panics")).collect::<Vec<_>>()
    });
    println!("library_7x5x7_s = {:.2}", start.elapsed().as_secs_f64());
    for (index, entry) in solved {
        library.insert(index, entry);
    }
    describe(robot, &library);
}

/// What the library holds, and what interpolation half way between its points breaks.
fn describe(robot: &Robot, library: &Library) {
    let (mut gaits, mut iterations, mut refused) = (0, 0, 0);
    for entry in library.entries().iter().flatten() {
        match entry {
            Entry::Gait { iterations: i, .. } => (gaits, iterations) = (gaits + 1, iterations + i),
            Entry::Refused(_) => refused += 1,
            Entry::Mirror { .. } => {}
        }
    }
    println!("library_7x5x7_solved = {gaits}");
    println!("library_7x5x7_refused = {refused}");
    println!("library_7x5x7_mean_iterations = {:.2}", f64::from(iterations) / f64::from(gaits));
    let mut broken: Vec<(f64, String)> = Vec::new();
    for [x, y, turn] in
        [[-0.225, 0.05, 0.1], [0.075, 0.15, -0.3], [0.225, -0.05, 0.5], [0.375, 0.15, 0.3], [0.525, 0.05, -0.5]]
    {
        let found = library.find(robot, &request(robot, [x, y, turn])).expect("within the grid");
        println!(
            "# {x} m/s, {y} m/s, {turn} rad/s, interpolated: {} by {:.3}",
            found.violation.name, found.violation.amount
        );
        broken.push((found.violation.amount, found.violation.name));
    }
    broken.sort_by(|a, b| a.0.total_cmp(&b.0));
    println!("library_7x5x7_interpolated_violation_median = {:.3}", broken[broken.len() / 2].0);
}
