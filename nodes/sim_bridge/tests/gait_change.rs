//! One gait after another without a stop in between: every pair, taken at either side's switch.

use control::{Config, Controller, Input, JointState, Mode, PreparedGait, Request, Tilt};
use gait::Gait;
use gait_design::{GaitRequest, PlanOptions};
use robot::Robot;
use std::ops::ControlFlow;
use std::path::Path;
use std::time::Duration;
use tandem_sim_bridge::simulator::{Posture, Simulator, SimulatorOptions};

const NAMES: [&str; 5] = ["gait1", "gait2", "gait3", "gait4", "amble"];
const PERIOD: Duration = Duration::from_millis(1);

fn vision60() -> Robot {
    Robot::load(&Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config/robots/vision60")).unwrap()
}

fn plan(robot: &Robot, name: &str) -> Gait {
    let request = GaitRequest::named(name, robot).unwrap();
    gait_design::plan(robot, &request, &PlanOptions::default(), |_| ControlFlow::Continue(())).unwrap().gait
}

/// What came of a change.
#[derive(Debug)]
struct Change {
    /// The new gait was taken at a switch, without standing in between.
    at_once: bool,
    /// Largest error of a joint and largest tilt after the new gait had come, rad.
    error_rad: f64,
    tilt_rad: f64,
    /// Where it ended with a fault: which, and how long after the new gait had come, s.
    fault: Option<(String, f64)>,
}

/// Stands up, walks `from` for 4 s and a little, hears of `to` at `phase` of a step on the side that `odd` tells, and walks on for 8 s.
fn change(robot: &Robot, from: &Gait, to: &Gait, odd: bool, phase: f64, seed: u64) -> Change {
    let config = Config::for_robot(robot);
    let [from, to] = [from, to].map(|gait| PreparedGait::new(gait, &config).unwrap());
    let mut controller = Controller::new(config).unwrap();
    let mut simulator =
        Simulator::new(robot, SimulatorOptions { joint_noise_rad: 0.01, seed, ..SimulatorOptions::default() }).unwrap();
    simulator.reset_to_posture(Posture::Sit);
    let mut result = Change { at_once: true, error_rad: 0.0, tilt_rad: 0.0, fault: None };
    let (mut walking_since, mut changed_at, mut step) = (None, None, (0, 0.0));
    for cycle in 0u32.. {
        let now = PERIOD * cycle;
        let state = simulator.state();
        let (position_rad, velocity_rad_s) = simulator.joints();
        let joints = JointState {
            stamp: now,
            arrived: [now; 12],
            position_rad,
            velocity_rad_s,
            temperature_c: None,
            drive_error: [0; 12],
        }
        .to_resolution();
        let [roll_rad, pitch_rad, _] = state.roll_pitch_yaw();
        let asks: &[Request] = if cycle == 0 { &[Request::Arm, Request::Stand, Request::Walk] } else { &[] };
        let due = changed_at.is_none()
            && walking_since.is_some_and(|since: Duration| now > since + Duration::from_secs(4))
            && (step.0 % 2 == 1) == odd
            && step.1 >= phase;
        if due {
            changed_at = Some(now);
        }
        let gait = if cycle == 0 { Some(&from) } else { due.then_some(&to) };
        let input = Input {
            joints: Some(&joints),
            tilt: Some(Tilt { roll_rad, pitch_rad }.to_resolution()),
            requests: asks,
            gait,
            ..Input::default()
        };
        let output = controller.step(&input, now);
        step = (output.step_index, output.step_phase);
        if output.mode == Mode::Walking {
            walking_since.get_or_insert(now);
        }
        if let Some(at) = changed_at {
            result.at_once &= output.mode == Mode::Walking;
            let errors = output.tracking_error_rad.iter().map(|error| error.abs());
            result.error_rad = errors.fold(result.error_rad, f64::max);
            result.tilt_rad = result.tilt_rad.max(roll_rad.abs()).max(pitch_rad.abs());
            let after = (now - at).as_secs_f64();
            if let Some(report) = output.report {
                result.fault = Some((format!("{} {:?} {:.3}", report.fault.name(), report.joint, report.value), after));
                return result;
            }
            if after > 8.0 {
                assert_eq!(output.mode, Mode::Walking);
                assert_eq!(controller.gait().map(PreparedGait::name), Some(to.name()));
                return result;
            }
        }
        assert!(now < Duration::from_secs(60), "{:?}", output.mode);
        simulator.command(&output.command);
        for _ in 0..2 {
            simulator.step();
        }
    }
    unreachable!("the loop returns")
}

#[test]
fn every_gait_follows_every_other_from_either_side() {
    let robot = vision60();
    let gaits = NAMES.map(|name| plan(&robot, name));
    let mut bad = Vec::new();
    for from in &gaits {
        for to in &gaits {
            for odd in [false, true] {
                let change = change(&robot, from, to, odd, 0.5, 1);
                println!("{} -> {} {}: {change:?}", from.name, to.name, if odd { "odd" } else { "even" });
                if change.fault.is_some() {
                    bad.push((from.name.clone(), to.name.clone(), odd, change));
                }
            }
        }
    }
    assert!(bad.is_empty(), "{bad:#?}");
}
