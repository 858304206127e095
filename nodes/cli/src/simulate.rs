//! `tandem simulate`: a gait file walks in MuJoCo, without ROS.

mod driven;
mod summary;

use crate::interrupt::Interrupt;
use crate::output;
use crate::progress::Progress;
use crate::robots::{self, RobotArguments};
use ::bag::BagError;
use anyhow::{Context, Result, bail};
use control::{DriveMode, Velocity};
use gait::Gait;
use joint_bus::{BusConfig, DriveModel};
use robot::Robot;
use run_recorder::{BodySample, RunInfo, RunRecorder};
use simulator::pictures::{self, Studio};
use simulator::walk::{self, Cycle, Drives, End, Start, Walk, WalkOptions};
use simulator::{Posture, Push, RobotState, SimulatorOptions, Terrain, setting};
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::{Duration, Instant};

/// Walk gait files in MuJoCo under the controller's own step
///
/// The robot starts in the gait's initial state and the paper's PD law tracks the gait, mirrored at every step, with
/// the robot's drives limited to what they can give. Says whether it stayed up, and its speed, drift and torques beside
/// the paper's Table II. Ends with an error code if a robot fell. Ctrl-C ends it at once, with everything that was
/// simulated in the bag and reported. One seed gives one trajectory, to the bit.
///
///   tandem simulate amble.json
///   tandem simulate amble.json --noise 0.03 --seed 4
///   tandem simulate gaits/*.json --seconds 60 --json
///   tandem plan amble --slope 5 -o uphill.json
///   tandem simulate uphill.json --slope 5 --mu 0.5 --push 3 0.1 0 100
///   tandem simulate amble.json --start sit --out out/amble
///   tandem simulate amble.json --slope 10 --balance --push 3 0.1 0 300 --velocity 5 0.2 0 0.3
#[derive(clap::Args)]
#[command(verbatim_doc_comment)]
pub struct Arguments {
    /// Gait files, as `tandem plan` writes them
    #[arg(required = true, value_name = "FILE")]
    files: Vec<PathBuf>,
    /// Walking time, s
    #[arg(long, value_name = "S", default_value_t = 20.0)]
    seconds: f64,
    /// Names the random start and the random ground
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// Standard deviation of every joint's offset at the start, rad
    #[arg(long, value_name = "RAD", default_value_t = setting::JOINT_NOISE_RAD.default)]
    noise: f64,
    /// Where the robot starts
    #[arg(long, value_enum, default_value_t = StartArgument::Gait)]
    start: StartArgument,
    /// Coefficient of friction between toes and ground
    #[arg(long, value_name = "MU", default_value_t = setting::FRICTION.default)]
    mu: f64,
    /// Ground that rises ahead, and to the left if a second number is given, degrees
    #[arg(long, value_name = "DEG", num_args = 1..=2, group = "ground", allow_negative_numbers = true)]
    slope: Option<Vec<f64>>,
    /// Bumps of random height up to this, m
    #[arg(long, value_name = "M", group = "ground")]
    bumps: Option<f64>,
    /// Stairs of this rise, m
    #[arg(long, value_name = "M", group = "ground")]
    stairs: Option<f64>,
    /// The stairs that the gait was planned for with `tandem plan --schedule crawl --stairs`; the walk begins on them
    #[arg(long, group = "ground")]
    staircase: bool,
    /// Level ground, from 1 m ahead on a ramp that rises by this, degrees
    #[arg(long, value_name = "DEG", group = "ground", allow_negative_numbers = true)]
    ramp: Option<f64>,
    /// Push on the base: seconds after the first step, duration in s, force ahead and to the left in N
    #[arg(
        long,
        value_names = ["T", "DURATION", "FX", "FY"],
        num_args = 4,
        action = clap::ArgAction::Append,
        allow_negative_numbers = true
    )]
    push: Vec<f64>,
    /// Walk in balance: steps are placed, hurried and levelled by what is measured (docs/balance.md)
    #[arg(long)]
    balance: bool,
    /// With --balance: velocity from T seconds after the first step on, ahead and to the left in m/s, turning in rad/s
    #[arg(
        long,
        value_names = ["T", "VX", "VY", "WZ"],
        num_args = 4,
        action = clap::ArgAction::Append,
        allow_negative_numbers = true,
        requires = "balance"
    )]
    velocity: Vec<f64>,
    /// Time that a command takes to the drives, a multiple of the control period, s
    #[arg(long, value_name = "S", default_value_t = 0.0)]
    delay: f64,
    /// Emulated drives behind the frames of this wiring file, in place of ideal ones
    /// (config/hardware/vision60_can.toml)
    #[arg(long, value_name = "FILE", conflicts_with = "delay")]
    bus: Option<PathBuf>,
    /// With --bus: how long a drive takes from a frame to its effect, s
    #[arg(long, value_name = "S", default_value_t = setting::DRIVE_LATENCY_S.default, requires = "bus")]
    drive_latency: f64,
    /// Close the law in the controller, once a control period, instead of at the drives
    #[arg(long)]
    torque_mode: bool,
    /// Time between two control cycles, s
    #[arg(long, value_name = "S", default_value_t = 1e-3)]
    period: f64,
    /// Write phase portraits, torques, time series, footfalls, tiles and an animation of a stride (PNG) into this
    /// folder
    #[arg(long, value_name = "FOLDER", value_parser = output::folder)]
    out: Option<PathBuf>,
    /// Record a bag of the run (rosbag2, MCAP) in this folder, for `tandem bag` and `tandem report`
    #[arg(long, value_name = "FOLDER", value_parser = output::folder)]
    bag: Option<PathBuf>,
    /// Print one JSON object for each file instead of text
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    robot: RobotArguments,
}

#[derive(Clone, Copy, clap::ValueEnum)]
enum StartArgument {
    /// In the gait's initial state
    Gait,
    /// Standing; it blends into the gait
    Stand,
    /// Sitting; it stands up first
    Sit,
}

/// Runs the subcommand.
pub fn run(arguments: &Arguments) -> Result<ExitCode> {
    let robot = arguments.robot.load()?;
    let mut options = arguments.options(&robot)?;
    let mut all_up = true;
    for file in &arguments.files {
        let found = robots::file(file);
        let text = std::fs::read_to_string(found).with_context(|| format!("cannot read {}", file.display()))?;
        let gait = Gait::from_json(&text).with_context(|| file.display().to_string())?;
        let folder = |folder: &PathBuf| {
            if arguments.files.len() == 1 { folder.clone() } else { folder.join(file.file_stem().unwrap_or_default()) }
        };
        if arguments.staircase {
            options.simulator.terrain =
                Terrain::staircase_of(&robot, &gait).with_context(|| file.display().to_string())?;
        }
        let (out, bag) = (arguments.out.as_ref().map(folder), arguments.bag.as_ref().map(folder));
        let done = simulate(&robot, &gait, &options, out.as_deref(), bag.as_deref())
            .with_context(|| file.display().to_string())?;
        all_up &= done.walk.end == End::Upright;
        if arguments.json {
            output::json(&done.json(&robot, &gait, &options))?;
        } else {
            output::part(format_args!("{}", done.text(&robot, &gait, &options)))?;
        }
        if let Some(code) = done.interrupted {
            note!("tandem: interrupted; what was simulated until then is whole");
            return Ok(code);
        }
    }
    Ok(if all_up { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}

impl Arguments {
    fn options(&self, robot: &Robot) -> Result<WalkOptions> {
        let drives = self.bus.as_ref().map(|file| self.drives(robot, file)).transpose()?;
        let terrain = if let Some(slope) = &self.slope {
            Terrain::Slope {
                uphill_rad: slope[0].to_radians(),
                sideways_rad: slope.get(1).copied().unwrap_or_default().to_radians(),
            }
        } else if let Some(height_m) = self.bumps {
            Terrain::Rough { height_m, cell_m: setting::BUMP_CELL_M.default }
        } else if let Some(rise_m) = self.stairs {
            Terrain::Steps { rise_m, run_m: setting::STAIR_RUN_M.default }
        } else if let Some(incline_deg) = self.ramp {
            Terrain::Ramp { incline_rad: incline_deg.to_radians() }
        } else {
            Terrain::Flat
        };
        Ok(WalkOptions {
            seconds: self.seconds,
            drive_mode: if self.torque_mode { DriveMode::Torque } else { DriveMode::Impedance },
            drives,
            start: match self.start {
                StartArgument::Gait => Start::Gait,
                StartArgument::Stand => Start::Posture(Posture::Stand),
                StartArgument::Sit => Start::Posture(Posture::Sit),
            },
            period_s: self.period,
            command_delay_s: self.delay,
            pushes: self
                .push
                .chunks_exact(4)
                .map(|p| Push { start_s: p[0], duration_s: p[1], force_n: [p[2], p[3], 0.0] })
                .collect(),
            balance: self.balance,
            velocities: self
                .velocity
                .chunks_exact(4)
                .map(|v| (v[0], Velocity { forward_m_s: v[1], left_m_s: v[2], yaw_rad_s: v[3] }))
                .collect(),
            simulator: SimulatorOptions {
                friction: self.mu,
                terrain,
                seed: self.seed,
                joint_noise_rad: self.noise,
                ..SimulatorOptions::default()
            },
        })
    }

    fn drives(&self, robot: &Robot, file: &Path) -> Result<Drives> {
        let found = robots::file(file);
        let text = std::fs::read_to_string(found).with_context(|| format!("cannot read {}", file.display()))?;
        let bus = BusConfig::from_toml_str(&text, &robot.name, &robot.joint_names())
            .with_context(|| file.display().to_string())?;
        if let Err(wrong) = setting::DRIVE_LATENCY_S.check(self.drive_latency) {
            bail!("--drive-latency {wrong}");
        }
        // The emulation has one limit for all drives; the simulator still keeps each joint's own.
        let torque_limit_nm = robot.limits.drive_torque_nm.into_iter().fold(0.0, f64::max);
        let latency = Duration::from_secs_f64(self.drive_latency);
        Ok(Drives { bus, model: DriveModel { torque_limit_nm, latency, ..DriveModel::default() } })
    }
}

struct Done {
    walk: Walk,
    wall_s: f64,
    files: Vec<PathBuf>,
    /// Why there are no pictures, where some were asked for.
    no_pictures: Vec<String>,
    /// The code to end with, if a signal ended the walk.
    interrupted: Option<ExitCode>,
}

fn simulate(robot: &Robot, gait: &Gait, options: &WalkOptions, out: Option<&Path>, bag: Option<&Path>) -> Result<Done> {
    let begin = Instant::now();
    let mut samples = Vec::new();
    let mut recording = bag.map(|folder| Recording::start(folder, robot, gait, options)).transpose()?;
    let progress = Progress::begin(&format!("walking {}", gait.name));
    let interrupt = Interrupt::watch()?;
    let walked = walk::walk_until(robot, gait, options, &mut |_, state, cycle| {
        if out.is_some() {
            samples.push(pictures::sample(state));
        }
        if let Some(recording) = &mut recording {
            recording.cycle(state, cycle);
        }
        if cycle.output.cycles.is_multiple_of(500) {
            progress.say(format!("{:.1} s", state.time_s));
        }
        if interrupt.came() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    });
    // Whatever ended the walk: what was recorded until then becomes a whole bag.
    let summary = recording.map(Recording::finish).transpose();
    let interrupted = interrupt.code();
    drop((interrupt, progress));
    let (walk, summary) = (walked?, summary?);
    let mut done =
        Done { walk, wall_s: begin.elapsed().as_secs_f64(), files: Vec::new(), no_pictures: Vec::new(), interrupted };
    done.files.extend(summary.map(|summary| summary.folder));
    if let Some(folder) = out {
        let _progress = Progress::begin("drawing");
        std::fs::create_dir_all(folder).with_context(|| format!("cannot make the folder {}", folder.display()))?;
        done.write(folder, "gait.json", gait.to_json().as_bytes())?;
        // Who interrupts does not wait for pictures.
        if done.interrupted.is_none() {
            done.draw(folder, robot, gait, options, &samples)?;
        }
    }
    Ok(done)
}

/// The run's bag. The first error is kept until the end: the walk itself goes on.
struct Recording {
    run: RunRecorder,
    failed: Option<BagError>,
}

impl Recording {
    fn start(folder: &Path, robot: &Robot, gait: &Gait, options: &WalkOptions) -> Result<Recording> {
        let config = walk::controller_config(robot, options)?;
        let [a, b, c, d] = &robot.legs;
        let info = RunInfo {
            config: &config,
            robot_description: &robot.urdf,
            leg_names: [&a.name, &b.name, &c.name, &d.name],
            epoch_ns: 0,
        };
        // A simulation can wait for the disk.
        let recorder = ::bag::RecorderOptions { when_full: ::bag::WhenFull::Wait, ..::bag::RecorderOptions::default() };
        let mut run = RunRecorder::start(folder, &info, recorder)?;
        run.gait(gait)?;
        Ok(Recording { run, failed: None })
    }

    fn cycle(&mut self, state: &RobotState, cycle: &Cycle) {
        if self.failed.is_none() {
            self.failed = self.record(state, cycle).err();
        }
    }

    fn record(&mut self, state: &RobotState, cycle: &Cycle) -> Result<(), BagError> {
        self.run.cycle(cycle.now, cycle.input, cycle.output, Some(&state.joint_torque_nm))?;
        // The base at 100 Hz is as much as a picture shows.
        if cycle.output.cycles % 10 == 1 {
            self.run.body(&BodySample {
                time: cycle.now,
                position_m: state.base_position_m,
                quaternion_xyzw: state.base_quaternion_xyzw,
                linear_velocity_body: state.base_linear_velocity_body(),
                angular_velocity_body: state.base_angular_velocity_body,
                ground_force_n: Some(state.toe_force_n),
            })?;
        }
        Ok(())
    }

    fn finish(self) -> Result<::bag::Summary> {
        match self.failed {
            Some(error) => Err(error.into()),
            None => Ok(self.run.finish()?),
        }
    }
}

impl Done {
    fn write(&mut self, folder: &Path, name: &str, bytes: &[u8]) -> Result<()> {
        let file = folder.join(name);
        output::write_file(&file, bytes)?;
        self.files.push(file);
        Ok(())
    }

    fn draw(
        &mut self,
        folder: &Path,
        robot: &Robot,
        gait: &Gait,
        options: &WalkOptions,
        samples: &[::report::Sample],
    ) -> Result<()> {
        let walking_from_s = self.walk.walking_from_s;
        // A fall in the first steps, or a machine without OpenGL, leaves less to show. The walk itself is still
        // reported.
        let mut tiles = Vec::new();
        let filmed = Studio::new(robot, &options.simulator, gait, samples, walking_from_s).and_then(|mut studio| {
            tiles = studio.tiles()?;
            studio.animation()
        });
        match filmed {
            Ok(animation) => self.write(folder, "walk.png", &animation)?,
            Err(problem) => self.no_pictures.push(problem.to_string()),
        }
        let run = ::report::Run { gait, origin: ::report::Origin::Simulated, samples, walking_from_s, tiles: &tiles };
        match ::report::render_run(folder, &run) {
            Ok(pictures) => self.files.extend(pictures),
            Err(problem @ ::report::ReportError::TooLittle { .. }) => self.no_pictures.push(problem.to_string()),
            Err(problem) => return Err(problem.into()),
        }
        if options.balance && self.no_pictures.is_empty() {
            self.write(folder, "driven.png", &driven::picture(&run, robot, options)?)?;
        }
        Ok(())
    }
}
