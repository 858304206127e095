//! Recording a run: what each cycle saw and put out goes through a wait-free buffer to a thread that writes a bag.
//!
//! The cycle's end ([`CycleLog`]) takes no lock, allocates nothing and never waits: what does not fit is counted.
//! The writer's end ([`Recording`]) has its own thread; a full or missing disk is its fault, not one of the walk.

use control::{
    Config, Controller, InertialState, Input, JOINTS, JointState, MAX_REQUESTS, Output, PreparedGait, Request, Snapshot,
};
use gait::{Gait, LEGS};
use recorder::{BagError, RecorderOptions, RecorderStatus};
use ros::{Node, Qos, RosError};
use rtrb::{Consumer, Producer, RingBuffer};
use run_recorder::{Continuity, RunInfo, RunRecorder};
use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, SyncSender, channel, sync_channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;
use tandem_msgs::diagnostic_msgs::DiagnosticArray;
use tandem_msgs::geometry_msgs::WrenchStamped;
use tandem_msgs::nav_msgs::Odometry;
use tandem_msgs::sensor_msgs::Imu;
use tandem_msgs::tf2_msgs::TFMessage;
use tandem_msgs::{Message, StopRecordingResponse};

/// Cycles that may wait for the writer: two seconds at 1 kHz.
const CYCLES: usize = 2048;
/// Messages of other topics that may wait for the writer.
const OTHERS: usize = 1024;
/// Messages and bytes that may wait for the disk: about eight seconds, because a disk that others keep busy can take seconds to
/// synchronise.
const QUEUE_MESSAGES: usize = 32_768;
/// See above.
const QUEUE_BYTES: usize = 16 << 20;
/// Gaits that are kept: more than can wait for the cycle.
const GAITS: usize = 32;
/// How often the writer looks when nothing wakes it.
const PATIENCE: Duration = Duration::from_millis(5);
/// How long a service waits for the writer: a slow disk opens slowly.
const SERVICE_PATIENCE: Duration = Duration::from_secs(20);

/// One cycle: all that its step saw, and its output.
#[derive(Clone, Copy, Debug)]
pub struct LoggedCycle {
    recording: u64,
    now: Duration,
    joints: Option<JointState>,
    sensed: (Option<InertialState>, Option<control::VelocityCommand>),
    requests: [Request; MAX_REQUESTS],
    request_count: usize,
    /// Number of the gait that arrived, as the services count them; 0: none did.
    gait: u64,
    emergency_stop: bool,
    fault: Option<control::FaultReport>,
    effort_nm: Option<[f64; JOINTS]>,
    output: Output,
}

/// The cycle's end.
pub struct CycleLog {
    cycles: Producer<LoggedCycle>,
    beginnings: Producer<(u64, Snapshot)>,
    shared: Arc<Shared>,
    /// The recording that this end is in; 0: none.
    recording: u64,
}

/// What both ends see.
#[derive(Debug, Default)]
struct Shared {
    /// The recording that is wanted; 0: none.
    wanted: AtomicU64,
    /// Cycles of the present recording that found the buffer full.
    dropped_cycles: AtomicU64,
}

impl CycleLog {
    /// Before a step: notices that a recording begins or ends.
    pub fn begin_cycle(&mut self, controller: &Controller) {
        let wanted = self.shared.wanted.load(Ordering::Acquire);
        // A full buffer of beginnings: tried again in the next cycle.
        if wanted != self.recording && (wanted == 0 || self.beginnings.push((wanted, controller.snapshot())).is_ok()) {
            self.recording = wanted;
        }
    }

    /// After a step.
    pub fn end_cycle(
        &mut self,
        now: Duration,
        input: &Input,
        gait: u64,
        effort_nm: Option<[f64; JOINTS]>,
        output: &Output,
    ) {
        if self.recording == 0 {
            return;
        }
        let mut requests = [Request::Stop; MAX_REQUESTS];
        let request_count = input.requests.len().min(MAX_REQUESTS);
        requests[..request_count].copy_from_slice(&input.requests[..request_count]);
        let logged = LoggedCycle {
            recording: self.recording,
            now,
            joints: input.joints.copied(),
            sensed: (input.inertial, input.velocity),
            requests,
            request_count,
            gait,
            emergency_stop: input.emergency_stop,
            fault: input.fault,
            effort_nm,
            output: *output,
        };
        if self.cycles.push(logged).is_err() {
            self.shared.dropped_cycles.fetch_add(1, Ordering::Relaxed);
        }
    }
}

/// What is recorded of the controller itself.
pub struct Subject {
    /// Its configuration.
    pub config: Config,
    /// The robot's URDF.
    pub robot_description: String,
    /// Names of the legs, in order.
    pub leg_names: [String; LEGS],
    /// Nanoseconds from the epoch to the controller's clock's zero; 0 where the clock itself counts from the epoch.
    pub epoch_ns: u64,
    /// The folder below which every recording lies; none: nothing can be recorded.
    pub record_root: Option<PathBuf>,
    /// Files end after so many bytes or so much time, and a further one begins.
    pub split_bytes: Option<u64>,
    /// See above.
    pub split_duration: Option<Duration>,
}

/// How a recording fares, for diagnostics.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct RecordingStatus {
    /// Its folder; none while nothing is recorded.
    pub folder: Option<PathBuf>,
    /// Messages known to be on disk.
    pub written: u64,
    /// Whole cycles that found the buffer full, and messages that found the disk too slow.
    pub dropped: u64,
    /// Cycles that are missing between the first and the last recorded.
    pub missing_cycles: u64,
    /// Longest time from one recorded cycle to the next.
    pub longest_hole: Duration,
    /// Why the present recording, or the last attempt, failed.
    pub fault: Option<String>,
}

/// Gaits that a cycle may still name, by the services' number. The cycle itself never looks here.
type Gaits = Arc<Mutex<BTreeMap<u64, (Gait, PreparedGait)>>>;

enum Order {
    Start(String, SyncSender<Result<(), String>>),
    Stop(SyncSender<Result<StopRecordingResponse, String>>),
    End,
    Other { topic: &'static str, leg: Option<usize>, cdr: Vec<u8> },
}

/// The other end: starts, stops and tells of recordings. Shared by the services and the publishers.
pub struct Recording {
    orders: Sender<Order>,
    /// Messages of other topics on their way.
    others: Arc<AtomicU64>,
    dropped_others: Arc<AtomicU64>,
    active: Arc<AtomicBool>,
    gaits: Gaits,
    status: Arc<Mutex<RecordingStatus>>,
}

fn lock<T>(mutex: &Mutex<T>) -> std::sync::MutexGuard<'_, T> {
    // What is guarded is whole after a panic elsewhere.
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// The writer, to be run on a thread of its own.
pub struct Writer {
    orders: Receiver<Order>,
    cycles: Consumer<LoggedCycle>,
    beginnings: Consumer<(u64, Snapshot)>,
    shared: Arc<Shared>,
    others: Arc<AtomicU64>,
    dropped_others: Arc<AtomicU64>,
    active: Arc<AtomicBool>,
    status: Arc<Mutex<RecordingStatus>>,
    subject: Subject,
    gaits: Gaits,
    recordings: u64,
    run: Option<Run>,
}

struct Run {
    number: u64,
    recorder: RunRecorder,
    begun: bool,
    topics: BTreeMap<String, recorder::Topic>,
    continuity: Continuity,
}

/// The two ends and the writer between.
pub fn open(subject: Subject) -> (CycleLog, Recording, Writer) {
    let (cycles_in, cycles) = RingBuffer::new(CYCLES);
    let (beginnings_in, beginnings) = RingBuffer::new(2);
    let (orders_in, orders) = channel();
    let shared = Arc::new(Shared::default());
    let dropped_others = Arc::new(AtomicU64::new(0));
    let (others, active) = (Arc::new(AtomicU64::new(0)), Arc::new(AtomicBool::new(false)));
    let status = Arc::new(Mutex::new(RecordingStatus::default()));
    let gaits = Gaits::default();
    let log = CycleLog { cycles: cycles_in, beginnings: beginnings_in, shared: Arc::clone(&shared), recording: 0 };
    let recording = Recording {
        orders: orders_in,
        others: Arc::clone(&others),
        dropped_others: Arc::clone(&dropped_others),
        active: Arc::clone(&active),
        gaits: Arc::clone(&gaits),
        status: Arc::clone(&status),
    };
    let writer = Writer {
        orders,
        cycles,
        beginnings,
        shared,
        others,
        dropped_others,
        active,
        status,
        subject,
        gaits,
        recordings: 0,
        run: None,
    };
    (log, recording, writer)
}

impl Recording {
    /// Begins a recording in the folder of this name below the root; it must be empty or not there.
    ///
    /// # Errors
    /// A sentence for people.
    pub fn start(&self, name: &str) -> Result<(), String> {
        self.order(|reply| Order::Start(name.to_owned(), reply))
    }

    /// Ends the recording.
    ///
    /// # Errors
    /// A sentence for people.
    pub fn stop(&self) -> Result<StopRecordingResponse, String> {
        self.order(Order::Stop)
    }

    fn order<T>(&self, order: impl FnOnce(SyncSender<Result<T, String>>) -> Order) -> Result<T, String> {
        let (reply, answer) = sync_channel(1);
        self.orders.send(order(reply)).map_err(|_| "the recording's thread has ended".to_owned())?;
        answer
            .recv_timeout(SERVICE_PATIENCE)
            .map_err(|_| format!("the disk does not answer within {SERVICE_PATIENCE:?}"))?
    }

    /// A gait is about to be handed to the cycle under this number.
    pub fn gait(&self, number: u64, gait: &Gait, prepared: &PreparedGait) {
        let mut gaits = lock(&self.gaits);
        gaits.insert(number, (gait.clone(), *prepared));
        // Those that the cycle has long taken or passed over.
        while gaits.len() > GAITS {
            gaits.pop_first();
        }
    }

    /// The node ends: a recording that goes on is completed, and the writer's thread ends.
    pub fn end(&self) {
        // Without the thread there is nothing to end.
        let _ = self.orders.send(Order::End);
    }

    /// How it fares.
    pub fn status(&self) -> RecordingStatus {
        lock(&self.status).clone()
    }

    /// A message of another topic: goes into the bag if one is recorded.
    pub fn other<M: Message>(&self, topic: &'static str, leg: Option<usize>, message: &M) {
        if !self.active.load(Ordering::Acquire) {
            return;
        }
        if self.others.fetch_add(1, Ordering::AcqRel) >= OTHERS as u64 {
            self.others.fetch_sub(1, Ordering::AcqRel);
            self.dropped_others.fetch_add(1, Ordering::Relaxed);
            return;
        }
        match recorder::to_cdr(M::NAME, message) {
            Ok(cdr) => {
                let _ = self.orders.send(Order::Other { topic, leg, cdr });
            }
            Err(error) => tracing::warn!("{error}"),
        }
    }

    /// Listens to what others say of the robot's surroundings, thinned out.
    ///
    /// # Errors
    /// The middleware's reason.
    pub fn listen(self: &Arc<Self>, node: &Node, leg_names: &[String; LEGS]) -> Result<(), RosError> {
        let thin = Thinning::new;
        self.listen_to(node, ODOM, None, "odom", thin(THINNED_NS), |message: &Odometry| {
            message.header.stamp.nanoseconds()
        })?;
        for (leg, name) in leg_names.iter().enumerate() {
            let topic = format!("ground_force/{name}");
            self.listen_to(node, GROUND_FORCE, Some(leg), &topic, thin(THINNED_NS), |message: &WrenchStamped| {
                message.header.stamp.nanoseconds()
            })?;
        }
        self.listen_to(node, TF, None, "/tf", thin(2 * THINNED_NS), |message: &TFMessage| {
            message.transforms.first().map_or(0, |transform| transform.header.stamp.nanoseconds())
        })
    }

    fn listen_to<M: Message>(
        self: &Arc<Self>,
        node: &Node,
        topic: &'static str,
        leg: Option<usize>,
        name: &str,
        mut thinning: Thinning,
        stamp_ns: impl Fn(&M) -> i64 + Send + 'static,
    ) -> Result<(), RosError> {
        let recording = Arc::clone(self);
        node.subscribe(name, Qos::best_effort(16), move |message: M| {
            if thinning.takes(stamp_ns(&message)) {
                recording.other(topic, leg, &message);
            }
        })
    }
}

/// Takes one message in each period of its stamps: the same instants on every topic of one period.
pub struct Thinning {
    period_ns: i64,
    slot: Option<i64>,
}

impl Thinning {
    /// For one topic.
    pub fn new(period_ns: i64) -> Self {
        Self { period_ns, slot: None }
    }

    /// Whether a message with this stamp goes into the bag.
    pub fn takes(&mut self, stamp_ns: i64) -> bool {
        let slot = Some(stamp_ns.div_euclid(self.period_ns));
        std::mem::replace(&mut self.slot, slot) != slot
    }
}

/// Time from one message of a thinned topic to the next, ns.
pub const THINNED_NS: i64 = 10_000_000;
const ODOM: &str = "odom";
const GROUND_FORCE: &str = "ground_force";
const TF: &str = "tf";
/// The topic of the node's own diagnostics in the bag.
pub const DIAGNOSTICS: &str = "diagnostics";
/// The topic of the inertial unit in the bag.
pub const IMU: &str = "imu";

impl Writer {
    /// Writes until every [`Recording`] is gone; a recording that goes on then is ended.
    pub fn run(mut self) {
        while self.turn() {}
    }

    /// Waits a little for an order, and writes what there is. `false`: it was the last.
    pub fn turn(&mut self) -> bool {
        let order = self.orders.recv_timeout(PATIENCE);
        self.write_cycles();
        match order {
            Err(RecvTimeoutError::Timeout) => {}
            Ok(Order::End) | Err(RecvTimeoutError::Disconnected) => {
                if self.run.is_some() {
                    match self.stop() {
                        Ok(done) => tracing::info!("{}: {} messages recorded", done.folder, done.messages),
                        Err(reason) => tracing::error!("recording: {reason}"),
                    }
                }
                return false;
            }
            Ok(order) => self.obey(order),
        }
        self.tell();
        true
    }

    fn obey(&mut self, order: Order) {
        match order {
            // Whoever asked and no longer waits has been answered so.
            Order::Start(name, reply) => {
                let started = self.start(&name);
                if let Err(reason) = &started {
                    lock(&self.status).fault = Some(reason.clone());
                }
                let _ = reply.send(started);
            }
            Order::End => {}
            Order::Stop(reply) => {
                let _ = reply.send(self.stop());
            }
            Order::Other { topic, leg, cdr } => {
                self.others.fetch_sub(1, Ordering::AcqRel);
                if let Err(error) = self.other(topic, leg, cdr) {
                    tracing::warn!("recording: {error}");
                }
            }
        }
    }

    fn start(&mut self, name: &str) -> Result<(), String> {
        if let Some(run) = &self.run {
            return Err(format!("{} is being recorded; stop that recording first", run.recorder.folder().display()));
        }
        let folder = crate::record_root::folder(self.subject.record_root.as_deref(), name)?;
        let info = RunInfo {
            config: &self.subject.config,
            robot_description: &self.subject.robot_description,
            leg_names: self.subject.leg_names.each_ref().map(String::as_str),
            epoch_ns: self.subject.epoch_ns,
        };
        let options = RecorderOptions {
            split_bytes: self.subject.split_bytes,
            split_duration: self.subject.split_duration,
            queue_messages: QUEUE_MESSAGES,
            queue_bytes: QUEUE_BYTES,
            ..RecorderOptions::default()
        };
        let mut recorder = RunRecorder::start(&folder, &info, options).map_err(|error| error.to_string())?;
        // The gait that is loaded already; the controller's memory holds it too, for running the recording again.
        if let Some((gait, _)) = lock(&self.gaits).values().next_back() {
            recorder.gait(gait).map_err(|error| error.to_string())?;
        }
        self.recordings += 1;
        self.shared.dropped_cycles.store(0, Ordering::Relaxed);
        self.dropped_others.store(0, Ordering::Relaxed);
        self.shared.wanted.store(self.recordings, Ordering::Release);
        self.active.store(true, Ordering::Release);
        *lock(&self.status) = RecordingStatus { folder: Some(folder.clone()), ..RecordingStatus::default() };
        self.run = Some(Run {
            number: self.recordings,
            recorder,
            begun: false,
            topics: BTreeMap::new(),
            continuity: Continuity::default(),
        });
        tracing::info!("recording into {}", folder.display());
        Ok(())
    }

    fn stop(&mut self) -> Result<StopRecordingResponse, String> {
        self.shared.wanted.store(0, Ordering::Release);
        self.active.store(false, Ordering::Release);
        self.write_cycles();
        let run = self.run.take().ok_or("nothing is being recorded")?;
        let dropped_before =
            self.shared.dropped_cycles.load(Ordering::Relaxed) + self.dropped_others.load(Ordering::Relaxed);
        let longest_hole = run.continuity.longest;
        let folder = run.recorder.folder().display().to_string();
        *lock(&self.status) = RecordingStatus::default();
        match run.recorder.finish() {
            Ok(summary) => {
                let (messages, dropped) = (summary.written(), summary.dropped() + dropped_before);
                let message = if dropped > 0 {
                    format!(
                        "{dropped} were dropped: the disk was too slow; at most {:.3} s from one recorded cycle to the next",
                        longest_hole.as_secs_f64()
                    )
                } else {
                    String::new()
                };
                Ok(StopRecordingResponse { success: true, message, folder, messages, dropped, bytes: summary.bytes })
            }
            Err(error) => {
                lock(&self.status).fault = Some(error.to_string());
                Err(error.to_string())
            }
        }
    }

    fn write_cycles(&mut self) {
        while let Ok((number, snapshot)) = self.beginnings.pop() {
            if let Some(run) = self.run.as_mut().filter(|run| run.number == number) {
                run.begun = true;
                if let Err(error) = run.recorder.snapshot(&snapshot) {
                    tracing::error!("recording: {error}");
                }
            }
        }
        while let Ok(cycle) = self.cycles.pop() {
            let Some(run) = self.run.as_mut().filter(|run| run.number == cycle.recording) else { continue };
            if !run.begun {
                // Its beginning was pushed before it, so it is there by now.
                while let Ok((number, snapshot)) = self.beginnings.pop() {
                    if number == run.number {
                        run.begun = true;
                        if let Err(error) = run.recorder.snapshot(&snapshot) {
                            tracing::error!("recording: {error}");
                        }
                    }
                }
            }
            let gait = lock(&self.gaits).get(&cycle.gait).cloned();
            if let Err(error) = run.cycle(&cycle, gait.as_ref()) {
                tracing::error!("recording: {error}");
            }
        }
    }

    fn other(&mut self, topic: &'static str, leg: Option<usize>, cdr: Vec<u8>) -> Result<(), BagError> {
        let Some(run) = &mut self.run else { return Ok(()) };
        let name = leg.map_or_else(|| topic.to_owned(), |leg| format!("{topic}/{}", self.subject.leg_names[leg]));
        let declared = match run.topics.get(&name) {
            Some(declared) => declared.clone(),
            None => {
                let sensor = recorder::Qos::sensor(1);
                let declared = match topic {
                    ODOM => run.recorder.topic::<Odometry>(&name, sensor)?,
                    GROUND_FORCE => run.recorder.topic::<WrenchStamped>(&name, sensor)?,
                    IMU => run.recorder.topic::<Imu>(&name, sensor)?,
                    TF => run.recorder.topic::<TFMessage>(&name, recorder::Qos::reliable(100))?,
                    _ => run.recorder.topic::<DiagnosticArray>(&name, recorder::Qos::reliable(10))?,
                };
                run.topics.insert(name, declared.clone());
                declared
            }
        };
        run.recorder.other(&declared, cdr);
        Ok(())
    }

    /// Brings the status up to date; says a new fault once.
    fn tell(&mut self) {
        let Some(run) = &self.run else { return };
        let RecorderStatus { written, dropped, fault, .. } = run.recorder.status();
        let mut status = lock(&self.status);
        status.written = written;
        status.dropped =
            dropped + self.shared.dropped_cycles.load(Ordering::Relaxed) + self.dropped_others.load(Ordering::Relaxed);
        status.missing_cycles = run.continuity.missing;
        status.longest_hole = run.continuity.longest;
        if status.fault.is_none()
            && let Some(fault) = fault
        {
            tracing::error!("the recording stopped, walking goes on: {fault}");
            status.fault = Some(fault);
        }
    }
}

impl Run {
    /// What is not taken is counted by the recorder.
    fn cycle(&mut self, cycle: &LoggedCycle, arrived: Option<&(Gait, PreparedGait)>) -> Result<(), BagError> {
        if let Some((gait, _)) = arrived {
            self.recorder.gait(gait)?;
        }
        let input = Input {
            joints: cycle.joints.as_ref(),
            inertial: cycle.sensed.0,
            velocity: cycle.sensed.1,
            requests: &cycle.requests[..cycle.request_count],
            gait: arrived.map(|(_, prepared)| prepared),
            emergency_stop: cycle.emergency_stop,
            fault: cycle.fault,
        };
        if self.recorder.cycle(cycle.now, &input, &cycle.output, cycle.effort_nm.as_ref())? {
            self.continuity.cycle(cycle.now, cycle.output.cycles);
        }
        Ok(())
    }
}

/// Folder for the recording of a run that begins now: the moment in UTC, as 2026-11-22T06_10_00.
pub fn folder_name(since_epoch: Duration) -> String {
    let seconds = since_epoch.as_secs();
    let (mut days, of_day) = (seconds / 86_400, seconds % 86_400);
    let leap = |year: u64| year.is_multiple_of(4) && (!year.is_multiple_of(100) || year.is_multiple_of(400));
    let mut year = 1970;
    while days >= 365 + u64::from(leap(year)) {
        days -= 365 + u64::from(leap(year));
        year += 1;
    }
    let mut month = 1;
    for length in [31, 28 + u64::from(leap(year)), 31, 30, 31, 30, 31, 31, 30, 31, 30, 31] {
        if days < length {
            break;
        }
        days -= length;
        month += 1;
    }
    format!("{year:04}-{month:02}-{:02}T{:02}_{:02}_{:02}", days + 1, of_day / 3600, of_day / 60 % 60, of_day % 60)
}
