//! What the days of the robot in the simulator share: the robot, its gaits, and a day that ends at the first fault.
#![allow(dead_code)]

use control::balanced::BalanceConfig;
use control::{BodyPose, Config, Controller, Input, JointState, Mode, Output, PreparedGait, Request};
use gait::Gait;
use gait_design::{GaitRequest, PlanOptions};
use robot::Robot;
use simulator::{Posture, Simulator, SimulatorOptions};
use std::ops::ControlFlow;
use std::path::Path;
use std::time::Duration;

pub const NAMES: [&str; 5] = ["gait1", "gait2", "gait3", "gait4", "amble"];
const PERIOD: Duration = Duration::from_millis(1);

/// Vision 60, its configuration, and the five gaits.
pub struct Shelf {
    pub robot: Robot,
    pub config: Config,
    pub gaits: Vec<(&'static str, PreparedGait)>,
}

impl Shelf {
    pub fn new() -> Self {
        let robot = Robot::load(&Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config/robots/vision60")).unwrap();
        let config = Config::for_robot(&robot);
        let mut shelf = Self { robot, config, gaits: Vec::new() };
        shelf.gaits = NAMES.map(|name| (name, shelf.plan(name, None))).into();
        shelf
    }

    /// The same, walked in balance.
    pub fn balanced() -> Self {
        let mut shelf = Self::new();
        shelf.config.balance = Some(BalanceConfig::for_robot(&shelf.robot).unwrap());
        shelf
    }

    /// A gait at its own speed or at another, m/s.
    pub fn plan(&self, name: &str, speed_m_s: Option<f64>) -> PreparedGait {
        PreparedGait::new(&self.plan_gait(name, speed_m_s), &self.config).unwrap()
    }

    /// The same as a file holds it.
    pub fn plan_gait(&self, name: &str, speed_m_s: Option<f64>) -> Gait {
        let mut request = GaitRequest::named(name, &self.robot).unwrap();
        request.speed_m_s = speed_m_s.unwrap_or(request.speed_m_s);
        gait_design::plan(&self.robot, &request, &PlanOptions::default(), |_| ControlFlow::Continue(())).unwrap().gait
    }
}

pub struct Day {
    /// What a failure reports.
    pub title: String,
    pub controller: Controller,
    pub simulator: Simulator,
    pub now: Duration,
    /// Largest distance of a joint from its command while it was held, rad, and largest tilt, rad.
    pub error_rad: f64,
    pub tilt_rad: f64,
    /// Asked for in the next cycle.
    pub body_pose: Option<BodyPose>,
}

impl Day {
    pub fn new(shelf: &Shelf, title: String, friction: f64) -> Self {
        let options = SimulatorOptions { friction, joint_noise_rad: 0.01, seed: 1, ..SimulatorOptions::default() };
        let mut simulator = Simulator::new(&shelf.robot, options).unwrap();
        simulator.reset_to_posture(Posture::Sit);
        let controller = Controller::new(shelf.config.clone()).unwrap();
        Self { title, controller, simulator, now: Duration::ZERO, error_rad: 0.0, tilt_rad: 0.0, body_pose: None }
    }

    /// On a gait at its first instant.
    pub fn on_gait(shelf: &Shelf, title: String, gait: &Gait) -> Self {
        let mut day = Self::new(shelf, title, 0.8);
        let config = Config { simulation_start: true, ..shelf.config.clone() };
        let prepared = PreparedGait::new(gait, &config).unwrap();
        day.controller = Controller::new(config).unwrap();
        day.simulator.reset_to_gait(gait).unwrap();
        day.cycle(&[Request::StartOnGait], Some(&prepared));
        day
    }

    /// One cycle; a fault ends the test.
    pub fn cycle(&mut self, requests: &[Request], gait: Option<&PreparedGait>) -> Output {
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
        let inertial = Some(self.simulator.inertial_state(self.now).to_resolution());
        let body_pose = self.body_pose.take();
        let input = Input { joints: Some(&joints), inertial, requests, gait, body_pose, ..Input::default() };
        let output = self.controller.step(&input, self.now);
        assert!(output.faults.is_empty(), "{}, {:?}, {:?}: {:?}", self.title, self.now, output.mode, output.report);
        for reply in output.replies.iter().flatten() {
            assert!(reply.is_ok(), "{}, {:?}: {reply:?}", self.title, self.now);
        }
        if output.mode.is_moving() {
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

    pub fn run(&mut self, seconds: f64) {
        for _ in 0..(seconds * 1e3) as usize {
            self.cycle(&[], None);
        }
    }

    pub fn until(&mut self, what: &str, seconds: f64, done: impl Fn(&Output) -> bool) -> Output {
        for _ in 0..(seconds * 1e3) as usize {
            let output = self.cycle(&[], None);
            if done(&output) {
                return output;
            }
        }
        panic!("{}: not {what} within {seconds} s: {:?}", self.title, self.controller.mode());
    }

    pub fn walk(&mut self, gait: &PreparedGait) {
        self.cycle(&[Request::Arm, Request::Stand, Request::Walk], Some(gait));
        self.until("walking", 10.0, |output| output.mode == Mode::Walking);
    }
}
