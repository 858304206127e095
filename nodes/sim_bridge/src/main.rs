//! tandem_sim_bridge: MuJoCo behind ROS 2 topics, or behind CAN. Parameters and topics: docs/simulation.md.

use ros::{Arguments, Node};
use std::io::Write;
use std::process::ExitCode;
use tandem_sim_bridge::config::Config;
use tandem_sim_bridge::work::Work;

fn main() -> ExitCode {
    match run() {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            // Where standard error cannot be written there is nobody to tell.
            let _ = writeln!(std::io::stderr(), "tandem_sim_bridge: {error:#}");
            ExitCode::FAILURE
        }
    }
}

/// `--can can0,can1,can2,can3`, if it is given.
fn can_interfaces(arguments: &[String]) -> anyhow::Result<Option<Vec<String>>> {
    let list = match arguments {
        [] => return Ok(None),
        [flag, list] if flag == "--can" => list,
        [argument] if argument.starts_with("--can=") => &argument["--can=".len()..],
        _ => anyhow::bail!(
            "arguments {arguments:?} are not known; expected --can INTERFACE,INTERFACE,... or nothing; parameters are given as \
             --ros-args -p NAME:=VALUE"
        ),
    };
    Ok(Some(list.split(',').map(str::to_owned).collect()))
}

fn run() -> anyhow::Result<()> {
    let (arguments, rest) = Arguments::from_process()?;
    let can = can_interfaces(&rest[1..])?;
    let node = Node::start("sim_bridge", &arguments)?;
    let config = Config::declare(&node)?;
    let lifecycle = node.manage(Work::new(&node, config, can))?;
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
