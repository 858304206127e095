//! The contract of every joint bus, kept by the topics `joint_states` and `joint_command` over real DDS between two
//! nodes.

use control::{JOINTS, JointCommand};
use joint_bus::{ContractBench, JointBus, Readings, check_contract};
use ros::{Arguments, Node, Publisher, Qos};
use rtrb::{Consumer, Producer, RingBuffer};
use std::sync::Arc;
use std::sync::mpsc::{Receiver, channel};
use std::time::{Duration, Instant};
use tandem_controller::dds_bus::{CommandPublisher, CycleClock, DEPTH, DdsBus, listen};
use tandem_controller::messages::{CommandMessage, StateMessage};
use tandem_controller::others::OtherPublishers;
use tandem_msgs::builtin_interfaces::Time;
use tandem_msgs::sensor_msgs::JointState;

const DOMAIN: u16 = 61;
const PATIENCE: Duration = Duration::from_secs(20);
const MS: Duration = Duration::from_millis(1);
/// Time runs on for so long without a state.
const GAP: Duration = Duration::from_millis(200);

/// The controller's side in one node, a robot of the bench's in another.
struct Bench {
    bus: DdsBus,
    commands_out: CommandPublisher,
    states: Publisher<JointState>,
    commands: Receiver<tandem_msgs::JointCommand>,
    names: [String; JOINTS],
    /// The stamp of the last joint state.
    answered: Option<Duration>,
    command: JointCommand,
    _nodes: [Node; 2],
}

impl Bench {
    fn new() -> Self {
        let node = |name| Node::start(name, &Arguments::default().with_domain_id(DOMAIN)).unwrap();
        let (controller, robot) = (node("contract_controller"), node("contract_robot"));
        let names: [String; JOINTS] = std::array::from_fn(|j| format!("joint_{j}"));
        let (states_in, mut states_out) = RingBuffer::new(DEPTH);
        let (mut commands_in, commands) = RingBuffer::new(DEPTH);
        let qos = Qos::reliable(10);
        listen(&controller, names.clone(), states_in, Some(std::thread::current()), qos, Arc::default()).unwrap();
        let mut commands_out = CommandPublisher::new(&controller, names.clone(), commands, true).unwrap();
        let (sender, receiver) = channel();
        robot
            .subscribe("joint_command", qos, move |message: tandem_msgs::JointCommand| {
                // The test may have ended.
                let _ = sender.send(message);
            })
            .unwrap();
        let states = robot.publisher("joint_states", qos).unwrap();
        let deadline = Instant::now() + PATIENCE;
        while robot.publisher_count("joint_command") == 0
            || controller.publisher_count("joint_states") == 0
            || robot.subscription_count("joint_states") == 0
            || controller.subscription_count("joint_command") == 0
        {
            assert!(Instant::now() < deadline, "the nodes do not find each other");
            std::thread::sleep(Duration::from_millis(20));
        }
        // Known is not yet connected: until one of each has arrived, and it is the last.
        connect(|probe| {
            states.publish(state(probe, &names, &[0.0; JOINTS], &[0.0; JOINTS], None)).unwrap();
            std::thread::sleep(10 * MS);
            std::iter::from_fn(|| states_out.pop().ok()).any(|arrived| arrived.stamp == probe)
        });
        connect(|probe| {
            let message = CommandMessage { stamp: probe, command: JointCommand::LIMP, drives_on: false };
            commands_in.push(message).unwrap();
            commands_out.publish_next().unwrap().unwrap();
            std::thread::sleep(10 * MS);
            receiver.try_iter().any(|arrived| arrived.header.stamp.nanoseconds() == probe.as_nanos() as i64)
        });
        Self {
            bus: DdsBus::new(states_out, commands_in, None, CycleClock::JointStates, GAP),
            commands_out,
            states,
            commands: receiver,
            names,
            answered: None,
            command: JointCommand::LIMP,
            _nodes: [controller, robot],
        }
    }

    /// Brings the newest command over the topic.
    fn fetch(&mut self) {
        let mut expected = 0;
        while let Some(sent) = self.commands_out.publish_next() {
            sent.unwrap();
            expected += 1;
        }
        for _ in 0..expected {
            let message = self.commands.recv_timeout(PATIENCE).expect("the command over DDS");
            assert_eq!(message.name, self.names);
            let stamp = Duration::from_nanos(message.header.stamp.nanoseconds() as u64);
            assert!(Some(stamp) <= self.answered, "a command answers a state that was read");
            let list = |values: &[f64]| std::array::from_fn(|j| values[j]);
            self.command = JointCommand {
                position_rad: list(&message.position),
                velocity_rad_s: list(&message.velocity),
                kp: list(&message.kp),
                kd: list(&message.kd),
                torque_nm: list(&message.torque),
            };
        }
    }
}

/// Sends probes, each with a stamp of its own, until one has arrived.
fn connect(mut arrives: impl FnMut(Duration) -> bool) {
    let deadline = Instant::now() + PATIENCE;
    let mut probe = Duration::ZERO;
    while !arrives(probe) {
        assert!(Instant::now() < deadline, "nothing arrives over DDS");
        probe += Duration::from_nanos(1);
    }
}

fn state(
    stamp: Duration,
    names: &[String; JOINTS],
    q: &[f64; JOINTS],
    v: &[f64; JOINTS],
    silent: Option<usize>,
) -> JointState {
    let spoken: Vec<usize> = (0..JOINTS).filter(|j| Some(*j) != silent).collect();
    let mut message = JointState {
        name: spoken.iter().map(|j| names[*j].clone()).collect(),
        position: spoken.iter().map(|j| q[*j]).collect(),
        velocity: spoken.iter().map(|j| v[*j]).collect(),
        effort: Vec::new(),
        ..JointState::default()
    };
    message.header.stamp = Time::from_nanoseconds(stamp.as_nanos() as i64);
    message
}

impl ContractBench for Bench {
    fn bus(&mut self) -> &mut dyn JointBus {
        &mut self.bus
    }

    fn act(&mut self, now: Duration, q: &[f64; JOINTS], v: &[f64; JOINTS], silent: Option<usize>) -> [f64; JOINTS] {
        self.fetch();
        self.states.publish(state(now, &self.names, q, v, silent)).unwrap();
        self.answered = Some(now);
        let deadline = Instant::now() + PATIENCE;
        while !self.bus.has_waiting() {
            assert!(Instant::now() < deadline, "the joint state over DDS");
            std::thread::park_timeout(Duration::from_millis(5));
        }
        self.command.torque(q, v)
    }

    fn tolerance(&self) -> (f64, f64) {
        (0.0, 0.0)
    }
}

#[test]
fn topics_over_dds() {
    check_contract(&mut Bench::new());
}

fn bus(clock: CycleClock) -> (DdsBus, Producer<StateMessage>, Consumer<CommandMessage>) {
    let (states_in, states) = RingBuffer::new(DEPTH);
    let (commands_in, commands) = RingBuffer::new(DEPTH);
    (DdsBus::new(states, commands_in, None, clock, GAP), states_in, commands)
}

fn message(stamp: Duration, wall: Duration) -> StateMessage {
    StateMessage {
        stamp,
        wall,
        named: [true; JOINTS],
        position_rad: [0.1; JOINTS],
        velocity_rad_s: [0.0; JOINTS],
        torque_nm: None,
    }
}

#[test]
fn time_is_the_stamps_and_runs_on_between_them() {
    let (mut bus, mut states, _commands) = bus(CycleClock::JointStates);
    assert_eq!(bus.now(1000 * MS), Duration::ZERO);
    states.push(message(5 * MS, 1000 * MS)).unwrap();
    assert_eq!(bus.now(1002 * MS), 7 * MS);
    // Paused: the same stamp again keeps time where it is, and the source counts as alive.
    states.push(message(5 * MS, 1050 * MS)).unwrap();
    assert_eq!(bus.now(1050 * MS), 7 * MS);
    let mut readings = Readings::default();
    bus.read(7 * MS, &mut readings);
    assert_eq!(readings.joint_state().unwrap().arrived, [5 * MS; JOINTS]);
    // The simulation begins anew: so does time.
    states.push(message(MS, 1060 * MS)).unwrap();
    assert_eq!(bus.now(1060 * MS), MS);
}

/// A simulation that stood still for a minute without a word was minutes old to a controller that had gone on counting.
#[test]
fn after_a_gap_of_any_length_states_are_fresh_again_within_the_patience() {
    let (mut bus, mut states, _commands) = bus(CycleClock::JointStates);
    states.push(message(5 * MS, 1000 * MS)).unwrap();
    assert_eq!(bus.now(1000 * MS), 5 * MS);
    assert_eq!(bus.now(61_000 * MS), 205 * MS);
    // Its time stood still too. The controller's waits for it, and never runs backwards.
    let mut caught_up = None;
    for n in 1..=400_u32 {
        states.push(message((5 + n) * MS, (61_000 + n) * MS)).unwrap();
        let now = bus.now((61_000 + n) * MS);
        assert!(now >= 205 * MS);
        if now == (5 + n) * MS {
            caught_up.get_or_insert(n);
        }
    }
    assert_eq!(caught_up, Some(200));
}

#[test]
fn on_the_machines_clock_a_source_that_repeats_itself_grows_stale() {
    let (mut bus, mut states, _commands) = bus(CycleClock::Monotonic);
    states.push(message(5 * MS, 1000 * MS)).unwrap();
    states.push(message(5 * MS, 1050 * MS)).unwrap();
    assert_eq!(bus.now(1060 * MS), 1060 * MS);
    let mut readings = Readings::default();
    bus.read(1060 * MS, &mut readings);
    assert_eq!(readings.joint_state().unwrap().arrived, [1000 * MS; JOINTS]);
    assert_eq!(readings.joint_state().unwrap().stamp, 5 * MS);
}

#[test]
fn commands_answer_the_newest_state_and_a_stalled_publisher_is_counted() {
    let (mut bus, mut states, mut commands) = bus(CycleClock::JointStates);
    bus.write(&JointCommand::LIMP, true, MS);
    assert!(commands.pop().is_err(), "nothing to answer");
    states.push(message(5 * MS, 1000 * MS)).unwrap();
    bus.now(1000 * MS);
    for _ in 0..DEPTH + 3 {
        bus.write(&JointCommand { kp: [9.0; JOINTS], ..JointCommand::LIMP }, false, 5 * MS);
    }
    let sent = commands.pop().unwrap();
    assert_eq!((sent.stamp, sent.command), (5 * MS, JointCommand::LIMP), "off is limp");
    assert_eq!((bus.health().links[0].sent, bus.health().links[0].full), (DEPTH as u64, 3));
}

#[test]
fn another_publisher_of_commands_is_a_fault_in_the_cycle_that_follows_and_can_be_cleared_when_it_left() {
    let (bus, mut states, _commands) = bus(CycleClock::Monotonic);
    let others = OtherPublishers::default();
    let mut bus = bus.beside(others.clone());
    states.push(message(5 * MS, 5 * MS)).unwrap();
    assert_eq!(bus.now(6 * MS), 6 * MS);
    assert_eq!(bus.fault(6 * MS), None);
    others.set(1);
    let report = bus.fault(7 * MS).expect("a fault");
    assert_eq!((report.fault, report.joint, report.value), (control::Fault::SecondController, None, 1.0));
    let names = std::array::from_fn(|j| format!("joint_{j}"));
    assert!(report.message(&names).contains("1.0000 other publishers of joint_command"), "{}", report.message(&names));
    others.set(0);
    assert_eq!(bus.fault(8 * MS), None);
}
