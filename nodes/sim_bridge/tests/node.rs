//! The node over real DDS between two processes: this test is the controller's side, the program built here is the
//! bridge.

use gait::{Gait, StepSide};
use ros::{Arguments, Node, Qos};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::sync::mpsc::{Receiver, channel};
use std::time::{Duration, Instant};
use tandem_msgs::JointCommand;
use tandem_msgs::diagnostic_msgs::DiagnosticArray;
use tandem_msgs::geometry_msgs::WrenchStamped;
use tandem_msgs::nav_msgs::Odometry;
use tandem_msgs::rosgraph_msgs::Clock;
use tandem_msgs::sensor_msgs::{Imu, JointState};
use tandem_msgs::std_msgs::Float64;
use tandem_msgs::std_srvs::{SetBool, SetBoolRequest, Trigger, TriggerRequest};
use tandem_msgs::tf2_msgs::TFMessage;

const PERIOD_NS: i64 = 1_000_000;
const PATIENCE: Duration = Duration::from_secs(20);

struct Bridge(Child);

impl Bridge {
    /// The bridge in a domain of its own, on this machine only.
    fn start(domain: u16, parameters: &[&str]) -> Self {
        let mut command = Command::new(env!("CARGO_BIN_EXE_tandem_sim_bridge"));
        command.arg("--ros-args");
        let robot = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config/robots/vision60");
        let robot = format!("robot:={}", robot.display());
        // The last value of a parameter is the one that holds.
        for parameter in ["mode:=lockstep", &robot].iter().chain(parameters) {
            command.args(["-p", parameter]);
        }
        command
            .env("ROS_DOMAIN_ID", domain.to_string())
            .env("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
            .stderr(Stdio::piped());
        Self(command.spawn().unwrap())
    }

    fn wait(mut self) -> (bool, String) {
        let start = Instant::now();
        while self.0.try_wait().unwrap().is_none() {
            assert!(start.elapsed() < PATIENCE, "the bridge did not end");
            std::thread::sleep(Duration::from_millis(20));
        }
        let mut text = String::new();
        std::io::Read::read_to_string(self.0.stderr.as_mut().unwrap(), &mut text).unwrap();
        (self.0.wait().unwrap().success(), text)
    }
}

impl Drop for Bridge {
    fn drop(&mut self) {
        // Already ended is as good.
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

fn node(name: &str, domain: u16) -> Node {
    Node::start(name, &Arguments::default().with_domain_id(domain)).unwrap()
}

fn states(node: &Node) -> Receiver<JointState> {
    let (sender, receiver) = channel();
    node.subscribe("joint_states", Qos::reliable(10), move |state: JointState| {
        // The test may have ended.
        let _ = sender.send(state);
    })
    .unwrap();
    receiver
}

fn call_pause(node: &Node, paused: bool) {
    let answer = node.client::<SetBool>("pause").unwrap().call(SetBoolRequest { data: paused }, PATIENCE).unwrap();
    assert!(answer.success, "{}", answer.message);
}

/// Runs the amble's law against a bridge for `cycles` periods and returns every state.
fn walk(domain: u16, cycles: usize) -> Vec<JointState> {
    let gait = Gait::from_json(include_str!("../../../tests/gaits/amble.json")).unwrap();
    let _bridge =
        Bridge::start(domain, &["start_paused:=true", "initial_posture:=stand", "joint_noise_rad:=0.01", "seed:=7"]);
    let node = node("test_controller", domain);
    let received = states(&node);
    let commands = node.publisher::<JointCommand>("joint_command", Qos::reliable(10)).unwrap();
    let mut history: Vec<JointState> = Vec::new();
    let mut released = false;
    while history.len() < cycles {
        let state = received.recv_timeout(PATIENCE).expect("a joint state");
        let stamp_ns = state.header.stamp.nanoseconds();
        let is_new = history.last().is_none_or(|last| last.header.stamp != state.header.stamp);
        if let Some(last) = history.last() {
            let expected = last.header.stamp.nanoseconds() + if is_new { PERIOD_NS } else { 0 };
            assert_eq!(stamp_ns, expected, "lockstep loses no period");
        }
        let steps = stamp_ns as f64 * 1e-9 / gait.step_duration_s;
        let index = steps.floor();
        let (position, velocity) = gait.reference(StepSide::of_step(index as u64), steps - index);
        let mut command = JointCommand {
            name: state.name.clone(),
            position: position.to_vec(),
            velocity: velocity.to_vec(),
            kp: gait.gains.kp.to_vec(),
            kd: gait.gains.kd.to_vec(),
            torque: vec![0.0; 12],
            ..Default::default()
        };
        command.header.stamp = state.header.stamp;
        commands.publish(command).unwrap();
        if is_new {
            history.push(state);
        }
        if !released {
            call_pause(&node, false);
            released = true;
        }
    }
    history
}

#[test]
fn two_runs_of_one_seed_are_the_same_to_the_bit() {
    let first = walk(41, 1500);
    let second = walk(41, 1500);
    assert_eq!(first.len(), second.len());
    for (a, b) in first.iter().zip(&second) {
        assert_eq!(a, b, "at {:?}", a.header.stamp);
    }
    // And it moved.
    let distance = first.iter().map(|s| (s.position[2] - first[0].position[2]).abs()).fold(0.0, f64::max);
    assert!(distance > 0.2, "{distance} rad at a knee");
    assert!(first.last().unwrap().effort.iter().any(|t| t.abs() > 1.0));
}

#[test]
fn without_a_controller_lockstep_ends_with_one_clear_error() {
    let (success, text) = Bridge::start(42, &["lockstep_timeout_s:=1.0"]).wait();
    assert!(!success);
    assert!(text.contains("no command with stamp 0.001000 s came on joint_command within 1 s"), "{text}");
    assert!(text.contains("Is the controller running"), "{text}");
}

#[test]
fn pause_step_and_reset_do_what_they_say() {
    let bridge = Bridge::start(43, &["start_paused:=true", "initial_posture:=stand"]);
    let node = node("test_client", 43);
    let received = states(&node);
    let commands = node.publisher::<JointCommand>("joint_command", Qos::reliable(10)).unwrap();
    let answer = |state: &JointState| {
        let mut command = JointCommand {
            name: state.name.clone(),
            position: state.position.clone(),
            velocity: vec![0.0; 12],
            kp: vec![100.0; 12],
            kd: vec![5.0; 12],
            torque: vec![0.0; 12],
            ..Default::default()
        };
        command.header.stamp = state.header.stamp;
        commands.publish(command).unwrap();
    };
    // Answers every state until one is at `stamp_ns` or later.
    let answer_until = |stamp_ns: i64| loop {
        let state = received.recv_timeout(PATIENCE).expect("a joint state");
        answer(&state);
        if state.header.stamp.nanoseconds() >= stamp_ns {
            return state;
        }
    };
    // Answers until time stands still: a paused bridge repeats its state every 50 ms.
    let answer_until_it_stands = || {
        let mut last = answer_until(0);
        let mut repeats = 0;
        while repeats < 5 {
            let state = answer_until(0);
            repeats = if state.header.stamp == last.header.stamp { repeats + 1 } else { 0 };
            last = state;
        }
        last
    };
    let still = answer_until_it_stands();
    assert_eq!(still.header.stamp.nanoseconds(), PERIOD_NS, "paused: no time passes");
    let step = node.client::<Trigger>("step").unwrap();
    assert!(step.call(TriggerRequest::default(), PATIENCE).unwrap().success);
    answer_until(2 * PERIOD_NS);
    assert_eq!(answer_until_it_stands().header.stamp.nanoseconds(), 2 * PERIOD_NS, "one period and no more");
    call_pause(&node, false);
    answer_until(11 * PERIOD_NS);
    assert!(!step.call(TriggerRequest::default(), PATIENCE).unwrap().success, "no single steps while it runs");
    call_pause(&node, true);
    let before = answer_until_it_stands();
    let reset = node.client::<Trigger>("reset").unwrap();
    assert!(reset.call(TriggerRequest::default(), PATIENCE).unwrap().success);
    let after = answer_until(before.header.stamp.nanoseconds() + PERIOD_NS);
    assert_eq!(
        after.header.stamp.nanoseconds(),
        before.header.stamp.nanoseconds() + PERIOD_NS,
        "time does not go back"
    );
    assert_eq!(after.position, still.position, "the same start");
    drop(bridge);
}

#[test]
fn a_can_interface_that_is_not_there_is_named() {
    let output = Command::new(env!("CARGO_BIN_EXE_tandem_sim_bridge"))
        .args(["--can", "nocan0,nocan1,nocan2,nocan3"])
        .env("ROS_DOMAIN_ID", "46")
        .env("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
        .output()
        .unwrap();
    let text = String::from_utf8(output.stderr).unwrap();
    assert!(!output.status.success());
    assert!(text.contains("nocan0 is down") && text.contains("ip link set nocan0 up"), "{text}");
}

#[test]
fn a_bad_parameter_is_one_clear_error() {
    for (parameter, expected) in [
        ("mode:=warp", "expected realtime or lockstep"),
        ("friction:=-1.0", "\"friction\": expected a value from 0.01 to 5, got -1"),
        ("control_period_s:=0.00075", "no multiple of timestep_s"),
        ("robot:=nowhere", "nowhere"),
    ] {
        let (success, text) = Bridge::start(44, &[parameter]).wait();
        assert!(!success, "{parameter}");
        let lines: Vec<&str> = text.lines().filter(|l| l.contains("tandem_sim_bridge:")).collect();
        assert!(lines.len() == 1 && lines[0].contains(expected), "{parameter}: {text}");
    }
}

/// Everything that a stream of one topic brought, with the thread that fills it.
fn listen<M: tandem_msgs::Message + Clone>(node: &Node, topic: &str, qos: Qos) -> Receiver<M> {
    let (sender, receiver) = channel();
    node.subscribe(topic, qos, move |message: M| {
        // The test may have ended.
        let _ = sender.send(message);
    })
    .unwrap();
    receiver
}

#[test]
fn in_realtime_every_topic_carries_what_it_says() {
    // The long timeout: a command that waits for a busy machine still holds.
    let start = ["mode:=realtime", "initial_posture:=stand", "push_duration_s:=0.2", "command_timeout_s:=10.0"];
    let _bridge = Bridge::start(45, &start);
    let node = node("test_listener", 45);
    let best_effort = Qos::best_effort(1);
    let states = listen::<JointState>(&node, "joint_states", best_effort);
    let imu = listen::<Imu>(&node, "imu", best_effort);
    let odom = listen::<Odometry>(&node, "odom", best_effort);
    let tf = listen::<TFMessage>(&node, "/tf", best_effort);
    let clock = listen::<Clock>(&node, "/clock", best_effort);
    let force = listen::<WrenchStamped>(&node, "ground_force/front_left", best_effort);
    let factor = listen::<Float64>(&node, "real_time_factor", best_effort);
    let diagnostics = listen::<DiagnosticArray>(&node, "/diagnostics", Qos::reliable(10));
    let description = listen::<tandem_msgs::std_msgs::String>(&node, "robot_description", Qos::latched());
    let commands = node.publisher::<JointCommand>("joint_command", best_effort).unwrap();
    let push = node.publisher::<WrenchStamped>("push", Qos::reliable(10)).unwrap();

    let first = states.recv_timeout(PATIENCE).expect("joint states");
    assert_eq!(first.name.len(), 12);
    // Hold the stand: the same command for every state, and one push in between.
    let hold = |state: &JointState| JointCommand {
        header: state.header.clone(),
        name: first.name.clone(),
        position: stand(),
        velocity: vec![0.0; 12],
        kp: vec![300.0; 12],
        kd: vec![10.0; 12],
        torque: vec![0.0; 12],
    };
    let reset = node.client::<Trigger>("reset").unwrap();
    assert!(reset.call(TriggerRequest::default(), PATIENCE).unwrap().success);
    let (mut begun_ns, mut simulated_ns, mut pushed, mut stamps) = (None, 0, false, Vec::new());
    while simulated_ns < 4_000_000_000_i64 {
        let state = states.recv_timeout(PATIENCE).expect("joint states");
        stamps.push(state.header.stamp);
        simulated_ns = state.header.stamp.nanoseconds() - *begun_ns.get_or_insert(state.header.stamp.nanoseconds());
        commands.publish(hold(&state)).unwrap();
        if !pushed && simulated_ns > 2_000_000_000 {
            pushed = true;
            let mut wrench = WrenchStamped::default();
            wrench.wrench.force.y = 150.0;
            push.publish(wrench).unwrap();
        }
    }
    assert!(stamps.windows(2).all(|pair| pair[0] < pair[1]), "joint states rise in time");
    let times: Vec<_> = clock.try_iter().map(|c| c.clock).collect();
    assert!(times.len() > 100 && times.windows(2).all(|pair| pair[0] < pair[1]), "the clock ticks once a step");
    let (imu, odom): (Vec<_>, Vec<_>) = (imu.try_iter().collect(), odom.try_iter().collect());
    let resting = &imu[imu.len() / 3];
    assert_eq!(resting.header.frame_id, "imu_link");
    assert!((resting.linear_acceleration.z - 9.81).abs() < 1.5, "{resting:?}");
    let settled = &odom[odom.len() / 3];
    assert_eq!((settled.header.frame_id.as_str(), settled.child_frame_id.as_str()), ("odom", "base_link"));
    assert!((0.5..0.65).contains(&settled.pose.pose.position.z), "{settled:?}");
    let fastest = odom.iter().map(|o| o.twist.twist.linear.y).fold(0.0, f64::max);
    assert!(fastest > 0.05, "the push moves the body to the left, {fastest} m/s at most");
    let transform = tf.try_iter().last().expect("a transform").transforms[0].clone();
    assert_eq!((transform.header.frame_id.as_str(), transform.child_frame_id.as_str()), ("odom", "base_link"));
    let forces: Vec<f64> = force.try_iter().map(|f| f.wrench.force.z).collect();
    let mean = forces.iter().sum::<f64>() / forces.len() as f64;
    assert!((40.0..160.0).contains(&mean), "a quarter of 373 N, more or less: {mean} N");
    let urdf = description.recv_timeout(PATIENCE).expect("a description").data;
    assert!(urdf.contains("<robot name=\"vision60\">"));
    let factors: Vec<f64> = factor.try_iter().map(|f| f.data).collect();
    println!("real-time factor on this machine, loaded as it is: {factors:?}");
    assert!(factors.iter().any(|f| (0.1..1.2).contains(f)), "{factors:?}");
    let status = diagnostics.try_iter().last().expect("diagnostics").status[0].clone();
    assert!(status.name.ends_with(": simulation") && status.values.iter().any(|v| v.key == "real_time_factor"));
}

fn stand() -> Vec<f64> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config/robots/vision60");
    robot::Robot::load(&folder).unwrap().stand_rad().to_vec()
}
