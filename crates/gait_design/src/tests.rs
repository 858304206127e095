//! The five gaits of the paper's Table I.

use super::*;
use nlp::{NullSpace, SqpSolver, Workspace};
use std::path::Path;

pub(crate) fn vision60() -> Robot {
    Robot::load(&Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config/robots/vision60")).unwrap()
}

/// A gait of Table I whose frequency counts steps, at a half-width of 0.25 m: harder to plan than the defaults, and what
/// the figures in these tests are of.
pub(crate) fn as_steps(name: &str, robot: &Robot) -> GaitRequest {
    let row = table_one().into_iter().find(|row| row.behaviour == name).unwrap();
    GaitRequest {
        step_duration_s: step_duration_from_step_frequency(row.frequency_hz),
        half_width_m: 0.25,
        ..GaitRequest::named(name, robot).unwrap()
    }
}

pub(crate) fn go_on(_: &Iteration) -> ControlFlow<()> {
    ControlFlow::Continue(())
}

/// Small, repeatable numbers between −1 and 1.
pub(crate) fn noise(seed: u64) -> impl FnMut() -> f64 {
    let mut state = seed.wrapping_mul(2).wrapping_add(1);
    move || {
        state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (state >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    }
}

#[test]
fn the_full_order_program_converges_to_gaits_no_costlier_than_the_decomposed_one_s() {
    let robot = vision60();
    for name in ["gait1", "amble"] {
        let request = as_steps(name, &robot);
        let whole = plan_full_order(&robot, &request, &PlanOptions::default(), go_on).unwrap();
        let decomposed = plan(&robot, &request, &PlanOptions::default(), go_on).unwrap();
        let (a, b) = (&whole.gait.solver, &decomposed.gait.solver);
        println!(
            "{name}: full order {} in {}, decomposed {} in {}",
            a.objective, a.iterations, b.objective, b.iterations
        );
        assert!(a.objective <= b.objective + 1e-6, "{name}: {} above {}", a.objective, b.objective);
        assert!(a.iterations <= 25 && a.max_violation <= 1e-5, "{name}: {a:?}");
        let comparison = simulate_planned_step(&robot, &whole.gait, &whole.points, StepLaw::Linearising).unwrap();
        // The freer motion of its rear legs is coarser sampled by eleven points than the decomposed plan's.
        assert!(comparison.joint_error_rad < 0.01 && comparison.normal_force_error < 0.01, "{name}: {comparison:?}");
    }
}

/// The optimum of the same program by an independent transcription (CasADi with IPOPT) at z = 0.55 m: of the default
/// requests (T = 1/(2 f), w = 0.31 m, the amble 0.341 m), and of their reading as steps (T = 1/f, w = 0.25 m).
const PEER_COSTS: [(&str, f64, f64); 5] = [
    ("gait1", 0.070504, 0.037376),
    ("gait2", 0.066064, 0.037045),
    ("gait3", 0.073042, 0.037492),
    ("gait4", 0.088989, 0.038555),
    ("amble", 0.120939, 0.053664),
];

#[test]
fn the_five_gaits_of_table_i_converge_to_the_independent_optimum() {
    let robot = vision60();
    let defaults = PEER_COSTS.map(|(name, peer, _)| (GaitRequest::named(name, &robot).unwrap(), peer));
    let steps = PEER_COSTS.map(|(name, _, peer)| (as_steps(name, &robot), peer));
    // The defaults take 6, 6, 6, 6 and 7 iterations.
    let most = [7; 5].into_iter().chain([10; 5]);
    for ((request, peer), most) in defaults.into_iter().chain(steps).zip(most) {
        let name = &request.behaviour;
        let plan = plan(&robot, &request, &PlanOptions::default(), go_on).unwrap();
        let solver = &plan.gait.solver;
        println!("{name}: {} iterations", solver.iterations);
        assert!(solver.iterations <= most, "{name} took {} iterations", solver.iterations);
        assert!(solver.max_violation <= 1e-5, "{name} violates a constraint by {}", solver.max_violation);
        assert!(solver.objective <= peer * 1.001, "{name} costs {}, the peer {peer}", solver.objective);
        assert!(
            solver.objective >= peer * 0.999,
            "{name} costs {}, below the peer's {peer}: a constraint is missing",
            solver.objective
        );
        for point in &plan.points {
            assert!(point.torque_nm.iter().all(|u| u.abs() <= 50.0 + 1e-4), "{name}: {:?}", point.torque_nm);
            for [x, y, z] in [point.ground_force_n[1], point.ground_force_n[2]] {
                assert!(z >= 30.0 - 1e-4 && x.hypot(y) <= 0.6 * z + 1e-4, "{name}: force ({x}, {y}, {z})");
            }
        }
    }
}

#[test]
fn the_compensated_reference_makes_the_bare_law_give_the_planned_torque() {
    let robot = vision60();
    let request = as_steps("amble", &robot);
    let plan = plan(&robot, &request, &PlanOptions::default(), go_on).unwrap();
    let (gait, gait::Gains { kp, kd }) = (&plan.gait, plan.gait.gains);
    for point in &plan.points {
        let (position, velocity) = gait.reference(gait::StepSide::First, point.phase);
        for j in 0..12 {
            let law = kp[j] * (position[j] - point.q[6 + j]) + kd[j] * (velocity[j] - point.v[6 + j]);
            let error = (law - point.torque_nm[j]).abs();
            assert!(
                error < 1.0,
                "joint {j} at s = {}: the law gives {law}, the plan wants {}",
                point.phase,
                point.torque_nm[j]
            );
        }
    }
}

#[test]
fn the_step_ends_where_its_mirror_begins_with_soft_touchdown() {
    let robot = vision60();
    let request = as_steps("amble", &robot);
    let plan = plan(&robot, &request, &PlanOptions::default(), go_on).unwrap();
    let (first, last) = (&plan.points[0], plan.points.last().unwrap());
    let mut expected = robot.mirror.coordinates(&first.q);
    expected[0] += plan.gait.step_length_m;
    let expected_velocity = robot.mirror.coordinates(&first.v);
    for i in 0..18 {
        assert!((last.q[i] - expected[i]).abs() < 2e-5, "q[{i}]");
        assert!((last.v[i] - expected_velocity[i]).abs() < 2e-5, "v[{i}]");
    }
    let mut data = rigid_body::Data::new(&robot.model);
    for leg in [0, 3] {
        let toe = rigid_body::point_kinematics(&robot.model, &mut data, &last.q, &last.v, &last.a, robot.legs[leg].toe);
        assert!(toe.velocity.norm() < 1e-4, "toe {leg} lands at {:?} m/s", toe.velocity);
        assert!(toe.position.z.abs() < 1e-4, "toe {leg} lands at height {}", toe.position.z);
    }
    let middle = &plan.points[5];
    for leg in [0, 3] {
        let toe =
            rigid_body::point_kinematics(&robot.model, &mut data, &middle.q, &middle.v, &middle.a, robot.legs[leg].toe);
        assert!((toe.position.z - request.clearance_m).abs() < 0.0051, "toe {leg} rises {}", toe.position.z);
    }
}

#[test]
fn the_same_request_gives_the_same_bytes() {
    let robot = vision60();
    let request = as_steps("gait2", &robot);
    let text = || plan(&robot, &request, &PlanOptions::default(), go_on).unwrap().gait.to_json();
    assert_eq!(text(), text());
}

#[test]
fn requests_that_cannot_be_meant_are_refused_by_field() {
    let robot = vision60();
    type Case = (&'static str, fn(&mut GaitRequest));
    let cases: [Case; 7] = [
        ("speed_m_s is 5, expected -2 to 2 m/s", |r| r.speed_m_s = 5.0),
        ("clearance_m is 0.4", |r| r.clearance_m = 0.4),
        ("height_m is NaN", |r| r.height_m = f64::NAN),
        ("step_duration_s is 0.01", |r| r.step_duration_s = 0.01),
        ("half_width_m is -0.1", |r| r.half_width_m = -0.1),
        ("height_m is 0.9", |r| r.height_m = 0.9),
        ("torque_limit_nm[knee] is 0", |r| r.torque_limit_nm[2] = 0.0),
    ];
    for (expected, spoil) in cases {
        let mut request = as_steps("amble", &robot);
        spoil(&mut request);
        let e = plan(&robot, &request, &PlanOptions::default(), go_on).unwrap_err().to_string();
        assert!(e.contains(expected), "expected {expected:?} in {e:?}");
    }
    let e = GaitRequest::named("moonwalk", &robot).unwrap_err().to_string();
    assert!(e.contains("moonwalk") && e.contains("gait1, gait2, gait3, gait4, amble"), "{e}");
}

#[test]
fn a_torque_bound_too_low_is_no_gait_and_names_what_fights() {
    let robot = vision60();
    let mut request = as_steps("gait1", &robot);
    request.torque_limit_nm = [5.0; 3];
    let e = plan(&robot, &request, &PlanOptions::default(), go_on).unwrap_err();
    println!("{e}");
    assert!(matches!(e, PlanError::NotConverged { .. }), "{e}");
}

#[test]
fn a_cancelled_plan_says_so() {
    let robot = vision60();
    let request = as_steps("gait1", &robot);
    let e = plan(&robot, &request, &PlanOptions::default(), |_| ControlFlow::Break(())).unwrap_err();
    assert!(matches!(e, PlanError::NotConverged { status: Status::Cancelled, .. }), "{e}");
}

#[test]
fn every_subproblem_solver_walks_the_same_path_to_the_same_optimum() {
    let robot = vision60();
    for name in behaviours() {
        let request = as_steps(name, &robot);
        let mut program = program_of(&robot, &request, ProgramSettings::default()).unwrap();
        let start = guess::nominal(&robot, &mut program, &request).unwrap();
        let solver = SqpSolver::new(PlanOptions::default().solver).unwrap();
        let mut workspace = Workspace::default();
        let sparse = solver.solve(&mut program, &start, go_on).unwrap();
        let condensed =
            solver.solve_with(&mut program, &mut Condensed::default(), &start, &mut workspace, go_on).unwrap();
        let mut null_space = NullSpace::<32>::new(1e3);
        let eliminated = solver.solve_with(&mut program, &mut null_space, &start, &mut workspace, go_on).unwrap();
        for (other, solution) in [("condensed", &condensed), ("eliminated", &eliminated)] {
            assert_eq!(solution.status, Status::Converged, "{name}, {other}");
            assert!(solution.multipliers.is_none(), "{name}, {other}: solved by Clarabel");
            assert!(sparse.iterations().abs_diff(solution.iterations()) <= 1, "{name}, {other}");
            assert!((sparse.objective - solution.objective).abs() < 2e-8, "{name}, {other}");
            // Extrapolation magnifies what Clarabel's tolerance leaves: the paths are one up to where it starts from.
            let plain = solution.log.iter().take_while(|i| !i.accelerated).count();
            assert!(plain >= 1, "{name}, {other}");
            for (a, b) in sparse.log.iter().zip(&solution.log[..=plain]) {
                assert!(
                    (a.objective - b.objective).abs() < 1e-6,
                    "{name}, {other}, iteration {}: {a:?}, {b:?}",
                    a.number
                );
            }
        }
    }
}

#[test]
fn the_full_order_quadruped_simulated_for_a_step_follows_every_plan() {
    let robot = vision60();
    for name in behaviours() {
        let request = as_steps(name, &robot);
        let plan = plan(&robot, &request, &PlanOptions::default(), go_on).unwrap();
        let comparison = simulate_planned_step(&robot, &plan.gait, &plan.points, StepLaw::Linearising).unwrap();
        println!("{name}: {comparison:?}");
        assert!(comparison.follows_plan(), "{name}: {comparison:?}");
        // Lines that lie on one another, as in the paper's Fig. "bi2quad": a thousandth of the weight.
        assert!(comparison.normal_force_error <= 1e-3, "{name}: {}", comparison.normal_force_error);
    }
}

#[test]
fn a_warm_start_reaches_the_cold_start_s_optimum_in_fewer_iterations() {
    let robot = vision60();
    let request = as_steps("amble", &robot);
    let first = plan(&robot, &request, &PlanOptions::default(), go_on).unwrap();
    let faster = GaitRequest { speed_m_s: 0.45, ..request };
    let cold = plan(&robot, &faster, &PlanOptions::default(), go_on).unwrap();
    let options = PlanOptions { warm_start: Some(first.warm_start), ..PlanOptions::default() };
    let warm = plan(&robot, &faster, &options, go_on).unwrap();
    let (a, b) = (&cold.gait.solver, &warm.gait.solver);
    assert!((a.objective - b.objective).abs() < 1e-6, "cold {}, warm {}", a.objective, b.objective);
    assert!(b.iterations <= a.iterations, "cold {}, warm {}", a.iterations, b.iterations);
}

#[test]
fn a_plan_for_a_slope_follows_its_step_on_that_slope_and_leans_into_it() {
    let robot = vision60();
    let mut request = as_steps("amble", &robot);
    request.slope_rad = 5.0_f64.to_radians();
    let plan = plan(&robot, &request, &PlanOptions::default(), go_on).unwrap();
    let comparison =
        simulate_planned_step(&on_slope(&robot, &request), &plan.gait, &plan.points, StepLaw::Linearising).unwrap();
    assert!(comparison.follows_plan(), "{comparison:?}");
    // Uphill the ground pushes forward: the mean of the horizontal forces carries the weight's share along the slope.
    let mean: f64 = plan.points.iter().map(|p| p.ground_force_n[1][0] + p.ground_force_n[2][0]).sum::<f64>()
        / plan.points.len() as f64;
    let expected = robot.model.total_mass() * 9.81 * request.slope_rad.sin();
    assert!((mean - expected).abs() < 0.1 * expected, "{mean} N, expected about {expected} N");
}

#[test]
fn on_a_sideways_slope_two_steps_are_planned_that_join_and_lean_into_it() {
    let robot = vision60();
    let mut request = as_steps("gait1", &robot);
    request.sideways_slope_rad = 5.0_f64.to_radians();
    let plan = plan(&robot, &request, &PlanOptions::default(), go_on).unwrap();
    println!("{:?}", plan.gait.solver);
    let on_slope = on_slope(&robot, &request);
    let weight = robot.model.total_mass() * 9.81;
    for points in [&plan.points, &plan.second_points] {
        let comparison = simulate_planned_step(&on_slope, &plan.gait, points, StepLaw::Linearising).unwrap();
        assert!(comparison.follows_plan(), "{comparison:?}");
        let between = between_points(&on_slope, &request, &plan.gait, points);
        assert!(between.is_kept(), "{between:?}");
        // The ground rises to the left: it has to push to the left.
        let sideways = points.iter().flat_map(|p| p.ground_force_n).map(|f| f[1]).sum::<f64>() / points.len() as f64;
        let expected = weight * request.sideways_slope_rad.sin();
        assert!((sideways - expected).abs() < 0.1 * expected, "{sideways} N, expected about {expected} N");
    }
    // A step ends as the other begins; a stride ends where it began.
    let (first, second) = (&plan.points, &plan.second_points);
    for (end, next) in [(first.last().unwrap(), &second[0]), (second.last().unwrap(), &first[0])] {
        for i in 0..18 {
            assert!((end.q[i] - next.q[i]).abs() < 1e-4 && (end.v[i] - next.v[i]).abs() < 1e-3, "coordinate {i}");
        }
    }
    // The second step is none of the mirror's.
    let mirrored = gait::Gait { second_step: None, ..plan.gait.clone() };
    let (own, image) =
        (plan.gait.planned(gait::StepSide::Mirrored, 0.5).0, mirrored.planned(gait::StepSide::Mirrored, 0.5).0);
    assert!(own.iter().zip(image).any(|(a, b)| (a - b).abs() > 0.02), "{own:?} {image:?}");
    let read = gait::Gait::from_json(&plan.gait.to_json()).unwrap();
    assert_eq!(read, plan.gait);
}

#[test]
fn a_reference_planned_in_the_program_gives_the_planned_torques_by_the_bare_law() {
    let robot = vision60();
    let request = as_steps("amble", &robot);
    let options = PlanOptions { reference: Reference::InProgram, ..PlanOptions::default() };
    let plan = plan(&robot, &request, &options, go_on).unwrap();
    let comparison = simulate_planned_step(&robot, &plan.gait, &plan.points, Reference::InProgram.step_law()).unwrap();
    println!("{comparison:?}", comparison = StepComparison { simulated: Vec::new(), ..comparison.clone() });
    assert!(comparison.follows_plan());
    let (gait, gait::Gains { kp, kd }) = (&plan.gait, plan.gait.gains);
    println!("{:?}", gait.solver);
    for point in &plan.points {
        let (position, velocity) = gait.reference(gait::StepSide::First, point.phase);
        for j in 0..12 {
            let law = kp[j] * (position[j] - point.q[6 + j]) + kd[j] * (velocity[j] - point.v[6 + j]);
            assert!(
                (law - point.torque_nm[j]).abs() < 0.05,
                "joint {j} at {}: {law}, planned {}",
                point.phase,
                point.torque_nm[j]
            );
        }
    }
}

#[test]
fn between_the_points_every_plan_keeps_its_limits() {
    let robot = vision60();
    for name in behaviours() {
        let request = as_steps(name, &robot);
        let plan = plan(&robot, &request, &PlanOptions::default(), go_on).unwrap();
        let between = between_points(&robot, &request, &plan.gait, &plan.points);
        println!("{name}: {between:?}");
        assert!(between.is_kept(), "{name}: {between:?}");
    }
}

#[test]
fn where_a_robot_is_and_where_it_heads_does_not_matter_to_its_multipliers() {
    let robot = vision60();
    let mut radii = Vec::new();
    for name in behaviours() {
        let request = as_steps(name, &robot);
        let plan = plan(&robot, &request, &PlanOptions::default(), go_on).unwrap();
        let stability = stability(&robot, &plan.gait, &plan.points, &[]).unwrap();
        println!("{name}: {:.3}, then {:.3?}", stability.spectral_radius(), &stability.multipliers[..4]);
        assert_eq!(stability.multipliers.len(), 25);
        let mut neutral: Vec<f64> = stability.neutral.iter().map(|m| m.re).collect();
        neutral.sort_by(f64::total_cmp);
        for (found, expected) in neutral.into_iter().zip([-1.0, -1.0, 1.0]) {
            assert!((found - expected).abs() < 1e-4, "{name}: {found}");
        }
        radii.push((plan.gait.step_duration_s, stability.spectral_radius()));
    }
    // The longer the robot tips about the line between two toes, the farther it has tipped.
    radii.sort_by(|a, b| a.0.total_cmp(&b.0));
    assert!(radii.windows(2).all(|w| w[0].1 < w[1].1), "{radii:?}");
}

#[test]
fn the_multipliers_of_two_mirrored_steps_are_the_squares_of_one_step_s() {
    let robot = vision60();
    let request = as_steps("gait1", &robot);
    let plan = plan(&robot, &request, &PlanOptions::default(), go_on).unwrap();
    let mirrored: Vec<PlanPoint> = plan
        .points
        .iter()
        .map(|p| {
            let mut torque = [0.0; 18];
            torque[6..].copy_from_slice(&p.torque_nm);
            let torque = robot.mirror.coordinates(&torque);
            let leg = |leg: usize| p.ground_force_n[robot.mirror.leg[leg]];
            PlanPoint {
                phase: p.phase,
                q: robot.mirror.coordinates(&p.q),
                v: robot.mirror.coordinates(&p.v),
                a: robot.mirror.coordinates(&p.a),
                torque_nm: torque[6..].try_into().unwrap(),
                ground_force_n: [0, 1, 2, 3].map(|l| [leg(l)[0], -leg(l)[1], leg(l)[2]]),
            }
        })
        .collect();
    let step = stability(&robot, &plan.gait, &plan.points, &[]).unwrap();
    let stride = stability(&robot, &plan.gait, &plan.points, &mirrored).unwrap();
    let mut squares: Vec<f64> = step.multipliers.iter().map(|m| m.norm_sqr()).collect();
    squares.sort_by(|a, b| b.total_cmp(a));
    for (square, found) in squares.iter().zip(&stride.multipliers).take(8) {
        assert!((square - found.norm()).abs() < 1e-6 * square.max(1.0), "{squares:?}, {:?}", stride.multipliers);
    }
    assert!(stride.neutral.iter().all(|m| (m - 1.0).norm() < 1e-3), "{:?}", stride.neutral);
}

#[test]
fn on_a_slope_only_the_place_is_neutral() {
    let robot = vision60();
    for (slope_rad, sideways_slope_rad) in [(0.1, 0.0), (0.0, 0.1)] {
        let request = GaitRequest { slope_rad, sideways_slope_rad, ..as_steps("gait1", &robot) };
        let plan = plan(&robot, &request, &PlanOptions::default(), go_on).unwrap();
        let s = stability(&on_slope(&robot, &request), &plan.gait, &plan.points, &plan.second_points).unwrap();
        println!("{:?}, largest {:?}", s.neutral, &s.multipliers[..4]);
        assert_eq!((s.neutral.len(), s.multipliers.len()), (2, 26));
        assert!(s.neutral.iter().all(|m| (m.norm() - 1.0).abs() < 1e-4), "{:?}", s.neutral);
    }
}

/// Twenty more requests (behaviour, step frequency Hz, clearance m, speed m/s, height m, half-width m) with the optimum's cost by the
/// same independent transcription as above, at 11 points: a sum over more of them is another number.
const MORE_PEER_COSTS: [(&str, f64, f64, f64, f64, f64, f64); 20] = [
    ("gait1", 4.44, 0.106, 0.00, 0.543, 0.253, 0.05468068),
    ("amble", 2.09, 0.119, 0.42, 0.497, 0.24, 0.10761389),
    ("gait2", 3.23, 0.119, 0.00, 0.51, 0.242, 0.04868250),
    ("amble", 4.35, 0.127, 0.17, 0.571, 0.227, 0.05514860),
    ("gait3", 4.17, 0.093, 0.00, 0.532, 0.23, 0.04862450),
    ("amble", 3.73, 0.098, -0.10, 0.543, 0.222, 0.04346534),
    ("gait4", 2.55, 0.105, 0.00, 0.501, 0.249, 0.04672984),
    ("amble", 2.66, 0.057, 0.10, 0.514, 0.215, 0.04202062),
    ("gait1", 3.38, 0.134, 0.00, 0.572, 0.221, 0.03890582),
    ("amble", 3.35, 0.064, 0.08, 0.537, 0.217, 0.03843201),
    ("gait2", 2.21, 0.144, 0.00, 0.512, 0.211, 0.04202841),
    ("amble", 3.15, 0.112, 0.03, 0.56, 0.229, 0.03735084),
    ("gait3", 4.29, 0.094, 0.00, 0.523, 0.213, 0.05073751),
    ("amble", 2.7, 0.06, 0.39, 0.492, 0.215, 0.06618500),
    ("gait4", 3.22, 0.081, 0.00, 0.565, 0.237, 0.03465890),
    ("amble", 2.59, 0.069, 0.06, 0.498, 0.211, 0.04412201),
    ("gait1", 3.2, 0.123, 0.00, 0.488, 0.253, 0.05350653),
    ("amble", 3.07, 0.081, -0.10, 0.489, 0.231, 0.04908690),
    ("gait2", 2.54, 0.115, 0.00, 0.502, 0.256, 0.04739448),
    ("amble", 2.87, 0.117, 0.39, 0.544, 0.255, 0.05726773),
];

#[test]
fn twenty_other_requests_converge_to_the_independent_optimum() {
    let robot = vision60();
    for (name, frequency_hz, clearance_m, speed_m_s, height_m, half_width_m, peer) in MORE_PEER_COSTS {
        let request = GaitRequest {
            step_duration_s: step_duration_from_step_frequency(frequency_hz),
            clearance_m,
            speed_m_s,
            height_m,
            half_width_m,
            ..as_steps(name, &robot)
        };
        let cost = Planner::new(&robot).solve(&request, &PlanOptions::default(), go_on).unwrap().objective;
        assert!((cost / peer - 1.0).abs() < 1e-4, "{name} at {frequency_hz} Hz: {cost}, the peer {peer}");
    }
}

#[test]
fn the_planned_joints_are_the_reference_where_they_are_asked_for() {
    let robot = vision60();
    let request = as_steps("gait1", &robot);
    let options = PlanOptions { reference: Reference::PlannedJoints, ..PlanOptions::default() };
    let planned = plan(&robot, &request, &options, go_on).unwrap().gait;
    let compensated = plan(&robot, &request, &PlanOptions::default(), go_on).unwrap().gait;
    assert_eq!(planned.reference_coefficients_rad, planned.coefficients_rad);
    assert_eq!(planned.coefficients_rad, compensated.coefficients_rad);
    assert_ne!(compensated.reference_coefficients_rad, compensated.coefficients_rad);
}

/// Changes of speed by 0.1 m/s and of clearance by 2 cm over the whole range, each from the solution before.
#[test]
fn a_leaning_torso_is_held_at_its_angle() {
    let robot = vision60();
    for (torso_pitch_rad, torso_roll_rad) in [(0.1, 0.0), (-0.1, 0.0), (0.0, 0.08)] {
        let request = GaitRequest { torso_pitch_rad, torso_roll_rad, ..as_steps("amble", &robot) };
        let plan = plan(&robot, &request, &PlanOptions::default(), go_on).unwrap();
        println!("{torso_pitch_rad} {torso_roll_rad}: {:?}", plan.gait.solver);
        assert_eq!(plan.gait.second_step.is_some(), torso_roll_rad != 0.0);
        for points in [&plan.points, &plan.second_points] {
            if points.is_empty() {
                continue;
            }
            let comparison = simulate_planned_step(&robot, &plan.gait, points, StepLaw::Linearising).unwrap();
            assert!(comparison.follows_plan(), "{comparison:?}");
            let between = between_points(&robot, &request, &plan.gait, points);
            assert!(between.is_kept(), "{between:?}");
        }
        let all: Vec<_> = plan.points.iter().chain(&plan.second_points).collect();
        for (coordinate, angle) in [(3, torso_roll_rad), (4, torso_pitch_rad)] {
            if angle != 0.0 {
                let mean = all.iter().map(|p| p.q[coordinate]).sum::<f64>() / all.len() as f64;
                assert!((mean - angle).abs() < 0.01, "coordinate {coordinate}: {mean} rad, asked {angle}");
            }
        }
    }
}
