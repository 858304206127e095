//! The controller's recording of a walk: its name, and how it comes to the walk's other files.

use anyhow::{Context as _, Result};
use std::path::Path;
use std::time::{SystemTime, UNIX_EPOCH};

/// A name that no recording has had: they all lie below the controller's `record_root`.
pub(super) fn name(gait: &str) -> Result<String> {
    let since_epoch = SystemTime::now().duration_since(UNIX_EPOCH).context("the machine's clock is before 1970")?;
    Ok(format!("walk-{gait}-{}", since_epoch.as_millis()))
}

/// Takes a bag from where the controller recorded it.
pub(super) fn fetch(from: &Path, to: &Path) -> Result<()> {
    match std::fs::rename(from, to) {
        Ok(()) => return Ok(()),
        Err(error) if error.kind() == std::io::ErrorKind::CrossesDevices => {}
        Err(error) => return Err(error).with_context(|| format!("cannot move it to {}", to.display())),
    }
    let copied = || -> std::io::Result<()> {
        std::fs::create_dir(to)?;
        for file in std::fs::read_dir(from)? {
            let file = file?;
            std::fs::copy(file.path(), to.join(file.file_name()))?;
        }
        std::fs::remove_dir_all(from)
    };
    copied().with_context(|| format!("cannot copy it to {}", to.display()))
}
