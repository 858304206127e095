//! The node's parameters.

use crate::dds_bus::CycleClock;
use crate::drive::DriveParameters;
use crate::record_root;
use control::{Config, DriveMode, default};
use realtime::RealtimeRequest;
use robot::{Robot, RobotError};
use ros::{Node, RosError};
use std::path::PathBuf;
use std::time::Duration;

/// Who sets the pace.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Pace {
    /// The wall clock.
    Realtime,
    /// The stamps of the joint states.
    Lockstep,
}

/// What the parameters say, checked.
pub struct Parameters {
    /// Who sets the pace.
    pub pace: Pace,
    /// The clock that the gait follows in realtime.
    pub clock: CycleClock,
    /// The bus file, where the drives are on CAN; else joint states and commands go over DDS.
    pub bus_file: Option<PathBuf>,
    /// The robot's folder.
    pub robot_folder: PathBuf,
    /// What stands before every joint's name on topics.
    pub joint_prefix: String,
    /// What the control thread asks of the system.
    pub realtime: RealtimeRequest,
    /// Control period.
    pub period: Duration,
    /// Control cycles between two messages of state.
    pub state_every: u64,
    /// With drives on CAN: control cycles between two messages on joint_states.
    pub joint_states_every: u64,
    /// Longest silence of the emergency stop's topic.
    pub heartbeat: Option<Duration>,
    /// Longest silence of the middleware's threads; none in lockstep.
    pub middleware_timeout: Option<Duration>,
    /// Start on the gait as soon as there is one: the robot is simulated and put there.
    pub start_on_gait: bool,
    /// Balance and driving.
    pub drive: DriveParameters,
    /// The folder below which every recording lies.
    pub record_root: Option<PathBuf>,
    /// Every run is recorded, into a folder named by its time.
    pub record_every_run: bool,
    /// Files of a recording end after so many bytes.
    pub split_bytes: Option<u64>,
    /// Files of a recording end after so long.
    pub split_duration: Option<Duration>,
    values: Values,
}

/// Parameters that go into the controller's own configuration.
struct Values {
    drive_mode: DriveMode,
    state_timeout_s: f64,
    overrun_s: f64,
    start_blend_s: f64,
    stop_blend_s: f64,
    posture_speed_rad_s: f64,
    tracking_error_rad: f64,
    tilt_limit_rad: f64,
}

fn one_of(allowed: &'static [&'static str]) -> impl Fn(&String) -> Result<(), String> {
    move |value| {
        if allowed.contains(&value.as_str()) {
            Ok(())
        } else {
            Err(format!("expected {}, got \"{value}\"", allowed.join(" or ")))
        }
    }
}

fn record_root(node: &Node) -> Result<Option<PathBuf>, RosError> {
    let root = node
        .parameter("record_root", String::new())
        .description(
            "The folder below which every recording lies, whoever asks for it; empty: tandem/recordings in XDG_DATA_HOME or ~/.local/share.",
        )
        .read_only()
        .declare()?
        .get();
    if root.is_empty() {
        return Ok(record_root::default_root());
    }
    let whole = std::path::absolute(&root);
    whole.map(Some).map_err(|error| RosError::Parameter { name: "record_root".into(), reason: error.to_string() })
}

impl Parameters {
    /// Declares every parameter and reads its value.
    ///
    /// # Errors
    /// The first parameter whose value is of another type or out of its range.
    pub fn declare(node: &Node) -> Result<Self, RosError> {
        let number = |name: &str, default: f64, low: f64, high: f64, text: &str| {
            node.parameter(name, default).description(text).range(low, high).read_only().declare().map(|p| p.get())
        };
        let choice = |name: &str, default: &str, allowed: &'static [&'static str], text: &str| {
            node.parameter(name, default.to_owned())
                .description(text)
                .validate(&allowed.join(" or "), one_of(allowed))
                .read_only()
                .declare()
                .map(|p| p.get())
        };
        let flag = |name: &str, default: bool, text: &str| {
            node.parameter(name, default).description(text).read_only().declare().map(|p| p.get())
        };
        let mode = choice(
            "mode",
            "realtime",
            &["realtime", "lockstep"],
            "realtime: cycles on the wall clock. lockstep: one cycle for each new stamp of joint_states.",
        )?;
        let clock = choice(
            "clock",
            "joint_states",
            &["joint_states", "monotonic"],
            "In realtime, the time that the gait follows: the stamps of joint_states (a simulation), or the machine's clock.",
        )?;
        let drive_mode = choice(
            "drive_mode",
            "impedance",
            &["impedance", "torque"],
            "impedance: the drive closes the law. torque: the controller does, and sends kp = kd = 0.",
        )?;
        let robot_folder = node
            .parameter("robot", "config/robots/vision60".to_owned())
            .description(
                "Folder of the robot's description; looked for from the working folder, then above the program.",
            )
            .read_only()
            .declare()?
            .get();
        let joint_prefix = node
            .parameter("joint_prefix", String::new())
            .description("Stands before every joint's name on topics, to tell the joints of several robots apart, such as left_.")
            .validate(ros::PREFIX_RULE, ros::check_prefix)
            .read_only()
            .declare()?
            .get();
        let backend = choice(
            "backend",
            "dds",
            &["dds", "can"],
            "dds: joint_states in, joint_command out. can: the drives are on the CAN interfaces that bus_file names.",
        )?;
        let bus_file = node
            .parameter("bus_file", "config/hardware/vision60_can.toml".to_owned())
            .description("With backend can: which joint hangs on which drive; looked for as the robot's folder is.")
            .read_only()
            .declare()?
            .get();
        let period_s = number("control_period_s", 1e-3, 2e-4, 0.02, "Control period in realtime, s.")?;
        let state_rate_hz = number("state_rate_hz", 50.0, 0.1, 1000.0, "Rate of controller_state, Hz.")?;
        let joint_states_rate_hz = number(
            "joint_states_rate_hz",
            1000.0,
            0.1,
            5000.0,
            "With backend can: rate of joint_states, as read from the drives, Hz.",
        )?;
        let heartbeat_s = number(
            "emergency_stop_heartbeat_s",
            0.0,
            0.0,
            10.0,
            "The emergency stop counts as pressed when its topic is silent for so long, s; 0: silence means nothing.",
        )?;
        let priority = node
            .parameter("priority", 80_i64)
            .description("SCHED_FIFO priority of the control thread; 0: ordinary scheduling.")
            .range(0, 99)
            .read_only()
            .declare()?
            .get();
        let core = node
            .parameter("core", -1_i64)
            .description("Processor of the control thread; -1: any.")
            .range(-1, 1023)
            .read_only()
            .declare()?
            .get();
        let drive = DriveParameters::declare(node)?;
        let start_on_gait = flag(
            "simulation_start_on_gait",
            false,
            "The robot is simulated and put on the gait's first instant: arm and walk as soon as a gait is there. Never for a real robot.",
        )?;
        let record_every_run = flag(
            "record_every_run",
            false,
            "Each start of the node begins a recording, named by the time in UTC; else they begin with start_recording.",
        )?;
        let split_mb = number(
            "record_split_mb",
            0.0,
            0.0,
            1e5,
            "A recording goes on in a further file after so many MB; 0: never.",
        )?;
        let split_s = number(
            "record_split_s",
            0.0,
            0.0,
            1e5,
            "A recording goes on in a further file after so long, s; 0: never.",
        )?;
        let (lockstep, on_bus) = (mode == "lockstep", backend == "can");
        let middleware_timeout_s = number(
            "middleware_timeout_s",
            if on_bus { 0.013 } else { 0.1 },
            0.006,
            1.0,
            "In realtime, damping and the end of the process when a thread through which the stop is heard stands still for so long, s. Default 0.1; with backend can 0.013.",
        )?;
        if lockstep && on_bus {
            return Err(RosError::Parameter {
                name: "mode".into(),
                reason: "is lockstep, expected realtime with backend can: drives do not wait".into(),
            });
        }
        if on_bus && start_on_gait {
            return Err(RosError::Parameter {
                name: "simulation_start_on_gait".into(),
                reason: "is true, expected false with backend can: it is for simulations only".into(),
            });
        }
        if lockstep && heartbeat_s > 0.0 {
            return Err(RosError::Parameter {
                name: "emergency_stop_heartbeat_s".into(),
                reason: format!(
                    "is {heartbeat_s} s, expected 0 in lockstep: silence is counted on the wall clock, which lockstep does not follow"
                ),
            });
        }
        Ok(Self {
            pace: if lockstep { Pace::Lockstep } else { Pace::Realtime },
            clock: if clock == "monotonic" { CycleClock::Monotonic } else { CycleClock::JointStates },
            bus_file: on_bus.then(|| bus_file.into()),
            robot_folder: robot_folder.into(),
            joint_prefix,
            realtime: RealtimeRequest {
                priority: u8::try_from(priority).ok().filter(|p| *p > 0),
                core: usize::try_from(core).ok(),
                lock_memory: flag("lock_memory", true, "Lock the process's memory.")?,
                ..RealtimeRequest::default()
            },
            period: Duration::from_nanos((period_s * 1e9).round() as u64),
            joint_states_every: (1.0 / (joint_states_rate_hz * period_s)).round().max(1.0) as u64,
            state_every: (1.0 / (state_rate_hz * period_s)).round().max(1.0) as u64,
            heartbeat: (heartbeat_s > 0.0).then(|| Duration::from_secs_f64(heartbeat_s)),
            middleware_timeout: (!lockstep).then(|| Duration::from_secs_f64(middleware_timeout_s)),
            start_on_gait,
            record_root: record_root(node)?,
            drive,
            record_every_run,
            split_bytes: (split_mb > 0.0).then_some((split_mb * 1e6) as u64),
            split_duration: (split_s > 0.0).then(|| Duration::from_secs_f64(split_s)),
            values: Values {
                drive_mode: if drive_mode == "torque" { DriveMode::Torque } else { DriveMode::Impedance },
                state_timeout_s: number(
                    "state_timeout_s",
                    if on_bus { 0.01 } else { 0.1 },
                    0.002,
                    1.0,
                    "Joint states older than this mean damping, s. Default 0.1; with backend can 0.01.",
                )?,
                overrun_s: number(
                    "overrun_s",
                    if on_bus { 0.01 } else { 0.1 },
                    0.002,
                    1.0,
                    "Two cycles further apart than this are a fault, s. Default 0.1; with backend can 0.01.",
                )?,
                start_blend_s: number(
                    "start_blend_s",
                    default::START_BLEND_S,
                    0.05,
                    10.0,
                    "From standing to the gait's first posture, s.",
                )?,
                stop_blend_s: number(
                    "stop_blend_s",
                    default::STOP_BLEND_S,
                    0.05,
                    10.0,
                    "From the last switch to rest, s.",
                )?,
                posture_speed_rad_s: number(
                    "posture_speed_rad_s",
                    default::POSTURE_SPEED_RAD_S,
                    0.05,
                    3.0,
                    "Mean speed of the fastest joint while standing up and sitting down, rad/s.",
                )?,
                tracking_error_rad: number(
                    "tracking_error_rad",
                    default::TRACKING_ERROR_RAD,
                    0.05,
                    2.0,
                    "A joint further than this from its command for 40 ms is a fault, rad.",
                )?,
                tilt_limit_rad: number(
                    "tilt_limit_rad",
                    default::TILT_LIMIT_RAD,
                    0.1,
                    1.5,
                    "Roll or pitch beyond which the robot is damped, where an inertial unit is heard, rad.",
                )?,
            },
        })
    }

    /// The controller's configuration for a robot.
    ///
    /// # Errors
    /// As [`DriveParameters::apply`].
    pub fn control(&self, robot: &Robot) -> Result<Config, RobotError> {
        let v = &self.values;
        let config = Config {
            drive_mode: v.drive_mode,
            simulation_start: self.start_on_gait,
            control_period_s: self.period.as_secs_f64(),
            state_timeout_s: v.state_timeout_s,
            overrun_s: v.overrun_s,
            start_blend_s: v.start_blend_s,
            stop_blend_s: v.stop_blend_s,
            posture_speed_rad_s: v.posture_speed_rad_s,
            tracking_error_rad: v.tracking_error_rad,
            tilt_limit_rad: v.tilt_limit_rad,
            ..Config::for_robot(robot)
        };
        self.drive.apply(robot, config)
    }
}
