//! Where a program's files are: robots, requests, gaits, wiring.

use std::path::{Path, PathBuf};

/// Where an installation has the files that belong to all nodes, below the installation's folder.
const SHARED: &str = "share/tandem";

/// A file or folder is not there.
#[derive(Debug, thiserror::Error)]
#[error("{} is neither in the working folder nor above {}: give its whole path", given.display(), program.display())]
pub struct NotFound {
    given: PathBuf,
    program: PathBuf,
}

/// The robot's folder where none is given.
pub const DEFAULT_FOLDER: &str = "config/robots/vision60";

/// What a parameter that takes a robot's folder says of itself.
pub const FOLDER_TEXT: &str =
    "Folder of the robot's description; looked for from the working folder, then above the program.";

/// A folder or file given relative to the working folder or, where it is not there, to a folder above the program or to
/// `share/tandem` in one: a clone's program finds the clone's `config` from anywhere, an installed one the installed
/// `config`.
///
/// # Errors
/// It is nowhere; the places are named.
pub fn find(given: &Path) -> Result<PathBuf, NotFound> {
    if given.exists() {
        return Ok(given.into());
    }
    // Without its own path a program looks only in the working folder.
    let program = std::env::current_exe().unwrap_or_default();
    program
        .ancestors()
        .skip(1)
        .flat_map(|above| [above.join(given), above.join(SHARED).join(given)])
        .find(|path| given.is_relative() && path.exists())
        .ok_or_else(|| NotFound { given: given.into(), program })
}
