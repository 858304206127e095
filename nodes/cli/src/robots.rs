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
        Robot::load(&folder).with_context(|| format!("robot \"{}\"", self.robot))
    }
}

/// A path as it is; a bare name in the configuration folder: `TANDEM_CONFIG`, or `config` here, or where this was built.
fn folder(robot: &str) -> PathBuf {
    if robot.contains('/') || Path::new(robot).join("robot.toml").exists() {
        return robot.into();
    }
    let built_from = concat!(env!("CARGO_MANIFEST_DIR"), "/../../config");
    let candidates = [std::env::var("TANDEM_CONFIG").unwrap_or_default(), "config".into(), built_from.into()];
    let folders = candidates.iter().filter(|c| !c.is_empty()).map(|c| Path::new(c).join("robots").join(robot));
    // Where none exists, opening the one in `config` gives the error that a person expects.
    folders.clone().find(|f| f.join("robot.toml").exists()).unwrap_or_else(|| Path::new("config/robots").join(robot))
}
