//! Where the robots' folders are.

use anyhow::{Context, Result, ensure};
use robot::Robot;
use std::path::{Path, PathBuf};

/// Which robot, for the subcommands that need one.
#[derive(clap::Args)]
pub struct RobotArguments {
    /// Robot: the name of a folder in config/robots, or the path of one
    #[arg(long, default_value = "vision60", value_name = "NAME|FOLDER")]
    pub robot: String,
}

impl RobotArguments {
    /// Opens the robot's folder.
    pub fn load(&self) -> Result<Robot> {
        let robot = load(&self.robot)?;
        for note in &robot.notes {
            note!("tandem: robot \"{}\": {note}", self.robot);
        }
        Ok(robot)
    }
}

/// The sources that this program was built from: what `cargo install` leaves behind finds robots, requests and gaits
/// there.
const SOURCES: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../..");

/// Opens a robot's folder.
pub fn load(robot: &str) -> Result<Robot> {
    let folder = folder(robot);
    ensure!(
        folder.exists(),
        "robot \"{robot}\": {} is neither here, nor above the program, nor in the sources that it was built from: give the \
         path of the robot's folder, or name the folder that has `robots` in it by TANDEM_CONFIG",
        folder.display()
    );
    Robot::load(&folder).with_context(|| format!("robot \"{robot}\""))
}

/// A file that is read: as it is given or, where it is not there, below `TANDEM_CONFIG`'s folder (for what begins with
/// `config/`), a folder above the program, or the sources that it was built from. The same for every option that names
/// one.
pub fn file(given: &Path) -> PathBuf {
    if given.exists() || given.is_absolute() {
        return given.into();
    }
    let config = std::env::var_os("TANDEM_CONFIG");
    let chosen = config.zip(given.strip_prefix("config").ok()).map(|(config, rest)| Path::new(&config).join(rest));
    // Where none exists, opening the given one gives the error that a person expects.
    let in_sources = || Some(Path::new(SOURCES).join(given)).filter(|file| file.exists());
    let found = chosen.filter(|file| file.exists()).or_else(|| robot::find(given).ok()).or_else(in_sources);
    found.unwrap_or_else(|| given.into())
}

/// A path, searched as every file; a bare name in the configuration folder: `TANDEM_CONFIG`, or `config` here or above
/// the program.
pub fn folder(robot: &str) -> PathBuf {
    if robot.contains('/') || Path::new(robot).join("robot.toml").exists() {
        return file(Path::new(robot));
    }
    let chosen = std::env::var_os("TANDEM_CONFIG").map(|config| Path::new(&config).join("robots").join(robot));
    let chosen = chosen.filter(|folder| folder.join("robot.toml").exists());
    chosen.unwrap_or_else(|| file(&Path::new("config/robots").join(robot)))
}
