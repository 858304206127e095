//! The controller's own step and the simulator in one process: the same code as on the robot, without a network between.

use crate::drives::{DriveBench, Speech};
use crate::measure::{Measure, WalkFigures};
use crate::simulator::{Fall, Posture, Push, RobotState, Simulator, SimulatorError, SimulatorOptions};
use control::{
    Config, Controller, DriveMode, Input, JointCommand, JointState, Mode, Output, PreparedGait, Request, Tilt,
};
use gait::Gait;
use joint_bus::{BusConfig, DriveBus, DriveModel, JointBus, Link, Readings, memory};
use robot::Robot;
use std::collections::VecDeque;
use std::time::Duration;

/// A robot that was asked to walk and does not after this simulated time never will, s.
const WALKING_PATIENCE_S: f64 = 30.0;

/// Where the robot starts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Start {
    /// In the gait's initial state, walking.
    Gait,
    /// In a posture: it is armed, stands up, and walks.
    Posture(Posture),
}

/// Drives on buses instead of the simulator's own: the command goes through the frames meant for the robot.
#[derive(Clone, Debug, PartialEq)]
pub struct Drives {
    /// The wiring file's content.
    pub bus: BusConfig,
    /// How the drives behave; the torque limit is the joint's.
    pub model: DriveModel,
}

/// What is walked, and on what.
#[derive(Clone, Debug, PartialEq)]
pub struct WalkOptions {
    /// Walking time, s.
    pub seconds: f64,
    /// Where the robot starts.
    pub start: Start,
    /// Time between two control cycles, s; a multiple of the physics step.
    pub period_s: f64,
    /// How long a command is on its way to the simulator's own drives, s; a multiple of the control period.
    pub command_delay_s: f64,
    /// Where the law is closed: at the drive, or in the controller once a control period.
    pub drive_mode: DriveMode,
    /// Emulated drives on buses within the process, in place of the simulator's own.
    pub drives: Option<Drives>,
    /// Pushes, their time counted from the first step.
    pub pushes: Vec<Push>,
    /// The simulator's options.
    pub simulator: SimulatorOptions,
}

impl Default for WalkOptions {
    fn default() -> Self {
        Self {
            seconds: 20.0,
            start: Start::Gait,
            period_s: 1e-3,
            command_delay_s: 0.0,
            drive_mode: DriveMode::Impedance,
            drives: None,
            pushes: Vec::new(),
            simulator: SimulatorOptions::default(),
        }
    }
}

/// How a walk ended.
#[derive(Clone, Debug, PartialEq)]
pub enum End {
    /// Upright after the time asked for.
    Upright,
    /// It fell, this long after the first step, s.
    Fell {
        /// Seconds since the first step.
        at_s: f64,
        /// How.
        fall: Fall,
    },
    /// The controller stopped walking because of a fault.
    Fault {
        /// Seconds since the first step.
        at_s: f64,
        /// The fault, with its joint and values.
        fault: String,
    },
}

/// A walk that has ended.
#[derive(Clone, Debug, PartialEq)]
pub struct Walk {
    /// How it ended.
    pub end: End,
    /// The figures, from the first step on.
    pub figures: WalkFigures,
    /// Simulated time of the first step, s.
    pub walking_from_s: f64,
    /// Control cycles in all.
    pub cycles: u64,
    /// State at the end.
    pub state: RobotState,
    /// What of the robot's description was not simulated as it says.
    pub notes: Vec<String>,
}

/// Why there was no walk.
#[derive(Debug, thiserror::Error)]
pub enum WalkError {
    /// The simulator.
    #[error(transparent)]
    Simulator(#[from] SimulatorError),
    /// The wiring file does not fit what the controller sends.
    #[error(transparent)]
    Bus(#[from] joint_bus::BusConfigError),
    /// The gait is not for this robot.
    #[error(transparent)]
    Gait(#[from] gait::GaitError),
    /// The controller's configuration.
    #[error(transparent)]
    Config(#[from] control::ConfigError),
    /// An option is out of range.
    #[error("{0}")]
    Option(String),
    /// The controller refused a request.
    #[error("the controller did not start to walk: {0}")]
    Refused(#[from] control::Refusal),
    /// The robot did not come to walk.
    #[error("after {WALKING_PATIENCE_S} s the robot does not walk but is {mode}{detail}")]
    NotWalking {
        /// The controller's mode.
        mode: &'static str,
        /// The latest fault.
        detail: String,
    },
}

/// Periods of `whole` in `part`, if it is a multiple.
fn multiple(name: &str, whole: f64, part: f64) -> Result<u32, WalkError> {
    let ratio = (whole / part).round();
    if (0.0..=1e6).contains(&ratio) && (ratio * part - whole).abs() < 1e-9 {
        Ok(ratio as u32)
    } else {
        Err(WalkError::Option(format!("{name} is {whole} s, expected a multiple of {part} s")))
    }
}

/// How commands reach the joints and states come back.
enum Path {
    /// The simulator's own drives, and commands on their way to them.
    Own { on_the_way: VecDeque<JointCommand>, delay_cycles: usize },
    /// Emulated drives behind frames.
    Bus { bus: Box<dyn JointBus>, bench: Box<DriveBench>, readings: Box<Readings> },
}

impl Path {
    fn new(options: &WalkOptions, config: &Config, delay_cycles: usize) -> Result<Self, WalkError> {
        let Some(drives) = &options.drives else {
            return Ok(Self::Own { on_the_way: VecDeque::with_capacity(delay_cycles + 1), delay_cycles });
        };
        if delay_cycles > 0 {
            return Err(WalkError::Option(
                "a command's delay belongs to the drives' model where drives are emulated".into(),
            ));
        }
        drives.bus.check_ranges(config)?;
        let (near, far): (Vec<_>, Vec<Box<dyn Link + Send>>) = drives
            .bus
            .interfaces
            .iter()
            .map(|_| {
                let (near, far) = memory::pair();
                (near, Box::new(far) as Box<dyn Link + Send>)
            })
            .unzip();
        let bus = Box::new(DriveBus::new(drives.bus.clone(), Speech::of(&drives.bus), near));
        let bench = Box::new(DriveBench::new(drives.bus.clone(), drives.model, far));
        let mut path = Self::Bus { bus, bench, readings: Box::default() };
        path.greet();
        Ok(path)
    }

    /// A drive says where it is only when it is spoken to: the first words come before the first cycle.
    fn greet(&mut self) {
        if let Self::Bus { bus, .. } = self {
            bus.write(&JointCommand::LIMP, false, Duration::ZERO);
        }
    }

    /// The state that the controller sees.
    fn read(&mut self, simulator: &Simulator, now: Duration) -> Option<JointState> {
        let (position_rad, velocity_rad_s) = simulator.joints();
        match self {
            Self::Own { .. } => Some(JointState {
                stamp: now,
                arrived: [now; 12],
                position_rad,
                velocity_rad_s,
                temperature_c: None,
                drive_error: [0; 12],
            }),
            Self::Bus { bus, bench, readings } => {
                // What was written in the last cycle has been answered; only the greeting still waits.
                if now.is_zero() {
                    bench.answer(now, &position_rad, &velocity_rad_s);
                }
                bus.read(now, readings);
                readings.joint_state()
            }
        }
    }

    fn fault(&self, now: Duration) -> Option<control::FaultReport> {
        match self {
            Self::Own { .. } => None,
            Self::Bus { bus, .. } => bus.fault(now),
        }
    }

    fn write(&mut self, output: &Output, simulator: &mut Simulator, now: Duration) {
        match self {
            Self::Own { on_the_way, delay_cycles } => {
                on_the_way.push_back(output.command);
                if on_the_way.len() > *delay_cycles
                    && let Some(command) = on_the_way.pop_front()
                {
                    simulator.command(&command);
                }
            }
            Self::Bus { bus, bench, .. } => {
                bus.write(&output.command, output.drives_on, now);
                let (q, v) = simulator.joints();
                bench.answer(now, &q, &v);
            }
        }
    }

    fn step(&mut self, simulator: &mut Simulator, now: Duration) {
        match self {
            Self::Own { .. } => simulator.step(),
            Self::Bus { bench, .. } => {
                let (q, v) = simulator.joints();
                simulator.step_with_torque(&bench.torques(now, &q, &v));
            }
        }
    }
}

fn fault(output: &Output, robot: &Robot) -> String {
    output.report.map_or_else(
        || "no fault was reported".into(),
        |r| {
            let joint = r.joint.map_or(String::new(), |j| format!(" of {}", robot.joint_names()[j]));
            format!("{}{joint}: {:.3}, limit {:.3}", r.fault.name(), r.value, r.limit)
        },
    )
}

/// One cycle of the controller, for those who watch.
#[derive(Clone, Copy, Debug)]
pub struct Cycle<'a> {
    /// When, on the simulation's clock.
    pub now: Duration,
    /// What the controller's step saw.
    pub input: &'a Input<'a>,
    /// What it said.
    pub output: &'a Output,
}

/// The controller's configuration in a walk with these options.
pub fn controller_config(robot: &Robot, options: &WalkOptions) -> Config {
    Config {
        simulation_start: true,
        control_period_s: options.period_s,
        drive_mode: options.drive_mode,
        ..Config::for_robot(robot)
    }
}

/// Walks. `observe` sees the simulator, the state and the controller's cycle, before the physics moves on.
///
/// # Errors
/// Options that cannot be, a gait for another robot, or a controller that does not start to walk.
pub fn walk(
    robot: &Robot,
    gait: &Gait,
    options: &WalkOptions,
    observe: &mut dyn FnMut(&mut Simulator, &RobotState, &Cycle),
) -> Result<Walk, WalkError> {
    if !(0.01..=1e5).contains(&options.seconds) {
        return Err(WalkError::Option(format!("seconds is {}, expected 0.01 to 1e5", options.seconds)));
    }
    let steps_per_cycle = multiple("the control period", options.period_s, options.simulator.timestep_s)?.max(1);
    let delay_cycles = multiple("the command's delay", options.command_delay_s, options.period_s)? as usize;
    let config = controller_config(robot, options);
    let prepared = PreparedGait::new(gait, &config)?;
    let torque_limit_nm = config.torque_limit_nm;
    let mut path = Path::new(options, &config, delay_cycles)?;
    let mut controller = Controller::new(config)?;
    let mut simulator = Simulator::new(robot, options.simulator.clone())?;
    let requests: &[Request] = match options.start {
        Start::Gait => {
            simulator.reset_to_gait(gait)?;
            &[Request::StartOnGait]
        }
        Start::Posture(posture) => {
            simulator.reset_to_posture(posture);
            &[Request::Arm, Request::Stand, Request::Walk]
        }
    };
    let mut measure = Measure::new(gait.step_duration_s, torque_limit_nm);
    let mut walking_from_s = None;
    let period = Duration::from_secs_f64(options.period_s);
    for cycle in 0u32.. {
        let now = period * cycle;
        let state = simulator.state();
        let joints = path.read(&simulator, now).map(JointState::to_resolution);
        let [roll_rad, pitch_rad, _] = state.roll_pitch_yaw();
        let first = cycle == 0;
        let input = Input {
            joints: joints.as_ref(),
            fault: path.fault(now),
            tilt: Some(Tilt { roll_rad, pitch_rad }.to_resolution()),
            requests: if first { requests } else { &[] },
            gait: first.then_some(&prepared),
            ..Input::default()
        };
        let output = controller.step(&input, now);
        for reply in output.replies.into_iter().flatten() {
            reply?;
        }
        observe(&mut simulator, &state, &Cycle { now, input: &input, output: &output });
        if walking_from_s.is_none() && output.mode == Mode::Walking {
            walking_from_s = Some(state.time_s);
            simulator.expect_height(robot.nominal.height_m);
            for push in &options.pushes {
                simulator.push(Push { start_s: push.start_s + state.time_s, ..*push })?;
            }
        }
        path.write(&output, &mut simulator, now);
        for step in 0..steps_per_cycle {
            path.step(&mut simulator, now + Duration::from_secs_f64(options.simulator.timestep_s) * step);
        }
        let after = simulator.state();
        let end = match walking_from_s {
            None if after.time_s > WALKING_PATIENCE_S => {
                let detail = output.report.map_or(String::new(), |_| format!(" ({})", fault(&output, robot)));
                return Err(WalkError::NotWalking { mode: output.mode.name(), detail });
            }
            None => continue,
            Some(from) => {
                let at_s = after.time_s - from;
                let fallen = simulator.fallen();
                if fallen != Some(Fall::NotFinite) {
                    measure.sample(&after, simulator.height_m());
                }
                if let Some(fall) = fallen {
                    End::Fell { at_s, fall }
                } else if output.mode != Mode::Walking {
                    End::Fault { at_s, fault: fault(&output, robot) }
                } else if at_s >= options.seconds - 1e-9 {
                    End::Upright
                } else {
                    continue;
                }
            }
        };
        return Ok(Walk {
            end,
            figures: measure.figures(),
            walking_from_s: walking_from_s.unwrap_or_default(),
            cycles: u64::from(cycle) + 1,
            state: after,
            notes: simulator.notes().to_vec(),
        });
    }
    Err(WalkError::Option("more control cycles than can be counted".into()))
}
