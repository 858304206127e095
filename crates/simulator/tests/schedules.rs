//! Gaits of other contact schedules than the trot, walked by the bare tracking law: the reference of each domain in
//! turn, switched by the clock.

mod common;

use common::Shelf;
use gait::{Domain, Gait, InitialState};
use gait_design::{ContactSchedule, GaitRequest, ScheduleOptions, plan_schedule};
use joints::{JOINTS, JointCommand};
use robot::Robot;
use simulator::{Fall, Simulator, SimulatorOptions};
use std::ops::ControlFlow;

const SECONDS: f64 = 12.0;

/// How a walk went.
#[derive(Debug)]
struct Walked {
    fell: Option<Fall>,
    /// Time on the legs, s.
    time_s: f64,
    /// Mean speed ahead over that time, m/s.
    speed_m_s: f64,
    /// Largest roll and pitch, rad.
    tilt_rad: [f64; 2],
    /// How high each toe rose, m.
    rise_m: [f64; 4],
}

/// Walks a cycle of domains for [`SECONDS`] from a state on it, joints off by 0.01 rad at random.
fn walk(robot: &Robot, on_it: &Gait, domains: &[Domain], seed: u64) -> Walked {
    let options = SimulatorOptions { friction: 0.8, joint_noise_rad: 0.01, seed, ..SimulatorOptions::default() };
    let mut simulator = Simulator::new(robot, options).unwrap();
    simulator.reset_to_gait(on_it).unwrap();
    let begins_m = simulator.state().base_position_m[0];
    let cycle_s: f64 = domains.iter().map(|domain| domain.duration_s).sum();
    let (mut tilt_rad, mut rise_m) = ([0.0_f64; 2], [0.0_f64; 4]);
    let mut fell = None;
    while simulator.time_s() < SECONDS && fell.is_none() {
        let mut time_s = simulator.time_s() % cycle_s;
        let mut domain = &domains[0];
        for next in &domains[1..] {
            if time_s < domain.duration_s {
                break;
            }
            time_s -= domain.duration_s;
            domain = next;
        }
        let (position_rad, velocity_rad_s) = domain.reference((time_s / domain.duration_s).min(1.0));
        simulator.command(&JointCommand {
            position_rad,
            velocity_rad_s,
            kp: std::array::from_fn(|j| robot.gains.kp_nm_per_rad[j % 3]),
            kd: std::array::from_fn(|j| robot.gains.kd_nm_s_per_rad[j % 3]),
            torque_nm: [0.0; JOINTS],
        });
        simulator.step();
        let [roll, pitch, _] = simulator.state().roll_pitch_yaw();
        tilt_rad = [tilt_rad[0].max(roll.abs()), tilt_rad[1].max(pitch.abs())];
        for (rise_m, toe) in rise_m.iter_mut().zip(simulator.toe_positions_m()) {
            *rise_m = rise_m.max(toe[2] - robot.toe_radius_m);
        }
        fell = simulator.fallen();
    }
    let (time_s, state) = (simulator.time_s(), simulator.state());
    Walked { fell, time_s, speed_m_s: (state.base_position_m[0] - begins_m) / time_s, tilt_rad, rise_m }
}

/// A gait of the robot that begins in a given state.
fn beginning(shelf: &Shelf, initial: InitialState) -> Gait {
    Gait { initial, ..shelf.plan_gait("amble", None) }
}

/// Walks a schedule's gait three times, from starts that differ.
fn walked(contacts: ContactSchedule, step_duration_s: f64, speed_m_s: f64, points: usize) -> Vec<Walked> {
    let shelf = Shelf::new();
    let amble = GaitRequest::named("amble", &shelf.robot).unwrap();
    let request = GaitRequest { step_duration_s, speed_m_s, clearance_m: 0.08, ..amble };
    let go_on = |_: &_| ControlFlow::Continue(());
    let mut options = ScheduleOptions::default();
    options.program.points = points;
    let plan = plan_schedule(&shelf.robot, &request, &contacts, &options, go_on).unwrap();
    let on_it = beginning(&shelf, plan.gait.initial.clone());
    let walks: Vec<Walked> = (1..=3).map(|seed| walk(&shelf.robot, &on_it, &plan.gait.cycle, seed)).collect();
    println!("{contacts:?}, T {step_duration_s} s, {speed_m_s} m/s, {} iterations", plan.gait.solver.iterations);
    walks.iter().for_each(|walked| println!("  {walked:?}"));
    walks
}

/// Every walk is upright, as fast as planned to within `off_m_s`, and lifts every toe.
fn is_walked(contacts: ContactSchedule, step_duration_s: f64, speed_m_s: f64, off_m_s: f64) {
    for walked in walked(contacts, step_duration_s, speed_m_s, 11) {
        assert!(walked.fell.is_none() && walked.time_s >= SECONDS, "{contacts:?}: {walked:?}");
        assert!((walked.speed_m_s - speed_m_s).abs() < off_m_s, "{contacts:?}: {walked:?}");
        assert!(walked.tilt_rad.iter().all(|tilt_rad| *tilt_rad < 0.15), "{contacts:?}: {walked:?}");
        assert!(walked.rise_m.iter().all(|rise_m| (0.05..0.12).contains(rise_m)), "{contacts:?}: {walked:?}");
    }
}

#[test]
fn a_trot_with_a_four_leg_phase_is_walked_along_its_domains() {
    is_walked(ContactSchedule::Trot { four_leg_share: 0.25 }, 0.22, 0.3, 0.05);
}

#[test]
fn a_crawl_is_walked_along_its_domains() {
    is_walked(ContactSchedule::Crawl { four_leg_share: 0.0 }, 0.4, 0.1, 0.02);
    is_walked(ContactSchedule::Crawl { four_leg_share: 0.0 }, 0.3, 0.2, 0.02);
}

#[test]
fn a_bound_is_walked_along_its_domains() {
    is_walked(ContactSchedule::Bound, 0.2, 0.5, 0.05);
}

/// It stays up, and goes slower than planned.
#[test]
fn a_pace_stays_up_along_its_domains() {
    for walked in walked(ContactSchedule::Pace, 0.15, 0.2, 21) {
        assert!(walked.fell.is_none() && walked.time_s >= SECONDS, "{walked:?}");
        assert!(walked.rise_m.iter().all(|rise_m| *rise_m > 0.05), "{walked:?}");
    }
}
