//! What the node's parameters mean.

use crate::parameters::Table;
use ros::{Node, Parameter, RosError};
use simulator::{SimulatorOptions, Terrain};
use std::path::PathBuf;
use std::time::Duration;

/// Who sets the pace.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Pace {
    /// The wall clock, times `real_time_factor`.
    Realtime,
    /// Every physics step waits for the command that answers the last joint state.
    Lockstep,
}

/// What the parameters say, checked.
#[derive(Clone)]
pub struct Config {
    /// Who sets the pace.
    pub pace: Pace,
    /// The robot's folder.
    pub robot_folder: PathBuf,
    /// What stands before every joint's name on topics.
    pub joint_prefix: String,
    /// What stands before every frame's name.
    pub frame_prefix: String,
    /// The wiring file of the emulated drives (with `--can`).
    pub bus_file: PathBuf,
    /// How long an emulated drive takes from a frame to its effect.
    pub drive_latency: Duration,
    /// What the simulator is built with.
    pub simulator: SimulatorOptions,
    /// Physics steps in a control period.
    pub steps_per_period: u32,
    /// Control period.
    pub period: Duration,
    /// Whether time stands still at the start.
    pub start_paused: bool,
    /// Simulated seconds per wall second in realtime.
    pub real_time_factor: f64,
    /// How long lockstep waits for a command.
    pub lockstep_timeout: Duration,
    /// Control periods between two messages of imu.
    pub imu_every: u64,
    /// The true pose is no odometry: it goes out on `ground_truth/odom`, and not on `odom` and `/tf`.
    pub is_only_truth: bool,
    /// Control periods between two messages of odometry, transforms and ground forces.
    pub odometry_every: u64,
    /// `stand` or `sit`: may be changed while running, for the next reset.
    pub initial_posture: Parameter<String>,
    /// How long a push lasts, s: may be changed while running.
    pub push_duration_s: Parameter<f64>,
}

/// Physics steps in a control period.
fn steps(table: &Table) -> Result<u32, RosError> {
    let (period_s, timestep_s) = (table.control_period_s, table.timestep_s);
    let steps = (period_s / timestep_s).round();
    if steps < 1.0 || (steps * timestep_s - period_s).abs() > 1e-9 {
        let reason = format!("is {period_s} s, no multiple of timestep_s, {timestep_s} s: change one of them");
        return Err(RosError::Parameter { name: "control_period_s".into(), reason });
    }
    Ok(steps as u32)
}

fn terrain(table: &Table) -> Terrain {
    match table.terrain.as_str() {
        "slope" => Terrain::Slope {
            uphill_rad: table.slope_uphill_deg.to_radians(),
            sideways_rad: table.slope_sideways_deg.to_radians(),
        },
        "rough" => Terrain::Rough { height_m: table.bump_height_m, cell_m: table.bump_cell_m },
        "steps" => Terrain::Steps { rise_m: table.stair_rise_m, run_m: table.stair_run_m },
        _ => Terrain::Flat,
    }
}

impl Config {
    /// Declares every parameter and reads its value.
    ///
    /// # Errors
    /// The first parameter whose value is of another type, out of its range or contradicts another one.
    pub fn declare(node: &Node) -> Result<Self, RosError> {
        let table = Table::declare(node)?;
        let every = |rate_hz: f64| (1.0 / (rate_hz * table.control_period_s)).round().max(1.0) as u64;
        Ok(Self {
            pace: if table.mode == "lockstep" { Pace::Lockstep } else { Pace::Realtime },
            simulator: SimulatorOptions {
                timestep_s: table.timestep_s,
                friction: table.friction,
                terrain: terrain(&table),
                seed: table.seed.unsigned_abs(),
                joint_noise_rad: table.joint_noise_rad,
                command_timeout_s: table.command_timeout_s,
                ..SimulatorOptions::default()
            },
            drive_latency: Duration::from_secs_f64(table.drive_latency_s),
            steps_per_period: steps(&table)?,
            period: Duration::from_nanos((table.control_period_s * 1e9).round() as u64),
            start_paused: table.start_paused,
            real_time_factor: table.real_time_factor,
            lockstep_timeout: Duration::from_secs_f64(table.lockstep_timeout_s),
            imu_every: every(table.imu_rate_hz),
            odometry_every: every(table.odometry_rate_hz),
            is_only_truth: table.ground_truth,
            robot_folder: table.robot.into(),
            joint_prefix: table.joint_prefix,
            frame_prefix: table.frame_prefix,
            bus_file: table.bus_file.into(),
            initial_posture: table.initial_posture,
            push_duration_s: table.push_duration_s,
        })
    }
}
