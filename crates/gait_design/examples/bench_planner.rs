//! Times of the planner on the Vision 60, one `name = value` line each; `launch-scripts/bench planner` runs it on one
//! core.
//!
//! bench_planner times | memory | library GAITS THREADS | plans NAME COUNT | replans COUNT
//!
//! `plans` and `replans` print iterations only: they are for a profiler.

use decomposition::Pairing;
use gait_design::library::{Axis, Field, Grid, Library};
use gait_design::{
    BipedPair, Condensed, DecomposedProgram, GaitRequest, Plan, PlanOptions, Planner, ProgramSettings, Reference,
    SubproblemSolver, behaviours, certificate, nominal, plan, plan_full_order,
};
use nlp::{Evaluation, Problem, Subproblem};
use robot::Robot;
use std::hint::black_box;
use std::ops::ControlFlow;
use std::path::Path;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Instant;

/// Rounds of every timing; the median of the rounds is what counts.
const ROUNDS: usize = 15;

fn main() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config/robots/vision60");
    let robot = Robot::load(&folder).expect("the robot's folder belongs to the project");
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    match arguments.iter().map(String::as_str).collect::<Vec<_>>()[..] {
        ["times"] => times(&robot),
        ["memory"] => memory(&robot),
        ["library", gaits, threads] => library(&robot, number(gaits), number(threads)),
        ["plans", name, count] => plans(&robot, name, number(count)),
        ["replans", count] => replans(&robot, number(count)),
        _ => {
            eprintln!("usage: bench_planner times | memory | library GAITS THREADS | plans NAME COUNT | replans COUNT");
            std::process::exit(2);
        }
    }
}

fn number(text: &str) -> usize {
    text.parse().unwrap_or_else(|e| {
        eprintln!("bench_planner: \"{text}\": {e}");
        std::process::exit(2);
    })
}

fn solve(robot: &Robot, request: &GaitRequest, options: &PlanOptions) -> Plan {
    plan(robot, request, options, |_| ControlFlow::Continue(())).expect("the benchmark's requests have gaits")
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

/// One cold plan after another.
fn plans(robot: &Robot, name: &str, count: usize) {
    let request = GaitRequest::named(name, robot).unwrap_or_else(|e| {
        eprintln!("bench_planner: {e}");
        std::process::exit(2);
    });
    for _ in 0..count {
        println!("{}", solve(robot, &request, &PlanOptions::default()).gait.solver.iterations);
    }
}

/// Changes of [`changes`] by a planner that remembers: iterations and points of each.
fn replans(robot: &Robot, count: usize) {
    let mut planner = Planner::with_memory(robot);
    for [before, after] in changes(robot).take(count) {
        replan(&mut planner, &before, &PlanOptions::default());
        let plan = replan(&mut planner, &after, &PlanOptions::default());
        println!("{} {}", plan.gait.solver.iterations, plan.points.len());
    }
}

/// Mean over the five gaits of the median time of a whole [`plan`], ms.
fn mean_ms(robot: &Robot, options: &PlanOptions, rounds: usize) -> f64 {
    mean_ms_by(robot, options, rounds, solve)
}

fn mean_ms_by(
    robot: &Robot,
    options: &PlanOptions,
    rounds: usize,
    solve: impl Fn(&Robot, &GaitRequest, &PlanOptions) -> Plan,
) -> f64 {
    let of = |name: &str| {
        let request = GaitRequest::named(name, robot).expect("a behaviour's own name");
        black_box(solve(robot, &request, options));
        let times = (0..rounds).map(|_| {
            let start = Instant::now();
            black_box(solve(robot, black_box(&request), options));
            1e3 * start.elapsed().as_secs_f64()
        });
        median(times.collect())
    };
    let each: Vec<f64> = behaviours().map(of).collect();
    each.iter().sum::<f64>() / each.len() as f64
}

fn times(robot: &Robot) {
    let cold = mean_ms(robot, &PlanOptions::default(), ROUNDS);
    println!("cold_mean_ms = {cold:.3}");
    let of = |name| solve(robot, &GaitRequest::named(name, robot).expect("its own name"), &PlanOptions::default());
    let gaits: Vec<Plan> = behaviours().map(of).collect();
    let certificates = gaits.iter().map(|plan| certificate_ms(robot, plan)).sum::<f64>() / gaits.len() as f64;
    println!("cold_without_certificate_mean_ms = {:.3}", cold - certificates);
    for plan in &gaits {
        println!("iterations_{} = {}", plan.gait.name, plan.gait.solver.iterations);
    }
    // What a plan costs that is asked for on the next finer grid.
    let mut of_21_points = PlanOptions::default();
    of_21_points.program.points = 21;
    println!("cold_21_points_ratio = {:.2}", mean_ms(robot, &of_21_points, ROUNDS) / cold);

    let large = PlanOptions { subproblem: SubproblemSolver::Eliminated, ..PlanOptions::default() };
    let large_ms = mean_ms(robot, &large, 5);
    println!("large_form_mean_ms = {large_ms:.2}");
    let by_clarabel = PlanOptions { subproblem: SubproblemSolver::Sparse, ..PlanOptions::default() };
    println!("large_form_by_clarabel_ms = {:.1}", mean_ms(robot, &by_clarabel, 1));
    // The program without the decomposition by the same general solver of the subproblems.
    let whole = |robot: &Robot, request: &GaitRequest, options: &PlanOptions| {
        plan_full_order(robot, request, options, |_| ControlFlow::Continue(()))
            .expect("the five gaits have full-order plans")
    };
    println!("full_order_ratio = {:.2}", mean_ms_by(robot, &large, 3, whole) / large_ms);

    warm(robot, "warm", Planner::with_memory, false);
    warm(robot, "warm_from_last", Planner::new, true);
    growth(robot);
    parts(robot);
}

/// A thousand of [`changes`] by a planner as made, each from the gait before it or from what the planner remembers. All
/// are made three times over, and a change's time is its shortest: the system interrupts one in fifty for longer than a
/// replan takes.
fn warm(robot: &Robot, name: &str, planner: impl Fn(&Robot) -> Planner, from_last: bool) {
    const CHANGES: usize = 1000;
    let (mut whole, mut without) = (vec![f64::INFINITY; CHANGES], vec![f64::INFINITY; CHANGES]);
    let mut iterations = 0;
    for _ in 0..3 {
        let mut planner = planner(robot);
        iterations = 0;
        for ([before, after], (whole, without)) in changes(robot).zip(whole.iter_mut().zip(&mut without)) {
            let before = replan(&mut planner, &before, &PlanOptions::default());
            let warm_start = from_last.then(|| before.warm_start.clone());
            let options = PlanOptions { warm_start, ..PlanOptions::default() };
            let start = Instant::now();
            let plan = black_box(replan(&mut planner, black_box(&after), &options));
            let time = 1e3 * start.elapsed().as_secs_f64();
            *whole = whole.min(time);
            *without = without.min(time - certificate_ms(robot, &plan));
            iterations += plan.gait.solver.iterations;
        }
    }
    for (what, times) in [("", whole), ("_without_certificate", without)] {
        println!("{name}{what}_worst_ms = {:.3}", times.iter().copied().fold(0.0, f64::max));
        println!("{name}{what}_median_ms = {:.3}", median(times));
    }
    println!("{name}_iterations_mean = {:.2}", f64::from(iterations) / CHANGES as f64);
}

/// Changes of speed by 0.1 m/s and of clearance by 2 cm in turns, each from a gait somewhere in the range, so that no
/// request comes twice: before and after.
fn changes(robot: &Robot) -> impl Iterator<Item = [GaitRequest; 2]> {
    let mut request = GaitRequest::named("amble", robot).expect("a behaviour's own name");
    let mut between_0_and_1 = random();
    (0..).map(move |number| {
        request.speed_m_s = 0.1 + 0.4 * between_0_and_1();
        request.clearance_m = 0.08 + 0.05 * between_0_and_1();
        let before = request.clone();
        let sign = if between_0_and_1() < 0.5 { -1.0 } else { 1.0 };
        if number % 2 == 0 {
            request.speed_m_s += 0.1 * sign;
        } else {
            request.clearance_m += 0.02 * sign;
        }
        [before, request.clone()]
    })
}

fn replan(planner: &mut Planner, request: &GaitRequest, options: &PlanOptions) -> Plan {
    planner.plan(request, options, |_| ControlFlow::Continue(())).expect("the benchmark's requests have gaits")
}

/// How long the certificate of a plan takes, ms: the shortest of three.
fn certificate_ms(robot: &Robot, plan: &Plan) -> f64 {
    let times = (0..3).map(|_| {
        let start = Instant::now();
        black_box(certificate(robot, &plan.gait, Reference::Compensated, [&plan.points, &plan.second_points]))
            .expect("it was found before");
        1e3 * start.elapsed().as_secs_f64()
    });
    times.fold(f64::INFINITY, f64::min)
}

/// How the time grows with the points.
fn growth(robot: &Robot) {
    let amble = GaitRequest::named("amble", robot).expect("a behaviour's own name");
    // By a planner that is set up, from the guess; the fastest, since a longer solve is interrupted more often.
    let of_points = |points: usize| {
        let mut options = PlanOptions::default();
        options.program.points = points;
        let mut planner = Planner::new(robot);
        let times = (0..40).map(|_| {
            let start = Instant::now();
            black_box(planner.plan(&amble, &options, |_| ControlFlow::Continue(()))).expect("the amble has a gait");
            start.elapsed().as_secs_f64()
        });
        times.fold(f64::INFINITY, f64::min)
    };
    println!("points_81_over_11 = {:.2}", of_points(81) / of_points(11));
}

/// Numbers between 0 and 1, the same ones every time (Knuth's MMIX generator).
fn random() -> impl FnMut() -> f64 {
    let mut state = 1_u64;
    move || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 11) as f64 / (1_u64 << 53) as f64
    }
}

/// Where the time of a solve goes: the median of each part, µs.
fn parts(robot: &Robot) {
    let request = GaitRequest::named("amble", robot).expect("a behaviour's own name");
    let new_program = || {
        let bipeds = BipedPair::new(robot, Pairing::diagonal(robot.mirror.sign)).expect("the Vision 60 splits");
        DecomposedProgram::new(robot, bipeds, &request, ProgramSettings::default())
    };
    let microseconds = |part: &mut dyn FnMut()| {
        let times = (0..400).map(|_| {
            let start = Instant::now();
            part();
            1e6 * start.elapsed().as_secs_f64()
        });
        median(times.collect())
    };
    println!("set_up_us = {:.1}", microseconds(&mut || drop(black_box(new_program()))));
    let mut program = new_program();
    let mut start = || nominal(robot, &mut program, &request).expect("the Vision 60 reaches its own gait");
    println!("guess_us = {:.1}", microseconds(&mut || drop(black_box(start()))));
    let x = start();
    let mut at = Evaluation::new(&program);
    // As the structured subproblem asks for it.
    at.jacobian_wanted = false;
    println!("evaluation_us = {:.1}", microseconds(&mut || program.evaluate(black_box(&x), &mut at)));
    let mut condensed = Condensed::default();
    let mut step = || condensed.solve(&program, black_box(&x), &at, &at.constraints).expect("the first step exists");
    println!("subproblem_us = {:.1}", microseconds(&mut || drop(black_box(step()))));
    let plan = solve(robot, &request, &PlanOptions::default());
    let mut check = || {
        black_box(gait_design::between_points(robot, &request, &plan.gait, &plan.points));
    };
    println!("check_us = {:.1}", microseconds(&mut check));
    println!("certificate_ms = {:.3}", certificate_ms(robot, &plan));
}

/// The largest resident memory of this process after it has planned the five gaits.
fn memory(robot: &Robot) {
    for name in behaviours() {
        let request = GaitRequest::named(name, robot).expect("a behaviour's own name");
        black_box(solve(robot, &request, &PlanOptions::default()));
    }
    let status = std::fs::read_to_string("/proc/self/status").expect("Linux reports a process' memory");
    let line = status.lines().find(|l| l.starts_with("VmHWM:")).expect("the status has the largest resident memory");
    let kilobytes: f64 = line.split_whitespace().nth(1).and_then(|v| v.parse().ok()).expect("a number of kB");
    println!("planner_rss_mb = {:.1}", kilobytes / 1024.0);
}

/// Time to solve a library of speeds and clearances.
fn library(robot: &Robot, gaits: usize, threads: usize) {
    let spread = |low: f64, high: f64, count: usize| -> Vec<f64> {
        (0..count).map(|k| low + (high - low) * k as f64 / (count - 1).max(1) as f64).collect()
    };
    let base = GaitRequest::named("amble", robot).expect("a behaviour's own name");
    let rows = 10;
    let axes = vec![
        Axis { field: Field::ClearanceM, values: spread(0.06, 0.15, rows) },
        Axis { field: Field::SpeedMS, values: spread(0.0, 0.5, gaits.div_ceil(rows)) },
    ];
    let grid = Grid::new(robot, base, axes).expect("a sensible grid");
    let library = Library::new(robot, grid);
    let (next, refused, iterations) = (AtomicUsize::new(0), AtomicUsize::new(0), AtomicUsize::new(0));
    let start = Instant::now();
    std::thread::scope(|scope| {
        for _ in 0..threads {
            scope.spawn(|| {
                loop {
                    let row = next.fetch_add(1, Ordering::Relaxed);
                    if row >= library.grid().rows() {
                        break;
                    }
                    library.solve_row(robot, row, |_, entry| {
                        match &entry {
                            gait_design::library::Entry::Refused(why) => {
                                eprintln!("bench_planner: refused: {why}");
                                refused.fetch_add(1, Ordering::Relaxed);
                            }
                            gait_design::library::Entry::Mirror { .. } => {}
                            gait_design::library::Entry::Gait { iterations: i, .. } => {
                                iterations.fetch_add(*i as usize, Ordering::Relaxed);
                            }
                        }
                        black_box(entry);
                        ControlFlow::Continue(())
                    });
                }
            });
        }
    });
    let seconds = start.elapsed().as_secs_f64();
    println!("library_{gaits}_s = {seconds:.2}");
    println!("library_refused = {}", refused.into_inner());
    println!("library_mean_iterations = {:.2}", iterations.into_inner() as f64 / library.grid().points() as f64);
}
