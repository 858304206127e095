//! The controller as a managed node. Configured, the loop runs and the topics are there, but the robot stays damped or
//! disarmed as under the emergency stop; active, requests are granted. Activating arms nothing. Deactivating lets a
//! walk come to rest first.

use crate::body_pose::BodyPoses;
use crate::config::{Pace, Parameters};
use crate::cycle::{Cycle, Middleware};
use crate::dds_bus::{self, CommandPublisher, CycleClock, DEPTH, DdsBus};
use crate::emergency_stop::EmergencyStop;
use crate::foot_contacts::FootContactsPublisher;
use crate::inputs::InputProblems;
use crate::odometry::Odometer;
use crate::others::OtherPublishers;
use crate::planning;
use crate::publishers::{PublisherThread, Publishers};
use crate::recording::{self, Recording, Subject};
use crate::services::{Sensors, Services};
use anyhow::Context as _;
use control::{Config, Controller, Mode};
use joint_bus::can::CanLink;
use joint_bus::{BusConfig, CanInertialUnit, CanLock, DriveBus, DriveProtocol, InertialUnit, LinkError};
use realtime::{Warning, monotonic_now};
use robot::Robot;
use ros::{Managed, Node, Qos};
use rtrb::RingBuffer;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::sync_channel;
use std::thread::JoinHandle;
use std::time::{Duration, SystemTime, UNIX_EPOCH};

/// How long deactivating waits for a walk to come to rest: a step, the motion running out, and room.
const STOPPING_PATIENCE: Duration = Duration::from_secs(3);
/// How long it then waits to see the robot damped. In lockstep time may stand still.
const DAMPING_PATIENCE: Duration = Duration::from_millis(300);

/// SCHED_FIFO priority of the threads through which the stop is received, where the control thread has one.
const MIDDLEWARE_PRIORITY: u8 = 10;
/// Name of the thread that publishes.
const PUBLISHERS: &str = "publishers";

/// How long a bus is listened to before the first frame: ten periods of the slowest controller.
const LISTEN_FIRST: Duration = Duration::from_millis(200);

/// The robot's drives, and that this process is their master.
struct Drives {
    bus: DriveBus<DriveProtocol, CanLink>,
    locks: Vec<CanLock>,
}

fn open_bus(file: &Path, robot: &Robot, config: &control::Config) -> anyhow::Result<Drives> {
    let file = robot::find(file)?;
    let text = std::fs::read_to_string(&file).with_context(|| format!("{}", file.display()))?;
    let bus = BusConfig::from_toml_str(&text, &robot.name, &config.joint_names)
        .and_then(|bus| bus.check_ranges(&config.command_range()).map(|()| bus))
        .with_context(|| format!("{}", file.display()))?;
    let locks = bus.interfaces.iter().map(|name| CanLock::take(name)).collect::<Result<Vec<_>, _>>()?;
    let links = bus.interfaces.iter().map(|name| CanLink::open(name)).collect::<Result<Vec<_>, _>>()?;
    let unit = open_inertial_unit(&bus)?;
    let protocol = DriveProtocol::of(&bus);
    let mut bus = DriveBus::new(bus, protocol, links).with_inertial_unit(unit);
    listen_first(&mut bus)?;
    Ok(Drives { bus, locks })
}

/// The robot's own inertial unit. A robot with another one opens it here.
fn open_inertial_unit(bus: &BusConfig) -> Result<Option<Box<dyn InertialUnit>>, LinkError> {
    let Some(unit) = bus.inertial else { return Ok(None) };
    let link = CanLink::open_for(&bus.interfaces[unit.interface], unit.frames)?;
    Ok(Some(Box::new(CanInertialUnit::new(unit.frames, link))))
}

/// Another host's controller holds no lock here: it is listened for before anything is sent.
fn listen_first(bus: &mut DriveBus<DriveProtocol, CanLink>) -> anyhow::Result<()> {
    let until = monotonic_now() + LISTEN_FIRST;
    while monotonic_now() < until {
        if let Some((interface, joint)) = bus.listen_for_second_master(monotonic_now()) {
            anyhow::bail!(
                "second_controller: somebody else commands the drive of {joint} on {interface}: stop that controller first"
            );
        }
        std::thread::sleep(Duration::from_millis(5));
    }
    Ok(())
}

/// What runs while the node is configured.
struct Running {
    node: Node,
    services: Arc<Services>,
    emergency_stop: Arc<EmergencyStop>,
    others: OtherPublishers,
    recording: Arc<Recording>,
    stop: Arc<AtomicBool>,
    cycle_ended: Arc<AtomicBool>,
    control: JoinHandle<()>,
    publishers: JoinHandle<()>,
    writer: JoinHandle<()>,
}

impl Running {
    /// The cycle's last command is damping, the publishers send it, the recording is completed, the topics go.
    fn end(self) -> Result<(), String> {
        self.stop.store(true, Ordering::Release);
        self.control.thread().unpark();
        let control = self.control.join();
        self.cycle_ended.store(true, Ordering::Release);
        self.publishers.thread().unpark();
        let publishers = self.publishers.join();
        self.recording.end();
        let writer = self.writer.join();
        drop(self.node);
        if control.is_err() || publishers.is_err() || writer.is_err() {
            return Err("a thread panicked; the lines above say where".into());
        }
        Ok(())
    }
}

/// The controller between its transitions.
pub struct Work {
    node: Node,
    parameters: Parameters,
    running: Option<Running>,
}

impl Work {
    /// Endpoints will be the node's.
    pub fn new(node: &Node, parameters: Parameters) -> Self {
        Self { node: node.part(), parameters, running: None }
    }

    fn open(&self, active: bool) -> anyhow::Result<Running> {
        let parameters = &self.parameters;
        let robot = self.load_robot()?;
        let config = parameters.control(&robot)?;
        let controller = Controller::new(config.clone())?;
        let drives = parameters.bus_file.as_deref().map(|file| open_bus(file, &robot, &config)).transpose()?;
        let (on_bus, lockstep) = (drives.is_some(), parameters.pace == Pace::Lockstep);
        // Nothing may be lost between two processes that wait for each other; else only the newest counts, and nobody
        // is to send an old one again.
        let fast = if lockstep { dds_bus::OFFERED } else { Qos::best_effort(1) };
        let (states_in, states) = RingBuffer::new(DEPTH);
        let (commands_in, commands) = RingBuffer::new(DEPTH);
        let (inertial_in, inertial) = RingBuffer::new(64);
        let (asked_in, asked) = RingBuffer::new(64);
        let (gaits_in, gaits) = RingBuffer::new(16);
        let (outputs_in, outputs) = RingBuffer::new(1024);
        let emergency_stop = Arc::new(EmergencyStop::new(parameters.heartbeat));
        emergency_stop.set_active(active);
        let node = self.node.part();
        let others = if on_bus { OtherPublishers::default() } else { OtherPublishers::listen_first(&node)? };
        let (stop, cycle_ended) = (Arc::new(AtomicBool::new(false)), Arc::new(AtomicBool::new(false)));

        let (since_epoch, zero) = self.epoch()?;
        let subject = self.subject(&robot, &config, zero);
        let leg_names = subject.leg_names.clone();
        let (cycle_log, recording, writer) = recording::open(subject);
        let recording = Arc::new(recording);
        recording.listen(&node, &leg_names)?;
        let problems = Arc::<InputProblems>::default();
        let command_gaits = parameters.drive.command_gaits(&config);
        let services = Services::new(
            asked_in,
            gaits_in,
            Arc::clone(&recording),
            Arc::clone(&emergency_stop),
            Arc::clone(&problems),
            config.clone(),
            lockstep,
        );
        let services = Arc::new(services.planning_for(command_gaits.clone()));
        let joint_names = config.joint_names.each_ref().map(|name| format!("{}{name}", parameters.joint_prefix));
        let commands_out =
            (!on_bus).then(|| CommandPublisher::new(&node, joint_names.clone(), commands, lockstep)).transpose()?;
        let every = (parameters.state_every, parameters.joint_states_every);
        let velocities = parameters.drive.listen(&node, services.gate(), command_gaits.clone())?;
        let body_poses = BodyPoses::listen(&node, services.gate())?;
        let odometry_every =
            (1.0 / (parameters.drive.odometry_rate_hz * config.control_period_s)).round().max(1.0) as u64;
        let odometer = Odometer::new(&node, &config, &parameters.drive.frame_prefix, odometry_every, on_bus)?;
        let publishers =
            Publishers::new(&node, joint_names.clone(), every, commands_out, Arc::clone(&recording), problems)?
                .with_estimates(odometer, FootContactsPublisher::new(&node, &robot, parameters.state_every)?)
                .telling(command_gaits.clone());
        planning::begin(&node, command_gaits, &services, &stop)?;
        let writer = std::thread::Builder::new().name("recording".into()).spawn(move || writer.run())?;
        if parameters.record_every_run
            // The robot walks without its recording; the fault stands in diagnostics until one begins.
            && let Err(reason) = recording.start(&recording::folder_name(since_epoch))
        {
            tracing::error!("no recording: {reason}");
        }
        let thread = PublisherThread {
            publishers,
            outputs,
            services: Arc::clone(&services),
            cycle_ended: Arc::clone(&cycle_ended),
        };
        let publishers = std::thread::Builder::new().name(PUBLISHERS.into()).spawn(move || thread.run())?;
        let cycle = Cycle {
            controller,
            inertial,
            velocities,
            body_poses,
            asked,
            gaits,
            emergency_stop: Arc::clone(&emergency_stop),
            middleware: Middleware::new(node.stop().health(), parameters.middleware_timeout, parameters.period),
            cycle_log,
            stop: Arc::clone(&stop),
            outputs: outputs_in,
            publishers: publishers.thread().clone(),
            start_on_gait: parameters.start_on_gait,
        };
        let (warnings_in, warnings) = sync_channel(1);
        let (pace, period, realtime) = (parameters.pace, parameters.period, parameters.realtime);
        // In lockstep the cycle follows the stamps and nothing else.
        let clock = if lockstep { CycleClock::JointStates } else { parameters.clock };
        let (patience, awaits) = (2 * Duration::from_secs_f64(config.state_timeout_s), publishers.thread().clone());
        let topics = DdsBus::new(states, commands_in, Some(awaits), clock, patience).beside(others.clone());
        let control = std::thread::Builder::new().name("control".into()).spawn(move || {
            // The receiver waits for it; the channel has room.
            let warn = move |list: Vec<Warning>| warnings_in.send(list).unwrap_or_default();
            match (drives, pace) {
                (Some(Drives { bus, locks }), _) => {
                    cycle.run_realtime(bus, period, realtime, warn);
                    drop(locks);
                }
                (None, Pace::Realtime) => cycle.run_realtime(topics, period, realtime, warn),
                (None, Pace::Lockstep) => {
                    warn(Vec::new());
                    cycle.run_lockstep(topics);
                }
            }
        })?;
        for warning in warnings.recv().unwrap_or_default() {
            tracing::warn!("{warning}");
        }
        raise_middleware(realtime.priority.filter(|_| !lockstep));
        let wake = lockstep.then(|| control.thread().clone());
        // On a bus the cycle reads the drives itself and joint_states is what it publishes.
        let states = (!on_bus).then_some(states_in);
        let running = Running {
            node,
            services,
            emergency_stop,
            others,
            recording,
            stop,
            cycle_ended,
            control,
            publishers,
            writer,
        };
        if let Err(error) =
            running.services.open(&running.node, Sensors { states, joint_names, inertial: inertial_in, wake }, fast)
        {
            return Err(match running.end() {
                Ok(()) => error.into(),
                Err(more) => anyhow::anyhow!("{error}; {more}"),
            });
        }
        tracing::info!("{}: disarmed, {}", config.robot, self.way_to_joints());
        Ok(running)
    }

    fn load_robot(&self) -> anyhow::Result<Robot> {
        let robot = Robot::load(&robot::find(&self.parameters.robot_folder)?)?;
        for note in &robot.notes {
            tracing::info!("robot '{}': {note}", robot.name);
        }
        Ok(robot)
    }

    /// Now since the epoch; and where the controller's clock begins, so that a bag's times count from the epoch also
    /// where that clock is the machine's own.
    fn epoch(&self) -> anyhow::Result<(Duration, Duration)> {
        let Parameters { bus_file, pace, clock, .. } = &self.parameters;
        let since_epoch = SystemTime::now().duration_since(UNIX_EPOCH).context("the machine's clock is before 1970")?;
        let own_clock = bus_file.is_some() || (*pace == Pace::Realtime && *clock == CycleClock::Monotonic);
        let zero = if own_clock { since_epoch.saturating_sub(monotonic_now()) } else { Duration::ZERO };
        Ok((since_epoch, zero))
    }

    /// What is recorded, where the controller's clock counts from `zero` after the epoch.
    fn subject(&self, robot: &Robot, config: &Config, zero: Duration) -> Subject {
        Subject {
            config: config.clone(),
            robot_description: robot.urdf.clone(),
            leg_names: std::array::from_fn(|leg| robot.legs[leg].name.clone()),
            epoch_ns: u64::try_from(zero.as_nanos()).unwrap_or_default(),
            record_root: self.parameters.record_root.clone(),
            split_bytes: self.parameters.split_bytes,
            split_duration: self.parameters.split_duration,
        }
    }

    fn way_to_joints(&self) -> &'static str {
        match (&self.parameters.bus_file, self.parameters.pace) {
            (Some(_), _) => "on CAN",
            (None, Pace::Lockstep) => "over DDS in lockstep",
            (None, Pace::Realtime) => "over DDS in realtime",
        }
    }
}

/// Threads that hold locks of the middleware which its event thread waits for: discovery's and the node's publishers'.
const LOCK_HOLDERS: [&str; 2] = ["RustDDS discove", PUBLISHERS];

/// The stop is received through `ros::THREADS`: below the control thread, and beside everything else that the machine
/// does. Who holds a lock that these wait for comes right after them: an ordinary thread loses its processor meanwhile.
fn raise_middleware(own: Option<u8>) {
    let Some(priority) = own.map(|own| MIDDLEWARE_PRIORITY.min(own - 1)) else { return };
    for (threads, priority) in [(&ros::THREADS, priority), (&LOCK_HOLDERS, priority.saturating_sub(1))] {
        if priority > 0
            && let Err(warning) = realtime::raise_threads(threads, priority)
        {
            tracing::warn!("the middleware's threads: {warning}");
        }
    }
}

impl Managed for Work {
    fn configure(&mut self, goes_active: bool) -> Result<(), String> {
        self.running = Some(self.open(goes_active).map_err(|error| format!("{error:#}"))?);
        Ok(())
    }

    fn activate(&mut self) -> Result<(), String> {
        if let Some(running) = &self.running {
            running.others.refuse_any().map_err(|error| format!("{error:#}"))?;
            running.emergency_stop.set_active(true);
        }
        Ok(())
    }

    fn deactivate(&mut self) -> Result<(), String> {
        let Some(running) = &self.running else { return Ok(()) };
        // At the end of the program damping comes at once: nobody waits for a process that is asked to end.
        let hurried = || self.node.stop().is_requested();
        if !hurried() {
            running.services.bring_to_rest(STOPPING_PATIENCE, hurried);
        }
        running.emergency_stop.set_active(false);
        running.services.end_lease();
        if !running.services.wait_for_mode(DAMPING_PATIENCE, hurried, |mode, _| {
            matches!(mode, Mode::Damping | Mode::Disarmed | Mode::Fault)
        }) {
            tracing::warn!(
                "deactivated: the robot is damped with the next joint state; none came for {DAMPING_PATIENCE:?}"
            );
        }
        Ok(())
    }

    fn clean_up(&mut self) -> Result<(), String> {
        self.running.take().map_or(Ok(()), Running::end)
    }
}
