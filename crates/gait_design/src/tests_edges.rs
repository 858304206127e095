//! Requests at the edge of what can be walked, random starts, and the library.

use super::*;
use crate::library::{Axis, Entry, Field, Grid, Library, LibraryError};
use crate::tests::{as_steps, go_on, noise, vision60};

/// Everything that a plan promises to keep, looked at in the full-order plan itself.
pub(crate) fn keeps_its_limits(robot: &Robot, request: &GaitRequest, plan: &Plan) {
    let normal_force_min_n = ProgramSettings::default().normal_force_min_share * robot.model.total_mass() * 9.81;
    assert!(plan.gait.solver.max_violation <= 1e-5, "{}", plan.gait.solver.max_violation);
    for p in &plan.points {
        for j in 0..12 {
            let leg = &robot.legs[j / 3];
            let (low, high) = (leg.position_min_rad[j % 3], leg.position_max_rad[j % 3]);
            assert!((low - 1e-4..=high + 1e-4).contains(&p.q[6 + j]), "joint {j} at {}", p.q[6 + j]);
            assert!(p.v[6 + j].abs() <= robot.limits.velocity_rad_s[j % 3] + 1e-4, "joint {j} moves {}", p.v[6 + j]);
            assert!(p.torque_nm[j].abs() <= request.torque_limit_nm[j % 3] + 1e-3, "joint {j}: {} N m", p.torque_nm[j]);
        }
        for leg in [1, 2] {
            let [x, y, z] = p.ground_force_n[leg];
            assert!(z >= normal_force_min_n - 1e-3 && x.hypot(y) <= request.friction * z + 1e-3);
        }
    }
}

#[test]
fn a_request_at_the_edge_gets_a_gait_or_the_nearest_that_works_and_what_binds() {
    let robot = vision60();
    type Case = (&'static str, &'static str, fn(&mut GaitRequest));
    let cases: [Case; 11] = [
        ("clearance 0", "clearance_m", |r| r.clearance_m = 0.0),
        ("clearance 0.4 m", "clearance_m", |r| r.clearance_m = 0.4),
        ("speed 0", "speed_m_s", |r| r.speed_m_s = 0.0),
        ("speed −0.3 m/s", "speed_m_s", |r| r.speed_m_s = -0.3),
        ("speed 3 m/s", "speed_m_s", |r| r.speed_m_s = 3.0),
        ("0.2 steps a second", "step_duration_s", |r| r.step_duration_s = step_duration_from_step_frequency(0.2)),
        ("10 steps a second", "step_duration_s", |r| r.step_duration_s = step_duration_from_step_frequency(10.0)),
        ("hips 0.8 m above the toes", "height_m", |r| r.height_m = 0.8),
        ("torques of 5 N m", "torque_limit_nm", |r| r.torque_limit_nm = [5.0; 3]),
        ("clearance not a number", "clearance_m", |r| r.clearance_m = f64::NAN),
        ("friction 0", "friction", |r| r.friction = 0.0),
    ];
    // The table of docs/planning.md: "a gait", or what works as the answer's first number.
    const DOCS: &str = include_str!("../../../docs/planning.md");
    let docs = |what: &str| -> &str {
        let row = DOCS.lines().find_map(|line| line.strip_prefix(&format!("| {what} | ")));
        row.unwrap_or_else(|| panic!("docs/planning.md has no row \"{what}\""))
    };
    for (what, field, change) in cases {
        let mut request = GaitRequest::named("amble", &robot).unwrap();
        change(&mut request);
        match plan_or_nearest(&robot, &request, &PlanOptions::default(), go_on, || true) {
            Ok(plan) => {
                println!("{what}: {} iterations", plan.gait.solver.iterations);
                assert!(docs(what).starts_with("a gait"), "{what}: the docs say {}", docs(what));
                keeps_its_limits(&robot, &request, &plan);
            }
            Err(refusal) => {
                println!("{what}: {refusal}");
                let nearest = refusal.nearest.as_ref().unwrap_or_else(|| panic!("{what}: nothing near: {refusal}"));
                assert!(nearest.changed.iter().all(|c| c.field.starts_with(field)), "{what}: {refusal}");
                assert!(!nearest.changed.is_empty(), "{what}: {refusal}");
                let (works, number) = (nearest.changed[0].works, docs(what).split(' ').next().map(str::parse::<f64>));
                let Some(Ok(number)) = number else { panic!("{what}: {works} works, the docs say {}", docs(what)) };
                assert!((number / works - 1.0).abs() < 0.01, "{what}: {works} works, the docs say {}", docs(what));
                let plan = plan(&robot, &nearest.request, &PlanOptions::default(), go_on);
                let plan = plan.unwrap_or_else(|e| panic!("{what}: what is proposed has no gait: {e}"));
                keeps_its_limits(&robot, &nearest.request, &plan);
            }
        }
    }
}

/// Long steps are out of reach ahead and behind, and the refusal says so; what it says to change makes it a gait.
#[test]
fn a_step_too_long_for_the_legs_is_refused_by_its_length() {
    let robot = vision60();
    let own = as_steps("amble", &robot);
    let request = GaitRequest { speed_m_s: 1.2, step_duration_s: 0.6, height_m: 0.62, ..own };
    let e = plan(&robot, &request, &PlanOptions::default(), go_on).unwrap_err();
    assert!(matches!(e, PlanError::Unreachable(_)), "{e}");
    assert!(e.to_string().contains("ahead of its hip") && e.to_string().contains("step length"), "{e}");
    let shorter = GaitRequest { speed_m_s: 0.4, ..request };
    plan(&robot, &shorter, &PlanOptions::default(), go_on).unwrap();
}

#[test]
fn a_valid_request_that_cannot_be_walked_names_the_binding_limit() {
    let robot = vision60();
    let mut request = GaitRequest::named("gait1", &robot).unwrap();
    request.torque_limit_nm = [50.0, 50.0, 20.0];
    let refusal = plan_or_nearest(&robot, &request, &PlanOptions::default(), go_on, || true).unwrap_err();
    let nearest = refusal.nearest.as_ref().unwrap();
    assert_eq!(nearest.changed.len(), 1, "{refusal}");
    assert_eq!(nearest.changed[0].field, "torque_limit_nm[knee]");
    assert!((20.0..45.0).contains(&nearest.changed[0].works), "{refusal}");
    assert!(nearest.binding.iter().any(|name| name.contains("torque of") && name.contains("knee")), "{refusal}");
}

#[test]
fn a_search_that_may_not_go_on_finds_nothing() {
    let robot = vision60();
    let mut request = as_steps("gait1", &robot);
    request.speed_m_s = 3.0;
    assert_eq!(nearest(&robot, &request, &PlanOptions::default(), || false), None);
}

#[test]
fn from_a_hundred_random_starts_of_each_gait_ninety_nine_converge() {
    let robot = vision60();
    for name in behaviours() {
        let request = as_steps(name, &robot);
        let mut program = program_of(&robot, &request, ProgramSettings::default()).unwrap();
        let nominal = guess::nominal(&robot, &mut program, &request).unwrap();
        let best = plan(&robot, &request, &PlanOptions::default(), go_on).unwrap().gait.solver.objective;
        let (mut converged, mut iterations, mut worse) = (0, Vec::new(), 0);
        for seed in 0..100 {
            let mut random = noise(seed);
            let start = nominal.iter().map(|v| v * (1.0 + 0.3 * random())).collect();
            let options =
                PlanOptions { warm_start: Some(WarmStart(crate::Solved::Decomposed(start))), ..PlanOptions::default() };
            match plan(&robot, &request, &options, go_on) {
                Ok(plan) => {
                    converged += 1;
                    iterations.push(plan.gait.solver.iterations);
                    worse += u32::from(plan.gait.solver.objective > 1.001 * best);
                }
                Err(e) => println!("{name}, seed {seed}: {e}"),
            }
        }
        iterations.sort_unstable();
        let (median, most) = (iterations[iterations.len() / 2], iterations[iterations.len() - 1]);
        println!("{name}: {converged} of 100, {median} iterations (at most {most}), {worse} to another optimum");
        assert!(converged >= 99, "{name}: {converged} of 100 converge");
        assert!(median <= 20, "{name}: {median} iterations");
    }
}

#[test]
fn any_odd_number_of_points_converges_to_nearly_the_same_gait() {
    let robot = vision60();
    let request = as_steps("amble", &robot);
    let mut options = PlanOptions::default();
    for (points, tolerance) in [(5, 0.1), (7, 0.05), (9, 0.02), (21, 0.02), (41, 0.02)] {
        options.program.points = points;
        let solution =
            Planner::new(&robot).solve(&request, &options, go_on).unwrap_or_else(|e| panic!("{points} points: {e}"));
        assert_eq!(solution.status, Status::Converged, "{points} points");
        // The cost is a sum over the points.
        let mean = solution.objective / points as f64;
        println!("{points} points: {} iterations, cost a point {mean}", solution.iterations());
        assert!((mean / (0.053664 / 11.0) - 1.0).abs() < 10.0 * tolerance, "{points} points: {mean}");
    }
    // Converged is not good enough to walk: between five points, and between nine, too little is held, and the plan is
    // made with more.
    for (points, made) in [(5, 17), (9, 17), (11, 11), (21, 21)] {
        options.program.points = points;
        let plan = plan(&robot, &request, &options, go_on).unwrap();
        assert_eq!(plan.points.len(), made, "{points} points");
    }
    for points in [3, 12, 1001] {
        options.program.points = points;
        let e = plan(&robot, &request, &options, go_on).unwrap_err().to_string();
        assert!(e.contains(&format!("points is {points}, expected an odd number from 5 to 161")), "{e}");
    }
}

/// What 11 points refuse is planned with more, and every plan holds when the full-order model walks it a step.
#[test]
fn what_eleven_points_cannot_hold_is_solved_again_with_more_and_says_so() {
    let robot = vision60();
    let mut random = noise(15);
    let mut between = |low: f64, high: f64| low + 0.5 * (random() + 1.0) * (high - low);
    let (mut grids, mut refused) = ([0; 3], 0);
    for case in 0..40 {
        let request = GaitRequest {
            step_duration_s: between(0.25, 0.6),
            speed_m_s: between(-0.5, 0.8),
            clearance_m: between(0.03, 0.2),
            height_m: between(0.45, 0.62),
            half_width_m: between(0.19, 0.35),
            ..as_steps("amble", &robot)
        };
        let plan = match plan(&robot, &request, &PlanOptions::default(), go_on) {
            Ok(plan) => plan,
            Err(e) => {
                println!("case {case}: {e}: {request:?}");
                refused += 1;
                continue;
            }
        };
        let points = plan.points.len();
        grids[[11, 21, 41].iter().position(|known| *known == points).unwrap()] += 1;
        let looked = between_points(&robot, &request, &plan.gait, &plan.points);
        assert!(looked.is_kept(), "case {case}: {:?}", looked.broken());
        let step = simulate_planned_step(&robot, &plan.gait, &plan.points, StepLaw::Linearising).unwrap();
        let errors = (step.joint_error_rad, step.normal_force_error, step.landing_height_m);
        assert!(step.follows_plan(), "case {case}: {request:?}: {points} points, {errors:?}");
    }
    println!("{grids:?} planned with 11, 21 and 41 points, {refused} refused");
    assert!(refused <= 2 && grids[1] + grids[2] >= 5, "{grids:?}, {refused} refused");
}

/// In long steps the stance hip rolls move as the distance of the toes has them, which no polynomial follows. The first
/// was planned, and its simulated step then refused by the ground's forces (1.6 % of the weight); the other was refused
/// for a jump of a hip roll at the switch of steps.
#[test]
fn a_step_whose_stance_hip_roll_is_no_polynomial_is_planned_and_followed() {
    let robot = vision60();
    for (step_duration_s, height_m, half_width_m, clearance_m, speed_m_s, slope_deg) in
        [(0.580, 0.549, 0.267, 0.142, 0.895, 6.671), (0.515, 0.566, 0.355, 0.097, 0.790, -0.741_f64)]
    {
        let own = as_steps("amble", &robot);
        let slope_rad = slope_deg.to_radians();
        let request = GaitRequest { step_duration_s, height_m, half_width_m, clearance_m, speed_m_s, slope_rad, ..own };
        let plan = plan(&robot, &request, &PlanOptions::default(), go_on).unwrap();
        let on_slope = on_slope(&robot, &request);
        let step = simulate_planned_step(&on_slope, &plan.gait, &plan.points, StepLaw::Linearising).unwrap();
        println!(
            "{step_duration_s} s: forces {:.1e}, joints {:.1e} rad",
            step.normal_force_error, step.joint_error_rad
        );
        assert!(step.follows_plan() && step.normal_force_error < 1e-3, "{request:?}: {}", step.normal_force_error);
    }
}

fn small_grid(robot: &Robot) -> Grid {
    let base = as_steps("amble", robot);
    let axes = vec![
        Axis { field: Field::ClearanceM, values: vec![0.08, 0.10] },
        Axis { field: Field::SpeedMS, values: vec![0.1, 0.2, 0.3, 0.4] },
    ];
    Grid::new(robot, base, axes).unwrap()
}

pub(crate) fn solved(robot: &Robot, mut library: Library) -> Library {
    let rows = library.grid().rows();
    for row in 0..rows {
        let mut found = Vec::new();
        library.solve_row(robot, row, |index, entry| {
            found.push((index, entry));
            ControlFlow::Continue(())
        });
        found.into_iter().for_each(|(index, entry)| library.insert(index, entry));
    }
    library
}

#[test]
fn a_library_is_the_same_bytes_however_often_it_was_interrupted() {
    let robot = vision60();
    let whole = solved(&robot, Library::new(&robot, small_grid(&robot)));
    assert_eq!(whole.missing(), 0);
    let text = whole.to_text();
    assert_eq!(Library::from_text(&text, &robot).unwrap(), whole);
    // Killed within the sixth gait's line, in the middle of a row.
    let sixth = text.match_indices('\n').nth(5).unwrap().0;
    let torn = &text[..sixth + 300];
    let e = Library::from_text(torn, &robot).unwrap_err().to_string();
    assert!(e.contains("line 7") && e.contains("cut short"), "{e}");
    let (part, used) = Library::resume(torn, &robot).unwrap();
    assert_eq!((part.missing(), used), (3, sixth + 1));
    assert_eq!(solved(&robot, part).to_text(), text);
    let e = Library::from_text(&text[..=sixth], &robot).unwrap_err();
    assert!(matches!(e, LibraryError::Incomplete { missing: 3, all: 8 }), "{e}");
}

#[test]
fn between_the_grid_s_points_a_library_states_what_interpolation_breaks() {
    let robot = vision60();
    let library = solved(&robot, Library::new(&robot, small_grid(&robot)));
    let mut request = library.grid().request(6);
    let there = library.find(&robot, &request).unwrap();
    assert_eq!(there.neighbours, [(6, 1.0)]);
    assert!(there.violation.amount <= 1e-5, "{:?}", there.violation);
    assert_eq!(there.gait.solver.status, "converged");

    request.speed_m_s = 0.25;
    request.clearance_m = 0.09;
    let between = library.find(&robot, &request).unwrap();
    assert_eq!(between.neighbours.len(), 4);
    assert_eq!(between.gait.solver.status, "interpolated");
    println!("{:?}", between.violation);
    assert!(between.violation.amount > 1e-5 && between.violation.amount < 5.0, "{:?}", between.violation);
    assert_eq!(between.gait.solver.max_violation, between.violation.amount);
    // And it is a good start.
    let options = PlanOptions { warm_start: Some(between.warm_start), ..PlanOptions::default() };
    let warm = plan(&robot, &request, &options, go_on).unwrap();
    let cold = plan(&robot, &request, &PlanOptions::default(), go_on).unwrap();
    assert!(warm.gait.solver.iterations < cold.gait.solver.iterations);
    assert!((warm.gait.solver.objective - cold.gait.solver.objective).abs() < 1e-6);

    for (change, expected) in [
        ((|r| r.speed_m_s = 0.5) as fn(&mut GaitRequest), "speed_m_s is 0.5; the library has 0.1 to 0.4"),
        (|r| r.friction = 0.8, "friction is 0.8; the library has 0.6"),
        (|r| r.height_m = f64::NAN, "height_m is NaN"),
    ] {
        let mut outside = request.clone();
        change(&mut outside);
        let e = library.find(&robot, &outside).unwrap_err().to_string();
        assert!(e.contains(expected), "expected {expected:?} in {e:?}");
    }
}

#[test]
fn a_damaged_library_is_refused_with_one_error_that_names_the_line() {
    let robot = vision60();
    let grid = small_grid(&robot);
    let entry = Entry::Refused("too fast".into());
    let mut library = Library::new(&robot, grid);
    for index in 0..8 {
        library.insert(index, entry.clone());
    }
    let text = library.to_text();
    let with = |line: usize, new: &str| -> String {
        text.lines().enumerate().map(|(k, l)| if k == line { new.to_string() } else { format!("{l}\n") }).collect()
    };
    let again = Library::entry_line(2, &entry);
    let far = Library::entry_line(99, &entry);
    let short =
        Library::entry_line(3, &Entry::Gait { iterations: 1, objective: 0.0, max_violation: 0.0, unknowns: vec![1.0] });
    let cases = [
        (String::new(), "line 1", "missing"),
        ("hello\n".into(), "line 1", "no library"),
        (text.replacen("vision60", "vision61", 1), "line 1", "checksum"),
        (text.replace("too fast", "too slow"), "line 2", "checksum"),
        (with(5, &again), "line 6", "second time"),
        (with(5, &far), "line 6", "gait number 99"),
        (with(4, &short), "line 5", "1 unknowns, expected 697"),
    ];
    for (bad, line, problem) in cases {
        let e = Library::from_text(&bad, &robot).unwrap_err().to_string();
        assert!(e.contains(line) && e.contains(problem), "expected {line:?} and {problem:?} in {e:?}");
    }
    let mut other = robot.clone();
    other.limits.plan_torque_nm[0] += 1.0;
    let e = Library::from_text(&text, &other).unwrap_err().to_string();
    assert!(e.contains("solve it again"), "{e}");
    let e = library.find(&robot, &library.grid().request(0)).unwrap_err().to_string();
    assert!(e.contains("too fast") && e.contains("clearance_m 0.08, speed_m_s 0.1"), "{e}");
}

#[test]
fn a_grid_that_cannot_be_meant_is_refused() {
    let robot = vision60();
    let base = as_steps("amble", &robot);
    let axis = |field, values: &[f64]| Axis { field, values: values.to_vec() };
    for (axes, expected) in [
        (vec![], "no axis"),
        (vec![axis(Field::SpeedMS, &[0.2, 0.1])], "not ascending"),
        (vec![axis(Field::SpeedMS, &[])], "no values"),
        (vec![axis(Field::SpeedMS, &[f64::NAN])], "not finite"),
        (vec![axis(Field::SpeedMS, &[0.1]), axis(Field::SpeedMS, &[0.2])], "two axes speed_m_s"),
        (vec![axis(Field::SpeedMS, &[0.1, 9.0])], "speed_m_s is 9"),
    ] {
        let e = Grid::new(&robot, base.clone(), axes).unwrap_err().to_string();
        assert!(e.contains(expected), "expected {expected:?} in {e:?}");
    }
}

/// A stance hip roll follows from the toes' fixed distance and is held to its polynomial at four points only: HyQ's
/// walk was refused for the polynomial through those four, and so was a long step across a slope.
#[test]
fn long_steps_of_the_full_order_program_keep_to_the_stance_rolls_polynomials() {
    let robot = vision60();
    let mut request = as_steps("amble", &robot);
    request.step_duration_s = step_duration_from_step_frequency(2.2);
    request.sideways_slope_rad = 4_f64.to_radians();
    request.speed_m_s = 0.37;
    let plan = plan(&robot, &request, &PlanOptions::default(), go_on).unwrap();
    for points in [&plan.points, &plan.second_points] {
        let between = between_points(&robot, &request, &plan.gait, points);
        assert!(between.is_kept(), "{:?}", between.broken());
    }
}

/// Request 24 of `bench requests --seed 2`: feasible from iteration 12 on, and the merit's tail stalls at steps of
/// 1/64. It was refused at the iteration limit.
#[test]
fn a_request_whose_last_gains_stall_is_planned_and_called_acceptable() {
    let robot = vision60();
    let request = GaitRequest {
        step_duration_s: 0.5838924745948644,
        height_m: 0.4940463919528749,
        half_width_m: 0.29303324963909544,
        clearance_m: 0.10135844276147697,
        speed_m_s: -0.47475349322510274,
        slope_rad: 0.927201981425279_f64.to_radians(),
        ..as_steps("amble", &robot)
    };
    let options = PlanOptions::default();
    let coarse = Planner::new(&robot).solve(&request, &options, go_on).unwrap();
    assert_eq!(coarse.status, Status::Acceptable);
    assert!(coarse.worst.amount <= 1e-5 && coarse.iterations() <= 40, "{} iterations", coarse.iterations());
    // From there, with twice the intervals.
    let plan = plan(&robot, &request, &options, go_on).unwrap();
    assert!(between_points(&on_slope(&robot, &request), &request, &plan.gait, &plan.points).is_kept());
}
