//! `tandem plan`: one gait from a request.

use crate::robots::RobotArguments;
use anyhow::{Context, Result, bail};
use gait_design::{GaitRequest, Plan, PlanOptions};
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Instant;

/// Plan a gait by the dynamics decomposition and write the gait file
///
/// BEHAVIOUR is one of the five gaits of Ma & Ames' Table I, or `all`. Its step duration, clearance and speed come from
/// the table (whose frequencies count steps), height and half-width from the robot's description; options replace them.
///
///   tandem plan amble -o amble.json
///   tandem plan amble --speed 0.5 --step-duration 0.35
///   tandem plan gait1 --clearance 0.08 --height 0.52
///   tandem plan all
#[derive(clap::Args)]
#[command(verbatim_doc_comment)]
pub struct Arguments {
    /// gait1, gait2, gait3, gait4, amble, or all
    behaviour: String,
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
    /// Friction coefficient that the plan may use
    #[arg(long, value_name = "MU", allow_negative_numbers = true)]
    friction: Option<f64>,
    /// Torque bound of every joint, N m
    #[arg(long, value_name = "NM", allow_negative_numbers = true)]
    torque_limit: Option<f64>,
    /// Where to write the gait file; with `all`, a folder
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
    /// Simulate the planned step with the full-order model and say how far it departs from the plan
    #[arg(long)]
    verify: bool,
    /// Print every iteration of the solver
    #[arg(short, long)]
    verbose: bool,
    #[command(flatten)]
    robot: RobotArguments,
}

/// Runs the subcommand.
pub fn run(arguments: &Arguments) -> Result<ExitCode> {
    let robot = arguments.robot.load()?;
    let all = arguments.behaviour == "all";
    let names: Vec<&str> = if all { gait_design::behaviours().collect() } else { vec![&arguments.behaviour] };
    if all && let Some(folder) = &arguments.output {
        std::fs::create_dir_all(folder).with_context(|| format!("cannot make the folder {}", folder.display()))?;
    }
    let mut followed = true;
    for (index, name) in names.into_iter().enumerate() {
        let request = arguments.request(name, &robot)?;
        let plan = timed(&robot, &request, arguments.verbose)?;
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
        if arguments.verify && !verify(&robot, &request, &plan)? {
            followed = false;
        }
    }
    if !followed {
        bail!("the full-order model does not follow every plan: see above");
    }
    Ok(ExitCode::SUCCESS)
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
fn timed(robot: &robot::Robot, request: &GaitRequest, verbose: bool) -> Result<Plan> {
    let start = Instant::now();
    let mut plan = gait_design::plan(robot, request, &PlanOptions::default(), |i| {
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
    })
    .with_context(|| format!("cannot plan {}", request.behaviour))?;
    plan.gait.solver.solve_time_s = start.elapsed().as_secs_f64();
    Ok(plan)
}

/// Simulates the planned step with the full-order model, prints how it compares, and says whether it follows the plan.
fn verify(robot: &robot::Robot, request: &GaitRequest, plan: &Plan) -> Result<bool> {
    let robot = gait_design::on_slope(robot, request.slope_rad);
    let c = gait_design::simulate_planned_step(&robot, &plan.gait, &plan.points)
        .with_context(|| format!("cannot simulate {}", plan.gait.name))?;
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
    Ok(follows)
}

/// Writes the whole file or none of it.
fn write(file: &Path, text: &str) -> Result<()> {
    let mut partial = file.as_os_str().to_owned();
    partial.push(".partial");
    let partial = PathBuf::from(partial);
    if let Err(e) = std::fs::write(&partial, text).and_then(|()| std::fs::rename(&partial, file)) {
        bail!("cannot write {}: {e}", file.display());
    }
    Ok(())
}
