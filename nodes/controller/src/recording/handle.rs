//! The services' and publishers' end.

use super::topics::{GROUND_FORCE, GROUND_TRUTH, ODOM, TF, THINNED_NS, Thinning};
use control::PreparedGait;
use gait::{Gait, LEGS};
use ros::{Node, Qos, RosError};
use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::mpsc::{Sender, SyncSender, sync_channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;
use tandem_msgs::geometry_msgs::WrenchStamped;
use tandem_msgs::nav_msgs::Odometry;
use tandem_msgs::tf2_msgs::TFMessage;
use tandem_msgs::{Message, StopRecordingResponse};

/// Messages of other topics that may wait for the writer.
const OTHERS: usize = 1024;
/// Gaits that are kept: more than can wait for the cycle.
const GAITS: usize = 32;
/// How long a service waits for the writer: a slow disk opens slowly.
const SERVICE_PATIENCE: Duration = Duration::from_secs(20);

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
pub(super) type Gaits = Arc<Mutex<BTreeMap<u64, (Gait, PreparedGait)>>>;

/// What the writer is to do.
pub(super) enum Order {
    Start(String, SyncSender<Result<(), String>>),
    Stop(SyncSender<Result<StopRecordingResponse, String>>),
    End,
    Other { topic: &'static str, leg: Option<usize>, cdr: Vec<u8> },
}

/// The other end: starts and stops recordings and reports on them. Shared by the services and the publishers.
pub struct Recording {
    pub(super) orders: Sender<Order>,
    /// Messages of other topics on their way.
    pub(super) others: Arc<AtomicU64>,
    pub(super) dropped_others: Arc<AtomicU64>,
    pub(super) active: Arc<AtomicBool>,
    pub(super) gaits: Gaits,
    pub(super) status: Arc<Mutex<RecordingStatus>>,
}

pub(super) fn lock<T>(mutex: &Mutex<T>) -> std::sync::MutexGuard<'_, T> {
    // What is guarded is whole after a panic elsewhere.
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
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
        for topic in [ODOM, GROUND_TRUTH] {
            self.listen_to(node, topic, None, topic, thin(THINNED_NS), |message: &Odometry| {
                message.header.stamp.nanoseconds()
            })?;
        }
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
