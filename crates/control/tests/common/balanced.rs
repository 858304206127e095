//! A robot that walks in balance as far as its joints show.

use control::balanced::BalanceConfig;
use control::{
    Config, Controller, InertialState, Input, JOINTS, JointCommand, JointState, Mode, Output, PreparedGait, Request,
    Velocity, VelocityCommand,
};
use gait::Gait;
use robot::Robot;
use std::time::Duration;

pub const PERIOD: Duration = Duration::from_millis(1);

pub fn config(balanced: bool) -> Config {
    let robot = Robot::from_toml_str(
        include_str!("../../../../config/robots/vision60/robot.toml"),
        include_str!("../../../../config/robots/vision60/vision60.urdf"),
    )
    .unwrap();
    let balance = balanced.then(|| BalanceConfig::for_robot(&robot).unwrap());
    Config { simulation_start: true, balance, ..Config::for_robot(&robot) }
}

/// A robot whose joints go where they are commanded, on a base that is level but for what a test does to it.
#[derive(Clone)]
pub struct Bench {
    pub controller: Controller,
    pub gait: PreparedGait,
    pub now: Duration,
    pub joints: JointState,
    pub unit: Option<InertialState>,
    /// The unit reports something new in every cycle.
    pub unit_sends: bool,
    pub force_m_s2: [f64; 3],
    pub turning_rad_s: [f64; 3],
    pub velocity: Option<VelocityCommand>,
    pub emergency_stop: bool,
    /// A gait comes with every request.
    pub has_gait: bool,
}

impl Bench {
    pub fn new(config: Config) -> Self {
        let gait = Gait::from_json(include_str!("../../../../tests/gaits/amble.json")).unwrap();
        let now = Duration::from_secs(5);
        let unit = InertialState {
            stamp: now,
            arrived: now,
            attitude_xyzw: Some([0.0, 0.0, 0.0, 1.0]),
            angular_velocity_rad_s: Some([0.0; 3]),
            acceleration_m_s2: Some([0.0, 0.0, 9.81]),
        };
        Self {
            gait: PreparedGait::new(&gait, &config).unwrap(),
            joints: JointState {
                stamp: now,
                arrived: [now; JOINTS],
                position_rad: gait.initial.joint_position_rad,
                velocity_rad_s: gait.initial.joint_velocity_rad_s,
                temperature_c: None,
                drive_error: [0; JOINTS],
            },
            controller: Controller::new(config).unwrap(),
            now,
            unit: Some(unit),
            unit_sends: true,
            force_m_s2: [0.0, 0.0, 9.81],
            turning_rad_s: [0.0; 3],
            velocity: None,
            emergency_stop: false,
            has_gait: true,
        }
    }

    pub fn cycle(&mut self, requests: &[Request]) -> Output {
        self.now += PERIOD;
        (self.joints.stamp, self.joints.arrived) = (self.now, [self.now; JOINTS]);
        if let Some(unit) = self.unit.as_mut().filter(|_| self.unit_sends) {
            (unit.stamp, unit.arrived) = (self.now, self.now);
            unit.acceleration_m_s2 = Some(self.force_m_s2);
            unit.angular_velocity_rad_s = Some(self.turning_rad_s);
        }
        let input = Input {
            joints: Some(&self.joints),
            inertial: self.unit,
            velocity: self.velocity,
            requests,
            gait: (self.has_gait && !requests.is_empty()).then_some(&self.gait),
            emergency_stop: self.emergency_stop,
            ..Input::default()
        };
        let output = self.controller.step(&input, self.now);
        if output.mode.is_moving() {
            self.joints.position_rad = output.command.position_rad;
            self.joints.velocity_rad_s = output.command.velocity_rad_s;
        }
        output
    }

    pub fn run(&mut self, cycles: usize) -> Vec<Output> {
        (0..cycles).map(|_| self.cycle(&[])).collect()
    }

    /// On the gait.
    pub fn walking(config: Config) -> Self {
        let mut bench = Self::new(config);
        let begun = bench.cycle(&[Request::StartOnGait]);
        assert_eq!((begun.mode, begun.reply(0)), (Mode::Walking, Some(Ok(Mode::Walking))));
        bench
    }

    /// Armed, with a gait, asked for this, until that mode.
    fn until(config: Config, requests: &[Request], mode: Mode) -> Self {
        let mut bench = Self::new(config);
        bench.joints.position_rad = bench.controller.config().stand.position_rad;
        bench.joints.velocity_rad_s = [0.0; JOINTS];
        bench.cycle(&[Request::Arm]);
        bench.cycle(requests);
        while bench.cycle(&[]).mode != mode {
            assert!(bench.now < Duration::from_secs(20), "{:?}", bench.controller.mode());
        }
        bench
    }

    /// Armed, stood up, walking.
    pub fn walked_out_of_standing(config: Config) -> Self {
        Self::until(config, &[Request::Stand, Request::Walk], Mode::Walking)
    }

    /// Armed, stood up, standing.
    pub fn standing(config: Config) -> Self {
        Self::until(config, &[Request::Stand], Mode::Standing)
    }

    /// Cycles until the robot is damped, and what was sent then.
    pub fn until_fault(&mut self, at_most: usize) -> (usize, Output) {
        for n in 1..=at_most {
            let output = self.cycle(&[]);
            if output.mode == Mode::Fault {
                assert!(output.command.kp == [0.0; JOINTS] && output.command.torque_nm == [0.0; JOINTS]);
                return (n, output);
            }
            assert_within_limits(self.controller.config(), &output.command);
        }
        panic!("{:?} after {at_most} cycles", self.controller.mode());
    }
}

fn assert_within_limits(config: &Config, command: &JointCommand) {
    assert!(command.is_finite());
    for j in 0..JOINTS {
        assert!((config.position_min_rad[j]..=config.position_max_rad[j]).contains(&command.position_rad[j]));
        assert!(command.velocity_rad_s[j].abs() <= config.velocity_limit_rad_s[j]);
    }
}

pub fn drive(forward_m_s: f64, left_m_s: f64, yaw_rad_s: f64) -> Velocity {
    Velocity { forward_m_s, left_m_s, yaw_rad_s }
}
