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
            eprintln!("tandem: robot \"{}\": {note}", self.robot);
        }
        Ok(robot)
    }
}

/// A path as it is; a bare name in the configuration folder: `TANDEM_CONFIG`, or `config` here or above the program.
pub fn folder(robot: &str) -> PathBuf {
    if robot.contains('/') || Path::new(robot).join("robot.toml").exists() {
        return robot.into();
    }
    let chosen = std::env::var_os("TANDEM_CONFIG").map(|config| Path::new(&config).join("robots").join(robot));
    let usual = Path::new("config/robots").join(robot);
    // Where none exists, opening the usual one gives the error that a person expects.
    chosen.filter(|folder| folder.join("robot.toml").exists()).or_else(|| ros::find(&usual).ok()).unwrap_or(usual)
}
