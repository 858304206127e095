//! What the commands print and write: the only place that does, so that a closed pipe or a full disk ends each of
//! them in order, and `-` is standard output everywhere.

use anyhow::{Context, Result};
use std::fmt;
use std::io::{self, ErrorKind, Write};
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::atomic::{AtomicBool, Ordering};
use tandem_msgs::text::printable;

/// What a shell shows for a program that a closed pipe has ended: 128 and the number of SIGPIPE.
const CLOSED_PIPE: u8 = 141;

/// Longest error, in characters.
const ERROR_CHARS: usize = 4000;

/// A file goes to standard output: what is reported goes to standard error.
static TAKEN: AtomicBool = AtomicBool::new(false);

/// Says one line, formatted as by `println!`; gives a `Result`.
macro_rules! say {
    ($($text:tt)*) => { $crate::output::line(format_args!($($text)*)) };
}

/// Writes one line to standard error. Where that is impossible there is nobody to tell.
macro_rules! note {
    ($($text:tt)*) => { $crate::output::note(format_args!($($text)*)) };
}

/// Standard output cannot be written: closed by its reader, or on a full disk.
#[derive(Debug)]
pub struct Unwritable(io::Error);

impl fmt::Display for Unwritable {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "cannot write to standard output: {}", self.0)
    }
}

impl std::error::Error for Unwritable {}

/// See `say!`.
pub fn line(text: fmt::Arguments<'_>) -> Result<(), Unwritable> {
    part(format_args!("{text}\n"))
}

/// A part of a line, or some lines.
pub fn part(text: fmt::Arguments<'_>) -> Result<(), Unwritable> {
    if TAKEN.load(Ordering::Relaxed) {
        // Standard error's failure is no reason to stop: what was asked for goes to standard output.
        let _ = io::stderr().write_fmt(text);
        return Ok(());
    }
    bytes(text.to_string().as_bytes())
}

/// See `note!`.
pub fn note(text: fmt::Arguments<'_>) {
    let _ = writeln!(io::stderr(), "{text}");
}

/// At once, so that what a person waits for is seen, and so that an error is reported and not lost at the end.
fn bytes(bytes: &[u8]) -> Result<(), Unwritable> {
    let mut out = io::stdout().lock();
    out.write_all(bytes).and_then(|()| out.flush()).map_err(Unwritable)
}

/// From here on what is reported goes to standard error: standard output is for a `document`.
pub fn divert() {
    TAKEN.store(true, Ordering::Relaxed);
}

/// Prints one JSON value on a line of its own on standard output, whatever is reported elsewhere.
#[cfg(feature = "network")]
pub fn document(value: &serde_json::Value) -> Result<(), Unwritable> {
    bytes(format!("{value}\n").as_bytes())
}

/// Prints one JSON value, on a line of its own.
pub fn json(value: &serde_json::Value) -> Result<(), Unwritable> {
    line(format_args!("{value}"))
}

/// Whether a file's name stands for standard output.
pub fn is_standard(file: &Path) -> bool {
    file == Path::new("-")
}

/// Before anything is reported: if the file is `-`, everything that is reported goes to standard error.
pub fn reserve(file: Option<&Path>) {
    if file.is_some_and(is_standard) {
        divert();
    }
}

/// A folder that is written to, for clap.
pub fn folder(text: &str) -> Result<PathBuf, String> {
    if text == "-" {
        return Err("'-' is standard output, which is no folder; for a folder of that name give ./-".into());
    }
    Ok(text.into())
}

/// Writes the whole file or none of it; `-` is standard output. What is no ordinary file (/dev/stdout, a pipe) is
/// written to.
pub fn write_file(file: &Path, content: &[u8]) -> Result<()> {
    if is_standard(file) {
        return Ok(bytes(content)?);
    }
    let cannot = || format!("cannot write {}", file.display());
    if file.metadata().is_ok_and(|found| !found.is_file()) {
        return std::fs::write(file, content).with_context(cannot);
    }
    let mut partial = file.as_os_str().to_owned();
    partial.push(".partial");
    let written = std::fs::write(&partial, content).and_then(|()| std::fs::rename(&partial, file));
    if written.is_err() {
        // What a full disk took of it is of no use. It may not even be there.
        let _ = std::fs::remove_file(&partial);
    }
    written.with_context(cannot)
}

/// How a file is named: standard output by its name.
pub fn shown(file: &Path) -> String {
    if is_standard(file) { "standard output".into() } else { file.display().to_string() }
}

/// Answers what clap has to say: help and version on standard output, mistakes on standard error.
pub fn answer(error: &clap::Error) -> ExitCode {
    use std::io::IsTerminal;
    let text = error.render();
    if error.use_stderr() {
        let coloured = io::stderr().is_terminal();
        let text = if coloured { text.ansi().to_string() } else { text.to_string() };
        let _ = io::stderr().write_all(text.as_bytes());
        return ExitCode::from(u8::try_from(error.exit_code()).unwrap_or(2));
    }
    let text = if io::stdout().is_terminal() { text.ansi().to_string() } else { text.to_string() };
    bytes(text.as_bytes()).map_or_else(|error| failed(&error.into()), |()| ExitCode::SUCCESS)
}

/// The code that an error ends the program with, after a line where there is something to say. A reader that has
/// closed its pipe wants no more.
pub fn failed(error: &anyhow::Error) -> ExitCode {
    let closed = error.chain().any(|cause| {
        cause.downcast_ref::<Unwritable>().is_some_and(|unwritable| unwritable.0.kind() == ErrorKind::BrokenPipe)
    });
    if closed {
        return ExitCode::from(CLOSED_PIPE);
    }
    // It may repeat what others answered; one line, whatever stands in it.
    note!("tandem: {}", printable(&format!("{error:#}"), ERROR_CHARS));
    ExitCode::FAILURE
}
