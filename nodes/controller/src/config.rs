//! What the node's parameters mean.

use crate::dds_bus::CycleClock;
use crate::drive::DriveParameters;
use crate::parameters::Table;
use crate::record_root;
use control::{Config, DriveMode};
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
    table: Table,
}

/// The error for a parameter that contradicts another one.
fn refuse(name: &str, reason: &str) -> RosError {
    RosError::Parameter { name: name.into(), reason: reason.into() }
}

fn record_root(root: &str) -> Result<Option<PathBuf>, RosError> {
    if root.is_empty() {
        return Ok(record_root::default_root());
    }
    std::path::absolute(root).map(Some).map_err(|error| refuse("record_root", &error.to_string()))
}

/// What no row can say by itself.
fn check_together(table: &Table) -> Result<(), RosError> {
    let (lockstep, on_bus) = (table.mode == "lockstep", table.backend == "can");
    if lockstep && on_bus {
        return Err(refuse("mode", "is lockstep, expected realtime with backend can: drives do not wait"));
    }
    if on_bus && table.simulation_start_on_gait {
        return Err(refuse(
            "simulation_start_on_gait",
            "is true, expected false with backend can: it is for simulations only",
        ));
    }
    if lockstep && table.emergency_stop_heartbeat_s > 0.0 {
        let heartbeat_s = table.emergency_stop_heartbeat_s;
        let reason = format!(
            "is {heartbeat_s} s, expected 0 in lockstep: silence is counted on the wall clock, which lockstep does not follow"
        );
        return Err(refuse("emergency_stop_heartbeat_s", &reason));
    }
    Ok(())
}

impl Parameters {
    /// Declares every parameter and reads its value.
    ///
    /// # Errors
    /// The first parameter whose value is of another type, out of its range or contradicts another one.
    pub fn declare(node: &Node) -> Result<Self, RosError> {
        let table = Table::declare(node)?;
        check_together(&table)?;
        let lockstep = table.mode == "lockstep";
        let every = |rate_hz: f64| (1.0 / (rate_hz * table.control_period_s)).round().max(1.0) as u64;
        let if_positive = |seconds: f64| (seconds > 0.0).then(|| Duration::from_secs_f64(seconds));
        Ok(Self {
            pace: if lockstep { Pace::Lockstep } else { Pace::Realtime },
            clock: if table.clock == "monotonic" { CycleClock::Monotonic } else { CycleClock::JointStates },
            bus_file: (table.backend == "can").then(|| table.bus_file.clone().into()),
            robot_folder: table.robot.clone().into(),
            joint_prefix: table.joint_prefix.clone(),
            realtime: RealtimeRequest {
                priority: u8::try_from(table.priority).ok().filter(|p| *p > 0),
                core: usize::try_from(table.core).ok(),
                lock_memory: table.lock_memory,
                ..RealtimeRequest::default()
            },
            period: Duration::from_nanos((table.control_period_s * 1e9).round() as u64),
            joint_states_every: every(table.joint_states_rate_hz),
            state_every: every(table.state_rate_hz),
            heartbeat: if_positive(table.emergency_stop_heartbeat_s),
            middleware_timeout: (!lockstep).then(|| Duration::from_secs_f64(table.middleware_timeout_s)),
            start_on_gait: table.simulation_start_on_gait,
            record_root: record_root(&table.record_root)?,
            drive: DriveParameters::new(&table),
            record_every_run: table.record_every_run,
            split_bytes: (table.record_split_mb > 0.0).then_some((table.record_split_mb * 1e6) as u64),
            split_duration: if_positive(table.record_split_s),
            table,
        })
    }

    /// The controller's configuration for a robot.
    ///
    /// # Errors
    /// As [`DriveParameters::apply`].
    pub fn control(&self, robot: &Robot) -> Result<Config, RobotError> {
        let table = &self.table;
        let config = Config {
            drive_mode: if table.drive_mode == "torque" { DriveMode::Torque } else { DriveMode::Impedance },
            simulation_start: self.start_on_gait,
            control_period_s: self.period.as_secs_f64(),
            state_timeout_s: table.state_timeout_s,
            overrun_s: table.overrun_s,
            start_blend_s: table.start_blend_s,
            stop_blend_s: table.stop_blend_s,
            posture_speed_rad_s: table.posture_speed_rad_s,
            tracking_error_rad: table.tracking_error_rad,
            tilt_limit_rad: table.tilt_limit_rad,
            ..Config::for_robot(robot)
        };
        self.drive.apply(robot, config)
    }
}
