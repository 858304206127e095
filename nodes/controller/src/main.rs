//! tandem_controller: walks a gait with the paper's PD law. Parameters, topics and services: docs/safety.md,
//! docs/hardware.md.

use ros::{Arguments, Node};
use std::io::Write;
use std::process::ExitCode;
use tandem_controller::config::Parameters;
use tandem_controller::work::Work;

fn main() -> ExitCode {
    match run() {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            // Where standard error cannot be written there is nobody to tell.
            let _ = writeln!(std::io::stderr(), "tandem_controller: {error:#}");
            ExitCode::FAILURE
        }
    }
}

fn run() -> anyhow::Result<()> {
    let (arguments, rest) = Arguments::from_process()?;
    if let Some(unknown) = rest.get(1) {
        anyhow::bail!("argument \"{unknown}\" is not known; parameters are given as --ros-args -p NAME:=VALUE");
    }
    let node = Node::start("controller", &arguments)?;
    let parameters = Parameters::declare(&node)?;
    let lifecycle = node.manage(Work::new(&node, parameters))?;
    node.parameters_are_declared();
    lifecycle.start()?;
    let stop = node.stop();
    let ended = node.run_managed(&lifecycle);
    if let Some(failure) = stop.failure() {
        anyhow::bail!("it comes back disarmed when it is started again: {failure}");
    }
    ended?;
    Ok(())
}
