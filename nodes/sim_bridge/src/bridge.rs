//! The node: the simulator behind topics and services.
//!
//! One thread steps the simulator and publishes; the middleware's threads only fill the [`Inbox`]. Stamps are the
//! simulation's own time, which begins one control period after zero (zero means "no time yet" to ROS 2) and never goes
//! back, not even at a reset.
//!
//! Lockstep: the joint state of a stamp is published, the command with that stamp awaited, the physics stepped to the
//! next stamp. While paused, or while no answer comes, the same state is published again every 50 ms of wall time, so
//! that a controller that starts late finds it.

mod clients;
mod error;
mod lockstep;
mod publishing;
mod realtime;
mod report;
mod requests;

pub(crate) use clients::ask;
pub use error::BridgeError;

use crate::config::{Config, Pace};
use crate::inbox::Inbox;
use crate::ports;
use robot::Robot;
use ros::{Node, Publisher, Qos};
use simulator::drives::DriveBench;
use simulator::{Posture, Simulator};
use std::sync::Arc;
use std::sync::atomic::AtomicU64;
use std::time::{Duration, Instant};
use tandem_msgs::diagnostic_msgs::DiagnosticArray;
use tandem_msgs::geometry_msgs::WrenchStamped;
use tandem_msgs::nav_msgs::Odometry;
use tandem_msgs::rosgraph_msgs::Clock;
use tandem_msgs::sensor_msgs::{Imu, JointState};
use tandem_msgs::std_msgs::Float64;
use tandem_msgs::tf2_msgs::TFMessage;

/// A state that is waited on is published again after this time.
const REPUBLISH: Duration = Duration::from_millis(50);
/// Serves subscriptions of either reliability; a slow one misses messages and holds up nobody.
const OFFERED: Qos = Qos::reliable(10);

struct Ports {
    joint_states: Publisher<JointState>,
    imu: Publisher<Imu>,
    odom: Publisher<Odometry>,
    tf: Option<Publisher<TFMessage>>,
    clock: Publisher<Clock>,
    ground_forces: Vec<Publisher<WrenchStamped>>,
    real_time_factor: Publisher<Float64>,
    diagnostics: Publisher<DiagnosticArray>,
    /// Latched, and held so that it stays there for those who come later.
    _robot_description: Publisher<tandem_msgs::std_msgs::String>,
}

/// Counts for diagnostics.
#[derive(Default)]
struct Counts {
    cycles: u64,
    lag_given_up: Duration,
    late_or_missing_commands: u64,
    publish_failures: u64,
}

/// The simulator behind topics; see the module.
pub struct Bridge {
    config: Config,
    simulator: Simulator,
    joint_names: [String; 12],
    frames: ports::Frames,
    node_name: String,
    ports: Ports,
    inbox: Arc<Inbox>,
    refused_commands: Arc<AtomicU64>,
    active: bool,
    paused: bool,
    /// Emulated drives on CAN, in place of `joint_command`.
    bench: Option<DriveBench>,
    started: Instant,
    /// Control periods since the program's start.
    period: u64,
    counts: Counts,
    report: Option<(Instant, f64)>,
    standing_time_published: Option<Instant>,
}

impl Bridge {
    /// Opens the topics and services and puts the robot down; it publishes and steps once it is activated. With `bench`
    /// the joints hang on emulated drives, and `joint_command` is not listened to.
    ///
    /// # Errors
    /// What the middleware or the simulator refuse.
    pub fn new(node: &Node, config: Config, robot: &Robot, bench: Option<DriveBench>) -> Result<Self, BridgeError> {
        let mut simulator = Simulator::new(robot, config.simulator.clone())?;
        // Before anybody can ask for anything: it takes its time.
        put_down(&mut simulator, &config);
        for note in robot.notes.iter().chain(simulator.notes()) {
            tracing::info!("robot '{}': {note}", robot.name);
        }
        let joint_names = robot.joint_names().map(|name| format!("{}{name}", config.joint_prefix));
        let frames = ports::Frames::new(&config.frame_prefix);
        let robot_description = node.publisher("robot_description", Qos::latched())?;
        robot_description.publish(tandem_msgs::std_msgs::String { data: robot.urdf.clone() })?;
        let ports = Ports {
            joint_states: node.publisher("joint_states", OFFERED)?,
            imu: node.publisher("imu", OFFERED)?,
            odom: node.publisher(if config.is_only_truth { "ground_truth/odom" } else { "odom" }, OFFERED)?,
            tf: (!config.is_only_truth).then(|| node.publisher("/tf", Qos::reliable(100))).transpose()?,
            clock: node.publisher("/clock", OFFERED)?,
            ground_forces: robot
                .legs
                .iter()
                .map(|leg| node.publisher(&format!("ground_force/{}", leg.name), OFFERED))
                .collect::<Result<_, _>>()?,
            real_time_factor: node.publisher("real_time_factor", OFFERED)?,
            diagnostics: node.publisher("/diagnostics", OFFERED)?,
            _robot_description: robot_description,
        };

        let inbox = Arc::new(Inbox::default());
        let refused_commands = Arc::new(AtomicU64::new(0));
        if bench.is_none() {
            clients::listen_to_commands(node, &config, joint_names.clone(), &inbox, &refused_commands)?;
        }
        clients::listen_to_requests(node, &inbox)?;

        Ok(Self {
            active: false,
            paused: config.start_paused,
            config,
            simulator,
            joint_names,
            frames,
            node_name: node.full_name(),
            ports,
            inbox,
            refused_commands,
            bench,
            started: Instant::now(),
            period: 1,
            counts: Counts::default(),
            report: None,
            standing_time_published: None,
        })
    }

    /// Whether it publishes and steps from the beginning.
    pub fn set_active(&mut self, active: bool) {
        self.active = active;
    }

    /// The inbox, to close it from the thread that watches for the program's end.
    pub fn inbox(&self) -> Arc<Inbox> {
        Arc::clone(&self.inbox)
    }

    /// Steps and publishes until the inbox is closed.
    ///
    /// # Errors
    /// In lockstep: no command, or what the middleware refuses.
    pub fn run(mut self) -> Result<(), BridgeError> {
        match self.config.pace {
            Pace::Realtime => self.run_realtime(),
            Pace::Lockstep => self.run_lockstep(),
        }
    }

    fn stamp_ns(&self) -> i64 {
        self.period as i64 * self.config.period.as_nanos() as i64
    }

    fn advance(&mut self) {
        for _ in 0..self.config.steps_per_period {
            match &mut self.bench {
                None => self.simulator.step(),
                Some(bench) => {
                    let (q, v) = self.simulator.joints();
                    // The drives live on the wall clock, as the frames do.
                    let now = self.started.elapsed();
                    bench.answer(now, &q, &v);
                    self.simulator.step_with_torque(&bench.torques(now, &q, &v));
                }
            }
        }
        self.period += 1;
        self.counts.cycles += 1;
    }
}

fn put_down(simulator: &mut Simulator, config: &Config) {
    let posture = if config.initial_posture.get() == "stand" { Posture::Stand } else { Posture::Sit };
    simulator.reset_to_posture(posture);
}
