//! Where recordings may lie: below one folder, under a name. A request from the network chooses the name and nothing
//! else.

use std::path::{Path, PathBuf};
use tandem_msgs::text::printable;

/// Longest name of a recording, in characters.
pub const MAX_NAME_CHARS: usize = 64;

/// The root where the parameter names none: the launching user's folder for data.
pub fn default_root() -> Option<PathBuf> {
    let of = |variable| std::env::var_os(variable).map(PathBuf::from).filter(|folder| folder.is_absolute());
    let data = of("XDG_DATA_HOME").or_else(|| of("HOME").map(|home| home.join(".local/share")))?;
    Some(data.join("tandem/recordings"))
}

/// The folder of a recording. The root is made where it is not there; the folder is not.
///
/// # Errors
/// A sentence for people: no root, a name that is none, a link in the folder's place, a root that cannot be made.
pub fn folder(root: Option<&Path>, name: &str) -> Result<PathBuf, String> {
    let root = root.ok_or("there is no folder for recordings: set record_root")?;
    let allowed = |c: char| c.is_ascii_alphanumeric() || matches!(c, '_' | '-' | '.');
    if name.is_empty() || name.len() > MAX_NAME_CHARS || name.starts_with('.') || !name.chars().all(allowed) {
        return Err(format!(
            "the recording's name is \"{}\", expected 1 to {MAX_NAME_CHARS} of the characters A-Z a-z 0-9 _ - . and no dot \
             first; it lies below {} (record_root)",
            printable(name, MAX_NAME_CHARS),
            root.display()
        ));
    }
    std::fs::create_dir_all(root).map_err(|error| format!("cannot create {}: {error}", root.display()))?;
    let folder = root.join(name);
    // A link would lead out of the root.
    if folder.symlink_metadata().is_ok_and(|found| found.is_symlink()) {
        return Err(format!("{} is a link; a recording needs a folder of its own", folder.display()));
    }
    Ok(folder)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_recording_leads_nowhere_out_of_its_root() {
        let there = tempfile::tempdir().unwrap();
        let root = there.path().join("root");
        let long = "x".repeat(MAX_NAME_CHARS + 1);
        for name in [
            "",
            ".",
            "..",
            ".hidden",
            "/etc/cron.d",
            "../out",
            "a/b",
            "a\\b",
            "a\nb",
            "a\0b",
            "a b",
            "ä",
            "~",
            "$HOME",
            &long,
        ] {
            let error = folder(Some(&root), name).unwrap_err();
            assert!(error.contains("record_root") && !error.contains(['\n', '\0']), "{name:?}: {error}");
        }
        assert!(!root.exists(), "a refused name makes nothing");
        assert!(folder(None, "monday").unwrap_err().contains("set record_root"));
        for name in ["monday", "2026-11-22T06_10_00", "a..b", &"x".repeat(MAX_NAME_CHARS)] {
            assert_eq!(folder(Some(&root), name).unwrap(), root.join(name));
        }
        for (name, target) in [("out", there.path().to_path_buf()), ("dangling", there.path().join("none"))] {
            std::os::unix::fs::symlink(target, root.join(name)).unwrap();
            assert!(folder(Some(&root), name).unwrap_err().contains("is a link"));
        }
    }
}
