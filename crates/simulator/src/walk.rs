//! The controller's own step and the simulator in one process: the same code as on the robot, without a network
//! between.

mod path;

use crate::measure::{Measure, WalkFigures};
use crate::{Fall, Posture, Push, RobotState, Simulator, SimulatorError, SimulatorOptions};
use control::balanced::BalanceConfig;
use control::{
    Config, Controller, DriveMode, InertialState, Input, JointState, Mode, Output, PreparedGait, Request, Velocity,
    VelocityCommand,
};
use gait::Gait;
use joint_bus::{BusConfig, DriveModel};
use path::Path;
use robot::{Robot, RobotError};
use std::ops::ControlFlow;
use std::time::Duration;

/// A robot that was asked to walk and does not after this simulated time never will, s.
const WALKING_PATIENCE_S: f64 = 30.0;
/// From one message of the inertial unit to the next, as the simulation bridge sends them.
const INERTIAL_PERIOD: Duration = Duration::from_millis(5);

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
    /// Whether the balanced law walks, or the paper's.
    pub balance: bool,
    /// Velocities asked for, each from its time on, counted from the first step; none before the first: the gait's own.
    pub velocities: Vec<(f64, Velocity)>,
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
            balance: false,
            velocities: Vec::new(),
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
    /// Who watched ended it.
    Stopped {
        /// Seconds since the first step; `None`: before it.
        at_s: Option<f64>,
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

impl Walk {
    /// Whether it came to a first step.
    pub fn has_walked(&self) -> bool {
        self.end != End::Stopped { at_s: None }
    }
}

/// Why there was no walk.
#[derive(Debug, thiserror::Error)]
pub enum WalkError {
    /// The simulator.
    #[error(transparent)]
    Simulator(#[from] SimulatorError),
    /// The robot's legs cannot be walked in balance.
    #[error(transparent)]
    Robot(#[from] RobotError),
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
    /// What it reported.
    pub output: &'a Output,
}

/// The controller's configuration in a walk with these options.
///
/// # Errors
/// If it is to be walked in balance, and the robot's legs are of another shape than the balanced law knows.
pub fn controller_config(robot: &Robot, options: &WalkOptions) -> Result<Config, RobotError> {
    Ok(Config {
        simulation_start: true,
        control_period_s: options.period_s,
        drive_mode: options.drive_mode,
        balance: options.balance.then(|| BalanceConfig::for_robot(robot)).transpose()?,
        ..Config::for_robot(robot)
    })
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
    walk_until(robot, gait, options, &mut |simulator, state, cycle| {
        observe(simulator, state, cycle);
        ControlFlow::Continue(())
    })
}

/// As [`walk`], but `observe` may end it: with [`End::Stopped`].
///
/// # Errors
/// As [`walk`].
pub fn walk_until(
    robot: &Robot,
    gait: &Gait,
    options: &WalkOptions,
    observe: &mut Observer,
) -> Result<Walk, WalkError> {
    let mut course = Course::new(robot, gait, options)?;
    for cycle in 0u32.. {
        if let Some(end) = course.cycle(cycle, observe)? {
            return Ok(Walk {
                end,
                figures: course.measure.figures(),
                walking_from_s: course.walking_from_s.unwrap_or_default(),
                cycles: u64::from(cycle) + 1,
                state: course.simulator.state(),
                notes: course.simulator.notes().to_vec(),
            });
        }
    }
    Err(WalkError::Option("more control cycles than can be counted".into()))
}

/// Who watches a walk and says whether it goes on.
type Observer<'a> = dyn FnMut(&mut Simulator, &RobotState, &Cycle) -> ControlFlow<()> + 'a;

/// A walk under way.
struct Course<'a> {
    robot: &'a Robot,
    options: &'a WalkOptions,
    prepared: PreparedGait,
    requests: &'static [Request],
    path: Path,
    controller: Controller,
    simulator: Simulator,
    measure: Measure,
    steps_per_cycle: u32,
    walking_from_s: Option<f64>,
    /// What the inertial unit reported last.
    inertial: Option<InertialState>,
}

impl<'a> Course<'a> {
    fn new(robot: &'a Robot, gait: &Gait, options: &'a WalkOptions) -> Result<Self, WalkError> {
        if !(0.01..=1e5).contains(&options.seconds) {
            return Err(WalkError::Option(format!("seconds is {}, expected 0.01 to 1e5", options.seconds)));
        }
        let steps_per_cycle = multiple("the control period", options.period_s, options.simulator.timestep_s)?.max(1);
        let delay_cycles = multiple("the command's delay", options.command_delay_s, options.period_s)? as usize;
        let config = controller_config(robot, options)?;
        let prepared = PreparedGait::new(gait, &config)?;
        let torque_limit_nm = config.torque_limit_nm;
        let path = Path::new(options, &config, delay_cycles)?;
        let controller = Controller::new(config)?;
        let mut simulator = Simulator::new(robot, options.simulator.clone())?;
        let requests: &'static [Request] = match options.start {
            Start::Gait => {
                simulator.reset_to_gait(gait)?;
                &[Request::StartOnGait]
            }
            Start::Posture(posture) => {
                simulator.reset_to_posture(posture);
                &[Request::Arm, Request::Stand, Request::Walk]
            }
        };
        let measure = Measure::new(gait.step_duration_s, torque_limit_nm);
        let walking_from_s = None;
        Ok(Self {
            robot,
            options,
            prepared,
            requests,
            path,
            controller,
            simulator,
            measure,
            steps_per_cycle,
            walking_from_s,
            inertial: None,
        })
    }

    /// One control cycle and the physics until the next; how the walk ended, if it did.
    fn cycle(&mut self, cycle: u32, observe: &mut Observer) -> Result<Option<End>, WalkError> {
        let now = Duration::from_secs_f64(self.options.period_s) * cycle;
        let state = self.simulator.state();
        let joints = self.path.read(&self.simulator, now).map(JointState::to_resolution);
        let is_due = |unit: &InertialState| now.saturating_sub(unit.stamp) >= INERTIAL_PERIOD;
        if self.inertial.as_ref().is_none_or(is_due) {
            let measured = self.simulator.inertial_state(now);
            self.inertial = self.path.inertial(measured, now).map(InertialState::to_resolution);
        }
        let first = cycle == 0;
        let input = Input {
            joints: joints.as_ref(),
            fault: self.path.fault(now),
            inertial: self.inertial,
            velocity: self.velocity(now, state.time_s),
            requests: if first { self.requests } else { &[] },
            gait: first.then_some(&self.prepared),
            ..Input::default()
        };
        let output = self.controller.step(&input, now);
        for reply in output.replies.into_iter().flatten() {
            reply?;
        }
        let go_on = observe(&mut self.simulator, &state, &Cycle { now, input: &input, output: &output });
        if go_on.is_break() {
            return Ok(Some(End::Stopped { at_s: self.walking_from_s.map(|from| state.time_s - from) }));
        }
        if self.walking_from_s.is_none() && output.mode == Mode::Walking {
            self.walking_from_s = Some(state.time_s);
            self.simulator.expect_height(self.robot.nominal.height_m);
            for push in &self.options.pushes {
                self.simulator.push(Push { start_s: push.start_s + state.time_s, ..*push })?;
            }
        }
        self.path.write(&output, &mut self.simulator, now);
        let timestep = Duration::from_secs_f64(self.options.simulator.timestep_s);
        for step in 0..self.steps_per_cycle {
            self.path.step(&mut self.simulator, now + timestep * step);
        }
        self.end(&output)
    }

    /// What is asked for now; it is reported anew in every cycle.
    fn velocity(&self, now: Duration, time_s: f64) -> Option<VelocityCommand> {
        let walked_s = time_s - self.walking_from_s?;
        let begun = |(from_s, _): &&(f64, Velocity)| *from_s <= walked_s;
        let (_, velocity) = self.options.velocities.iter().take_while(begun).last()?;
        Some(VelocityCommand { velocity: *velocity, arrived: now })
    }

    /// Whether the walk has ended with the last step of the physics, which is measured.
    fn end(&mut self, output: &Output) -> Result<Option<End>, WalkError> {
        let after = self.simulator.state();
        let Some(from) = self.walking_from_s else {
            if after.time_s > WALKING_PATIENCE_S {
                let detail = output.report.map_or(String::new(), |_| format!(" ({})", fault(output, self.robot)));
                return Err(WalkError::NotWalking { mode: output.mode.name(), detail });
            }
            return Ok(None);
        };
        let at_s = after.time_s - from;
        let fallen = self.simulator.fallen();
        if fallen != Some(Fall::NotFinite) {
            self.measure.sample(&after, self.simulator.height_m());
        }
        Ok(if let Some(fall) = fallen {
            Some(End::Fell { at_s, fall })
        } else if output.mode != Mode::Walking {
            Some(End::Fault { at_s, fault: fault(output, self.robot) })
        } else {
            (at_s >= self.options.seconds - 1e-9).then_some(End::Upright)
        })
    }
}
