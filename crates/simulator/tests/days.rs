//! Days of the robot in the simulator: up, walk, one gait after another, stop, sit. What an operator may ask ends in no fault.

use control::{Config, Controller, InertialState, Input, JointState, Mode, Output, PreparedGait, Request, Tilt};
use gait_design::{GaitRequest, PlanOptions};
use robot::Robot;
use simulator::{Posture, Simulator, SimulatorOptions};
use std::ops::ControlFlow;
use std::path::Path;
use std::time::Duration;

const NAMES: [&str; 5] = ["gait1", "gait2", "gait3", "gait4", "amble"];
const PERIOD: Duration = Duration::from_millis(1);

/// Vision 60, its configuration, and the five gaits.
struct Shelf {
    robot: Robot,
    config: Config,
    gaits: Vec<(&'static str, PreparedGait)>,
}

impl Shelf {
    fn new() -> Self {
        let robot = Robot::load(&Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config/robots/vision60")).unwrap();
        let config = Config::for_robot(&robot);
        let gaits = NAMES.map(|name| {
            let request = GaitRequest::named(name, &robot).unwrap();
            let plan =
                gait_design::plan(&robot, &request, &PlanOptions::default(), |_| ControlFlow::Continue(())).unwrap();
            (name, PreparedGait::new(&plan.gait, &config).unwrap())
        });
        Self { robot, config, gaits: gaits.into() }
    }
}

struct Day {
    /// Of what a failure tells.
    title: String,
    controller: Controller,
    simulator: Simulator,
    now: Duration,
    /// Largest distance of a joint from its command while it was held, rad, and largest tilt, rad.
    error_rad: f64,
    tilt_rad: f64,
}

impl Day {
    fn new(shelf: &Shelf, title: String, friction: f64) -> Self {
        let options = SimulatorOptions { friction, joint_noise_rad: 0.01, seed: 1, ..SimulatorOptions::default() };
        let mut simulator = Simulator::new(&shelf.robot, options).unwrap();
        simulator.reset_to_posture(Posture::Sit);
        let controller = Controller::new(shelf.config.clone()).unwrap();
        Self { title, controller, simulator, now: Duration::ZERO, error_rad: 0.0, tilt_rad: 0.0 }
    }

    /// One cycle; a fault ends the test.
    fn cycle(&mut self, requests: &[Request], gait: Option<&PreparedGait>) -> Output {
        let (position_rad, velocity_rad_s) = self.simulator.joints();
        let joints = JointState {
            stamp: self.now,
            arrived: [self.now; 12],
            position_rad,
            velocity_rad_s,
            temperature_c: None,
            drive_error: [0; 12],
        }
        .to_resolution();
        let [roll_rad, pitch_rad, _] = self.simulator.state().roll_pitch_yaw();
        let inertial = Some(InertialState::tilted(Tilt { roll_rad, pitch_rad }, self.now).to_resolution());
        let input = Input { joints: Some(&joints), inertial, requests, gait, ..Input::default() };
        let output = self.controller.step(&input, self.now);
        assert!(output.faults.is_empty(), "{}, {:?}, {:?}: {:?}", self.title, self.now, output.mode, output.report);
        for reply in output.replies.iter().flatten() {
            assert!(reply.is_ok(), "{}, {:?}: {reply:?}", self.title, self.now);
        }
        if output.mode.is_moving() && output.mode != Mode::SittingDown {
            self.error_rad = output.tracking_error_rad.iter().fold(self.error_rad, |most, rad| most.max(rad.abs()));
        }
        self.tilt_rad = self.tilt_rad.max(roll_rad.abs()).max(pitch_rad.abs());
        self.simulator.command(&output.command);
        for _ in 0..2 {
            self.simulator.step();
        }
        self.now += PERIOD;
        output
    }

    fn run(&mut self, seconds: f64) {
        for _ in 0..(seconds * 1e3) as usize {
            self.cycle(&[], None);
        }
    }

    fn until(&mut self, what: &str, seconds: f64, done: impl Fn(&Output) -> bool) -> Output {
        for _ in 0..(seconds * 1e3) as usize {
            let output = self.cycle(&[], None);
            if done(&output) {
                return output;
            }
        }
        panic!("{}: not {what} within {seconds} s: {:?}", self.title, self.controller.mode());
    }

    fn walk(&mut self, gait: &PreparedGait) {
        self.cycle(&[Request::Arm, Request::Stand, Request::Walk], Some(gait));
        self.until("walking", 10.0, |output| output.mode == Mode::Walking);
    }
}

/// Feet that carry the robot are dragged while it sits down: on a rough ground joints lag by 0.2 rad, which is no stuck joint.
#[test]
fn after_any_walk_it_stops_and_sits_down_on_smooth_and_rough_ground() {
    let shelf = Shelf::new();
    for (name, gait) in &shelf.gaits {
        for (friction, seconds) in [(0.4, 3.0), (0.8, 3.4), (1.2, 3.8)] {
            let mut day = Day::new(&shelf, format!("{name}, friction {friction}"), friction);
            day.walk(gait);
            day.run(seconds);
            day.cycle(&[Request::Stop], None);
            day.until("standing", 2.0, |output| output.mode == Mode::Standing);
            day.run(0.6);
            day.cycle(&[Request::Sit], None);
            day.until("disarmed", 10.0, |output| output.mode == Mode::Disarmed);
            assert!(day.tilt_rad < 0.25, "{}: tilted by {}", day.title, day.tilt_rad);
        }
    }
}

/// At a switch or, where the gaits are too far apart, through standing.
#[test]
fn every_gait_follows_every_other() {
    let shelf = Shelf::new();
    let mut odd = false;
    for (from, first) in &shelf.gaits {
        for (to, second) in shelf.gaits.iter().filter(|(to, _)| to != from) {
            odd = !odd;
            let mut day = Day::new(&shelf, format!("{from}, then {to}"), 0.8);
            day.walk(first);
            day.run(3.0);
            day.until("in a step of that side", 2.0, |o| (o.step_index % 2 == 1) == odd && o.step_phase > 0.5);
            let mut last = day.cycle(&[], Some(second));
            let (mut stood, mut jump) = (false, 0.0_f64);
            for _ in 0..8000 {
                let output = day.cycle(&[], None);
                stood |= output.mode != Mode::Walking;
                for j in 0..12 {
                    let moved = (output.command.position_rad[j] - last.command.position_rad[j]).abs();
                    jump = jump.max(moved / shelf.config.velocity_limit_rad_s[j] * 1e3);
                }
                last = output;
            }
            println!(
                "{}: {}, joints within {:.3} rad, tilted by at most {:.3} rad, commands at {:.2} of the velocity limit",
                day.title,
                if stood { "through standing" } else { "at a switch" },
                day.error_rad,
                day.tilt_rad,
                jump
            );
            assert_eq!(last.mode, Mode::Walking, "{}", day.title);
            assert_eq!(day.controller.gait().map(PreparedGait::name), Some(second.name()), "{}", day.title);
            assert!(jump < 0.6 && day.tilt_rad < 0.25, "{}", day.title);
        }
    }
}
