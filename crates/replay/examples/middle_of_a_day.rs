//! Records the middle of a day of a robot without dynamics, from a snapshot on: walking while the gait grows, a hot
//! drive, standing, walking again, the emergency stop, a lost encoder. `tests/bag/make_references` keeps it.
//!
//!     middle_of_a_day GAIT_FILE FOLDER

use control::{Config, Controller, Fault, Input, JointState, Mode, Output, PreparedGait, Request};
use gait::Gait;
use robot::Robot;
use run_recorder::{RunInfo, RunRecorder};
use std::path::Path;
use std::time::Duration;

/// A slow cycle: a bag of few messages that goes far.
const PERIOD: Duration = Duration::from_millis(4);
/// Cycles of walking before the recording begins.
const BEFORE: u64 = 40;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [file, folder] = arguments.as_slice() else { return Err("expected GAIT_FILE FOLDER".into()) };
    let robot = Robot::load(Path::new("config/robots/vision60"))?;
    let config = Config { control_period_s: PERIOD.as_secs_f64(), ..Config::for_robot(&robot) };
    let gait = Gait::from_json(&std::fs::read_to_string(file)?)?;
    let mut day = Day::new(&robot, &config, PreparedGait::new(&gait, &config)?)?;
    day.until_walking()?;
    let info = RunInfo {
        config: &config,
        robot_description: "",
        leg_names: ["front_left", "rear_left", "front_right", "rear_right"],
        epoch_ns: 0,
    };
    let mut run = RunRecorder::start(folder, &info, bag::RecorderOptions::default())?;
    run.gait(&gait)?;
    run.snapshot(&day.controller.snapshot())?;
    for n in 0..230 {
        day.cycle(n, &mut run)?;
    }
    use Mode as M;
    if day.modes != [M::Walking, M::Stopping, M::Standing, M::Starting, M::Damping, M::Fault, M::Damping] {
        return Err(format!("the day came to {:?}", day.modes).into());
    }
    run.finish()?;
    Ok(())
}

struct Day {
    controller: Controller,
    gait: PreparedGait,
    now: Duration,
    state: JointState,
    modes: Vec<Mode>,
}

impl Day {
    fn new(robot: &Robot, config: &Config, gait: PreparedGait) -> Result<Self, control::ConfigError> {
        let state = JointState {
            stamp: Duration::ZERO,
            arrived: [Duration::ZERO; 12],
            position_rad: robot.sit_rad(),
            velocity_rad_s: [0.0; 12],
            temperature_c: Some([30.0; 12]),
            drive_error: [0; 12],
        };
        let controller = Controller::new(config.clone())?;
        Ok(Self { controller, gait, now: Duration::from_secs(1), state, modes: Vec::new() })
    }

    fn until_walking(&mut self) -> Result<(), String> {
        let gait = self.gait;
        self.step(&Input { gait: Some(&gait), ..Input::default() });
        self.step(&Input { requests: &[Request::Arm, Request::Stand, Request::Walk], ..Input::default() });
        let mut walked = 0;
        for _ in 0..2000 {
            let (output, _) = self.step(&Input::default());
            walked += u64::from(output.mode == Mode::Walking);
            if walked == BEFORE {
                return Ok(());
            }
        }
        Err(format!("the robot does not walk: {:?}", self.controller.mode()))
    }

    /// One cycle; what it was given.
    fn step(&mut self, input: &Input) -> (Output, JointState) {
        self.now += PERIOD;
        let mut state = self.state;
        state.stamp = self.now;
        state.arrived = [self.now; 12];
        let output = self.controller.step(&Input { joints: Some(&state), ..*input }, self.now);
        if output.mode.is_moving() {
            for j in 0..12 {
                let to = output.command.position_rad[j];
                state.velocity_rad_s[j] = output.command.velocity_rad_s[j];
                state.position_rad[j] += 0.75 * (to - state.position_rad[j]);
            }
            self.state = state.to_resolution();
        } else {
            self.state.velocity_rad_s = [0.0; 12];
        }
        (output, state)
    }

    fn cycle(&mut self, n: u64, run: &mut RunRecorder) -> Result<(), Box<dyn std::error::Error>> {
        let position_rad = self.state.position_rad[2];
        let mut requests: &[Request] = &[];
        match n {
            20 => self.state.temperature_c = Some([85.0; 12]),
            21 => self.state.temperature_c = Some([30.0; 12]),
            190 => requests = &[Request::ClearFault(Fault::DriveHot), Request::Walk],
            215 => self.state.position_rad[2] = f64::NAN,
            225 => requests = &[Request::ClearFault(Fault::InvalidInput)],
            _ => {}
        }
        let input = Input { requests, emergency_stop: (205..209).contains(&n), ..Input::default() };
        let mut seen = self.state;
        let (output, _) = self.step(&input);
        (seen.stamp, seen.arrived) = (self.now, [self.now; 12]);
        if n == 215 {
            self.state.position_rad[2] = position_rad;
        }
        if self.modes.last() != Some(&output.mode) {
            self.modes.push(output.mode);
        }
        run.cycle(self.now, &Input { joints: Some(&seen), ..input }, &output, None)?;
        Ok(())
    }
}
