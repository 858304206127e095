//! `tandem plan`: one gait from a request.

use crate::robots::RobotArguments;
use anyhow::{Context, Result, bail};
use gait_design::{Complex, GaitRequest, Plan, PlanOptions, PlanPoint, Reference, StepLaw};
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::{Duration, Instant};

/// Plan a gait by the dynamics decomposition and write the gait file
///
/// BEHAVIOUR is one of the five gaits of Ma & Ames' Table I, or `all`. Its step duration, clearance and speed come from
/// the table (whose frequencies count steps), height and half-width from the robot's description; options replace them.
///
///   tandem plan amble -o amble.json
///   tandem plan amble --speed 0.5 --step-duration 0.35
///   tandem plan gait1 --clearance 0.08 --height 0.52
///   tandem plan all
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
    /// Hip axes above the toe centres, m
    #[arg(long, value_name = "M", allow_negative_numbers = true)]
    height: Option<f64>,
    /// Lateral distance of a stance toe from the mid plane, m
    #[arg(long, value_name = "M", allow_negative_numbers = true)]
    half_width: Option<f64>,
    /// Slope of the ground, degrees; positive is uphill
    #[arg(long, value_name = "DEG", allow_negative_numbers = true)]
    slope: Option<f64>,
    /// Slope of the ground across the walk, degrees; positive rises to the left. Two steps are planned, by the full-order program:
    /// tenths of a second instead of milliseconds
    #[arg(long, value_name = "DEG", allow_negative_numbers = true)]
    sideways_slope: Option<f64>,
    /// Pitch that the torso is held at, degrees; positive lowers its nose. Planned by the full-order program: tenths of a second
    #[arg(long, value_name = "DEG", allow_negative_numbers = true)]
    torso_pitch: Option<f64>,
    /// Roll that the torso is held at, degrees; positive lowers its right side. Two steps: tenths of a second
    #[arg(long, value_name = "DEG", allow_negative_numbers = true)]
    torso_roll: Option<f64>,
    /// Friction coefficient that the plan may use
    #[arg(long, value_name = "MU", allow_negative_numbers = true)]
    friction: Option<f64>,
    /// Torque bound of every joint, N m
    #[arg(long, value_name = "NM", allow_negative_numbers = true)]
    torque_limit: Option<f64>,
    /// What the tracking law follows
    #[arg(long, value_enum, default_value_t = ReferenceArgument::Compensated)]
    reference: ReferenceArgument,
    /// Where to write the gait file; with `all`, a folder
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
    /// Simulate the planned step with the full-order model, look at the plan between the program's points, and say how far they
    /// depart from the plan
    #[arg(long)]
    verify: bool,
    /// With --verify, draw the planned and the simulated step into this folder, NAME_step.png
    #[arg(long, value_name = "FOLDER", requires = "verify")]
    plot: Option<PathBuf>,
    /// Compute the multipliers of the step-to-step map under the tracking law
    #[arg(long)]
    stability: bool,
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
    /// A reference planned inside the full-order program, with the law's torques: tenths of a second instead of milliseconds
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
    let robot = arguments.robot.load()?;
    let Some(behaviour) = &arguments.behaviour else {
        table(arguments, &robot)?;
        return Ok(ExitCode::SUCCESS);
    };
    let all = behaviour == "all";
    let names: Vec<&str> = if all { gait_design::behaviours().collect() } else { vec![behaviour] };
    if all && let Some(folder) = &arguments.output {
        std::fs::create_dir_all(folder).with_context(|| format!("cannot make the folder {}", folder.display()))?;
    }
    let mut followed = true;
    for (index, name) in names.into_iter().enumerate() {
        let request = arguments.request(name, &robot)?;
        let plan = timed(&robot, &request, arguments.reference.into(), arguments.verbose)?;
        let solver = &plan.gait.solver;
        let file = arguments.output.as_ref().map(|o| if all { o.join(format!("{name}.json")) } else { o.clone() });
        if let Some(file) = &file {
            write(file, &plan.gait.to_json())?;
        }
        if index == 0 {
            println!(
                "{:8} {:>10} {:>8} {:>12} {:>12} {:>9}  file",
                "gait", "iterations", "time s", "cost", "violation", "T s"
            );
        }
        println!(
            "{name:8} {:>10} {:>8.3} {:>12.6} {:>12.1e} {:>9.4}  {}",
            solver.iterations,
            solver.solve_time_s,
            solver.objective,
            solver.max_violation,
            plan.gait.step_duration_s,
            file.map_or_else(|| "not written: give -o FILE".into(), |f| f.display().to_string())
        );
        let law = Reference::from(arguments.reference).step_law();
        if arguments.verify && !verify(&robot, &request, &plan, law, arguments.plot.as_deref())? {
            followed = false;
        }
        if arguments.stability {
            let on_slope = gait_design::on_slope(&robot, &request);
            let s = gait_design::stability(&on_slope, &plan.gait, &plan.points, &plan.second_points)
                .with_context(|| format!("cannot linearise {name}"))?;
            let show =
                |m: &[Complex]| m.iter().map(|m| format!("{:+.3}{:+.3}i", m.re, m.im)).collect::<Vec<_>>().join(", ");
            println!(
                "         {} map, rigid touchdown by the clock: largest multiplier {:.3} ({}): {}; x, y{} {}",
                if plan.second_points.is_empty() { "step-to-step" } else { "stride-to-stride" },
                s.spectral_radius(),
                if s.is_stable() { "stable" } else { "not stable by itself: early touchdown has to catch it" },
                show(&s.multipliers[..6]),
                if s.neutral.len() == 3 { ", yaw" } else { "" },
                show(&s.neutral)
            );
        }
    }
    if !followed {
        bail!("the full-order model does not follow every plan: see above");
    }
    Ok(ExitCode::SUCCESS)
}

/// Plans the five gaits and prints Table I of the paper beside what came of them. Each is planned a few times, and the fastest
/// counts: the first finds the processor asleep.
fn table(arguments: &Arguments, robot: &robot::Robot) -> Result<()> {
    const TIMES: usize = 5;
    println!("          Table I of the paper                                  here, {}", robot.name);
    println!("gait      steps/s  clearance m  speed m/s  iterations  time s  iterations  time ms      cost  violation");
    let (mut paper_s, mut ours_s) = (0.0, 0.0);
    for row in gait_design::table_one() {
        let request = arguments.request(row.behaviour, robot)?;
        let mut best: Option<Plan> = None;
        for _ in 0..TIMES {
            let plan = timed(robot, &request, arguments.reference.into(), false)?;
            if best.as_ref().is_none_or(|b| plan.gait.solver.solve_time_s < b.gait.solver.solve_time_s) {
                best = Some(plan);
            }
        }
        let solver = best.expect("planned at least once").gait.solver;
        println!(
            "{:8} {:>8} {:>12} {:>10} {:>11} {:>7} {:>11} {:>8.2} {:>9.6} {:>10.1e}",
            row.behaviour,
            row.frequency_hz,
            row.clearance_m,
            row.speed_m_s,
            row.iterations,
            row.time_s,
            solver.iterations,
            1e3 * solver.solve_time_s,
            solver.objective,
            solver.max_violation
        );
        paper_s += row.time_s / 5.0;
        ours_s += solver.solve_time_s / 5.0;
    }
    println!(
        "mean {:>57.2} {:>20.2}     {:.0} times as fast (the paper on an i7-6820HQ)",
        paper_s,
        1e3 * ours_s,
        paper_s / ours_s
    );
    Ok(())
}

impl Arguments {
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

/// Plans and states the wall time.
fn timed(robot: &robot::Robot, request: &GaitRequest, reference: Reference, verbose: bool) -> Result<Plan> {
    let start = Instant::now();
    let report = |i: &nlp::Iteration| {
        if verbose {
            println!(
                "  iteration {:3}  objective {:.6e}  violation {:.1e}  to gain {:.1e}  step {:.3}{}",
                i.number,
                i.objective,
                i.max_violation,
                i.predicted_decrease,
                i.step_length,
                if i.elastic { "  (constraints relaxed)" } else { "" }
            );
        }
        ControlFlow::Continue(())
    };
    let options = PlanOptions { reference, ..PlanOptions::default() };
    let mut plan = gait_design::plan_or_nearest(robot, request, &options, report, || start.elapsed() < SEARCH_LIMIT)
        .with_context(|| format!("cannot plan {}", request.behaviour))?;
    plan.gait.solver.solve_time_s = start.elapsed().as_secs_f64();
    Ok(plan)
}

/// Simulates each planned step with the full-order model, prints how it compares, and says whether it follows the plan.
fn verify(robot: &robot::Robot, request: &GaitRequest, plan: &Plan, law: StepLaw, plot: Option<&Path>) -> Result<bool> {
    let robot = gait_design::on_slope(robot, request);
    let mut good = true;
    for (points, which) in [(&plan.points, ""), (&plan.second_points, "_second")] {
        if !points.is_empty() {
            let file = plot.map(|folder| folder.join(format!("{}{which}_step.png", plan.gait.name)));
            good &= verify_step(&robot, request, &plan.gait, points, law, file.as_deref())?;
        }
    }
    Ok(good)
}

fn verify_step(
    robot: &robot::Robot,
    request: &GaitRequest,
    gait: &gait::Gait,
    points: &[PlanPoint],
    law: StepLaw,
    plot: Option<&Path>,
) -> Result<bool> {
    let c = gait_design::simulate_planned_step(robot, gait, points, law)
        .with_context(|| format!("cannot simulate {}", gait.name))?;
    let follows = c.follows_plan();
    println!(
        "         full-order step {}: joints within {:.1e} rad, body {:.1e} m and {:.1e} rad, normal forces {:.3} %, toes land at {:+.1e} and {:+.1e} m",
        if follows { "follows the plan" } else { "DOES NOT FOLLOW the plan" },
        c.joint_error_rad,
        c.body_position_error_m,
        c.body_orientation_error_rad,
        100.0 * c.normal_force_error,
        c.landing_height_m[0],
        c.landing_height_m[1]
    );
    if let Some(file) = plot {
        draw_step(gait, points, &c, file)?;
    }
    let b = gait_design::between_points(robot, request, gait, points);
    println!(
        "         between the points {}: stance toes slip {:.1e} m, swing toes {:.1e} m below the floor, joints {:.1e} rad from their polynomials, base out of balance by {:.2} N or N m; beyond limits: joints {:.1e} rad, {:.1e} rad/s, torque {:.2} N m, ground forces {:.2} N",
        if b.is_kept() { "the plan is kept" } else { "the plan is NOT KEPT" },
        b.stance_slip_m,
        b.swing_below_floor_m,
        b.polynomial_rad,
        b.imbalance,
        b.joint_range_rad,
        b.joint_velocity_rad_s,
        b.torque_nm,
        b.ground_force_n
    );
    Ok(follows && b.is_kept())
}

/// Draws a planned step beside its simulation.
fn draw_step(
    gait: &gait::Gait,
    points: &[PlanPoint],
    comparison: &gait_design::StepComparison,
    file: &Path,
) -> Result<()> {
    let legs = comparison.stance_legs;
    let planned: Vec<report::StepPoint> = points
        .iter()
        .map(|p| report::StepPoint {
            time_s: p.phase * gait.step_duration_s,
            joint_position_rad: std::array::from_fn(|j| p.q[6 + j]),
            normal_force_n: legs.map(|leg| p.ground_force_n[leg][2]),
        })
        .collect();
    let simulated: Vec<report::StepPoint> = comparison
        .simulated
        .iter()
        .map(|p| report::StepPoint {
            time_s: p.time_s,
            joint_position_rad: p.joint_position_rad,
            normal_force_n: p.normal_force_n,
        })
        .collect();
    let step = report::PlannedStep { name: &gait.name, stance_legs: legs, planned: &planned, simulated: &simulated };
    let png = report::planned_step(&step)?.to_png()?;
    if let Some(folder) = file.parent() {
        std::fs::create_dir_all(folder).with_context(|| format!("cannot make the folder {}", folder.display()))?;
    }
    std::fs::write(file, png).with_context(|| format!("cannot write {}", file.display()))?;
    println!("         drawn: {}", file.display());
    Ok(())
}

/// Writes the whole file or none of it.
pub fn write(file: &Path, text: &str) -> Result<()> {
    let mut partial = file.as_os_str().to_owned();
    partial.push(".partial");
    let partial = PathBuf::from(partial);
    if let Err(e) = std::fs::write(&partial, text).and_then(|()| std::fs::rename(&partial, file)) {
        bail!("cannot write {}: {e}", file.display());
    }
    Ok(())
}
