//! The programs of the day, as processes that do not outlive it.

use crate::{Failure, MS};
use realtime::monotonic_now;
use std::io::Read;
use std::os::unix::process::CommandExt;
use std::process::{Child, Command, ExitStatus, Stdio};
use std::time::Duration;

/// Before its first instruction: its threads inherit it.
fn set_nice(command: &mut Command, nice: i32) {
    let set = move || {
        // SAFETY: a plain system call on the calling process itself.
        if unsafe { libc::setpriority(libc::PRIO_PROCESS, 0, nice) } != 0 {
            return Err(std::io::Error::last_os_error());
        }
        Ok(())
    };
    // SAFETY: between fork and exec it makes one system call and takes no lock.
    unsafe { command.pre_exec(set) };
}

/// A program that does not outlive this one.
pub struct Program(Child);

impl Program {
    /// `nice` is -20 for the simulation: it plays the drives, which need no processor of the robot's.
    pub fn start(folder: &str, name: &str, arguments: &[&str], nice: i32) -> Result<Self, Failure> {
        let mut command = Command::new(format!("{folder}/{name}"));
        set_nice(&mut command, nice);
        Ok(Self(command.args(arguments).spawn().map_err(|e| format!("{name}: {e}"))?))
    }

    /// Runs a program that should end by itself, and returns how it ended and its standard error. It yields to the
    /// others: they share one processor with the simulation, which plays the drives.
    pub fn run(
        folder: &str,
        name: &str,
        arguments: &[&str],
        patience: Duration,
    ) -> Result<(ExitStatus, String), Failure> {
        let mut command = Command::new(format!("{folder}/{name}"));
        set_nice(&mut command, 19);
        let child = command.args(arguments).stdout(Stdio::null()).stderr(Stdio::piped()).spawn()?;
        let mut program = Self(child);
        let status = program.wait(patience)?;
        let mut stderr = String::new();
        if let Some(mut pipe) = program.0.stderr.take() {
            pipe.read_to_string(&mut stderr)?;
        }
        Ok((status, stderr))
    }

    pub fn id(&self) -> u32 {
        self.0.id()
    }

    pub fn signal(&self, signal: i32) -> Result<(), Failure> {
        // Not by a program `kill`, whose start takes as long as the drives' watchdog.
        // SAFETY: a plain system call; the number is that of a child that has not been waited for.
        if unsafe { libc::kill(self.0.id() as i32, signal) } != 0 {
            return Err(format!("kill {signal}: {}", std::io::Error::last_os_error()).into());
        }
        Ok(())
    }

    pub fn kill(&mut self) -> Result<(), Failure> {
        self.0.kill()?;
        self.0.wait()?;
        Ok(())
    }

    pub fn wait(&mut self, patience: Duration) -> Result<ExitStatus, Failure> {
        let deadline = monotonic_now() + patience;
        loop {
            match self.0.try_wait()? {
                Some(status) => return Ok(status),
                None if monotonic_now() > deadline => return Err(format!("it did not end within {patience:?}").into()),
                None => std::thread::sleep(5 * MS),
            }
        }
    }

    pub fn check(&mut self, name: &str) -> Result<(), Failure> {
        match self.0.try_wait()? {
            None => Ok(()),
            Some(status) => Err(format!("{name} has ended: {status}").into()),
        }
    }
}

impl Drop for Program {
    fn drop(&mut self) {
        // Already ended is as good.
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}
