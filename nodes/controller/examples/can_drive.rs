//! The robot driven in balance over a kernel's CAN, as `tests/can/run --only can_drive` runs it in a virtual machine:
//! planner, controller (`backend:=can`, `balance:=true`) and the simulation bridge with emulated drives (`--can`) are
//! processes of their own, and this is their client. The inertial unit is a topic here.
//!
//!     can_drive FOLDER_OF_PROGRAMS SECONDS
//!
//! Plan, arm, stand up, walk, be asked by `cmd_vel` for 0.2 m/s for SECONDS, be pushed in the middle. It fails where it
//! does not walk all the while, or does not go as far.

#[path = "can_day/program.rs"]
#[allow(dead_code)]
mod program;

use program::Program;
use realtime::monotonic_now;
use ros::{Arguments, Client, Node, Qos};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;
use tandem_msgs::geometry_msgs::{Twist, WrenchStamped};
use tandem_msgs::nav_msgs::Odometry;
use tandem_msgs::std_srvs::{Trigger, TriggerRequest};
use tandem_msgs::{ControllerState, GenerateGait, GenerateGaitRequest};

type Failure = Box<dyn std::error::Error>;

const MS: Duration = Duration::from_millis(1);
/// A service's answer, and a mode, is waited for so long.
const PATIENCE: Duration = Duration::from_secs(20);
const ASKED_M_S: f64 = 0.2;
/// For 0.1 s, to the left.
const PUSH_N: f64 = 300.0;
/// A push that was none leaves it slower than this to the side.
const PUSHED_M_S: f64 = 0.15;
const ROBOT: &str = "--ros-args -p backend:=can -p balance:=true -p posture_speed_rad_s:=2.0 -p start_blend_s:=0.6 \
                     -p joint_states_rate_hz:=10.0 -r imu:=/sim/imu";
const BRIDGE: &str = "--can can0,can1,can2,can3 --ros-args -r __ns:=/sim -p mode:=realtime -p odometry_rate_hz:=20.0 \
                      -p imu_rate_hz:=200.0 -p timestep_s:=0.001";

fn main() {
    if let Err(failure) = run() {
        println!("can_drive: FAILED: {failure}");
        std::process::exit(1);
    }
    println!("can_drive: passed");
}

/// The newest of what was received, and the fastest that it went to the side, m/s.
#[derive(Clone, Default)]
struct Received {
    state: Option<ControllerState>,
    truth: Option<Odometry>,
    aside_m_s: f64,
}

struct Watched(Arc<Mutex<Received>>);

impl Watched {
    fn listen(node: &Node) -> Result<Self, Failure> {
        let received = Arc::new(Mutex::new(Received::default()));
        let to = Arc::clone(&received);
        node.subscribe("controller_state", Qos::reliable(10), move |state: ControllerState| {
            to.lock().unwrap_or_else(PoisonError::into_inner).state = Some(state);
        })?;
        let to = Arc::clone(&received);
        node.subscribe("/sim/odom", Qos::best_effort(1), move |truth: Odometry| {
            let mut received = to.lock().unwrap_or_else(PoisonError::into_inner);
            received.aside_m_s = received.aside_m_s.max(truth.twist.twist.linear.y.abs());
            received.truth = Some(truth);
        })?;
        Ok(Self(received))
    }

    fn now(&self) -> Received {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    fn wait(&self, what: &str, condition: impl Fn(&Received) -> bool) -> Result<(), Failure> {
        let deadline = monotonic_now() + PATIENCE;
        while !condition(&self.now()) {
            if monotonic_now() > deadline {
                let state = self.now().state.map(|state| (state.mode, state.fault));
                return Err(format!("{what}: not within {PATIENCE:?}; the controller: {state:?}").into());
            }
            std::thread::sleep(5 * MS);
        }
        Ok(())
    }

    fn mode(&self, mode: &str) -> Result<(), Failure> {
        self.wait(mode, |received| received.state.as_ref().is_some_and(|state| state.mode == mode))
    }

    /// It walks on for so long.
    fn walks_on(&self, seconds: f64, after: &str) -> Result<(), Failure> {
        let from = monotonic_now();
        while monotonic_now() - from < Duration::from_secs_f64(seconds) {
            std::thread::sleep(20 * MS);
            let state = self.now().state.ok_or("no controller_state")?;
            if state.mode != "walking" {
                return Err(format!("after {after} it no longer walks: {} {}", state.mode, state.fault).into());
            }
        }
        Ok(())
    }

    /// Simulated seconds, and the place ahead, m.
    fn place(&self) -> Result<(f64, f64), Failure> {
        let truth = self.now().truth.ok_or("no odometry")?;
        Ok((truth.header.stamp.seconds(), truth.pose.pose.position.x))
    }
}

fn run() -> Result<(), Failure> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [folder, seconds] = arguments.as_slice() else {
        return Err("usage: can_drive FOLDER_OF_PROGRAMS SECONDS".into());
    };
    let seconds: f64 = seconds.parse()?;
    let words = |text: &'static str| text.split_whitespace().collect::<Vec<_>>();
    let node = Node::start("can_drive", &Arguments::default())?;
    let watched = Watched::listen(&node)?;
    // As in can_day: the simulation plays the drives, which need no processor of the robot's.
    let mut bridge = Program::start(folder, "tandem_sim_bridge", &words(BRIDGE), -20)?;
    watched.wait("the simulation", |received| received.truth.is_some())?;
    let _planner = Program::start(folder, "tandem_planner", &[], 0)?;
    let mut controller = Program::start(folder, "tandem_controller", &words(ROBOT), 0)?;

    let generate: Client<GenerateGait> = node.client("generate_gait")?;
    let request = GenerateGaitRequest { behaviour: "amble".into(), ..GenerateGaitRequest::default() };
    let answer = generate.call(request, Duration::from_secs(120))?;
    if !answer.success {
        return Err(format!("generate_gait: {} {}", answer.status, answer.message).into());
    }
    watched.wait("the gait at the controller", |received| {
        received.state.as_ref().is_some_and(|state| state.gait == "amble")
    })?;
    let ask = node.publisher::<Twist>("cmd_vel", Qos::reliable(10))?;
    node.every(50 * MS, move || {
        let mut twist = Twist::default();
        twist.linear.x = ASKED_M_S;
        // One that is lost is followed by the next.
        let _ = ask.publish(twist);
    });
    let push = node.publisher::<WrenchStamped>("/sim/push", Qos::reliable(10))?;
    for name in ["arm", "stand", "walk"] {
        let service: Client<Trigger> = node.client(name)?;
        let answer = service.call(TriggerRequest::default(), PATIENCE)?;
        if !answer.success {
            return Err(format!("{name}: {}", answer.message).into());
        }
        std::thread::sleep(100 * MS);
    }
    watched.mode("walking")?;
    watched.walks_on(3.0, "a walk that grows out of standing")?;

    let (from_s, from_m) = watched.place()?;
    watched.walks_on(0.5 * seconds, "nothing")?;
    watched.0.lock().unwrap_or_else(PoisonError::into_inner).aside_m_s = 0.0;
    let mut wrench = WrenchStamped::default();
    wrench.wrench.force.y = PUSH_N;
    push.publish(wrench)?;
    watched.walks_on(0.5 * seconds, "a push")?;
    let ((to_s, to_m), aside_m_s) = (watched.place()?, watched.now().aside_m_s);
    println!(
        "can_drive: driven for {:.2} simulated seconds, {:.3} m/s of {ASKED_M_S} asked, pushed by {:.0} N s: {aside_m_s:.2} m/s aside",
        to_s - from_s,
        (to_m - from_m) / (to_s - from_s),
        0.1 * PUSH_N
    );
    controller.check("tandem_controller")?;
    bridge.check("tandem_sim_bridge")?;
    if aside_m_s < PUSHED_M_S {
        return Err("the push was none".into());
    }
    if to_m - from_m < 0.5 * ASKED_M_S * (to_s - from_s) {
        return Err("it does not go where it is driven".into());
    }
    node.shutdown();
    Ok(())
}
