//! tandem_planner: the service `generate_gait` and the latched topic `gait`. Parameters and topics: docs/interfaces.md.

use std::io::Write;
use std::process::ExitCode;

use anyhow::bail;
use ros::{Arguments, Node};
use tandem_planner::work::{Parameters, Work};

fn main() -> ExitCode {
    match run() {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            // Where standard error cannot be written there is nobody to tell.
            let _ = writeln!(std::io::stderr(), "tandem_planner: {error:#}");
            ExitCode::FAILURE
        }
    }
}

fn run() -> anyhow::Result<()> {
    let (arguments, rest) = Arguments::from_process()?;
    if let Some(unknown) = rest.get(1) {
        bail!("argument \"{unknown}\" is not known; parameters are given as --ros-args -p NAME:=VALUE");
    }
    let node = Node::start("planner", &arguments)?;
    let parameters = Parameters::declare(&node)?;
    let lifecycle = node.manage(Work::new(&node, parameters))?;
    node.parameters_are_declared();
    lifecycle.start()?;
    let stop = node.stop();
    let ended = node.run_managed(&lifecycle);
    if let Some(failure) = stop.failure() {
        anyhow::bail!("{failure}");
    }
    ended?;
    Ok(())
}
