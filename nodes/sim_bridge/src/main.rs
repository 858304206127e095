//! tandem_sim_bridge: MuJoCo behind ROS 2 topics, or behind CAN. Parameters and topics: docs/simulation.md.

use anyhow::Context;
use joint_bus::can::CanLink;
use joint_bus::{BusConfig, DriveModel, Link, LinkError};
use robot::Robot;
use ros::{Arguments, Node};
use std::process::ExitCode;
use tandem_sim_bridge::bridge::Bridge;
use tandem_sim_bridge::config::{Config, Pace};
use tandem_sim_bridge::drives::DriveBench;

fn main() -> ExitCode {
    match run() {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("tandem_sim_bridge: {error:#}");
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

/// Emulated drives wired as in the wiring file, on interfaces of these names.
fn drives(config: &Config, robot: &Robot, interfaces: Vec<String>) -> anyhow::Result<DriveBench> {
    if config.pace != Pace::Realtime {
        anyhow::bail!("--can needs mode realtime: frames on a bus do not wait");
    }
    let file = ros::find(&config.bus_file)?;
    let text = std::fs::read_to_string(&file).with_context(|| format!("cannot read {}", file.display()))?;
    let mut bus = BusConfig::from_toml_str(&text, &robot.name, &robot.joint_names())
        .with_context(|| file.display().to_string())?;
    if interfaces.len() != bus.interfaces.len() {
        anyhow::bail!("--can names {} interfaces, {} has {}", interfaces.len(), file.display(), bus.interfaces.len());
    }
    bus.interfaces = interfaces;
    let links = bus
        .interfaces
        .iter()
        .map(|interface| Ok(Box::new(CanLink::open(interface)?) as Box<dyn Link + Send>))
        .collect::<Result<Vec<_>, LinkError>>()?;
    let torque_limit_nm = robot.limits.drive_torque_nm.into_iter().fold(0.0, f64::max);
    let model = DriveModel { torque_limit_nm, latency: config.drive_latency, ..DriveModel::default() };
    Ok(DriveBench::new(bus, model, links))
}

fn run() -> anyhow::Result<()> {
    let (arguments, rest) = Arguments::from_process()?;
    let can = can_interfaces(&rest[1..])?;
    let node = Node::start("sim_bridge", &arguments)?;
    let config = Config::declare(&node)?;
    node.warn_of_unused_parameters();
    let robot = Robot::load(&ros::find(&config.robot_folder)?)?;
    let bench = can.map(|interfaces| drives(&config, &robot, interfaces)).transpose()?;
    let bridge = Bridge::new(&node, config, &robot, bench)?;
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
    let suspended = node.stop().was_suspended();
    node.shutdown();
    if suspended {
        anyhow::bail!("the process had been stopped and went on; start it again");
    }
    match result {
        Ok(result) => Ok(result?),
        Err(_) => anyhow::bail!("the simulation's thread panicked; the lines above say where"),
    }
}
