//! tandem_controller: walks a gait with the paper's PD law. Parameters, topics and services: docs/safety.md, docs/hardware.md.

use control::Controller;
use robot::Robot;
use ros::{Arguments, Node, Qos};
use rtrb::RingBuffer;
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::sync_channel;
use tandem_controller::config::{Pace, Parameters, find_folder};
use tandem_controller::cycle::{Cycle, EmergencyStop};
use tandem_controller::desk::{Desk, Sensors};
use tandem_controller::press::{Press, PressRoom};

fn main() -> ExitCode {
    match run() {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("tandem_controller: {error:#}");
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
    node.warn_of_unused_parameters();
    let robot = Robot::load(&find_folder(&parameters.robot_folder)?)?;
    let config = parameters.control(&robot);
    let controller = Controller::new(config.clone())?;
    let lockstep = parameters.pace == Pace::Lockstep;
    // Nothing may be lost between two processes that wait for each other; else only the newest counts.
    let fast = if lockstep { Qos::reliable(10) } else { Qos::best_effort(1) };

    let (states_in, states) = RingBuffer::new(256);
    let (tilts_in, tilts) = RingBuffer::new(64);
    let (asked_in, asked) = RingBuffer::new(64);
    let (gaits_in, gaits) = RingBuffer::new(16);
    let (said_in, said) = RingBuffer::new(1024);
    let emergency_stop = Arc::new(EmergencyStop::new(parameters.heartbeat));
    let stop = Arc::new(AtomicBool::new(false));
    let cycle_ended = Arc::new(AtomicBool::new(false));

    let desk = Arc::new(Desk::new(asked_in, gaits_in, Arc::clone(&emergency_stop), config.clone(), lockstep));
    let press = Press::new(&node, config.joint_names, lockstep, parameters.state_every, fast)?;
    let room = PressRoom { press, said, desk: Arc::clone(&desk), cycle_ended: Arc::clone(&cycle_ended) };
    let press = std::thread::Builder::new().name("press".into()).spawn(move || room.run())?;
    let cycle = Cycle {
        controller,
        states,
        tilts,
        asked,
        gaits,
        emergency_stop,
        stop: Arc::clone(&stop),
        said: said_in,
        press: press.thread().clone(),
        start_on_gait: parameters.start_on_gait,
    };
    let (warnings_in, warnings) = sync_channel(1);
    let control = std::thread::Builder::new().name("control".into()).spawn(move || match parameters.pace {
        Pace::Lockstep => {
            drop(warnings_in);
            cycle.run_lockstep();
        }
        Pace::Realtime => {
            cycle.run_realtime(parameters.period, parameters.clock, parameters.realtime, move |warnings| {
                // The receiver waits for it; the channel has room.
                let _ = warnings_in.send(warnings);
            })
        }
    })?;
    for warning in warnings.recv().unwrap_or_default() {
        tracing::warn!("{warning}");
    }
    let wake = lockstep.then(|| control.thread().clone());
    desk.open(&node, Sensors { states: states_in, tilts: tilts_in, wake }, fast)?;
    tracing::info!("{}: disarmed, {}", config.robot, if lockstep { "lockstep" } else { "realtime" });

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
    node.shutdown();
    if control_result.is_err() || press_result.is_err() {
        anyhow::bail!("a thread panicked; the lines above say where");
    }
    Ok(())
}
