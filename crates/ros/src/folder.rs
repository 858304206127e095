//! Where a node's files are.

use std::path::{Path, PathBuf};

use crate::RosError;

/// A folder given relative to the working folder or, where it is not there, to a folder above the program: the program of a
/// clone finds the clone's own `config` from anywhere.
///
/// # Errors
/// Neither is there; both are named.
pub fn find_folder(given: &Path) -> Result<PathBuf, RosError> {
    if given.is_dir() {
        return Ok(given.into());
    }
    // Without its own path a program looks only in the working folder.
    let program = std::env::current_exe().unwrap_or_default();
    program
        .ancestors()
        .skip(1)
        .map(|above| above.join(given))
        .find(|folder| given.is_relative() && folder.is_dir())
        .ok_or_else(|| RosError::Name {
            name: given.display().to_string(),
            reason: format!("no such folder, neither from here nor above {}: give its whole path", program.display()),
        })
}
