//! The node's parameters.

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

fn odometry_rate_hz(node: &Node) -> Result<f64, RosError> {
    let rate_hz = node.parameter("odometry_rate_hz", 50.0);
    let rate_hz = rate_hz.description("Messages on odom, tf and each ground_force per simulated second.");
    Ok(rate_hz.range(0.1, 10_000.0).read_only().declare()?.get())
}

fn is_only_truth(node: &Node) -> Result<bool, RosError> {
    let only = node.parameter("ground_truth", false);
    let text =
        "The true pose goes out on ground_truth/odom, and not on odom and /tf, which are a controller's in balance.";
    Ok(only.description(text).read_only().declare()?.get())
}

/// A parameter's value that cannot be, in ROS terms.
fn refuse(name: &str, reason: String) -> RosError {
    RosError::Parameter { name: name.into(), reason }
}

fn one_of(choices: &'static [&'static str]) -> impl Fn(&String) -> Result<(), String> + Send + Sync {
    move |value| {
        if choices.contains(&value.as_str()) {
            Ok(())
        } else {
            Err(format!("expected one of {choices:?}, got \"{value}\""))
        }
    }
}

impl Config {
    /// Declares every parameter and reads its value.
    ///
    /// # Errors
    /// The first parameter whose value is of another type or out of its range.
    pub fn declare(node: &Node) -> Result<Self, RosError> {
        let number = |name: &str, default: f64, low: f64, high: f64, text: &str| {
            node.parameter(name, default).description(text).range(low, high).read_only().declare().map(|p| p.get())
        };
        let mode = node
            .parameter("mode", "realtime".to_owned())
            .description("realtime: on the wall clock. lockstep: every step waits for the command that answers the last joint state.")
            .validate("realtime or lockstep", one_of(&["realtime", "lockstep"]))
            .read_only()
            .declare()?
            .get();
        let robot_folder = node
            .parameter("robot", "config/robots/vision60".to_owned())
            .description(
                "Folder of the robot's description; looked for from the working folder, then beside the program.",
            )
            .read_only()
            .declare()?
            .get();
        let prefix = |name: &str, text: &str| {
            node.parameter(name, String::new())
                .description(text)
                .validate(ros::PREFIX_RULE, ros::check_prefix)
                .read_only()
                .declare()
                .map(|parameter| parameter.get())
        };
        let joint_prefix = prefix(
            "joint_prefix",
            "Stands before every joint's name on topics, to tell the joints of several robots apart, such as left_.",
        )?;
        let frame_prefix = prefix(
            "frame_prefix",
            "Stands before the names of the frames odom, base_link and imu_link, such as left/.",
        )?;
        let bus_file = node
            .parameter("bus_file", "config/hardware/vision60_can.toml".to_owned())
            .description("With --can: the wiring file of the emulated drives; looked for as robot is.")
            .read_only()
            .declare()?
            .get();
        let drive_latency_s = number(
            "drive_latency_s",
            0.0,
            0.0,
            0.015,
            "With --can: from a frame's arrival at a drive to its effect, s.",
        )?;
        let timestep_s = number("timestep_s", 5e-4, 1e-5, 2e-3, "Physics step, s.")?;
        let period_s = number(
            "control_period_s",
            1e-3,
            1e-4,
            0.02,
            "Time between two joint states, a multiple of timestep_s, s.",
        )?;
        let steps = (period_s / timestep_s).round();
        if steps < 1.0 || (steps * timestep_s - period_s).abs() > 1e-9 {
            return Err(refuse(
                "control_period_s",
                format!("{period_s} s is no multiple of timestep_s, {timestep_s} s"),
            ));
        }
        let terrain = node
            .parameter("terrain", "flat".to_owned())
            .description("The ground. A slope turns gravity: the world's x-y plane stays the ground.")
            .validate("flat, slope, rough or steps", one_of(&["flat", "slope", "rough", "steps"]))
            .read_only()
            .declare()?
            .get();
        let uphill_deg =
            number("slope_uphill_deg", 5.0, -45.0, 45.0, "With terrain slope: inclination along +x, degrees.")?;
        let sideways_deg =
            number("slope_sideways_deg", 0.0, -45.0, 45.0, "With terrain slope: inclination along +y, degrees.")?;
        let height_m = number("bump_height_m", 0.02, 0.001, 0.3, "With terrain rough: highest bump, m.")?;
        let cell_m = number("bump_cell_m", 0.1, 0.02, 2.0, "With terrain rough: side of a bump, m.")?;
        let rise_m = number("stair_rise_m", 0.05, 0.005, 0.3, "With terrain steps: rise of a stair, m.")?;
        let run_m = number("stair_run_m", 0.4, 0.1, 2.0, "With terrain steps: depth of a stair, m.")?;
        let terrain = match terrain.as_str() {
            "slope" => Terrain::Slope { uphill_rad: uphill_deg.to_radians(), sideways_rad: sideways_deg.to_radians() },
            "rough" => Terrain::Rough { height_m, cell_m },
            "steps" => Terrain::Steps { rise_m, run_m },
            _ => Terrain::Flat,
        };
        let seed = node
            .parameter("seed", 0i64)
            .description("Names the random terrain and the random start.")
            .range(0, i64::MAX)
            .read_only()
            .declare()?
            .get();
        let simulator = SimulatorOptions {
            timestep_s,
            friction: number("friction", 0.8, 0.01, 5.0, "Coefficient of sliding friction between toes and ground.")?,
            terrain,
            seed: seed.unsigned_abs(),
            joint_noise_rad: number(
                "joint_noise_rad",
                0.0,
                0.0,
                0.3,
                "Standard deviation of every joint's offset at a reset, rad.",
            )?,
            command_timeout_s: number(
                "command_timeout_s",
                0.1,
                1e-3,
                10.0,
                "Simulated time after which a command is too old and the drives damp, s.",
            )?,
            ..SimulatorOptions::default()
        };
        let every = |rate_hz: f64| (1.0 / (rate_hz * period_s)).round().max(1.0) as u64;
        Ok(Self {
            pace: if mode == "lockstep" { Pace::Lockstep } else { Pace::Realtime },
            robot_folder: robot_folder.into(),
            joint_prefix,
            frame_prefix,
            bus_file: bus_file.into(),
            drive_latency: Duration::from_secs_f64(drive_latency_s),
            simulator,
            steps_per_period: steps as u32,
            period: Duration::from_nanos((period_s * 1e9).round() as u64),
            start_paused: node
                .parameter("start_paused", false)
                .description("Time stands still until the service pause lets it go.")
                .read_only()
                .declare()?
                .get(),
            real_time_factor: number(
                "real_time_factor",
                1.0,
                0.01,
                100.0,
                "In realtime: simulated seconds per wall second.",
            )?,
            lockstep_timeout: Duration::from_secs_f64(number(
                "lockstep_timeout_s",
                10.0,
                0.1,
                3600.0,
                "In lockstep: how long to wait for a command before giving up with an error, wall s.",
            )?),
            imu_every: every(number("imu_rate_hz", 200.0, 0.1, 10_000.0, "Messages on imu per simulated second.")?),
            odometry_every: every(odometry_rate_hz(node)?),
            is_only_truth: is_only_truth(node)?,
            initial_posture: node
                .parameter("initial_posture", "sit".to_owned())
                .description("How the robot is put down at the start and at a reset.")
                .validate("stand or sit", one_of(&["stand", "sit"]))
                .declare()?,
            push_duration_s: node
                .parameter("push_duration_s", 0.1)
                .description("How long the force of a message on push acts, s.")
                .range(0.001, 60.0)
                .declare()?,
        })
    }
}
