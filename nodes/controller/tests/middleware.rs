//! The middleware's event thread panics or hangs under a walking robot: the robot is damped at once and the process
//! ends with an error. Each case runs in a process of its own, this same test program once more.

use control::{Config, Controller, JOINTS, JointCommand, PreparedGait};
use gait::Gait;
use joint_bus::memory::{MemoryLink, pair};
use joint_bus::{BusConfig, DriveBus, DriveModel, DriveRequest, EmulatedDrive, Incoming, Link, Mit, Protocol};
use realtime::{RealtimeRequest, monotonic_now};
use robot::Robot;
use ros::{Arguments, Node, Silence};
use rtrb::{Consumer, Producer, RingBuffer};
use std::path::Path;
use std::process::{Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::{Duration, Instant};
use tandem_controller::body_pose::BodyPoses;
use tandem_controller::cycle::{Cycle, Middleware};
use tandem_controller::dds_bus::{CycleClock, DEPTH, DdsBus};
use tandem_controller::emergency_stop::EmergencyStop;
use tandem_controller::messages::{CommandMessage, StateMessage};
use tandem_controller::recording::{self, Subject};

const MS: Duration = Duration::from_millis(1);
const PERIOD: Duration = MS;
const ROLE: &str = "TANDEM_TEST_ROLE";
const DOMAIN: u16 = 67;
/// `middleware_timeout_s` here. On an idle machine 15 ms hold; a machine that runs tests is late by tenths of a second.
const TIMEOUT: Duration = Duration::from_millis(200);
/// From the fault to damping, where the machine is not busy: the timeout and 5 ms; the rest is for one that is.
const DAMPED_WITHIN: Duration = Duration::from_millis(500);
/// From the fault to the end of the process: 2 s, and the time to see it.
const ENDED_WITHIN: Duration = Duration::from_millis(2500);

/// A robot that follows its commands to the letter, in its own thread, at the far end of a bus.
trait Far: Send + 'static {
    /// Takes the newest command and says where the joints are.
    fn act(&mut self, now: Duration, q: &mut [f64; JOINTS], v: &mut [f64; JOINTS]) -> Option<FarCommand>;
}

/// What a robot is commanded.
#[derive(Clone, Copy, PartialEq)]
enum FarCommand {
    Hold,
    Damp,
    Nothing,
}

/// Behind topics: what the middleware's callbacks and the publishers do, without the middleware.
struct Topics {
    states: Producer<StateMessage>,
    commands: Consumer<CommandMessage>,
}

impl Far for Topics {
    fn act(&mut self, now: Duration, q: &mut [f64; JOINTS], v: &mut [f64; JOINTS]) -> Option<FarCommand> {
        let mut last = None;
        while let Ok(message) = self.commands.pop() {
            last = Some(command_by(&message.command));
            follow(&message.command, q, v);
        }
        let state = StateMessage {
            stamp: now,
            wall: now,
            named: [true; JOINTS],
            position_rad: *q,
            velocity_rad_s: *v,
            torque_nm: None,
        };
        // A full buffer: the cycle is late, and takes the newest.
        let _ = self.states.push(state);
        last
    }
}

fn command_by(command: &JointCommand) -> FarCommand {
    if command.kp.iter().any(|kp| *kp > 0.0) {
        FarCommand::Hold
    } else if command.kd.iter().all(|kd| *kd > 0.0) {
        FarCommand::Damp
    } else {
        FarCommand::Nothing
    }
}

fn follow(command: &JointCommand, q: &mut [f64; JOINTS], v: &mut [f64; JOINTS]) {
    if command_by(command) == FarCommand::Hold {
        (*q, *v) = (command.position_rad, command.velocity_rad_s);
    }
}

/// On CAN: emulated drives.
struct Drives {
    config: BusConfig,
    links: Vec<MemoryLink>,
    drives: [EmulatedDrive; JOINTS],
    /// The joint side's commands as last received.
    command: JointCommand,
}

impl Far for Drives {
    fn act(&mut self, now: Duration, q: &mut [f64; JOINTS], v: &mut [f64; JOINTS]) -> Option<FarCommand> {
        let mut last = None;
        for n in 0..self.links.len() {
            while let Ok(Some(Incoming::Frame(frame, _))) = self.links[n].receive(now) {
                for j in (0..JOINTS).filter(|j| self.config.joints[*j].interface == n) {
                    let w = &self.config.joints[j];
                    let motor = |q: f64, v: f64| (w.sign * w.gear_ratio * (q - w.zero_rad), w.sign * w.gear_ratio * v);
                    let (motor_q, motor_v) = motor(q[j], v[j]);
                    let Some(reply) = self.drives[j].receive(&Mit::default(), &frame, now, motor_q, motor_v) else {
                        continue;
                    };
                    let request = Mit::default().decode_request(w.id, &w.ranges, &frame);
                    if let Some(DriveRequest::Command(command)) = request {
                        self.command.kp[j] = command.kp;
                        self.command.kd[j] = command.kd;
                        if command.kp > 0.0 {
                            q[j] = w.sign * command.position_rad / w.gear_ratio + w.zero_rad;
                            v[j] = w.sign * command.velocity_rad_s / w.gear_ratio;
                        }
                        last = Some(command_by(&self.command));
                    }
                    let _ = self.links[n].send(&reply, now);
                }
            }
        }
        last
    }
}

/// Times on the monotonic clock, ns; 0: not yet.
#[derive(Default)]
struct Seen {
    broken_ns: AtomicU64,
    walks: AtomicBool,
}

fn play(mut far: impl Far, mut q: [f64; JOINTS], mut v: [f64; JOINTS], seen: Arc<Seen>) {
    let mut periodic = realtime::Periodic::new(PERIOD);
    let mut damped = false;
    loop {
        periodic.wait();
        let now = monotonic_now();
        let Some(command) = far.act(now, &mut q, &mut v) else { continue };
        let broken = seen.broken_ns.load(Ordering::SeqCst);
        if command == FarCommand::Hold && broken == 0 {
            seen.walks.store(true, Ordering::SeqCst);
        }
        if command == FarCommand::Damp && broken > 0 && !std::mem::replace(&mut damped, true) {
            println!("DAMPED {:.3}", (now - Duration::from_nanos(broken)).as_secs_f64() * 1e3);
        }
    }
}

fn bus_config(robot: &Robot, config: &Config) -> BusConfig {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config/hardware/vision60_can.toml");
    let text = std::fs::read_to_string(file).unwrap();
    let wiring = BusConfig::from_toml_str(&text, &robot.name, &config.joint_names).unwrap();
    BusConfig { ask_before_arming: true, ..wiring }
}

fn both_ends() -> [Arc<Seen>; 2] {
    let seen = Arc::<Seen>::default();
    [Arc::clone(&seen), seen]
}

/// The process that is to end by itself: walks, then breaks the middleware.
fn walk_and_break(bus: &str, how: &str, timeout: Duration) {
    let begun = Instant::now();
    let node = Node::start("walker", &Arguments::default().with_domain_id(DOMAIN).supervised()).unwrap();
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let robot = Robot::load(&root.join("../../config/robots/vision60")).unwrap();
    let text = std::fs::read_to_string(root.join("../../tests/gaits/amble.json")).unwrap();
    let gait = Gait::from_json(&text).unwrap();
    let config = Config { simulation_start: true, state_timeout_s: 0.5, overrun_s: 0.5, ..Config::for_robot(&robot) };
    let prepared = PreparedGait::new(&gait, &config).unwrap();
    let (cycle_log, _recording, writer) = recording::open(Subject {
        config: config.clone(),
        robot_description: robot.urdf.clone(),
        leg_names: std::array::from_fn(|leg| robot.legs[leg].name.clone()),
        epoch_ns: 0,
        record_root: None,
        split_bytes: None,
        split_duration: None,
    });
    std::thread::spawn(move || writer.run());
    let health = node.stop().health();
    let (mut gaits, gaits_out) = RingBuffer::new(4);
    gaits.push((1, prepared)).map_err(drop).unwrap();
    let ((_inertial, inertial), (_asked, asked)) = (RingBuffer::new(4), RingBuffer::new(4));
    // Nobody prints: what does not fit is dropped.
    let (outputs, _outputs) = RingBuffer::new(4);
    let cycle = Cycle {
        controller: Controller::new(config.clone()).unwrap(),
        inertial,
        velocities: RingBuffer::new(1).1,
        body_poses: BodyPoses::default(),
        asked,
        gaits: gaits_out,
        emergency_stop: Arc::new(EmergencyStop::new(None)),
        middleware: Middleware::new(health.clone(), Some(timeout), PERIOD),
        cycle_log,
        stop: Arc::default(),
        outputs,
        publishers: std::thread::current(),
        start_on_gait: true,
    };
    let (q, v) = (gait.initial.joint_position_rad, gait.initial.joint_velocity_rad_s);
    let [seen, observer] = both_ends();
    let realtime = RealtimeRequest { priority: Some(80), ..RealtimeRequest::default() };
    if bus == "can" {
        let config = bus_config(&robot, &config);
        let (near, links): (Vec<_>, Vec<_>) = config.interfaces.iter().map(|_| pair()).unzip();
        let drives = config.joints.each_ref().map(|j| EmulatedDrive::new(j.id, j.ranges, DriveModel::default()));
        let bus = DriveBus::new(config.clone(), Mit::default(), near);
        let far = Drives { config, links, drives, command: JointCommand::LIMP };
        std::thread::spawn(move || play(far, q, v, observer));
        std::thread::spawn(move || cycle.run_realtime(bus, PERIOD, realtime, |_| {}));
    } else {
        let (states_in, states) = RingBuffer::new(DEPTH);
        let (commands_in, commands) = RingBuffer::new(DEPTH);
        let bus = DdsBus::new(states, commands_in, None, CycleClock::Monotonic, MS);
        let far = Topics { states: states_in, commands };
        std::thread::spawn(move || play(far, q, v, observer));
        std::thread::spawn(move || cycle.run_realtime(bus, PERIOD, realtime, |_| {}));
    }
    let deadline = Instant::now() + Duration::from_secs(60);
    while !seen.walks.load(Ordering::SeqCst) {
        assert!(Instant::now() < deadline, "it does not walk");
        std::thread::sleep(MS);
    }
    std::thread::sleep(300 * MS);
    println!("WALKS {}", !health.has_failed());
    println!("BREAKS_AT {:.6}", begun.elapsed().as_secs_f64());
    seen.broken_ns.store(monotonic_now().as_nanos() as u64, Ordering::SeqCst);
    health.fail_event_loop_for_test(how == "hang");
    let stop = node.stop();
    node.run();
    // As the programs do.
    if let Some(failure) = stop.failure() {
        eprintln!("{failure}");
        std::process::exit(1);
    }
}

/// Prints for how long the middleware's threads stand still at most, as a cycle sees it.
fn measure(seconds: u64) {
    let node = Node::start("walker", &Arguments::default().with_domain_id(DOMAIN)).unwrap();
    let health = node.stop().health();
    println!("raised: {:?}", realtime::raise_threads(&ros::THREADS, 10));
    for warning in (RealtimeRequest { priority: Some(80), ..RealtimeRequest::default() }).apply() {
        println!("{warning}");
    }
    let mut periodic = realtime::Periodic::new(PERIOD);
    let mut silence = Silence::new(2 * PERIOD);
    let mut counts = [[0_u32; 6]; 2];
    let mut most = [Duration::ZERO; 2];
    let mut last = [Duration::ZERO; 2];
    for _ in 0..1000 * seconds {
        periodic.wait();
        let silent = silence.look(health.turns(), monotonic_now());
        for n in 0..2 {
            most[n] = most[n].max(silent[n]);
            // It turned: how long had it been silent?
            if silent[n] < last[n] {
                for (count, limit) in counts[n].iter_mut().zip([8, 10, 15, 20, 50, 100]) {
                    *count += u32::from(last[n] > limit * MS);
                }
            }
        }
        last = silent;
    }
    println!("event loop, workers: most {most:?}, silences above 8, 10, 15, 20, 50, 100 ms: {counts:?}");
}

/// What the child does, which is this program with one test chosen and a role in its environment.
fn play_role(role: &str) {
    let parts: Vec<&str> = role.split(' ').collect();
    match parts.as_slice() {
        ["measure", seconds] => measure(seconds.parse().unwrap()),
        [bus, how, timeout_ms] => walk_and_break(bus, how, timeout_ms.parse::<u32>().unwrap() * MS),
        _ => panic!("{ROLE} is {role:?}, expected BUS HOW TIMEOUT_MS or measure SECONDS"),
    }
}

/// The test that plays a role when it has one.
const PANICS: &str = "an_event_thread_that_panics_damps_the_robot_and_ends_the_process";

fn breaks(bus: &str, how: &str) {
    let timeout = TIMEOUT.as_millis();
    let child = Command::new(std::env::current_exe().unwrap())
        .args(["--exact", PANICS, "--nocapture", "--test-threads=1"])
        .env(ROLE, format!("{bus} {how} {timeout}"))
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let begun = Instant::now();
    let output = child.wait_with_output().unwrap();
    let took = begun.elapsed();
    let (text, log) = (String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr));
    let command = |what: &str| {
        let line = text.lines().find_map(|line| line.split_once(what));
        line.map(|(_, value)| value.trim().to_owned()).unwrap_or_else(|| panic!("no {what}:\n{text}\n{log}"))
    };
    assert_eq!(command("WALKS"), "true", "nothing had failed before:\n{log}");
    let damped = Duration::from_secs_f64(command("DAMPED").parse::<f64>().unwrap() / 1e3);
    assert!(damped < DAMPED_WITHIN, "damped after {damped:?}");
    let lived = Duration::from_secs_f64(command("BREAKS_AT").parse().unwrap());
    let ended = took.saturating_sub(lived);
    assert!(ended < ENDED_WITHIN, "the process ended after {ended:?}");
    assert_eq!(output.status.code(), Some(1), "{log}");
    let why = if how == "hang" { "the middleware's event thread stands still" } else { "a thread panicked: RustDDS" };
    assert!(log.contains(why), "{log}");
    println!("{bus}, {how}: damped after {damped:?}, ended after {ended:?}");
}

#[test]
fn an_event_thread_that_panics_damps_the_robot_and_ends_the_process() {
    if let Ok(role) = std::env::var(ROLE) {
        return play_role(&role);
    }
    breaks("dds", "panic");
    breaks("can", "panic");
}

#[test]
fn an_event_thread_that_hangs_damps_the_robot_and_ends_the_process() {
    breaks("dds", "hang");
    breaks("can", "hang");
}
