//! `tandem plan`: one gait from a request.

mod schedule;
mod table;
mod transition;
mod verify;

use crate::output;
use crate::progress::Progress;
use crate::robots::RobotArguments;
use anyhow::{Context, Result, bail};
use gait_design::{GaitRequest, Open, Plan, PlanOptions, Reference};
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::{Duration, Instant};
use transition::{Between, TwoSteps};
use verify::{Stable, Verified};

/// Plan a gait by the dynamics decomposition and write the gait file
///
/// BEHAVIOUR is one of the five gaits of Ma & Ames' Table I, or `all`. Its step duration, clearance and speed come from
/// the table (whose frequencies count strides), height and half-width from the robot's description; options replace
/// them.
///
///   tandem plan amble -o amble.json
///   tandem plan amble --speed 0.5 --step-duration 0.35
///   tandem plan gait1 --clearance 0.08 --height 0.52
///   tandem plan amble --speed 0.4 --stable
///   tandem plan amble --schedule crawl --step-duration 0.4 --speed 0.1 --clearance 0.08 -o crawl.json
///   tandem plan amble --schedule trot --four-leg-share 0.25 --speed 0.3 --clearance 0.08
///   tandem plan gait1 --schedule crawl --stairs 0.1 0.3 --step-duration 0.5 --clearance 0.12 -o stairs.json
///   tandem plan all -o gaits
///   tandem plan --table
#[derive(clap::Args)]
#[command(verbatim_doc_comment)]
pub struct Arguments {
    /// gait1, gait2, gait3, gait4, amble, or all
    #[arg(required_unless_present = "table")]
    behaviour: Option<String>,
    /// Print the paper's Table I beside this planner's: the five gaits, planned now
    #[arg(long, conflicts_with_all = ["behaviour", "output"])]
    table: bool,
    /// Step duration T, s
    #[arg(long, value_name = "S", group = "timing", allow_negative_numbers = true)]
    step_duration: Option<f64>,
    /// Steps a second: T = 1 / f
    #[arg(long, value_name = "HZ", group = "timing", allow_negative_numbers = true)]
    step_frequency: Option<f64>,
    /// Strides (two steps) a second: T = 1 / (2 f)
    #[arg(long, value_name = "HZ", group = "timing", allow_negative_numbers = true)]
    stride_frequency: Option<f64>,
    /// Height of the swing toes in the middle of the step, m
    #[arg(long, value_name = "M", allow_negative_numbers = true)]
    clearance: Option<f64>,
    /// Forward speed, m/s; negative walks backward
    #[arg(long, value_name = "M/S", allow_negative_numbers = true)]
    speed: Option<f64>,
    /// Speed to the left, m/s; negative is to the right. Two steps are planned, by the full-order program: tens of
    /// milliseconds
    #[arg(long, value_name = "M/S", allow_negative_numbers = true)]
    lateral_speed: Option<f64>,
    /// Yaw rate, rad/s; positive turns to the left. Speeds are in axes that turn along. Two steps, as above
    #[arg(long, value_name = "RAD/S", allow_negative_numbers = true)]
    yaw_rate: Option<f64>,
    /// Hip axes above the toe centres, m
    #[arg(long, value_name = "M", allow_negative_numbers = true)]
    height: Option<f64>,
    /// Lateral distance of a stance toe from the mid plane, m
    #[arg(long, value_name = "M", allow_negative_numbers = true)]
    half_width: Option<f64>,
    /// Slope of the ground, degrees; positive is uphill
    #[arg(long, value_name = "DEG", allow_negative_numbers = true)]
    slope: Option<f64>,
    /// Slope of the ground across the walk, degrees; positive rises to the left. Two steps are planned, by the
    /// full-order program: tens of milliseconds
    #[arg(long, value_name = "DEG", allow_negative_numbers = true)]
    sideways_slope: Option<f64>,
    /// Pitch that the torso is held at, degrees; positive lowers its nose. Planned by the full-order program: tens of
    /// milliseconds
    #[arg(long, value_name = "DEG", allow_negative_numbers = true)]
    torso_pitch: Option<f64>,
    /// Roll that the torso is held at, degrees; positive lowers its right side. Two steps: tens of milliseconds
    #[arg(long, value_name = "DEG", allow_negative_numbers = true)]
    torso_roll: Option<f64>,
    /// Friction coefficient that the plan may use
    #[arg(long, value_name = "MU", allow_negative_numbers = true)]
    friction: Option<f64>,
    /// Torque bound of every joint, N m
    #[arg(long, value_name = "NM", allow_negative_numbers = true)]
    torque_limit: Option<f64>,
    /// Hermite–Simpson points of the program, odd, 5 to 161. A solution that breaks something between its points is
    /// solved again with every interval halved, up to twice
    #[arg(long, value_name = "N", default_value_t = 11)]
    points: usize,
    /// Choose the step duration and the half-width, each where no option gives it, for the smallest multiplier of the
    /// step-to-step map: about a tenth of a second
    #[arg(long, conflicts_with = "table")]
    stable: bool,
    #[command(flatten)]
    schedule: schedule::ScheduleArguments,
    /// What the tracking law follows
    #[arg(long, value_enum, default_value_t = ReferenceArgument::Compensated)]
    reference: ReferenceArgument,
    /// Where to write the gait file, `-` for standard output; with `all`, a folder
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
    /// Simulate the planned step with the full-order model, look at the plan between the program's points, and say how
    /// far they depart from the plan
    #[arg(long)]
    verify: bool,
    /// With --verify, draw the planned and the simulated step into this folder, NAME_step.png
    #[arg(long, value_name = "FOLDER", requires = "verify", value_parser = output::folder)]
    plot: Option<PathBuf>,
    /// Compute the multipliers of the step-to-step map under the tracking law
    #[arg(long)]
    stability: bool,
    /// Plan the two steps from standing to the gait as well, by the full-order program: tens of milliseconds. They are
    /// reported, with --json polynomials and all, and the gait file has them as its lead, which is walked once before
    /// the first step
    #[arg(long, conflicts_with = "table")]
    from_rest: bool,
    /// Plan the two steps from another gait, the one in this file, to the gait instead: as its lead they are walked
    /// where the gait takes over from that one
    #[arg(long, value_name = "FILE", conflicts_with_all = ["table", "from_rest"])]
    from: Option<PathBuf>,
    /// The two steps from the gait to standing; reported alone, the gait file has no room for them
    #[arg(long, conflicts_with = "table")]
    to_rest: bool,
    /// Print one JSON object for each gait instead of text
    #[arg(long, conflicts_with = "verbose")]
    json: bool,
    /// Print every iteration of the solver
    #[arg(short, long)]
    verbose: bool,
    #[command(flatten)]
    robot: RobotArguments,
}

#[derive(Clone, Copy, clap::ValueEnum)]
enum ReferenceArgument {
    /// A reference that makes the bare law give the planned torques
    Compensated,
    /// The planned joints themselves: the robot sags, for comparison
    PlannedJoints,
    /// A reference planned inside the full-order program, with the law's torques: tens of milliseconds
    InProgram,
}

impl From<ReferenceArgument> for Reference {
    fn from(argument: ReferenceArgument) -> Self {
        match argument {
            ReferenceArgument::Compensated => Self::Compensated,
            ReferenceArgument::PlannedJoints => Self::PlannedJoints,
            ReferenceArgument::InProgram => Self::InProgram,
        }
    }
}

/// How long to look for something near that can be planned, where a request cannot.
const SEARCH_LIMIT: Duration = Duration::from_secs(60);

/// Runs the subcommand.
pub fn run(arguments: &Arguments) -> Result<ExitCode> {
    output::reserve(arguments.output.as_deref());
    let robot = arguments.robot.load()?;
    let Some(behaviour) = &arguments.behaviour else {
        table::print(arguments, &robot)?;
        return Ok(ExitCode::SUCCESS);
    };
    let all = behaviour == "all";
    let names: Vec<&str> = if all { gait_design::behaviours().collect() } else { vec![behaviour] };
    if all && let Some(folder) = &arguments.output {
        let folder = output::folder(&folder.display().to_string()).map_err(anyhow::Error::msg)?;
        std::fs::create_dir_all(&folder).with_context(|| format!("cannot make the folder {}", folder.display()))?;
    }
    if !arguments.json {
        say!("gait     iterations   time s         cost    violation       T s  points  multiplier  file")?;
    }
    let mut followed = true;
    for name in names {
        let file = arguments.output.as_ref().map(|o| if all { o.join(format!("{name}.json")) } else { o.clone() });
        followed &= one(arguments, &robot, name, file.as_deref())?;
    }
    if !followed {
        bail!("the full-order model does not follow every plan: see above");
    }
    Ok(ExitCode::SUCCESS)
}

/// Plans one gait, writes it and reports it. Whether the model follows it.
fn one(arguments: &Arguments, robot: &robot::Robot, name: &str, file: Option<&Path>) -> Result<bool> {
    let request = arguments.request(name, robot)?;
    if let Some(contacts) = arguments.schedule.contacts()? {
        schedule::one(arguments, robot, request, contacts, file)?;
        return Ok(true);
    }
    let mut plan = timed(robot, &request, arguments, arguments.verbose)?;
    let rest = transition::planned(robot, &plan.gait, &arguments.transitions(robot)?)?;
    transition::lead(&mut plan.gait, &rest)?;
    // What was left open is chosen.
    let request: GaitRequest = serde_json::from_value(plan.gait.request.clone()).context("the gait's request")?;
    if let Some(file) = file {
        output::write_file(file, plan.gait.to_json().as_bytes())?;
    }
    let law = Reference::from(arguments.reference).step_law();
    let plot = arguments.plot.as_deref();
    let verified = if arguments.verify { Some(verify::verify(robot, &request, &plan, law, plot)?) } else { None };
    let is_followed = verified.iter().flatten().all(Verified::is_good);
    let stable = if arguments.stability { Some(Stable::of(robot, &request, &plan)?) } else { None };
    if arguments.json {
        let mut reported = reported(&plan.gait, &request, plan.points.len(), file);
        let verified = verified.as_ref().map(|steps| steps.iter().map(Verified::json).collect::<Vec<_>>());
        reported["verified"] = verified.into();
        reported["stability"] = stable.as_ref().map(Stable::json).into();
        if !rest.is_empty() {
            reported["transitions"] = rest.iter().map(TwoSteps::json).collect();
        }
        output::json(&reported)?;
    } else {
        say_row(&plan.gait, plan.points.len(), file)?;
        let lines = verified.iter().flatten().map(Verified::text).chain(stable.iter().map(Stable::text));
        let lines = lines.chain(rest.iter().map(TwoSteps::text));
        output::part(format_args!("{}", lines.collect::<String>()))?;
    }
    Ok(is_followed)
}

/// What is reported of every plan, for a program.
fn reported(gait: &gait::Gait, request: &GaitRequest, points: usize, file: Option<&Path>) -> serde_json::Value {
    let solver = &gait.solver;
    serde_json::json!({
        "gait": gait.name, "iterations": solver.iterations, "solve_time_s": solver.solve_time_s,
        "cost": solver.objective, "violation": solver.max_violation, "step_duration_s": gait.step_duration_s,
        "file": file, "points": points, "half_width_m": request.half_width_m, "certificate": gait.certificate,
    })
}

/// The same for a person.
fn say_row(gait: &gait::Gait, points: usize, file: Option<&Path>) -> Result<()> {
    let solver = &gait.solver;
    say!(
        "{:8} {:>10} {:>8.3} {:>12.6} {:>12.1e} {:>9.4} {points:>7} {:>11}  {}",
        gait.name,
        solver.iterations,
        solver.solve_time_s,
        solver.objective,
        solver.max_violation,
        gait.step_duration_s,
        multiplier(gait),
        file.map_or_else(|| "not written: give -o FILE".into(), output::shown)
    )?;
    Ok(())
}

/// The largest multiplier, marked where the gait is not called stable although its map contracts.
fn multiplier(gait: &gait::Gait) -> String {
    let Some(c) = &gait.certificate else { return "not known".into() };
    let contracts_only = c.largest_multiplier < 1.0 && !c.stable;
    format!("{:.3}{}", c.largest_multiplier, if contracts_only { " not stable" } else { "" })
}

impl Arguments {
    /// The steps to and from the gait that are to be planned with it.
    fn transitions(&self, robot: &robot::Robot) -> Result<Vec<Between>> {
        let from = self.from.as_deref().map(|file| Between::from_file(file, robot)).transpose()?;
        let from_rest = self.from_rest.then_some(Between::FromRest);
        Ok(from_rest.into_iter().chain(from).chain(self.to_rest.then_some(Between::ToRest)).collect())
    }

    /// What is left to the planner, where it is to choose.
    fn open(&self) -> Option<Open> {
        let timing = [self.step_duration, self.step_frequency, self.stride_frequency];
        let open = Open { step_duration: timing.iter().all(Option::is_none), half_width: self.half_width.is_none() };
        self.stable.then_some(open)
    }

    fn request(&self, name: &str, robot: &robot::Robot) -> Result<GaitRequest> {
        let mut request = GaitRequest::named(name, robot)?;
        let duration = [
            self.step_duration,
            self.step_frequency.map(gait_design::step_duration_from_step_frequency),
            self.stride_frequency.map(gait_design::step_duration_from_stride_frequency),
        ];
        for (field, value) in [
            (&mut request.step_duration_s, duration.into_iter().flatten().next()),
            (&mut request.clearance_m, self.clearance),
            (&mut request.speed_m_s, self.speed),
            (&mut request.lateral_speed_m_s, self.lateral_speed),
            (&mut request.yaw_rate_rad_s, self.yaw_rate),
            (&mut request.height_m, self.height),
            (&mut request.half_width_m, self.half_width),
            (&mut request.slope_rad, self.slope.map(f64::to_radians)),
            (&mut request.sideways_slope_rad, self.sideways_slope.map(f64::to_radians)),
            (&mut request.torso_pitch_rad, self.torso_pitch.map(f64::to_radians)),
            (&mut request.torso_roll_rad, self.torso_roll.map(f64::to_radians)),
            (&mut request.friction, self.friction),
        ] {
            if let Some(value) = value {
                *field = value;
            }
        }
        if let Some(limit) = self.torque_limit {
            request.torque_limit_nm = [limit; 3];
        }
        Ok(request)
    }
}

/// Shows an iteration of the solver, and prints it where that is asked for.
fn say_iteration(progress: &Progress, i: &nlp::Iteration, verbose: bool) -> Result<(), output::Unwritable> {
    progress.say(format!("iteration {}, violation {:.1e}", i.number, i.max_violation));
    if !verbose {
        return Ok(());
    }
    say!(
        "  iteration {:3}  objective {:.6e}  violation {:.1e}  to gain {:.1e}  step {:.3}{}",
        i.number,
        i.objective,
        i.max_violation,
        i.predicted_decrease,
        i.step_length,
        if i.elastic { "  (constraints relaxed)" } else { "" }
    )
}

/// Plans and states the wall time.
fn timed(robot: &robot::Robot, request: &GaitRequest, arguments: &Arguments, verbose: bool) -> Result<Plan> {
    let start = Instant::now();
    let progress = Progress::begin(&format!("planning {}", request.behaviour));
    let mut unwritable = None;
    let mut report = |i: &nlp::Iteration| {
        unwritable = say_iteration(&progress, i, verbose).err();
        if unwritable.is_none() { ControlFlow::Continue(()) } else { ControlFlow::Break(()) }
    };
    let mut options = PlanOptions { reference: arguments.reference.into(), ..PlanOptions::default() };
    options.program.points = arguments.points;
    let chosen = arguments.open().and_then(|open| gait_design::choose(robot, request, open, &options, &mut report));
    let request = chosen.as_ref().unwrap_or(request);
    let planned = gait_design::plan_or_nearest(robot, request, &options, report, || start.elapsed() < SEARCH_LIMIT);
    if let Some(unwritable) = unwritable {
        return Err(unwritable.into());
    }
    let mut plan = planned.with_context(|| format!("cannot plan {}", request.behaviour))?;
    plan.gait.solver.solve_time_s = start.elapsed().as_secs_f64();
    Ok(plan)
}
