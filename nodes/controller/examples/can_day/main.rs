//! A day of the shipped programs on a kernel's CAN, as `tests/can/run` runs it in a virtual machine with the virtual
//! interfaces
//! `can0` to `can3`: planner, controller (`backend:=can`, the shipped wiring file) and the simulation bridge with
//! emulated drives (`--can`) are processes of their own, and this is their client. Nothing but the buses joins
//! controller and drives.
//!
//!     can_day FOLDER_OF_PROGRAMS SECONDS SECOND_CONTROLLERS [long]
//!
//! Doctor, plan, arm, stand up, walk SECONDS; then second controllers are started, the planner dies, the wall clock
//! jumps, the bus reports an error, goes off, an interface goes down, and the controller hangs. A long day goes on: the
//! controller comes back, dies and comes back again, and the robot dies. Each has a bound on the time until the robot
//! is safe, as a client sees it over DDS; 1 ms is a control cycle. Any failure ends it with exit status 1.

mod program;

use control::JOINTS;
use joint_bus::DriveModel;
use joint_bus::can::send_error_frame;
use program::Program;
use realtime::monotonic_now;
use ros::{Arguments, Client, Node, Qos};
use std::collections::VecDeque;
use std::process::Command;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;
use tandem_msgs::nav_msgs::Odometry;
use tandem_msgs::sensor_msgs::JointState;
use tandem_msgs::std_msgs::Float64;
use tandem_msgs::std_srvs::{Trigger, TriggerRequest};
use tandem_msgs::{
    ClearFault, ClearFaultRequest, ControllerState, GenerateGait, GenerateGaitRequest, LoadGait, LoadGaitRequest,
};

type Failure = Box<dyn std::error::Error>;

const MS: Duration = Duration::from_millis(1);
/// A service's answer is waited for so long, discovery included.
const PATIENCE: Duration = Duration::from_secs(20);
/// From the controller's cycle to this client: the message's way over DDS.
const ON_THE_WAY: Duration = Duration::from_millis(15);
/// The drives' watchdog.
const WATCHDOG_CYCLES: i64 = 20;
/// From a drive's torque to this client's eyes: two messages of joint states.
const SEEN_CYCLES: i64 = 8;
/// Silence of a drive that means damping, on CAN.
const STATE_TIMEOUT: Duration = Duration::from_millis(10);
/// A drive that damps gives −kd v within this, N m.
const DAMPING_TOLERANCE_NM: f64 = 1.5;
/// The last joint states that are kept.
const KEPT: usize = 1000;

fn main() {
    if let Err(failure) = run() {
        println!("can_day: FAILED: {failure}");
        std::process::exit(1);
    }
    println!("can_day: passed");
}

/// What was received.
#[derive(Default)]
struct Received {
    /// Every change of mode or fault, when it came in, on the monotonic clock; and the newest state of all.
    changes: Vec<(Duration, ControllerState)>,
    state: Option<(Duration, ControllerState)>,
    /// From the simulation: what the drives do, and when it came in on the monotonic clock.
    joints: VecDeque<(Duration, JointState)>,
    /// Simulated over wall time, once a second.
    factors: Vec<f64>,
    odometry: Option<Odometry>,
}

fn lock(received: &Mutex<Received>) -> MutexGuard<'_, Received> {
    received.lock().unwrap_or_else(PoisonError::into_inner)
}

struct Day {
    folder: String,
    planner: Program,
    controller: Program,
    bridge: Program,
    received: Arc<Mutex<Received>>,
    generate: Client<GenerateGait>,
    load: Client<LoadGait>,
    clear: Client<ClearFault>,
    triggers: Vec<Client<Trigger>>,
}

/// Services of the controller, and the simulation's own.
const TRIGGERS: [&str; 5] = ["arm", "disarm", "stand", "walk", "/sim/reset"];
/// Stood up faster than a real robot would be, because a second here takes many on the machine that plays it.
/// Topics are published less often than every millisecond for the same reason: the machine has one processor for
/// everything.
const CONTROLLER: [&str; 9] = [
    "--ros-args",
    "-p",
    "backend:=can",
    "-p",
    "posture_speed_rad_s:=2.0",
    "-p",
    "start_blend_s:=0.6",
    "-p",
    "joint_states_rate_hz:=10.0",
];
const BRIDGE: [&str; 13] = [
    "--can",
    "can0,can1,can2,can3",
    "--ros-args",
    "-r",
    "__ns:=/sim",
    "-p",
    "mode:=realtime",
    "-p",
    "odometry_rate_hz:=10.0",
    "-p",
    "imu_rate_hz:=10.0",
    "-p",
    "timestep_s:=0.001",
];

fn doctor(folder: &str) -> Result<(bool, String), Failure> {
    let output = Command::new(format!("{folder}/tandem"))
        .args(["doctor", "--bus", "config/hardware/vision60_can.toml", "--seconds", "0.3"])
        .output()?;
    let text = format!("{}{}", String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr));
    Ok((output.status.success(), text))
}

/// Folder, seconds, second controllers, whether the day is long.
fn arguments() -> Result<(String, f64, u32, bool), Failure> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let (folder, seconds, second, long) = match arguments.as_slice() {
        [folder, seconds, second] => (folder, seconds, second, false),
        [folder, seconds, second, long] if long == "long" => (folder, seconds, second, true),
        _ => return Err("usage: can_day FOLDER_OF_PROGRAMS SECONDS SECOND_CONTROLLERS [long]".into()),
    };
    Ok((folder.clone(), seconds.parse()?, second.parse()?, long))
}

fn run() -> Result<(), Failure> {
    let (folder, seconds, second, long) = arguments()?;

    // No robot: every drive is missed by its name.
    let (healthy, text) = doctor(&folder)?;
    if healthy || !text.contains("front_left_hip_roll") {
        return Err(format!("the doctor finds no fault with a robot that is not there:\n{text}").into());
    }
    println!("can_day: the doctor misses drives that do not answer");

    let node = Node::start("can_day", &Arguments::default())?;
    let received = Arc::new(Mutex::new(Received::default()));
    let to = Arc::clone(&received);
    node.subscribe("controller_state", Qos::reliable(10), move |state: ControllerState| {
        let mut received = lock(&to);
        let now = monotonic_now();
        let last = received.state.as_ref().map(|(_, last)| (last.mode.clone(), last.fault.clone()));
        if last != Some((state.mode.clone(), state.fault.clone())) {
            received.changes.push((now, state.clone()));
        }
        received.state = Some((now, state));
    })?;
    let to = Arc::clone(&received);
    node.subscribe("/sim/odom", Qos::best_effort(1), move |odometry: Odometry| lock(&to).odometry = Some(odometry))?;
    let to = Arc::clone(&received);
    node.subscribe("/sim/joint_states", Qos::best_effort(1), move |joints: JointState| {
        let mut received = lock(&to);
        if received.joints.len() == KEPT {
            received.joints.pop_front();
        }
        received.joints.push_back((monotonic_now(), joints));
    })?;

    let to = Arc::clone(&received);
    node.subscribe("/sim/real_time_factor", Qos::best_effort(1), move |factor: Float64| {
        lock(&to).factors.push(factor.data);
    })?;

    let bridge = Program::start(&folder, "tandem_sim_bridge", &BRIDGE, -20)?;
    wait(&received, Duration::from_secs(20), "the simulation's joint states", |received| !received.joints.is_empty())?;
    let (healthy, text) = doctor(&folder)?;
    for line in text.lines() {
        println!("can_day: {line}");
    }
    if !healthy {
        return Err("the doctor finds fault with a healthy robot".into());
    }

    let day = Day {
        folder: folder.clone(),
        planner: Program::start(&folder, "tandem_planner", &[], 0)?,
        controller: Program::start(&folder, "tandem_controller", &CONTROLLER, 0)?,
        bridge,
        received,
        generate: node.client("generate_gait")?,
        load: node.client("load_gait")?,
        clear: node.client("clear_fault")?,
        triggers: TRIGGERS.iter().map(|service| node.client(service)).collect::<Result<_, _>>()?,
    };
    let received = Arc::clone(&day.received);
    let result = day.run(seconds, second, long);
    node.shutdown();
    println!("can_day: simulated over wall time, second by second: {:.2?}", lock(&received).factors);
    result
}

fn wait(
    received: &Mutex<Received>,
    patience: Duration,
    what: &str,
    condition: impl Fn(&Received) -> bool,
) -> Result<(), Failure> {
    let deadline = monotonic_now() + patience;
    while !condition(&lock(received)) {
        if monotonic_now() > deadline {
            let received = lock(received);
            let state = received.state.as_ref().map(|(_, state)| (state.mode.clone(), state.fault.clone()));
            return Err(format!("{what}: not within {patience:?}; the controller: {state:?}").into());
        }
        std::thread::sleep(5 * MS);
    }
    Ok(())
}

fn ip_link(interface: &str, state: &str) -> Result<(), Failure> {
    let status = Command::new("ip").args(["link", "set", interface, state]).status()?;
    if status.success() { Ok(()) } else { Err(format!("ip link set {interface} {state}: {status}").into()) }
}

/// Whether drive `j` damps on its own: −kd v, of a velocity between two states: its torque is of the one before.
fn damps(states: &[&JointState], j: usize) -> bool {
    let own = |n: usize| -DriveModel::default().damping_kd * states[n].velocity[j];
    let [least, most] = [own(0).min(own(1)) - DAMPING_TOLERANCE_NM, own(0).max(own(1)) + DAMPING_TOLERANCE_NM];
    (least..most).contains(&states[1].effort[j])
}

impl Day {
    fn trigger(&self, name: &str) -> Result<(), Failure> {
        let n = TRIGGERS.iter().position(|service| *service == name).ok_or("no such service")?;
        let answer = self.triggers[n].call(TriggerRequest::default(), PATIENCE)?;
        if answer.success { Ok(()) } else { Err(format!("{name}: {}", answer.message).into()) }
    }

    fn state(&self) -> Result<ControllerState, Failure> {
        let received = lock(&self.received);
        received.state.as_ref().map(|(_, state)| state.clone()).ok_or_else(|| "no controller_state".into())
    }

    fn wait_for_mode(&self, mode: &str, patience: Duration) -> Result<(), Failure> {
        wait(&self.received, patience, mode, |received| {
            received.state.as_ref().is_some_and(|(_, state)| state.mode == mode)
        })
    }

    /// From wherever it is: disarmed, the robot put down, faults cleared, armed, stood up, walking.
    fn start_walking(&self) -> Result<(), Failure> {
        if self.state()?.mode != "disarmed" {
            self.trigger("disarm")?;
            self.wait_for_mode("disarmed", PATIENCE)?;
        }
        self.trigger("/sim/reset")?;
        // Until links are open again and no fault comes back.
        let deadline = monotonic_now() + PATIENCE;
        let mut quiet = 0;
        while quiet < 3 {
            if monotonic_now() > deadline {
                return Err(format!("faults come back: {}", self.state()?.fault).into());
            }
            let state = self.state()?;
            let names: Vec<&str> = state.fault.split(',').filter(|name| !name.is_empty()).collect();
            for name in &names {
                let _ = self.clear.call(ClearFaultRequest { name: (*name).into() }, PATIENCE)?; // refused if cleared
            }
            quiet = if names.is_empty() { quiet + 1 } else { 0 };
            std::thread::sleep(50 * MS);
        }
        self.trigger("arm")?;
        std::thread::sleep(100 * MS);
        self.trigger("stand")?;
        self.trigger("walk")?;
        self.wait_for_mode("walking", PATIENCE)
    }

    /// It walks on for this long without a word.
    fn walks_on(&mut self, seconds: f64, after: &str) -> Result<(), Failure> {
        let from = monotonic_now();
        while monotonic_now() - from < Duration::from_secs_f64(seconds) {
            std::thread::sleep(50 * MS);
            let state = self.state()?;
            if state.mode != "walking" {
                return Err(format!("after {after} it no longer walks: {} {}", state.mode, state.fault).into());
            }
        }
        self.controller.check("tandem_controller")?;
        self.bridge.check("tandem_sim_bridge")?;
        let received = lock(&self.received);
        let pose = received.odometry.as_ref().ok_or("no odometry")?.pose.pose;
        let (q, height) = (pose.orientation, pose.position.z);
        if 1.0 - 2.0 * (q.x * q.x + q.y * q.y) < 0.7 || height < 0.4 {
            return Err(format!("after {after} it has fallen: {height:.2} m high").into());
        }
        Ok(())
    }

    /// Waits until it is damped, and says how long after `since` a client saw it.
    fn safe_within(&self, since: Duration, bound: Duration, fault: &str, what: &str) -> Result<(), Failure> {
        let safe = |(at, state): &(Duration, ControllerState)| {
            *at >= since && (state.mode == "fault" || state.mode == "damping") && state.fault.contains(fault)
        };
        wait(&self.received, Duration::from_secs(2), what, |received| received.changes.iter().any(safe))?;
        let received = lock(&self.received);
        let (at, state) = received.changes.iter().find(|change| safe(change)).ok_or("no change")?;
        let took = *at - since;
        println!("can_day: {what}: {} ({}) seen after {:.1} ms", state.mode, state.fault, took.as_secs_f64() * 1e3);
        if took > bound + ON_THE_WAY {
            return Err(format!("{what}: safe after {took:?}, expected {bound:?}").into());
        }
        Ok(())
    }

    /// The simulation's time now, by the state of the last 0.2 s that was here soonest: they take up to 15 ms.
    fn simulated_ns(&self) -> Result<i64, Failure> {
        let received = lock(&self.received);
        let now = monotonic_now();
        let recent = received.joints.iter().rev().take_while(|(at, _)| now - *at < Duration::from_millis(200));
        let guesses = recent.map(|(at, state)| state.header.stamp.nanoseconds() + (now - *at).as_nanos() as i64);
        guesses.max().ok_or_else(|| "no joint states for 0.2 s".into())
    }

    /// Cycles from `since` (simulated ns) until each drive damps, five states on end: an impact turns a joint round.
    fn drives_damp_within(&self, since: i64, cycles: i64, what: &str) -> Result<(), Failure> {
        std::thread::sleep(300 * MS);
        let received = lock(&self.received);
        let states: Vec<&JointState> =
            received.joints.iter().map(|(_, state)| state).filter(|s| s.header.stamp.nanoseconds() > since).collect();
        let five_of = |j| states.windows(6).find(|six| six.windows(2).all(|two| damps(two, j)));
        let first = |j| five_of(j).map(|six| (six[1].header.stamp.nanoseconds() - since) / 1_000_000);
        let took = (0..JOINTS).map(first).try_fold(0, |last: i64, one| Some(last.max(one?)));
        let took = took.ok_or_else(|| format!("{what}: a drive never damps"))?;
        println!("can_day: {what}: the drives damp by themselves after {took} cycles");
        if took > cycles { Err(format!("{what}: {took} cycles, expected {cycles}").into()) } else { Ok(()) }
    }

    /// Since then every drive has braked or rested; by the velocity before, too: an impact may turn it round at once.
    fn no_drive_has_pushed(&self, since: i64) -> Result<(), Failure> {
        const NOISE_W: f64 = 0.5;
        let received = lock(&self.received);
        let states = received.joints.iter().filter(|(_, s)| s.header.stamp.nanoseconds() > since);
        for ((_, before), (_, state)) in states.clone().zip(states.skip(1)) {
            for (torque, (v0, v1)) in state.effort.iter().zip(before.velocity.iter().zip(&state.velocity)) {
                if (torque * v0).min(torque * v1) > NOISE_W {
                    return Err(format!("a drive gives {torque} N m at {v0} and {v1} rad/s").into());
                }
            }
        }
        Ok(())
    }

    /// It comes back disarmed, with the drives at rest, and is given a gait.
    fn restart_controller(&mut self) -> Result<(), Failure> {
        {
            let mut received = lock(&self.received);
            received.state = None;
            received.changes.clear();
        }
        self.controller = Program::start(&self.folder, "tandem_controller", &CONTROLLER, 0)?;
        wait(&self.received, PATIENCE, "the controller's return", |received| received.state.is_some())?;
        let first = lock(&self.received).changes.first().map(|(_, state)| state.mode.clone());
        if first.as_deref() != Some("disarmed") {
            return Err(format!("the controller comes back {first:?}, expected disarmed").into());
        }
        // It commands them to rest in its first cycles; until then they damp.
        wait(
            &self.received,
            Duration::from_millis(200),
            "drives at rest under a controller that has come back",
            |received| {
                received.joints.back().is_some_and(|(_, state)| state.effort.iter().all(|torque| *torque == 0.0))
            },
        )?;
        let json = include_str!("../../../../tests/gaits/amble.json");
        // The one before has ended without a word and is taken for present for a while; a request that only it was
        // there for gets no answer.
        let deadline = monotonic_now() + PATIENCE;
        let loaded = loop {
            match self.load.call(LoadGaitRequest { json: json.into() }, Duration::from_secs(2)) {
                Ok(loaded) => break loaded,
                Err(error) if monotonic_now() > deadline => return Err(error.into()),
                Err(_) => {}
            }
        };
        if !loaded.success {
            return Err(format!("load_gait: {}", loaded.message).into());
        }
        Ok(())
    }

    /// Started by mistake, with other names, so that nothing but the buses shows it: it says whose they are and
    /// ends, and the robot walks on.
    fn second_controllers(&mut self, times: u32) -> Result<(), Failure> {
        if times == 0 {
            return Ok(());
        }
        let arguments = [&CONTROLLER[..], &["-r", "__ns:=/second"]].concat();
        let master = format!("can0 has a master already, process {}", self.controller.id());
        for one in 1..=times {
            let (status, stderr) = Program::run(&self.folder, "tandem_controller", &arguments, PATIENCE)?;
            if status.success() || !stderr.contains(&master) {
                return Err(format!("a second controller ends with {status}, expected '{master}':\n{stderr}").into());
            }
            self.walks_on(0.1, "a second controller")?;
            println!("can_day: second controller {one} of {times} is refused with '{master}': walked on");
        }
        Ok(())
    }

    fn plan(&self) -> Result<(), Failure> {
        let request = GenerateGaitRequest { behaviour: "amble".into(), ..GenerateGaitRequest::default() };
        let answer = self.generate.call(request, Duration::from_secs(120))?;
        if !answer.success {
            return Err(format!("generate_gait: {} {}", answer.status, answer.message).into());
        }
        wait(&self.received, PATIENCE, "the gait at the controller", |received| {
            received.state.as_ref().is_some_and(|(_, state)| state.gait == "amble")
        })?;
        let (healthy, text) = doctor(&self.folder)?;
        if healthy || !text.contains("the drives were not asked") {
            return Err(format!("the doctor sent to drives that a controller commands:\n{text}").into());
        }
        println!("can_day: the doctor keeps silent where a controller runs");
        Ok(())
    }

    fn run(mut self, seconds: f64, second: u32, long: bool) -> Result<(), Failure> {
        self.plan()?;
        self.start_walking()?;
        self.walks_on(2.0, "a walk that grows out of standing")?;
        let x = |day: &Self| lock(&day.received).odometry.as_ref().map_or(0.0, |o| o.pose.pose.position.x);
        let (from_x, from_ns) = (x(&self), self.simulated_ns()?);
        self.walks_on(seconds, "nothing")?;
        let (went, took) = (x(&self) - from_x, (self.simulated_ns()? - from_ns) as f64 * 1e-9);
        println!("can_day: walked {took:.2} simulated seconds in {seconds} s on four buses, {went:.2} m ahead");
        if took < 0.98 * seconds || went < 0.25 * seconds {
            return Err("it did not walk as the gait says".into());
        }

        self.second_controllers(second)?;

        self.planner.kill()?;
        self.walks_on(0.5, "the planner's death")?;
        println!("can_day: the planner is killed: walked on");

        Command::new("date").args(["-s", "2037-01-01 00:00:00"]).output()?;
        self.walks_on(0.5, "a jump of the wall clock")?;
        println!("can_day: the wall clock jumps by years: walked on");

        send_error_frame("can0", 0x08, &[0; 8])?;
        self.walks_on(0.3, "an error frame")?;
        println!("can_day: an error frame: walked on");

        let since = monotonic_now();
        send_error_frame("can1", 0x40, &[0; 8])?;
        self.safe_within(since, 8 * MS, "bus_down", "bus-off")?;
        self.start_walking()?;
        self.walks_on(0.3, "recovery from bus-off")?;

        let since = monotonic_now();
        ip_link("can2", "down")?;
        // From here on `ip` has run too.
        self.safe_within(since.max(monotonic_now() - 8 * MS), 8 * MS, "bus_down", "interface down")?;
        std::thread::sleep(100 * MS);
        ip_link("can2", "up")?;
        self.start_walking()?;
        self.walks_on(0.3, "recovery from an interface down")?;

        // Hung: the drives' watchdogs damp; when it goes on it ends before a torque, because its connections are gone.
        let since = self.simulated_ns()?;
        self.controller.signal(19)?;
        self.drives_damp_within(since, WATCHDOG_CYCLES + SEEN_CYCLES, "the controller hangs")?;
        // Long enough to be distinguished from a busy machine.
        std::thread::sleep(300 * MS);
        self.controller.signal(18)?;
        let status = self.controller.wait(Duration::from_secs(10))?;
        if status.success() {
            return Err("a controller that was stopped and went on ends as if nothing had been".into());
        }
        self.no_drive_has_pushed(since + (WATCHDOG_CYCLES + SEEN_CYCLES) * 1_000_000)?;
        println!("can_day: the controller goes on, and ends with {status} without a torque");
        if long { self.goes_on() } else { Ok(()) }
    }

    fn goes_on(mut self) -> Result<(), Failure> {
        self.restart_controller()?;
        self.start_walking()?;
        self.walks_on(0.3, "recovery from a controller that hung")?;

        let since = self.simulated_ns()?;
        self.controller.kill()?;
        self.drives_damp_within(since, WATCHDOG_CYCLES + SEEN_CYCLES, "the controller is killed")?;
        self.restart_controller()?;
        self.start_walking()?;
        self.walks_on(1.0, "the controller's death and return")?;
        println!("can_day: the controller is killed and comes back: disarmed; stood up, walked again");

        let since = monotonic_now();
        self.bridge.kill()?;
        self.safe_within(
            since,
            STATE_TIMEOUT + 2 * MS,
            "stale_joint_state",
            "every drive silent (the robot is killed)",
        )?;

        self.controller.signal(15)?;
        let status = self.controller.wait(Duration::from_secs(10))?;
        if !status.success() {
            return Err(format!("SIGTERM ends the controller with {status}").into());
        }
        Ok(())
    }
}
