//! ROS 2 node: MuJoCo behind DDS topics; the simulator itself as a library, and what is measured of a walk.

pub mod bridge;
pub mod config;
pub mod drives;
pub mod inbox;
pub mod measure;
pub mod pictures;
pub mod ports;
pub mod simulator;
pub mod walk;

use std::path::{Path, PathBuf};

/// A folder or file given relative to the working folder or, where it is not there, to a folder above the program: the
/// program of a clone finds the clone's own `config` from anywhere.
///
/// # Errors
/// Neither is there; both are named.
pub fn find(given: &Path) -> Result<PathBuf, NotFound> {
    if given.exists() {
        return Ok(given.into());
    }
    let program = std::env::current_exe().unwrap_or_default();
    program
        .ancestors()
        .skip(1)
        .map(|above| above.join(given))
        .find(|path| given.is_relative() && path.exists())
        .ok_or_else(|| NotFound { given: given.into(), program })
}

/// A file or folder is not there.
#[derive(Debug, thiserror::Error)]
#[error("{} is neither in the working folder nor above {}: give its whole path", given.display(), program.display())]
pub struct NotFound {
    given: PathBuf,
    program: PathBuf,
}
