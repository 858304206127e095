//! The writer, on a thread of its own: a full or missing disk is its fault, not one of the walk.

use super::cycle_log::{LoggedCycle, Shared};
use super::handle::{Gaits, Order, RecordingStatus, lock};
use super::topics::{GROUND_FORCE, GROUND_TRUTH, IMU, ODOM, TF};
use crate::record_root;
use control::{Config, Input, PreparedGait, Snapshot};
use gait::{Gait, LEGS};
use recorder::{BagError, RecorderOptions, RecorderStatus};
use rtrb::Consumer;
use run_recorder::{Continuity, RunInfo, RunRecorder};
use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError};
use std::sync::{Arc, Mutex};
use std::time::Duration;
use tandem_msgs::StopRecordingResponse;
use tandem_msgs::diagnostic_msgs::DiagnosticArray;
use tandem_msgs::geometry_msgs::WrenchStamped;
use tandem_msgs::nav_msgs::Odometry;
use tandem_msgs::sensor_msgs::Imu;
use tandem_msgs::tf2_msgs::TFMessage;

/// Messages and bytes that may wait for the disk: about eight seconds, because a disk that others keep busy can take
/// seconds to synchronise.
const QUEUE_MESSAGES: usize = 32_768;
/// See above.
const QUEUE_BYTES: usize = 16 << 20;
/// How often the writer looks when nothing wakes it.
const PATIENCE: Duration = Duration::from_millis(5);

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

/// The writer, to be run on a thread of its own.
pub struct Writer {
    pub(super) orders: Receiver<Order>,
    pub(super) cycles: Consumer<LoggedCycle>,
    pub(super) beginnings: Consumer<(u64, Snapshot)>,
    pub(super) shared: Arc<Shared>,
    pub(super) others: Arc<AtomicU64>,
    pub(super) dropped_others: Arc<AtomicU64>,
    pub(super) active: Arc<AtomicBool>,
    pub(super) status: Arc<Mutex<RecordingStatus>>,
    pub(super) subject: Subject,
    pub(super) gaits: Gaits,
    pub(super) recordings: u64,
    pub(super) run: Option<Run>,
}

pub(super) struct Run {
    number: u64,
    recorder: RunRecorder,
    begun: bool,
    topics: BTreeMap<String, recorder::Topic>,
    continuity: Continuity,
}

impl Writer {
    /// Writes until every [`Recording`](super::Recording) is gone; a recording that goes on then is ended.
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
        self.update_status();
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
        let folder = record_root::folder(self.subject.record_root.as_deref(), name)?;
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
                    ODOM | GROUND_TRUTH => run.recorder.topic::<Odometry>(&name, sensor)?,
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
    fn update_status(&mut self) {
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
            body_pose: cycle.body_pose,
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
