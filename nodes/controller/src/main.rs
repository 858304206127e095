//! tandem_controller: walks a gait with the paper's PD law. Parameters, topics and services: docs/safety.md, docs/hardware.md.

use anyhow::Context as _;
use control::Controller;
use joint_bus::can::CanLink;
use joint_bus::{BusConfig, DriveBus, Mit, ProtocolName, Registers};
use realtime::{Warning, monotonic_now};
use robot::Robot;
use ros::{Arguments, Node, Qos};
use rtrb::RingBuffer;
use std::path::Path;
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::sync_channel;
use std::time::{SystemTime, UNIX_EPOCH};
use tandem_controller::config::{Pace, Parameters};
use tandem_controller::cycle::{Cycle, EmergencyStop};
use tandem_controller::dds_bus::{CycleClock, DEPTH, DdsBus, Speaker};
use tandem_controller::desk::{Desk, Sensors};
use tandem_controller::press::{Press, PressRoom};
use tandem_controller::tape::{self, Subject};

fn main() -> ExitCode {
    match run() {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("tandem_controller: {error:#}");
            ExitCode::FAILURE
        }
    }
}

/// The drives' bus, by what they speak.
enum Bus {
    Mit(DriveBus<Mit, CanLink>),
    Registers(DriveBus<Registers, CanLink>),
}

fn open_bus(file: &Path, robot: &Robot, config: &control::Config) -> anyhow::Result<Bus> {
    let file = ros::find(file)?;
    let text = std::fs::read_to_string(&file).with_context(|| format!("{}", file.display()))?;
    let bus = BusConfig::from_toml_str(&text, &robot.name, &config.joint_names)
        .and_then(|bus| bus.check_ranges(config).map(|()| bus))
        .with_context(|| format!("{}", file.display()))?;
    let links = bus.interfaces.iter().map(|name| CanLink::open(name)).collect::<Result<Vec<_>, _>>()?;
    Ok(match bus.protocol {
        ProtocolName::Mit => {
            let protocol = Mit { host_id: bus.host_id, ..Mit::default() };
            Bus::Mit(DriveBus::new(bus, protocol, links))
        }
        ProtocolName::Registers => {
            let protocol = Registers { host_id: bus.host_id as u8 };
            Bus::Registers(DriveBus::new(bus, protocol, links))
        }
    })
}

fn run() -> anyhow::Result<()> {
    let (arguments, rest) = Arguments::from_process()?;
    if let Some(unknown) = rest.get(1) {
        anyhow::bail!("argument \"{unknown}\" is not known; parameters are given as --ros-args -p NAME:=VALUE");
    }
    let node = Node::start("controller", &arguments)?;
    let parameters = Parameters::declare(&node)?;
    node.warn_of_unused_parameters();
    let robot = Robot::load(&ros::find(&parameters.robot_folder)?)?;
    let config = parameters.control(&robot);
    let controller = Controller::new(config.clone())?;
    let bus = parameters.bus_file.as_deref().map(|file| open_bus(file, &robot, &config)).transpose()?;
    let on_bus = bus.is_some();
    let lockstep = parameters.pace == Pace::Lockstep;
    // Nothing may be lost between two processes that wait for each other; else only the newest counts.
    let fast = if lockstep { Qos::reliable(10) } else { Qos::best_effort(1) };

    let (states_in, states) = RingBuffer::new(DEPTH);
    let (commands_in, commands) = RingBuffer::new(DEPTH);
    let (tilts_in, tilts) = RingBuffer::new(64);
    let (asked_in, asked) = RingBuffer::new(64);
    let (gaits_in, gaits) = RingBuffer::new(16);
    let (said_in, said) = RingBuffer::new(1024);
    let emergency_stop = Arc::new(EmergencyStop::new(parameters.heartbeat));
    let stop = Arc::new(AtomicBool::new(false));
    let cycle_ended = Arc::new(AtomicBool::new(false));

    // Where the controller's clock is the machine's own, a bag's times count from the epoch all the same.
    let since_epoch = SystemTime::now().duration_since(UNIX_EPOCH).context("the machine's clock is before 1970")?;
    let own_clock = on_bus || (!lockstep && parameters.clock == CycleClock::Monotonic);
    let zero = since_epoch.saturating_sub(monotonic_now());
    let leg_names = std::array::from_fn(|leg| robot.legs[leg].name.clone());
    let (tape, recording, writer) = tape::tape(Subject {
        config: config.clone(),
        robot_description: robot.urdf.clone(),
        leg_names: Clone::clone(&leg_names),
        epoch_ns: if own_clock { u64::try_from(zero.as_nanos()).unwrap_or_default() } else { 0 },
        split_bytes: parameters.split_bytes,
        split_duration: parameters.split_duration,
    });
    let recording = Arc::new(recording);
    recording.listen(&node, &leg_names)?;
    let writer = std::thread::Builder::new().name("recording".into()).spawn(move || writer.run())?;
    if let Some(folder) = &parameters.record_folder {
        let folder = std::path::absolute(folder)?.join(tape::folder_name(since_epoch));
        // The robot walks without its recording; the fault stands in diagnostics until one begins.
        if let Err(reason) = recording.start(folder) {
            tracing::error!("no recording: {reason}");
        }
    }

    let desk = Arc::new(Desk::new(
        asked_in,
        gaits_in,
        Arc::clone(&recording),
        Arc::clone(&emergency_stop),
        config.clone(),
        lockstep,
    ));
    let speaker =
        (!on_bus).then(|| Speaker::new(&node, config.joint_names.clone(), commands, lockstep, fast)).transpose()?;
    let every = (parameters.state_every, parameters.joint_states_every);
    let press = Press::new(&node, config.joint_names, lockstep, every, fast, speaker, Arc::clone(&recording))?;
    let room = PressRoom { press, said, desk: Arc::clone(&desk), cycle_ended: Arc::clone(&cycle_ended) };
    let press = std::thread::Builder::new().name("press".into()).spawn(move || room.run())?;
    let cycle = Cycle {
        controller,
        tilts,
        asked,
        gaits,
        emergency_stop,
        tape,
        stop: Arc::clone(&stop),
        said: said_in,
        press: press.thread().clone(),
        start_on_gait: parameters.start_on_gait,
    };
    let (warnings_in, warnings) = sync_channel(1);
    let (pace, period, realtime) = (parameters.pace, parameters.period, parameters.realtime);
    // In lockstep the cycle follows the stamps and nothing else.
    let clock = if lockstep { CycleClock::JointStates } else { parameters.clock };
    let topics = DdsBus::new(states, commands_in, Some(press.thread().clone()), clock);
    let control = std::thread::Builder::new().name("control".into()).spawn(move || {
        // The receiver waits for it; the channel has room.
        let warn = move |list: Vec<Warning>| warnings_in.send(list).unwrap_or_default();
        match (bus, pace) {
            (Some(Bus::Mit(bus)), _) => cycle.run_realtime(bus, period, realtime, warn),
            (Some(Bus::Registers(bus)), _) => cycle.run_realtime(bus, period, realtime, warn),
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
    let wake = lockstep.then(|| control.thread().clone());
    // On a bus the cycle reads the drives itself and joint_states is what it publishes.
    let states = (!on_bus).then_some(states_in);
    desk.open(&node, Sensors { states, tilts: tilts_in, wake }, fast)?;
    let how = match (on_bus, lockstep) {
        (true, _) => "on CAN",
        (false, true) => "over DDS in lockstep",
        (false, false) => "over DDS in realtime",
    };
    tracing::info!("{}: disarmed, {how}", config.robot);

    // Wait for the end, then: the cycle's last command is damping, the press publishes it, the node leaves.
    let node_stop = node.stop();
    let (asked_to_stop_in, asked_to_stop) = sync_channel(1);
    node.spawn(async move {
        node_stop.requested().await;
        let _ = asked_to_stop_in.send(());
    });
    let _ = asked_to_stop.recv();
    stop.store(true, Ordering::Release);
    control.thread().unpark();
    let control_result = control.join();
    cycle_ended.store(true, Ordering::Release);
    press.thread().unpark();
    let press_result = press.join();
    recording.end();
    let writer_result = writer.join();
    let suspended = node.stop().was_suspended();
    node.shutdown();
    if suspended {
        anyhow::bail!("the process had been stopped and went on; it comes back disarmed when it is started again");
    }
    if control_result.is_err() || press_result.is_err() || writer_result.is_err() {
        anyhow::bail!("a thread panicked; the lines above say where");
    }
    Ok(())
}
