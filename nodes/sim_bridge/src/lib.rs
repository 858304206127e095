//! ROS 2 node: MuJoCo behind DDS topics; the simulator itself as a library, and what is measured of a walk.

pub mod bridge;
pub mod config;
pub mod inbox;
pub mod measure;
pub mod pictures;
pub mod ports;
pub mod simulator;
pub mod walk;

use std::path::{Path, PathBuf};

/// A folder given relative to the working folder or, where it is not there, to a folder above the program: the program of
/// a clone finds the clone's own `config` from anywhere.
///
/// # Errors
/// Neither is there; both are named.
pub fn find_folder(given: &Path) -> Result<PathBuf, FolderError> {
    if given.is_dir() {
        return Ok(given.into());
    }
    let program = std::env::current_exe().unwrap_or_default();
    program
        .ancestors()
        .skip(1)
        .map(|above| above.join(given))
        .find(|folder| given.is_relative() && folder.is_dir())
        .ok_or_else(|| FolderError { given: given.into(), program })
}

/// A folder is not there.
#[derive(Debug, thiserror::Error)]
#[error("folder {} is neither in the working folder nor above {}: give its whole path", given.display(), program.display())]
pub struct FolderError {
    given: PathBuf,
    program: PathBuf,
}
