//! A crawl that is planned onto stairs, walked up them by the controller in the simulator.

mod common;

use common::Shelf;
use gait::Gait;
use gait_design::{ContactSchedule, GaitRequest, ScheduleOptions, plan_schedule};
use robot::Robot;
use simulator::walk::{End, Start, WalkOptions, walk};
use simulator::{SimulatorOptions, Terrain};
use std::ops::ControlFlow;

const RISE_M: f64 = 0.1;
const RUN_M: f64 = 0.3;
const STEP_DURATION_S: f64 = 0.5;

/// Up one stair a stride of four steps, toes in the middles of the treads.
fn plan(robot: &Robot) -> Gait {
    let request = GaitRequest {
        step_duration_s: STEP_DURATION_S,
        speed_m_s: RISE_M.hypot(RUN_M) / (4.0 * STEP_DURATION_S),
        clearance_m: 0.12,
        half_width_m: 0.31,
        slope_rad: RISE_M.atan2(RUN_M),
        ..GaitRequest::named("amble", robot).unwrap()
    };
    let options = ScheduleOptions { treads: true, ..ScheduleOptions::default() };
    let crawl = ContactSchedule::Crawl { four_leg_share: 0.0 };
    let plan = plan_schedule(robot, &request, &crawl, &options, |_| ControlFlow::Continue(())).unwrap();
    println!("{} iterations", plan.gait.solver.iterations);
    plan.gait
}

/// How far a stride goes along the slope, m.
fn stride_m(gait: &Gait) -> f64 {
    gait.speed_m_s() * gait.stride_duration_s()
}

#[test]
fn a_crawl_climbs_five_stairs_of_ten_centimetres_under_both_laws_and_does_not_fall() {
    let shelf = Shelf::new();
    let gait = plan(&shelf.robot);
    let terrain = Terrain::staircase_of(&shelf.robot, &gait).unwrap();
    let Terrain::Staircase { rise_m, .. } = terrain else { panic!("{terrain:?}") };
    assert!(rise_m > 0.1, "stairs of {rise_m} m");
    for balance in [false, true] {
        for seed in 1..=3 {
            let simulator = SimulatorOptions {
                friction: 0.8,
                terrain,
                seed,
                joint_noise_rad: 0.005,
                ..SimulatorOptions::default()
            };
            let options =
                WalkOptions { seconds: 12.0, start: Start::Gait, balance, simulator, ..WalkOptions::default() };
            let walk = walk(&shelf.robot, &gait, &options, &mut |_, _, _| {}).unwrap();
            let (f, stairs) = (&walk.figures, walk.figures.drift_m[0] / stride_m(&gait));
            println!(
                "balance {balance}, seed {seed}: {:?}, {stairs:.1} stairs, tilt {:.1} deg, {:.0} N m",
                walk.end, f.max_tilt_deg, f.max_torque_nm
            );
            assert_eq!(walk.end, End::Upright, "balance {balance}, seed {seed}");
            assert!(stairs > 5.0, "{stairs} stairs, balance {balance}, seed {seed}");
            assert!(f.max_tilt_deg < 8.0, "tilted by {} degrees against the stairs' slope", f.max_tilt_deg);
        }
    }
}

#[test]
fn a_gait_that_is_planned_for_no_stairs_has_none() {
    let amble = Gait::from_json(include_str!("../../../tests/gaits/amble.json")).unwrap();
    let error = Terrain::staircase_of(&Shelf::new().robot, &amble).unwrap_err().to_string();
    assert!(error.contains("\"amble\" is not planned for stairs"), "{error}");
}
