//! `tandem robot`: a robot's folder from its URDF, and a look at one.

use crate::output;
use crate::robots;
use ::robot::Robot;
use anyhow::{Context, Result, bail};
use simulator::{Camera, Renderer, Simulator, SimulatorOptions};
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Size of the picture of the standing robot, pixels.
const PICTURE: (usize, usize) = (960, 640);

/// Make a robot's folder from its URDF, or check one
///
///   tandem robot init my_robot.urdf -o config/robots/my_robot
///   tandem robot check config/robots/my_robot
#[derive(clap::Args)]
#[command(verbatim_doc_comment)]
pub struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(clap::Subcommand)]
enum Command {
    /// Write a folder with robot.toml, the URDF and a picture of the standing robot, and say what must be looked at
    Init {
        /// URDF of a robot with four legs of three joints; xacro must be expanded
        file: PathBuf,
        /// Folder to write; without it, one of the robot's name here
        #[arg(short, long, value_name = "FOLDER", value_parser = output::folder)]
        output: Option<PathBuf>,
        /// The robot's name; without it, the URDF's
        #[arg(long, value_name = "NAME")]
        name: Option<String>,
        /// Replace a robot.toml that is there
        #[arg(long)]
        force: bool,
    },
    /// Load a robot as plans and simulation do, and print what they read
    Check {
        /// Name of a folder in config/robots, or the path of one
        #[arg(default_value = "vision60", value_name = "NAME|FOLDER")]
        robot: String,
        /// Draw the standing robot (PNG); `-` is standard output
        #[arg(long, value_name = "FILE")]
        picture: Option<PathBuf>,
        /// Print one JSON object
        #[arg(long)]
        json: bool,
    },
}

/// Runs the subcommand.
pub fn run(arguments: &Arguments) -> Result<ExitCode> {
    match &arguments.command {
        Command::Init { file, output, name, force } => init(file, output.as_deref(), name.as_deref(), *force)?,
        Command::Check { robot, picture, json } => check(robot, picture.as_deref(), *json)?,
    }
    Ok(ExitCode::SUCCESS)
}

fn check(name: &str, picture: Option<&Path>, as_json: bool) -> Result<()> {
    output::reserve(picture);
    let robot = robots::load(name)?;
    let mut simulator = simulator(&robot)?;
    if as_json {
        output::json(&facts(&robot, &simulator, picture))?;
    } else {
        output::part(format_args!("{}", summary(&robot, &simulator)))?;
    }
    if let Some(file) = picture {
        draw(&mut simulator, file)?;
        if !as_json {
            say!("  wrote {}", output::shown(file))?;
        }
    }
    Ok(())
}

fn facts(robot: &Robot, simulator: &Simulator, picture: Option<&Path>) -> serde_json::Value {
    let legs = robot.legs.iter().map(|leg| {
        serde_json::json!({
            "name": leg.name, "joints": leg.joints, "toe": robot.model.frame_name(leg.toe), "stand_rad": leg.stand_rad,
        })
    });
    let limits = &robot.limits;
    serde_json::json!({
        "robot": robot.name, "mass_kg": robot.model.total_mass(), "height_m": robot.nominal.height_m,
        "half_width_m": robot.nominal.half_width_m, "legs": legs.collect::<Vec<_>>(),
        "drive_torque_nm": limits.drive_torque_nm, "plan_torque_nm": limits.plan_torque_nm,
        "velocity_rad_s": limits.velocity_rad_s,
        "notes": robot.notes.iter().chain(simulator.notes()).collect::<Vec<_>>(), "picture": picture,
    })
}

fn init(file: &Path, output: Option<&Path>, name: Option<&str>, force: bool) -> Result<()> {
    let (urdf, converted) = Robot::read_text(file)?;
    let name = match name {
        Some(name) => name.to_owned(),
        None => name_of(&urdf).with_context(|| file.display().to_string())?,
    };
    let folder = output.map_or_else(|| PathBuf::from(&name), Path::to_owned);
    let meshes = meshes_folder(file, &folder, &urdf)?;
    let proposal = ::robot::propose(&name, &format!("{name}.urdf"), meshes.as_deref(), &urdf)
        .with_context(|| file.display().to_string())?;
    let toml = folder.join("robot.toml");
    if toml.exists() && !force {
        bail!("{} exists: give --force to replace it, or another folder with -o", toml.display());
    }
    std::fs::create_dir_all(&folder).with_context(|| format!("cannot make the folder {}", folder.display()))?;
    output::write_file(&folder.join(format!("{name}.urdf")), urdf.as_bytes())?;
    output::write_file(&toml, proposal.toml.as_bytes())?;
    let robot = Robot::load(&folder)?;
    let mut simulator = simulator(&robot)?;
    output::part(format_args!("{}", summary(&robot, &simulator)))?;
    say!("  wrote {}", folder.display())?;
    let picture = folder.join("standing.png");
    match draw(&mut simulator, &picture) {
        Ok(()) => say!("  wrote {}", picture.display())?,
        Err(problem) => say!("  {problem}")?,
    }
    say!("Look at:")?;
    for line in converted.iter().chain(&proposal.look_at) {
        say!("  {line}")?;
    }
    Ok(())
}

/// The URDF's own folder, where its meshes are looked for from, unless it has none or stays there.
fn meshes_folder(file: &Path, folder: &Path, urdf: &str) -> Result<Option<String>> {
    let own = file.canonicalize().with_context(|| file.display().to_string())?;
    let own = own.parent().context("a file is in a folder")?;
    if !urdf.contains("<mesh") || folder.canonicalize().is_ok_and(|folder| folder == own) {
        return Ok(None);
    }
    Ok(Some(own.to_str().with_context(|| format!("{}: the path is not UTF-8", own.display()))?.to_owned()))
}

/// The URDF's own name as a word.
fn name_of(urdf: &str) -> Result<String> {
    let description = rigid_body::Description::read(urdf)?;
    let name = &description.robot().name;
    let word: String =
        name.chars().map(|c| if c.is_ascii_alphanumeric() { c.to_ascii_lowercase() } else { '_' }).collect();
    Ok(if word.is_empty() { "robot".to_owned() } else { word })
}

fn simulator(robot: &Robot) -> Result<Simulator> {
    Ok(Simulator::new(robot, SimulatorOptions::default())?)
}

fn draw(simulator: &mut Simulator, file: &Path) -> Result<()> {
    let (width, height) = PICTURE;
    let mut renderer = Renderer::new(simulator, width, height)?;
    let picture = renderer.draw(simulator, Camera::ThreeQuarter)?.to_png()?;
    output::write_file(file, &picture)
}

fn summary(robot: &Robot, simulator: &Simulator) -> String {
    let mut text = format!(
        "{}: {:.2} kg, stands {:.3} m above its toes, {:.3} m from toe to middle plane\n",
        robot.name,
        robot.model.total_mass(),
        robot.nominal.height_m,
        robot.nominal.half_width_m
    );
    for leg in &robot.legs {
        let toe = robot.model.frame_name(leg.toe);
        let _ = writeln!(text, "  {:12} {} -> toe {toe}", leg.name, leg.joints.join(", "));
        let _ = writeln!(text, "               stands at {:?} rad", leg.stand_rad);
    }
    let limits = &robot.limits;
    let _ = writeln!(
        text,
        "  hip roll, hip pitch, knee: drives {:?} N m, plans {:?} N m, {:?} rad/s",
        limits.drive_torque_nm, limits.plan_torque_nm, limits.velocity_rad_s
    );
    for note in robot.notes.iter().chain(simulator.notes()) {
        let _ = writeln!(text, "  {note}");
    }
    text
}
