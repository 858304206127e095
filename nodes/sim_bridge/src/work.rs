//! The bridge as a managed node: configured the robot is put down and the topics are there, active time passes and they
//! are published.

use crate::bridge::{Bridge, BridgeError, ask};
use crate::config::{Config, Pace};
use crate::inbox::{Ask, Inbox};
use anyhow::Context;
use joint_bus::can::CanLink;
use joint_bus::{BusConfig, DriveModel, EmulatedInertialUnit, InertialWiring, Link, LinkError};
use robot::Robot;
use ros::{Managed, Node};
use simulator::drives::DriveBench;
use std::sync::Arc;
use std::thread::JoinHandle;

/// Emulated drives wired as in the wiring file, on interfaces of these names.
fn drives(config: &Config, robot: &Robot, interfaces: &[String]) -> anyhow::Result<DriveBench> {
    if config.pace != Pace::Realtime {
        anyhow::bail!("--can needs mode realtime: frames on a bus do not wait");
    }
    let file = robot::find(&config.bus_file)?;
    let text = std::fs::read_to_string(&file).with_context(|| format!("cannot read {}", file.display()))?;
    let mut bus = BusConfig::from_toml_str(&text, &robot.name, &robot.joint_names())
        .with_context(|| file.display().to_string())?;
    if interfaces.len() != bus.interfaces.len() {
        anyhow::bail!("--can names {} interfaces, {} has {}", interfaces.len(), file.display(), bus.interfaces.len());
    }
    bus.interfaces = interfaces.to_vec();
    let links = bus
        .interfaces
        .iter()
        .map(|interface| Ok(Box::new(CanLink::open(interface)?) as Box<dyn Link + Send>))
        .collect::<Result<Vec<_>, LinkError>>()?;
    let torque_limit_nm = robot.limits.drive_torque_nm.into_iter().fold(0.0, f64::max);
    let model = DriveModel { torque_limit_nm, latency: config.drive_latency, ..DriveModel::default() };
    let open_unit = |unit: InertialWiring| -> Result<EmulatedInertialUnit, LinkError> {
        let link = CanLink::open_for(&bus.interfaces[unit.interface], unit.frames)?;
        Ok(EmulatedInertialUnit::new(unit.frames, link))
    };
    let unit = bus.inertial.map(open_unit).transpose()?;
    Ok(DriveBench::new(bus, model, links).with_inertial_unit(unit))
}

/// What runs while the node is configured.
struct Running {
    node: Node,
    inbox: Arc<Inbox>,
    stepping: JoinHandle<Result<(), BridgeError>>,
}

/// The bridge between its transitions.
pub struct Work {
    node: Node,
    config: Config,
    can: Option<Vec<String>>,
    running: Option<Running>,
}

impl Work {
    /// Endpoints will be the node's. With `can`, the robot hangs on emulated drives on these interfaces.
    pub fn new(node: &Node, config: Config, can: Option<Vec<String>>) -> Self {
        Self { node: node.part(), config, can, running: None }
    }

    fn open(&self, active: bool) -> anyhow::Result<Running> {
        let robot = Robot::load(&robot::find(&self.config.robot_folder)?)?;
        let bench = self.can.as_deref().map(|interfaces| drives(&self.config, &robot, interfaces)).transpose()?;
        let node = self.node.part();
        let mut bridge = Bridge::new(&node, self.config.clone(), &robot, bench)?;
        bridge.set_active(active);
        let inbox = bridge.inbox();
        let stop = node.stop();
        let stepping = std::thread::Builder::new().name("simulation".into()).spawn(move || {
            let result = bridge.run();
            // It ends by itself only where it cannot go on, and the process with it.
            if result.is_err() {
                stop.request();
            }
            result
        })?;
        Ok(Running { node, inbox, stepping })
    }

    fn set_active(&self, active: bool) -> Result<(), String> {
        self.running.as_ref().map_or(Ok(()), |running| ask(&running.inbox, Ask::Activate(active)).map(drop))
    }
}

impl Managed for Work {
    fn configure(&mut self, goes_active: bool) -> Result<(), String> {
        self.running = Some(self.open(goes_active).map_err(|error| format!("{error:#}"))?);
        Ok(())
    }

    fn activate(&mut self) -> Result<(), String> {
        self.set_active(true)
    }

    fn deactivate(&mut self) -> Result<(), String> {
        // At the end of the program the simulation may have ended already.
        if self.node.stop().is_requested() { Ok(()) } else { self.set_active(false) }
    }

    fn clean_up(&mut self) -> Result<(), String> {
        let Some(Running { node, inbox, stepping }) = self.running.take() else { return Ok(()) };
        inbox.close();
        let result = stepping.join();
        drop(node);
        match result {
            Ok(result) => result.map_err(|error| error.to_string()),
            Err(_) => Err("the simulation's thread panicked; the lines above say where".into()),
        }
    }
}
