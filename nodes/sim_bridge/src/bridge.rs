//! The node: the simulator behind topics and services.
//!
//! One thread steps the simulator and publishes; the middleware's threads only fill the [`Inbox`]. Stamps are the
//! simulation's own time, which begins one control period after zero (zero means "no time yet" to ROS 2) and never goes
//! back, not even at a reset.
//!
//! Lockstep: the joint state of a stamp is published, the command with that stamp awaited, the physics stepped to the next
//! stamp. While paused, or while no answer comes, the same state is published again every 50 ms of wall time, so that a
//! controller that starts late finds it.

use crate::config::{Config, Pace};
use crate::inbox::{Answer, Ask, Inbox, Request};
use crate::ports;
use robot::Robot;
use ros::{Node, PublishError, Publisher, Qos, RosError};
use simulator::drives::DriveBench;
use simulator::{Posture, Push, Simulator, SimulatorError};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::channel;
use std::time::{Duration, Instant};
use tandem_msgs::builtin_interfaces::Time;
use tandem_msgs::diagnostic_msgs::{DiagnosticArray, DiagnosticStatus, KeyValue};
use tandem_msgs::geometry_msgs::WrenchStamped;
use tandem_msgs::nav_msgs::Odometry;
use tandem_msgs::rosgraph_msgs::Clock;
use tandem_msgs::sensor_msgs::{Imu, JointState};
use tandem_msgs::std_msgs::{Float64, Header};
use tandem_msgs::std_srvs::{SetBool, SetBoolResponse, Trigger, TriggerResponse};
use tandem_msgs::tf2_msgs::TFMessage;

/// A state that is waited on is published again after this time.
const REPUBLISH: Duration = Duration::from_millis(50);
/// Serves subscriptions of either reliability; a slow one misses messages and holds up nobody.
const OFFERED: Qos = Qos::reliable(10);
/// A service gives up on the simulation's thread after this time.
const SERVICE_PATIENCE: Duration = Duration::from_secs(3);
/// Behind CAN nobody waits for the topics: joint states and clock are published every so many control periods.
const PUBLISH_EVERY: u64 = 4;
/// Behind CAN: how often frames are looked for between two control periods.
const FRAME_POLL: Duration = Duration::from_micros(200);
/// In realtime, what is more than this behind the wall clock is given up instead of being made up for.
const MAX_LAG: Duration = Duration::from_millis(50);
/// How often the real-time factor and diagnostics are published.
const REPORT_PERIOD: Duration = Duration::from_secs(1);

/// Why the bridge ends before it is asked to.
#[derive(Debug, thiserror::Error)]
pub enum BridgeError {
    /// The middleware.
    #[error(transparent)]
    Ros(#[from] RosError),
    /// The simulator.
    #[error(transparent)]
    Simulator(#[from] SimulatorError),
    /// No command answered a joint state in time.
    #[error(
        "lockstep: no command with stamp {stamp_s:.6} s came on {topic} within {waited_s} s{detail}. Is the controller running, \
         in lockstep mode, with the same ROS_DOMAIN_ID and namespace?"
    )]
    NoAnswer {
        /// The stamp waited for, s.
        stamp_s: f64,
        /// The topic.
        topic: String,
        /// How long, s.
        waited_s: f64,
        /// What came instead.
        detail: String,
    },
    /// A publisher failed in lockstep, where nothing may be lost.
    #[error("lockstep: {0}")]
    Publish(#[from] PublishError),
}

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
    /// Opens the topics and services and puts the robot down; it publishes and steps once it is activated. With `bench` the joints hang on emulated drives, and
    /// `joint_command` is not listened to.
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
        let commands = match config.pace {
            // Only the newest counts: nobody is to send an old one again.
            Pace::Realtime => Qos::best_effort(1),
            // Nothing may be lost between two processes that wait for each other.
            Pace::Lockstep => OFFERED,
        };
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
        let (to, names, refused) = (Arc::clone(&inbox), joint_names.clone(), Arc::clone(&refused_commands));
        if bench.is_none() {
            node.subscribe("joint_command", commands, move |message: tandem_msgs::JointCommand| {
                match ports::joint_command(&message, &names) {
                    Ok(command) => to.put_command(Answer { stamp_ns: message.header.stamp.nanoseconds(), command }),
                    Err(reason) => {
                        // Said once in ten thousand: a wrong publisher at 1 kHz must not fill the log.
                        if refused.fetch_add(1, Ordering::Relaxed).is_multiple_of(10_000) {
                            tracing::warn!("joint_command refused: {reason}");
                        }
                        to.put_refusal(reason);
                    }
                }
            })?;
        }
        let to = Arc::clone(&inbox);
        node.subscribe("push", Qos::reliable(10), move |message: WrenchStamped| {
            let f = message.wrench.force;
            let force = [f.x, f.y, f.z];
            if force.iter().any(|v| !v.is_finite()) {
                tracing::warn!("push refused: the force is {force:?}, expected finite numbers");
            } else if !to.put_request(Request { ask: Ask::Push(force), reply: None }) {
                tracing::warn!("push refused: too many requests are waiting");
            }
        })?;
        let to = Arc::clone(&inbox);
        node.serve::<SetBool>("pause", move |request| {
            let (success, message) = flatten(ask(&to, Ask::Pause(request.data)));
            SetBoolResponse { success, message }
        })?;
        for (service, what) in [("reset", Ask::Reset), ("step", Ask::Step)] {
            let to = Arc::clone(&inbox);
            node.serve::<Trigger>(service, move |_| {
                let (success, message) = flatten(ask(&to, what));
                TriggerResponse { success, message }
            })?;
        }

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

    fn publish_joint_states(&self) -> Result<(), PublishError> {
        let message =
            ports::joint_state(&self.simulator.state(), &self.joint_names, Time::from_nanoseconds(self.stamp_ns()));
        self.ports.joint_states.publish(message)
    }

    /// While paused: the joint states for a controller that comes now, and the time for nodes that follow `/clock`.
    fn publish_standing_time(&mut self) -> Result<(), PublishError> {
        if self.standing_time_published.is_none_or(|at| at.elapsed() >= REPUBLISH) {
            self.standing_time_published = Some(Instant::now());
            self.ports.clock.publish(Clock { clock: Time::from_nanoseconds(self.stamp_ns()) })?;
        }
        self.publish_joint_states()
    }

    /// Everything that belongs to a new stamp; joint states last, because they are what others wait for.
    fn publish_all(&mut self) -> Result<(), PublishError> {
        let stamp = Time::from_nanoseconds(self.stamp_ns());
        let state = self.simulator.state();
        // Behind topics every period is published, because the controller answers it.
        let publishes = self.bench.is_none() || self.period.is_multiple_of(PUBLISH_EVERY);
        if publishes {
            self.ports.clock.publish(Clock { clock: stamp })?;
        }
        if self.period.is_multiple_of(self.config.imu_every) {
            self.ports.imu.publish(ports::imu(&mut self.simulator, &self.frames, stamp))?;
        }
        if self.period.is_multiple_of(self.config.odometry_every) {
            self.ports.odom.publish(ports::odometry(&state, &self.frames, stamp))?;
            self.ports.tf.as_ref().map_or(Ok(()), |tf| tf.publish(ports::transform(&state, &self.frames, stamp)))?;
            for (port, force) in self.ports.ground_forces.iter().zip(state.toe_force_n) {
                port.publish(ports::ground_force(force, &self.frames, stamp))?;
            }
        }
        if publishes {
            self.ports.joint_states.publish(ports::joint_state(&state, &self.joint_names, stamp))?;
        }
        Ok(())
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

    /// Does what clients asked. True if the state has a new stamp by it (reset) or a single step is asked for.
    fn serve_requests(&mut self) -> Served {
        let mut served = Served::default();
        while let Some(request) = self.inbox.take_request() {
            let answer = match request.ask {
                Ask::Activate(active) => {
                    served.activated |= active && !self.active;
                    self.active = active;
                    Ok(if active { "active" } else { "inactive" }.to_owned())
                }
                _ if !self.active => Err("the simulation is not active: activate it (its service change_state)".into()),
                Ask::Pause(paused) => {
                    self.paused = paused;
                    Ok(if paused { "paused" } else { "running" }.to_owned())
                }
                Ask::Reset => {
                    put_down(&mut self.simulator, &self.config);
                    served.reset = true;
                    Ok(format!("the robot is put down: {}", self.config.initial_posture.get()))
                }
                Ask::Step if self.paused => {
                    served.single_steps += 1;
                    Ok(format!("one control period of {:?}", self.config.period))
                }
                Ask::Step => Err("the simulation is running: pause it first".into()),
                Ask::Push(force_n) => {
                    let push = Push {
                        start_s: self.simulator.time_s(),
                        duration_s: self.config.push_duration_s.get(),
                        force_n,
                    };
                    self.simulator.push(push).map(|()| "pushing".to_owned()).map_err(|e| e.to_string())
                }
            };
            if let Some(reply) = request.reply {
                // A client that has given up does not want the answer.
                let _ = reply.send(answer);
            }
        }
        if served.reset {
            self.period += 1;
        }
        served
    }

    fn run_lockstep(&mut self) -> Result<(), BridgeError> {
        if self.active {
            self.publish_all()?;
        }
        let mut single_steps = 0;
        let mut waiting_since = Instant::now();
        while !self.inbox.is_closed() {
            let served = self.serve_requests();
            single_steps += served.single_steps;
            if !self.active {
                self.inbox.wait_for_request(REPUBLISH);
                continue;
            }
            if served.reset || served.activated {
                self.publish_all()?;
                waiting_since = Instant::now();
            }
            self.report(Instant::now());
            if self.paused && single_steps == 0 {
                self.inbox.wait_for_request(REPUBLISH);
                self.publish_standing_time()?;
                waiting_since = Instant::now();
                continue;
            }
            let Some(answer) = self.inbox.wait_for_answer(self.stamp_ns(), REPUBLISH) else {
                let waited = waiting_since.elapsed();
                if waited > self.config.lockstep_timeout && !self.inbox.is_closed() {
                    return Err(self.no_answer(waited));
                }
                if waited >= REPUBLISH {
                    self.publish_joint_states()?;
                }
                continue;
            };
            self.simulator.command(&answer.command);
            self.advance();
            single_steps = u32::saturating_sub(single_steps, 1);
            self.publish_all()?;
            waiting_since = Instant::now();
        }
        Ok(())
    }

    fn no_answer(&self, waited: Duration) -> BridgeError {
        let detail = match (self.inbox.newest(), self.inbox.last_refusal()) {
            (_, Some(refusal)) => format!(" (the last command was refused: {refusal})"),
            (Some(answer), None) => format!(" (the newest command has stamp {:.6} s)", answer.stamp_ns as f64 * 1e-9),
            (None, None) => " (no command came at all)".into(),
        };
        BridgeError::NoAnswer {
            stamp_s: self.stamp_ns() as f64 * 1e-9,
            topic: "joint_command".into(),
            waited_s: waited.as_secs_f64().round(),
            detail,
        }
    }

    fn run_realtime(&mut self) -> Result<(), BridgeError> {
        let wall_period = self.config.period.div_f64(self.config.real_time_factor);
        let mut next = Instant::now();
        let mut used_stamp_ns = None;
        while !self.inbox.is_closed() {
            let served = self.serve_requests();
            if !self.active {
                self.rest();
                next = Instant::now();
                continue;
            }
            if self.paused && served.single_steps == 0 {
                if let Err(error) = self.publish_standing_time() {
                    self.note_failure(&error);
                }
                self.report(Instant::now());
                self.rest();
                next = Instant::now();
                continue;
            }
            for _ in 0..served.single_steps.max(1) {
                match self.inbox.newest() {
                    Some(answer) if Some(answer.stamp_ns) != used_stamp_ns => {
                        self.simulator.command(&answer.command);
                        used_stamp_ns = Some(answer.stamp_ns);
                    }
                    // The drives hold the last command, and damp when it grows too old.
                    Some(_) => self.counts.late_or_missing_commands += 1,
                    None => {}
                }
                self.advance();
                if let Err(error) = self.publish_all() {
                    self.note_failure(&error);
                }
            }
            self.report(Instant::now());
            next += wall_period;
            self.answer_until(next);
            let now = Instant::now();
            match next.checked_duration_since(now) {
                Some(early) => std::thread::sleep(early),
                None if now - next > MAX_LAG => {
                    self.counts.lag_given_up += now - next;
                    next = now;
                }
                None => {}
            }
        }
        Ok(())
    }

    /// While time stands still: waits for a request. Behind CAN frames are answered all the same.
    fn rest(&mut self) {
        self.inbox.wait_for_request(if self.bench.is_some() { self.config.period } else { REPUBLISH });
        self.answer_until(Instant::now() + self.config.period);
    }

    /// Behind CAN: goes on answering frames until just before `next`.
    fn answer_until(&mut self, next: Instant) {
        let Some(bench) = &mut self.bench else { return };
        let (q, v) = self.simulator.joints();
        while Instant::now() + FRAME_POLL < next {
            bench.answer(self.started.elapsed(), &q, &v);
            std::thread::sleep(FRAME_POLL);
        }
    }

    fn note_failure(&mut self, error: &PublishError) {
        self.counts.publish_failures += 1;
        if self.counts.publish_failures.is_power_of_two() && !self.inbox.is_closed() {
            tracing::warn!("{} messages not published; the last: {error}", self.counts.publish_failures);
        }
    }

    /// Once a second: real-time factor and diagnostics.
    fn report(&mut self, now: Instant) {
        let simulated_s = self.stamp_ns() as f64 * 1e-9;
        let Some((since, from_s)) = self.report else {
            self.report = Some((now, simulated_s));
            return;
        };
        let wall = now - since;
        if wall < REPORT_PERIOD {
            return;
        }
        self.report = Some((now, simulated_s));
        let factor = (simulated_s - from_s) / wall.as_secs_f64();
        let fallen = self.simulator.fallen();
        let stale = match &self.bench {
            None => self.simulator.command_is_stale(),
            Some(bench) => bench.following() == 0,
        };
        let (level, message) = match (fallen, stale, self.paused) {
            (Some(fall), _, _) => (DiagnosticStatus::ERROR, fall.to_string()),
            (None, _, true) => (DiagnosticStatus::OK, "paused".into()),
            (None, true, false) => (DiagnosticStatus::WARN, "no fresh command: the drives damp".into()),
            (None, false, false) => (DiagnosticStatus::OK, "running".into()),
        };
        let value = |key: &str, value: String| KeyValue { key: key.into(), value };
        let status = DiagnosticStatus {
            level,
            name: format!("{}: simulation", self.node_name),
            message,
            hardware_id: "mujoco".into(),
            values: vec![
                value("real_time_factor", format!("{factor:.3}")),
                value("simulated_s", format!("{simulated_s:.3}")),
                value("cycles", self.counts.cycles.to_string()),
                value("commands_late_or_missing", self.counts.late_or_missing_commands.to_string()),
                value("commands_refused", self.refused_commands.load(Ordering::Relaxed).to_string()),
                value("lag_given_up_s", format!("{:.3}", self.counts.lag_given_up.as_secs_f64())),
                value("publish_failures", self.counts.publish_failures.to_string()),
            ],
        };
        let mut status = status;
        if let Some(bench) = &self.bench {
            status.values.push(value("drives_following", bench.following().to_string()));
            status.values.push(value("replies_lost", bench.lost_replies().to_string()));
            status.values.push(value("hottest_drive_c", format!("{:.0}", bench.hottest_c())));
        }
        let header = Header { stamp: Time::from_nanoseconds(self.stamp_ns()), frame_id: String::new() };
        let sent = self
            .ports
            .real_time_factor
            .publish(Float64 { data: factor })
            .and_then(|()| self.ports.diagnostics.publish(DiagnosticArray { header, status: vec![status] }));
        if let Err(error) = sent {
            self.note_failure(&error);
        }
    }
}

fn put_down(simulator: &mut Simulator, config: &Config) {
    let posture = if config.initial_posture.get() == "stand" { Posture::Stand } else { Posture::Sit };
    simulator.reset_to_posture(posture);
}

/// What [`Bridge::serve_requests`] did.
#[derive(Clone, Copy, Debug, Default)]
struct Served {
    activated: bool,
    reset: bool,
    single_steps: u32,
}

/// Hands a request to the simulation's thread and waits for its answer.
pub(crate) fn ask(inbox: &Inbox, what: Ask) -> Result<String, String> {
    let (reply, answer) = channel();
    if !inbox.put_request(Request { ask: what, reply: Some(reply) }) {
        return Err("too many requests are waiting, or the simulation has ended".into());
    }
    answer.recv_timeout(SERVICE_PATIENCE).map_err(|_| "the simulation did not answer in time".to_owned())?
}

fn flatten(answer: Result<String, String>) -> (bool, String) {
    match answer {
        Ok(message) => (true, message),
        Err(message) => (false, message),
    }
}
