//! What the tests of the program's shell side share.
#![allow(dead_code)]

use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};

/// The domain of commands that are nodes.
pub const DOMAIN: &str = "92";

/// A folder with what commands are tried on: amble.json, uphill.json, a library, a bag, a robot's URDF.
pub struct Place(tempfile::TempDir);

impl Place {
    /// Makes everything by the program itself.
    pub fn new() -> Place {
        let place = Place(tempfile::tempdir().unwrap());
        for line in [
            "tandem plan amble -o amble.json",
            "tandem library solve amble --axis speed_m_s=0.3:0.35:2 -o vision60.gaits",
            "tandem simulate amble.json --seconds 4 --bag out/run",
        ] {
            place.succeeds(line);
        }
        let urdf = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config/robots/vision60/vision60.urdf");
        std::fs::copy(urdf, place.path().join("my_robot.urdf")).unwrap();
        place
    }

    /// The folder.
    pub fn path(&self) -> &Path {
        self.0.path()
    }

    /// A command line as a shell reads it, in this folder, in which `tandem` is the program under test.
    pub fn shell(&self, line: &str) -> Command {
        let program = Path::new(env!("CARGO_BIN_EXE_tandem"));
        let mut paths = vec![program.parent().unwrap().to_owned()];
        paths.extend(std::env::split_paths(&std::env::var_os("PATH").unwrap_or_default()));
        let mut command = Command::new("sh");
        command
            .args(["-c", line])
            .current_dir(self.path())
            .env("PATH", std::env::join_paths(paths).unwrap())
            .env("ROS_DOMAIN_ID", DOMAIN)
            .env("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
            .stdin(Stdio::null());
        command
    }

    /// Runs it; nothing may panic.
    pub fn run(&self, line: &str) -> Output {
        let output = self.shell(line).output().unwrap();
        let errors = String::from_utf8_lossy(&output.stderr);
        assert!(!errors.contains("panicked"), "{line}: {errors}");
        output
    }

    /// Runs it to success; gives its standard output.
    pub fn succeeds(&self, line: &str) -> String {
        let output = self.run(line);
        assert!(output.status.success(), "{line}: {}\n{}", output.status, String::from_utf8_lossy(&output.stderr));
        String::from_utf8(output.stdout).unwrap()
    }

    /// Every command with its subcommands, as their help lists them.
    pub fn commands(&self) -> Vec<String> {
        let (mut found, mut waiting) = (Vec::new(), vec!["tandem".to_owned()]);
        while let Some(command) = waiting.pop() {
            let help = self.succeeds(&format!("{command} --help"));
            let list = help.split("\nCommands:\n").nth(1).map(|list| list.split("\n\n").next().unwrap());
            let names =
                list.into_iter().flat_map(str::lines).filter(|line| line.starts_with("  ") && !line.starts_with("   "));
            let inner: Vec<&str> = names.filter_map(|line| line.split_whitespace().next()).collect();
            waiting.extend(inner.iter().filter(|name| **name != "help").map(|name| format!("{command} {name}")));
            if inner.is_empty() {
                found.push(command);
            }
        }
        found.sort();
        found
    }
}

/// The one file that a pattern of a name's end finds in a folder.
pub fn one_file(folder: &Path, end: &str) -> PathBuf {
    let entries = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    let mut found: Vec<PathBuf> = entries.filter(|path| path.to_string_lossy().ends_with(end)).collect();
    assert_eq!(found.len(), 1, "{found:?}");
    found.remove(0)
}
