//! The log's copy in a file, where ROS 2 keeps them: `ROS_LOG_DIR`, else `ROS_HOME/log`, else `~/.ros/log`; a file a
//! process, named `PROGRAM_PID_MILLISECONDS.log`, with lines as ROS 2's:
//! `[INFO] [1764428400.123456789] [left.controller]: ready`.

use std::fs::{File, OpenOptions};
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::time::{SystemTime, UNIX_EPOCH};

use tracing::{Event, Level, Subscriber};
use tracing_subscriber::Layer;
use tracing_subscriber::layer::Context;

use crate::RosError;
use crate::log_text::Text;

/// Lines that wait for the disk. What comes when so many wait is on standard error only: logging never waits.
const WAITING_LINES: usize = 1024;
/// Where a file ends: a month's log of a robot that complains once a second.
const MOST_BYTES: u64 = 256 << 20;

/// What the command line reports of it. What writes the file is an external library in ROS 2.
#[derive(Clone, Debug)]
pub(crate) struct LogFileChoice {
    pub(crate) wanted: bool,
    /// What the file's name begins with, instead of the program's.
    prefix: Option<String>,
}

impl Default for LogFileChoice {
    fn default() -> Self {
        Self { wanted: true, prefix: None }
    }
}

impl LogFileChoice {
    /// Takes a name's beginning; no path, because the folder is the environment's to say.
    pub(crate) fn rename(&mut self, prefix: String) -> Result<(), RosError> {
        if prefix.contains('/') {
            let reason =
                format!("\"{prefix}\" is a path: expected a file name's beginning; ROS_LOG_DIR says the folder");
            return Err(RosError::Argument { argument: "--log-file-name".to_string(), reason });
        }
        self.prefix = Some(prefix);
        Ok(())
    }
}

/// The folder, by the environment; none without a home.
fn folder(environment: impl Fn(&str) -> Option<String>) -> Option<PathBuf> {
    let set = |variable: &str| environment(variable).filter(|value| !value.is_empty());
    let home = set("HOME").map(PathBuf::from);
    let expanded = |text: String| match (text.strip_prefix('~'), &home) {
        (Some(rest), Some(home)) => home.join(rest.trim_start_matches('/')),
        _ => PathBuf::from(text),
    };
    set("ROS_LOG_DIR")
        .map(expanded)
        .or_else(|| Some(set("ROS_HOME").map(expanded)?.join("log")))
        .or_else(|| Some(home.as_ref()?.join(".ros/log")))
}

/// The file of a process that began at `now`.
fn name(prefix: Option<&str>, program: &Path, process: u32, now: SystemTime) -> String {
    let stem = program.file_name().map_or_else(|| "tandem".into(), |name| name.to_string_lossy());
    let prefix = prefix.filter(|text| !text.is_empty()).unwrap_or(&stem);
    let milliseconds = now.duration_since(UNIX_EPOCH).unwrap_or_default().as_millis();
    format!("{prefix}_{process}_{milliseconds}.log")
}

/// Opens this process's file and starts the thread that writes it.
///
/// # Errors
/// The folder that cannot be made, or the file that cannot be written, and why.
pub(crate) fn start(choice: &LogFileChoice, logger: &str) -> Result<LogFile, String> {
    let folder = folder(|variable| std::env::var(variable).ok())
        .ok_or_else(|| "none of ROS_LOG_DIR, ROS_HOME and HOME is set".to_string())?;
    let program = std::env::current_exe().unwrap_or_default();
    let path = folder.join(name(choice.prefix.as_deref(), &program, std::process::id(), SystemTime::now()));
    let failed = |error: io::Error| format!("{}: {error}", path.display());
    std::fs::create_dir_all(&folder).map_err(failed)?;
    let file = OpenOptions::new().append(true).create(true).open(&path).map_err(failed)?;
    let (lines, waiting) = sync_channel(WAITING_LINES);
    std::thread::Builder::new().name("log".into()).spawn(move || write(file, &waiting)).map_err(failed)?;
    Ok(LogFile { lines, logger: logger.to_string(), path })
}

/// Line by line, so that a process that is killed has left what it logged. A full disk ends the file, not the node.
fn write(mut file: File, lines: &Receiver<String>) {
    let mut room = MOST_BYTES;
    while let Ok(line) = lines.recv() {
        room = room.saturating_sub(line.len() as u64);
        if room == 0 || file.write_all(line.as_bytes()).is_err() {
            return;
        }
    }
}

/// The layer of the log that a file is written from.
pub(crate) struct LogFile {
    lines: SyncSender<String>,
    logger: String,
    path: PathBuf,
}

impl LogFile {
    /// Where it is.
    pub(crate) fn path(&self) -> &Path {
        &self.path
    }
}

impl<S: Subscriber> Layer<S> for LogFile {
    fn on_event(&self, event: &Event<'_>, _context: Context<'_, S>) {
        let mut text = Text::default();
        event.record(&mut text);
        let level = match *event.metadata().level() {
            Level::ERROR => "ERROR",
            Level::WARN => "WARN",
            Level::INFO => "INFO",
            Level::DEBUG | Level::TRACE => "DEBUG",
        };
        let stamp = crate::time::wall_time();
        let line = format!(
            "[{level}] [{}.{:09}] [{}]: {}{}\n",
            stamp.sec, stamp.nanosec, self.logger, text.message, text.fields
        );
        // Full, or the file has ended: the line has gone to standard error.
        let _ = self.lines.try_send(line);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Duration;

    #[test]
    fn the_folder_is_the_one_that_ros_2_takes() {
        let in_ =
            |pairs: &[(&str, &str)]| folder(|asked| Some(pairs.iter().find(|(name, _)| *name == asked)?.1.to_string()));
        let home = ("HOME", "/home/eve");
        assert_eq!(in_(&[home]), Some("/home/eve/.ros/log".into()));
        assert_eq!(in_(&[home, ("ROS_HOME", "/data/ros")]), Some("/data/ros/log".into()));
        assert_eq!(in_(&[home, ("ROS_HOME", "/data/ros"), ("ROS_LOG_DIR", "~/logs")]), Some("/home/eve/logs".into()));
        assert_eq!(in_(&[home, ("ROS_LOG_DIR", "")]), Some("/home/eve/.ros/log".into()), "empty is not set");
        assert_eq!(in_(&[]), None);
    }

    #[test]
    fn the_file_is_named_as_ros_2_names_it() {
        let began = UNIX_EPOCH + Duration::from_millis(1_764_428_400_123);
        let program = Path::new("/opt/tandem/lib/tandem_planner/tandem_planner");
        assert_eq!(name(None, program, 42, began), "tandem_planner_42_1764428400123.log");
        assert_eq!(name(Some("left"), program, 42, began), "left_42_1764428400123.log");
    }
}
