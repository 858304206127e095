//! Gaits of other contact schedules than the trot's two steps, walked by the controller in the simulator.

mod common;

use common::{Day, Shelf};
use control::{Mode, PreparedGait, Request, Velocity};
use gait::Gait;
use gait_design::{ContactSchedule, GaitRequest, ScheduleOptions, plan_schedule};
use simulator::walk::{End, Start, Walk, WalkError, WalkOptions, walk};
use simulator::{Posture, SimulatorOptions};
use std::ops::ControlFlow;

const SECONDS: f64 = 12.0;
const TROT: ContactSchedule = ContactSchedule::Trot { four_leg_share: 0.25 };
const CRAWL: ContactSchedule = ContactSchedule::Crawl { four_leg_share: 0.0 };

fn plan(shelf: &Shelf, contacts: ContactSchedule, step_duration_s: f64, speed_m_s: f64, points: usize) -> Gait {
    let amble = GaitRequest::named("amble", &shelf.robot).unwrap();
    let request = GaitRequest { step_duration_s, speed_m_s, clearance_m: 0.08, ..amble };
    let mut options = ScheduleOptions::default();
    options.program.points = points;
    let plan = plan_schedule(&shelf.robot, &request, &contacts, &options, |_| ControlFlow::Continue(())).unwrap();
    println!("{contacts:?}, T {step_duration_s} s, {speed_m_s} m/s, {} iterations", plan.gait.solver.iterations);
    // What is written down is what is walked.
    Gait::from_json(&plan.gait.to_json()).unwrap()
}

fn out_of_standing() -> WalkOptions {
    WalkOptions { seconds: SECONDS, start: Start::Posture(Posture::Stand), ..WalkOptions::default() }
}

/// Walks on a floor of friction 0.8, joints off by 0.01 rad at random; how high each toe rose, m.
fn walked(shelf: &Shelf, gait: &Gait, options: &WalkOptions, seed: u64) -> Result<(Walk, [f64; 4]), WalkError> {
    let simulator = SimulatorOptions { friction: 0.8, joint_noise_rad: 0.01, seed, ..SimulatorOptions::default() };
    let options = WalkOptions { simulator, ..options.clone() };
    let mut rise_m = [0.0_f64; 4];
    let walk = walk(&shelf.robot, gait, &options, &mut |simulator, _, _| {
        for (rise_m, toe) in rise_m.iter_mut().zip(simulator.toe_positions_m()) {
            *rise_m = rise_m.max(toe[2] - shelf.robot.toe_radius_m);
        }
    })?;
    let f = &walk.figures;
    println!(
        "  {:?}, {:.3} and {:.3} m/s, turned {:.0} deg, tilt {:.2} deg, {:.0} N m, toes rise {rise_m:.3?} m",
        walk.end, f.speed_m_s, f.lateral_speed_m_s, f.turned_deg, f.max_tilt_deg, f.max_torque_nm
    );
    Ok((walk, rise_m))
}

/// What a walk is held to: off its speed and tilted at most by so much.
struct Bounds {
    off_m_s: f64,
    tilt_deg: f64,
}

/// Every walk of three is upright to the end, as fast as planned, hardly tilted, and lifts every toe.
fn is_walked(shelf: &Shelf, gait: &Gait, options: &WalkOptions, bounds: &Bounds) {
    for seed in 1..=3 {
        let (walk, rise_m) = walked(shelf, gait, options, seed).unwrap();
        assert_eq!(walk.end, End::Upright, "{}", gait.request);
        let (f, planned_m_s) = (&walk.figures, gait.speed_m_s());
        assert!((f.speed_m_s - planned_m_s).abs() < bounds.off_m_s, "{} m/s of {planned_m_s}", f.speed_m_s);
        assert!(f.lateral_speed_m_s.abs() < 0.02, "{} m/s to a side", f.lateral_speed_m_s);
        assert!(f.max_tilt_deg < bounds.tilt_deg, "tilted by {} degrees", f.max_tilt_deg);
        assert!(rise_m.iter().all(|rise_m| (0.05..0.12).contains(rise_m)), "{rise_m:?}");
    }
}

#[test]
fn a_trot_with_a_four_leg_phase_walks_out_of_standing_and_does_not_fall() {
    let shelf = Shelf::new();
    let gait = plan(&shelf, TROT, 0.22, 0.3, 11);
    is_walked(&shelf, &gait, &out_of_standing(), &Bounds { off_m_s: 0.08, tilt_deg: 3.0 });
}

#[test]
fn a_crawl_walks_out_of_standing_and_does_not_fall() {
    let shelf = Shelf::new();
    for (step_duration_s, speed_m_s) in [(0.4, 0.1), (0.3, 0.2)] {
        let gait = plan(&shelf, CRAWL, step_duration_s, speed_m_s, 11);
        is_walked(&shelf, &gait, &out_of_standing(), &Bounds { off_m_s: 0.02, tilt_deg: 2.0 });
    }
}

/// Out of standing it does not come onto its motion (docs/measurements/planning.md).
#[test]
fn a_bound_goes_on_from_its_own_state_and_does_not_fall() {
    let shelf = Shelf::new();
    let gait = plan(&shelf, ContactSchedule::Bound, 0.2, 0.5, 11);
    let on_it = WalkOptions { start: Start::Gait, ..out_of_standing() };
    is_walked(&shelf, &gait, &on_it, &Bounds { off_m_s: 0.05, tilt_deg: 6.0 });
}

#[test]
fn a_stopped_crawl_stands_on_all_four_feet() {
    let shelf = Shelf::new();
    let gait = PreparedGait::new(&plan(&shelf, CRAWL, 0.4, 0.1, 11), &shelf.config).unwrap();
    for walked_s in [0.5, 3.05, 3.3, 3.5, 3.7] {
        let mut day = Day::new(&shelf, format!("a crawl that is stopped after {walked_s} s"), 0.8);
        day.walk(&gait);
        day.run(walked_s);
        day.cycle(&[Request::Stop], None);
        day.until("standing", 0.41, |output| output.mode == Mode::Standing);
        day.until("at rest", 1.0, |output| output.holds_posture);
        day.run(1.0);
        let state = day.simulator.state();
        assert!(state.toe_force_n.iter().all(|force| force[2] > 20.0), "{}: {:?}", day.title, state.toe_force_n);
        assert!(day.tilt_rad < 0.05, "{}: {} rad", day.title, day.tilt_rad);
        // And down and off.
        day.cycle(&[Request::Sit], None);
        day.until("disarmed", 10.0, |output| output.mode == Mode::Disarmed);
    }
}

fn driven(shelf: &Shelf, gait: &Gait, [forward_m_s, left_m_s, yaw_rad_s]: [f64; 3]) -> Walk {
    let velocities = vec![(2.0, Velocity { forward_m_s, left_m_s, yaw_rad_s })];
    let (walk, _) = walked(shelf, gait, &WalkOptions { balance: true, velocities, ..out_of_standing() }, 1).unwrap();
    assert_eq!(walk.end, End::Upright, "asked for {forward_m_s} m/s");
    walk
}

/// Speeds by the body's heading over the second half of the walk; turning over 10 s.
fn goes(shelf: &Shelf, gait: &Gait, asked: [f64; 3], off_m_s: f64) {
    let f = driven(shelf, gait, asked).figures;
    let [forward_m_s, left_m_s, yaw_rad_s] = asked;
    assert!((f.speed_m_s - forward_m_s).abs() < off_m_s, "{} m/s of {forward_m_s}", f.speed_m_s);
    assert!((f.lateral_speed_m_s - left_m_s).abs() < 0.03, "{} m/s of {left_m_s} to the left", f.lateral_speed_m_s);
    let turns_deg = (10.0 * yaw_rad_s).to_degrees();
    assert!((f.turned_deg - turns_deg).abs() < 12.0, "turned {} of {turns_deg} degrees", f.turned_deg);
}

#[test]
fn a_crawl_in_balance_goes_as_fast_as_it_is_told_and_turns() {
    let shelf = Shelf::new();
    for (step_duration_s, speed_m_s) in [(0.4, 0.1), (0.3, 0.2)] {
        let gait = plan(&shelf, CRAWL, step_duration_s, speed_m_s, 11);
        for asked in [[1.5 * speed_m_s, 0.0, 0.0], [0.0; 3], [speed_m_s, 0.05, 0.2]] {
            goes(&shelf, &gait, asked, 0.02);
        }
    }
}

#[test]
fn a_trot_with_a_four_leg_phase_in_balance_goes_about_as_fast_as_it_is_told_and_turns() {
    let shelf = Shelf::new();
    let gait = plan(&shelf, TROT, 0.22, 0.3, 11);
    for asked in [[0.45, 0.0, 0.0], [0.0; 3], [0.3, 0.05, 0.2]] {
        goes(&shelf, &gait, asked, 0.1);
    }
}

/// Their bodies pitch and roll as planned, by 2 and 5 degrees at up to 1.7 rad/s.
#[test]
fn the_balanced_law_refuses_a_bound_and_a_pace_before_they_are_walked() {
    let shelf = Shelf::new();
    for (contacts, step_duration_s, speed_m_s, points) in
        [(ContactSchedule::Bound, 0.2, 0.5, 11), (ContactSchedule::Pace, 0.15, 0.2, 21)]
    {
        let gait = plan(&shelf, contacts, step_duration_s, speed_m_s, points);
        let options = WalkOptions { balance: true, ..out_of_standing() };
        let error = walked(&shelf, &gait, &options, 1).unwrap_err().to_string();
        assert!(error.contains("cycle[0].stance_legs are") && error.contains("under the bare law"), "{error}");
    }
}
