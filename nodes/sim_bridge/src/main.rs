//! tandem_sim_bridge: MuJoCo behind ROS 2 topics. Parameters and topics: docs/simulation.md.

use robot::Robot;
use ros::{Arguments, Node};
use std::process::ExitCode;
use tandem_sim_bridge::bridge::Bridge;
use tandem_sim_bridge::config::Config;

fn main() -> ExitCode {
    match run() {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("tandem_sim_bridge: {error:#}");
            ExitCode::FAILURE
        }
    }
}

fn run() -> anyhow::Result<()> {
    let (arguments, rest) = Arguments::from_process()?;
    if let Some(unknown) = rest.get(1) {
        anyhow::bail!("argument \"{unknown}\" is not known; parameters are given as --ros-args -p NAME:=VALUE");
    }
    let node = Node::start("sim_bridge", &arguments)?;
    let config = Config::declare(&node)?;
    node.warn_of_unused_parameters();
    let robot = Robot::load(&tandem_sim_bridge::find_folder(&config.robot_folder)?)?;
    let bridge = Bridge::new(&node, config, &robot)?;
    let inbox = bridge.inbox();
    let stop = node.stop();
    let stepping = std::thread::Builder::new().name("simulation".into()).spawn(move || {
        let result = bridge.run();
        stop.request();
        result
    })?;
    // Close the inbox as soon as the end is asked for, while the node is still there.
    let stop = node.stop();
    node.spawn(async move {
        stop.requested().await;
        inbox.close();
    });
    // Nothing else may hold the node up: wait for the simulation's thread first, then leave in order.
    let result = stepping.join();
    node.shutdown();
    match result {
        Ok(result) => Ok(result?),
        Err(_) => anyhow::bail!("the simulation's thread panicked; the lines above say where"),
    }
}
