//! Where the robots' folders are.

use anyhow::{Context, Result};
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
        let folder = folder(&self.robot);
        let robot = Robot::load(&folder).with_context(|| format!("robot \"{}\"", self.robot))?;
        for note in &robot.notes {
            note!("tandem: robot \"{}\": {note}", self.robot);
        }
        Ok(robot)
    }
}

/// A file that is read: as it is given or, where it is not there, below `TANDEM_CONFIG`'s folder (for what begins with
/// `config/`) or a folder above the program. The same for every option that names one.
pub fn file(given: &Path) -> PathBuf {
    if given.exists() || given.is_absolute() {
        return given.into();
    }
    let config = std::env::var_os("TANDEM_CONFIG");
    let chosen = config.zip(given.strip_prefix("config").ok()).map(|(config, rest)| Path::new(&config).join(rest));
    // Where none exists, opening the given one gives the error that a person expects.
    chosen.filter(|file| file.exists()).or_else(|| robot::find(given).ok()).unwrap_or_else(|| given.into())
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
