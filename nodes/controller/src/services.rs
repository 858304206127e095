//! Callbacks and services: turn messages into values, refuse what is wrong with them, put the rest into the cycle's
//! buffers.

use crate::command_gait::CommandGaits;
use crate::cycle::{Asked, TimedInertial};
use crate::dds_bus;
use crate::emergency_stop::{EmergencyStop, PUBLISHERS};
use crate::inputs::{InputProblems, Topic};
use crate::lease::{Gate, Lease};
use crate::messages::StateMessage;
use crate::ports;
use crate::recording::{self, Recording};
use control::{Config, Fault, JOINTS, Mode, PreparedGait, Refusal, Request};
use gait::Gait;
use realtime::monotonic_now;
use ros::{Node, ProgramId, Qos, RosError, ServeOptions};
use rtrb::Producer;
use std::collections::HashMap;
use std::sync::mpsc::{RecvTimeoutError, Sender, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::Thread;
use std::time::{Duration, Instant};
use tandem_msgs::std_srvs::{SetBool, SetBoolRequest, SetBoolResponse, Trigger, TriggerResponse};
use tandem_msgs::text::{NAME_CHARS, SENTENCE_CHARS, printable};
use tandem_msgs::{
    Claim, ClaimResponse, ClearFault, ClearFaultResponse, LoadGait, LoadGaitResponse, Service, StartRecording,
    StartRecordingResponse, StopRecording, StopRecordingResponse, sensor_msgs, std_msgs,
};

/// How long a service waits for the cycle. In lockstep time may stand still; the request is then applied when it goes
/// on.
const PATIENCE: Duration = Duration::from_millis(300);

/// Presses and releases that may come at once without one being dropped.
const EMERGENCY_STOP_DEPTH: usize = 100;

type Reply = Result<Mode, Refusal>;

/// The middleware's side of the buffers for requests and gaits. Shared by the services, which take turns.
pub struct Services {
    asked: Mutex<(Producer<Asked>, u64)>,
    gaits: Mutex<(Producer<(u64, PreparedGait)>, u64)>,
    recording: Arc<Recording>,
    waiting: Mutex<HashMap<u64, Sender<Reply>>>,
    emergency_stop: Arc<EmergencyStop>,
    problems: Arc<InputProblems>,
    command_gaits: Option<Arc<CommandGaits>>,
    config: Config,
    lease: Arc<Lease>,
    lockstep: bool,
    /// The controller's mode as last published, and whether it then held a posture that it had reached.
    mode: Mutex<Option<(Mode, bool)>>,
}

/// The middleware's side of the buffers for measurements.
pub struct Sensors {
    /// Joint states to the cycle; none where it reads the drives itself.
    pub states: Option<Producer<StateMessage>>,
    /// The joints' names on topics.
    pub joint_names: [String; JOINTS],
    /// What the inertial unit reports, to the cycle.
    pub inertial: Producer<TimedInertial>,
    /// In lockstep: the cycle's thread, to be woken by a state.
    pub wake: Option<Thread>,
}

fn lock<T>(mutex: &Mutex<T>) -> std::sync::MutexGuard<'_, T> {
    // What is guarded is whole after a panic elsewhere.
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Services {
    /// The services of a cycle.
    pub fn new(
        asked: Producer<Asked>,
        gaits: Producer<(u64, PreparedGait)>,
        recording: Arc<Recording>,
        emergency_stop: Arc<EmergencyStop>,
        problems: Arc<InputProblems>,
        config: Config,
        lockstep: bool,
    ) -> Self {
        Self {
            asked: Mutex::new((asked, 0)),
            gaits: Mutex::new((gaits, 0)),
            recording,
            waiting: Mutex::default(),
            emergency_stop,
            problems,
            command_gaits: None,
            config,
            lease: Arc::default(),
            lockstep,
            mode: Mutex::default(),
        }
    }

    /// Gaits are planned for the command.
    #[must_use]
    pub fn planning_for(self, command_gaits: Option<Arc<CommandGaits>>) -> Self {
        Self { command_gaits, ..self }
    }

    /// The cycle's mode, and whether it holds a posture that it has reached.
    pub fn set_mode(&self, mode: Mode, holds_posture: bool) {
        *lock(&self.mode) = Some((mode, holds_posture));
    }

    /// Waits for a mode, and whether a posture is held in it; false: it did not come in time, or `hurried`.
    pub fn wait_for_mode(
        &self,
        patience: Duration,
        hurried: impl Fn() -> bool,
        wanted: impl Fn(Mode, bool) -> bool,
    ) -> bool {
        let deadline = Instant::now() + patience;
        while !lock(&self.mode).is_some_and(|(mode, holds_posture)| wanted(mode, holds_posture)) {
            if Instant::now() >= deadline || hurried() {
                return false;
            }
            std::thread::sleep(Duration::from_millis(2));
        }
        true
    }

    /// Where the robot walks: stops it at the next switch and waits until it stands still. The mode is standing from
    /// the switch on, while what moved the robot there still runs out; damped before that, it sinks aside.
    pub fn bring_to_rest(&self, patience: Duration, hurried: impl Fn() -> bool) {
        let moves = |mode| matches!(mode, Mode::Starting | Mode::Walking | Mode::Stopping);
        let stands_still = |mode, holds_posture| match mode {
            Mode::Standing => holds_posture,
            _ => !moves(mode),
        };
        if lock(&self.mode).is_none_or(|(mode, holds_posture)| stands_still(mode, holds_posture)) {
            return;
        }
        let (granted, reason) = self.put(Request::Stop);
        if !granted || !self.wait_for_mode(patience, hurried, stands_still) {
            tracing::warn!("the walk did not come to rest within {patience:?} ({reason}): damping");
        }
    }

    /// The cycle has replied to request number `id`.
    pub fn reply(&self, id: u64, reply: Reply) {
        let waiting = lock(&self.waiting).remove(&id);
        let received = waiting.is_some_and(|sender| sender.send(reply).is_ok());
        if !received && let Err(refusal) = reply {
            tracing::warn!("a queued request: {refusal}");
        }
    }

    /// Asks the cycle and waits for its reply: whether it was granted, and a sentence for people. While the node is not
    /// active only the drives may be switched off.
    pub fn ask(&self, request: Request) -> (bool, String) {
        if !self.emergency_stop.is_active() && request != Request::Disarm {
            return (false, "the controller is not active: activate it (its service change_state)".into());
        }
        // What the cycle cannot know, and what it would only call missing.
        if matches!(request, Request::Arm | Request::Stand | Request::Walk) {
            let problem = self.problems.hindering(monotonic_now());
            if !problem.is_empty() {
                return (false, format!("refused: {problem}"));
            }
        }
        self.put(request)
    }

    /// Who holds the lease; empty: nobody.
    pub fn holder(&self) -> String {
        self.lease.holder(monotonic_now())
    }

    /// What the topics that move the robot ask.
    pub fn gate(&self) -> Gate {
        Gate { lease: Arc::clone(&self.lease), problems: Arc::clone(&self.problems) }
    }

    /// Nobody holds the lease any more.
    pub fn end_lease(&self) {
        self.lease.end();
    }

    /// Asks for a program: what would move the robot is refused where another program has claimed it. To stop is
    /// everybody's.
    fn ask_for(&self, program: ProgramId, request: Request) -> (bool, String) {
        match self.lease.refusal(program, monotonic_now()) {
            Some(refusal) if !matches!(request, Request::Stop | Request::Disarm) => (false, refusal),
            _ => self.ask(request),
        }
    }

    fn put(&self, request: Request) -> (bool, String) {
        let (sender, receiver) = channel();
        {
            let mut asked = lock(&self.asked);
            asked.1 += 1;
            let id = asked.1;
            lock(&self.waiting).insert(id, sender);
            if asked.0.push(Asked { id, request }).is_err() {
                lock(&self.waiting).remove(&id);
                return (false, "too many requests are waiting: are joint states coming in?".into());
            }
        }
        match receiver.recv_timeout(PATIENCE) {
            Ok(Ok(mode)) => (true, mode.name().into()),
            Ok(Err(refusal)) => (false, refusal.to_string()),
            Err(RecvTimeoutError::Timeout) if self.lockstep => {
                (true, "queued: time stands still; it is applied with the next joint state".into())
            }
            Err(_) => (false, "the control loop does not answer; see the node's log".into()),
        }
    }

    /// Checks a gait against the robot and hands it to the cycle.
    pub fn load(&self, gait: &Gait) -> Result<String, String> {
        let prepared = PreparedGait::new(gait, &self.config).map_err(|e| e.to_string())?;
        let mut gaits = lock(&self.gaits);
        // Under the lock: what it knows of the gait before is what the cycle was handed last.
        self.command_gaits.as_ref().map_or(Ok(()), |own| own.take(gait, &prepared))?;
        gaits.1 += 1;
        let number = gaits.1;
        self.recording.gait(number, gait, &prepared);
        gaits
            .0
            .push((number, prepared))
            .map_err(|_| "too many gaits are waiting: are joint states coming in?".to_owned())?;
        Ok(format!("gait \"{}\": {:.3} s a step, {:.3} m/s", gait.name, gait.step_duration_s, gait.speed_m_s()))
    }

    fn open_emergency_stop(&self, node: &Node) -> Result<(), RosError> {
        let stop = Arc::clone(&self.emergency_stop);
        let leaving = Arc::clone(&self.emergency_stop);
        let mut warned = false;
        node.subscribe_from(
            "emergency_stop",
            Qos::reliable(EMERGENCY_STOP_DEPTH),
            move |publisher, message: std_msgs::Bool| {
                if !stop.received(publisher, message.data, monotonic_now()) && !std::mem::replace(&mut warned, true) {
                    tracing::error!("emergency_stop has more than {PUBLISHERS} publishers: that counts as pressed");
                }
            },
            move |departure| leaving.left(departure),
        )?;
        let stop = Arc::clone(&self.emergency_stop);
        let press = move |request: &SetBoolRequest| {
            stop.set_by_service(request.data, monotonic_now());
            let message = if request.data { "pressed: the robot is damped" } else { "released; it stays damped" };
            SetBoolResponse { success: true, message: message.into() }
        };
        // A press counts however many requests wait before it; a release beyond them is answered that it is busy.
        let beyond = press.clone();
        let options = ServeOptions::bounded(ros::WAITING, move |request: &SetBoolRequest| {
            if request.data {
                beyond(request)
            } else {
                SetBool::refusal(request, "busy: ask again later").unwrap_or_default()
            }
        });
        node.serve_with::<SetBool>("emergency_stop", options, move |request| press(&request))
    }

    fn open_lease(self: &Arc<Self>, node: &Node) -> Result<(), RosError> {
        let services = Arc::clone(self);
        node.serve_programs::<Claim>("claim", ServeOptions::default(), move |program, request| {
            let claimed = services.lease.claim(program, &request, monotonic_now());
            let (success, message) = claimed.map_or_else(|reason| (false, reason), |what| (true, what));
            tracing::info!("claim: {message}");
            ClaimResponse { success, message }
        })?;
        let services = Arc::clone(self);
        node.serve_programs::<Trigger>("release", ServeOptions::default(), move |program, _| {
            let released = services.lease.release(program, monotonic_now());
            let (success, message) = released.map_or_else(|reason| (false, reason), |what| (true, what));
            tracing::info!("release: {message}");
            TriggerResponse { success, message }
        })?;
        let services = Arc::clone(self);
        node.watch_departures(move |departure| {
            if let Some(name) = services.lease.left(departure, monotonic_now()) {
                tracing::warn!("\"{name}\", which had claimed the robot, is gone: it is claimed no more");
            }
        });
        Ok(())
    }

    fn open_load_gait(self: &Arc<Self>, node: &Node) -> Result<(), RosError> {
        let services = Arc::clone(self);
        node.serve_programs::<LoadGait>("load_gait", ServeOptions::default(), move |program, request| {
            let free = services.lease.refusal(program, monotonic_now()).map_or(Ok(()), Err);
            let loaded = free
                .and_then(|()| Gait::from_json(&request.json).map_err(|e| e.to_string()))
                .and_then(|gait| services.load(&gait));
            let (success, message) = match loaded {
                Ok(what) => (true, what),
                // It may repeat what stands in the text.
                Err(reason) => (false, printable(&reason, SENTENCE_CHARS).into_owned()),
            };
            tracing::info!("load_gait: {message}");
            LoadGaitResponse { success, message }
        })
    }

    /// Creates the node's subscriptions and services.
    pub fn open(self: &Arc<Self>, node: &Node, mut sensors: Sensors, fast: Qos) -> Result<(), RosError> {
        if let Some(states) = sensors.states.take() {
            dds_bus::listen(
                node,
                sensors.joint_names.clone(),
                states,
                sensors.wake.take(),
                fast,
                Arc::clone(&self.problems),
            )?;
        }
        let recording = Arc::clone(&self.recording);
        // What the controller takes from it is recorded with every cycle.
        let mut thinning = recording::Thinning::new(2 * recording::THINNED_NS);
        let problems = Arc::clone(&self.problems);
        node.subscribe("imu", Qos::best_effort(1), move |message: sensor_msgs::Imu| {
            if thinning.takes(message.header.stamp.nanoseconds()) {
                recording.other(recording::IMU, None, &message);
            }
            let wall = monotonic_now();
            let (state, problem) = ports::inertial_state(&message);
            match problem {
                None => problems.is_fine(Topic::Imu),
                Some(problem) => problems.note(Topic::Imu, problem, wall),
            }
            // A full buffer: the cycle takes the newest of what is there, or has ended.
            let _ = sensors.inertial.push(TimedInertial { state, wall });
        })?;
        let services = Arc::clone(self);
        node.subscribe("gait", Qos::latched(), move |message: tandem_msgs::Gait| {
            match message.to_gait().map_err(|e| e.to_string()).and_then(|gait| services.load(&gait)) {
                Ok(what) => tracing::info!("{what}"),
                Err(reason) => tracing::error!(
                    "gait \"{}\" refused: {}",
                    printable(&message.name, NAME_CHARS),
                    printable(&reason, SENTENCE_CHARS)
                ),
            }
        })?;
        self.open_emergency_stop(node)?;
        self.open_lease(node)?;
        // No service starts on the gait: the parameter simulation_start_on_gait does.
        for (service, request) in Request::NAMED.into_iter().filter(|(_, request)| *request != Request::StartOnGait) {
            let services = Arc::clone(self);
            node.serve_programs::<Trigger>(service, ServeOptions::default(), move |program, _| {
                let (success, message) = services.ask_for(program, request);
                tracing::info!("{service}: {message}");
                TriggerResponse { success, message }
            })?;
        }
        let services = Arc::clone(self);
        node.serve_programs::<ClearFault>("clear_fault", ServeOptions::default(), move |program, request| {
            let (success, message) = match Fault::from_name(&request.name) {
                Some(fault) => services.ask_for(program, Request::ClearFault(fault)),
                None => (
                    false,
                    format!(
                        "there is no fault \"{}\"; there are {}",
                        printable(&request.name, NAME_CHARS),
                        Fault::ALL.map(Fault::name).join(", ")
                    ),
                ),
            };
            tracing::info!("clear_fault {}: {message}", printable(&request.name, NAME_CHARS));
            ClearFaultResponse { success, message }
        })?;
        let recording = Arc::clone(&self.recording);
        node.serve::<StartRecording>("start_recording", move |request| {
            let started = recording.start(&request.folder);
            let (success, message) = started.map_or_else(|reason| (false, reason), |()| (true, String::new()));
            if !success {
                tracing::warn!("start_recording: {message}");
            }
            StartRecordingResponse { success, message }
        })?;
        let recording = Arc::clone(&self.recording);
        node.serve::<StopRecording>("stop_recording", move |_| match recording.stop() {
            Ok(done) => {
                tracing::info!("{}: {} messages recorded, {} dropped", done.folder, done.messages, done.dropped);
                done
            }
            Err(message) => {
                tracing::warn!("stop_recording: {message}");
                StopRecordingResponse { message, ..StopRecordingResponse::default() }
            }
        })?;
        self.open_load_gait(node)
    }
}
