//! Gaits of other schedules than the trot: their programs' derivatives, and what they are.

use super::*;
use crate::tests::{go_on, noise, vision60};
use crate::tests_derivatives::agrees_with_central_differences;

/// Slow enough for every schedule.
fn slow(step_duration_s: f64, speed_m_s: f64) -> GaitRequest {
    let amble = GaitRequest::named("amble", &vision60()).unwrap();
    GaitRequest { step_duration_s, speed_m_s, clearance_m: 0.08, ..amble }
}

const TROT: ContactSchedule = ContactSchedule::Trot { four_leg_share: 0.25 };
const CRAWL: ContactSchedule = ContactSchedule::Crawl { four_leg_share: 0.0 };

/// Two, three and four legs stand, mirrored and over a stride that turns.
#[test]
fn the_jacobian_agrees_with_central_differences_over_any_stance_legs() {
    let robot = vision60();
    let mut options = ScheduleOptions::default();
    options.program.points = 5;
    let turning = GaitRequest { yaw_rate_rad_s: 0.3, ..slow(0.3, 0.1) };
    for (contacts, request) in [
        (TROT, slow(0.3, 0.2)),
        (CRAWL, slow(0.3, 0.1)),
        (CRAWL, turning),
        (ContactSchedule::Pace, slow(0.25, 0.2)),
        (ContactSchedule::Bound, slow(0.25, 0.2)),
    ] {
        let (mut program, mut x) = program_and_start(&robot, &request, &contacts, &options, Grid::coarse(5)).unwrap();
        let mut random = noise(5);
        x.iter_mut().for_each(|v| *v += 0.05 * random() * v.abs().max(1.0));
        agrees_with_central_differences(&mut program, x);
    }
}

/// The forces inside two, four and three stance legs follow from the law: elimination along the schedule and Clarabel's
/// sparse factors find the same gait.
#[test]
fn both_eliminations_find_the_same_gait_of_any_stance_legs() {
    let robot = vision60();
    let options = |subproblem| ScheduleOptions { subproblem, ..ScheduleOptions::default() };
    let [along, sparse] = [SubproblemSolver::Condensed, SubproblemSolver::Sparse].map(options);
    for (contacts, request) in [(TROT, slow(0.3, 0.3)), (CRAWL, slow(0.4, 0.1))] {
        let (mut program, start) = program_and_start(&robot, &request, &contacts, &along, Grid::coarse(11)).unwrap();
        let mut elimination = Ordered::<INPUTS, FREE>::new(&program, &program.order().unwrap(), 1e3).unwrap();
        let mut evaluation = nlp::Evaluation::new(&program);
        nlp::Problem::evaluate(&mut program, &start, &mut evaluation);
        let constraints = evaluation.constraints.clone();
        let step = nlp::Subproblem::solve(&mut elimination, &program, &start, &evaluation, &constraints).unwrap();
        assert!(step.multipliers.is_none(), "{contacts:?}: Clarabel had to help");
        let [a, b] = [&along, &sparse].map(|options| {
            let solution = solve(&mut program, &start, options, go_on).unwrap();
            assert!(solution.status.is_solution(), "{contacts:?}: {}", solution.status);
            (solution.objective, plan_of(&program, &solution, &robot, &request, &contacts).unwrap())
        });
        assert!((a.0 / b.0 - 1.0).abs() < 1e-6, "{contacts:?}: {} and {}", a.0, b.0);
        for (a, b) in a.1.points.iter().flatten().zip(b.1.points.iter().flatten()) {
            let furthest = |a: &[f64], b: &[f64]| a.iter().zip(b).fold(0.0_f64, |most, (a, b)| most.max((a - b).abs()));
            assert!(furthest(&a.q, &b.q) < 1e-4, "{contacts:?}: {:?} and {:?}", a.q, b.q);
            assert!(furthest(&a.torque_nm, &b.torque_nm) < 0.1, "{contacts:?}: {:?}, {:?}", a.torque_nm, b.torque_nm);
        }
    }
}

fn toes_m(robot: &Robot, q: &[f64; 18]) -> [nalgebra::Vector3<f64>; 4] {
    let mut data = rigid_body::Data::new(&robot.model);
    rigid_body::forward_kinematics(&robot.model, &mut data, q, &[0.0; 18], &[0.0; 18]);
    std::array::from_fn(|leg| rigid_body::frame_position(&robot.model, &data, robot.legs[leg].toe))
}

/// A leg that stands in one domain and in the next has not moved.
#[test]
fn toes_stay_where_they_landed_until_their_legs_swing() {
    let robot = vision60();
    for (contacts, request) in [(TROT, slow(0.3, 0.3)), (CRAWL, slow(0.4, 0.1))] {
        let plan = plan_schedule(&robot, &request, &contacts, &ScheduleOptions::default(), go_on).unwrap();
        let [first, second] = [0, 1].map(|domain| &plan.points[domain]);
        let landed = toes_m(&robot, &first.last().unwrap().q);
        let later = toes_m(&robot, &second.last().unwrap().q);
        for leg in (0..LEGS).filter(|&leg| plan.gait.cycle[1].stands[leg]) {
            assert!(
                (landed[leg] - later[leg]).norm() < 1e-3,
                "{contacts:?}, leg {leg}: {} {}",
                landed[leg],
                later[leg]
            );
            assert!(landed[leg].z.abs() < 1e-3, "{contacts:?}, leg {leg}: {}", landed[leg]);
        }
        // The second half is the mirror image of the first.
        let images = [2, 3, 0, 1];
        let [half, whole] = [&plan.gait.cycle[..2], &plan.gait.cycle[2..]];
        for (a, b) in half.iter().zip(whole) {
            assert!((0..LEGS).all(|leg| a.stands[leg] == b.stands[images[leg]]), "{:?} and {:?}", a.stands, b.stands);
        }
        // Over half a stride the ground carries the weight: what a force gives in between is a change of momentum.
        let mut impulse_n_s = 0.0;
        for (points, domain) in plan.points.iter().zip(&plan.gait.cycle) {
            let h = 2.0 * domain.duration_s / (points.len() - 1) as f64;
            let force_n = |p: &PlanPoint| p.ground_force_n.iter().map(|force| force[2]).sum::<f64>();
            for three in points.windows(3).step_by(2) {
                impulse_n_s += h / 6.0 * (force_n(&three[0]) + 4.0 * force_n(&three[1]) + force_n(&three[2]));
            }
        }
        let half_s: f64 = half.iter().map(|domain| domain.duration_s).sum();
        let weight_n = robot.model.total_mass() * robot.model.gravity.norm();
        assert!((impulse_n_s / (weight_n * half_s) - 1.0).abs() < 0.01, "{contacts:?}: {impulse_n_s} N s");
    }
}

#[test]
fn a_stride_that_turns_is_planned_with_both_halves() {
    let robot = vision60();
    let request = GaitRequest { lateral_speed_m_s: 0.1, yaw_rate_rad_s: 0.3, ..slow(0.25, 0.2) };
    let schedule = Schedule::of_contacts(&robot.mirror, &request, &CRAWL, Grid::coarse(11), false);
    let stands: Vec<_> = schedule.domains.iter().map(|d| &d.stance[..]).collect();
    assert_eq!(stands, [[0, 2, 3], [1, 2, 3], [0, 1, 2], [0, 1, 3]]);
    for (domain, swings) in [1, 0, 3, 2].into_iter().enumerate() {
        assert_eq!(schedule.landing(&robot.mirror, domain), [swings]);
        assert_eq!(schedule.newly_standing(&robot.mirror, (domain + 1) % 4), [swings]);
    }
}

#[test]
fn what_no_schedule_is_planned_for_is_named() {
    let robot = vision60();
    let leaning = GaitRequest { torso_roll_rad: 0.1, ..slow(0.3, 0.2) };
    for (contacts, request, expected) in [
        (TROT, leaning, "torso_roll_rad is 0.1"),
        (ContactSchedule::Trot { four_leg_share: 0.9 }, slow(0.5, 0.2), "four_leg_share is 0.9, expected 0.05 to 0.6"),
        (CRAWL, slow(5.0, 0.2), "step_duration_s is 5"),
    ] {
        let error = plan_schedule(&robot, &request, &contacts, &ScheduleOptions::default(), go_on).unwrap_err();
        assert!(error.to_string().contains(expected), "{error}");
    }
    let aside = GaitRequest { lateral_speed_m_s: 0.1, ..slow(0.4, 0.1) };
    let on_treads = ScheduleOptions { treads: true, ..ScheduleOptions::default() };
    let error = plan_schedule(&robot, &aside, &CRAWL, &on_treads, go_on).unwrap_err().to_string();
    assert!(error.contains("lateral_speed_m_s is 0.1, expected 0 to 0 m/s on treads"), "{error}");
}

/// With 7 points ground forces leave their limits between them by 5 N.
#[test]
fn a_phase_on_four_legs_that_breaks_a_limit_between_its_points_is_planned_with_more() {
    let robot = vision60();
    let contacts = ContactSchedule::Trot { four_leg_share: 0.1 };
    let plan = plan_schedule(&robot, &slow(0.3, 0.5), &contacts, &ScheduleOptions::default(), go_on).unwrap();
    let points: Vec<_> = plan.points.iter().map(Vec::len).collect();
    assert_eq!(points, [11, 13]);
}
