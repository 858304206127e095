//! The recorder: a bounded queue, and a thread that writes MCAP files.

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::atomic::Ordering;
use std::sync::mpsc::{SyncSender, TrySendError, sync_channel};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use std::time::Duration;

use serde::Serialize;

use crate::metadata::FilePart;
use crate::shared::{Order, Shared, TopicShared};
use crate::writer::Writer;
use crate::{BagError, Qos, RecorderOptions, WhenFull, full_definition};

/// A declared topic: what [`Recorder::push`] needs. Cheap to clone.
#[derive(Clone, Debug)]
pub struct Topic(Arc<TopicShared>);

impl Topic {
    /// The topic's name.
    pub fn name(&self) -> &str {
        &self.0.name
    }

    /// The type of its messages, `package/msg/Type`.
    pub fn type_name(&self) -> &str {
        &self.0.type_name
    }
}

/// Ends with the files it wrote.
type WriterThread = JoinHandle<Result<Vec<FilePart>, BagError>>;

/// A recording in progress. It may be shared between threads; dropping it finishes the bag.
#[derive(Debug)]
pub struct Recorder {
    folder: PathBuf,
    queue_bytes: usize,
    when_full: WhenFull,
    shared: Arc<Shared>,
    sender: SyncSender<Order>,
    thread: Mutex<Option<WriterThread>>,
}

/// How a recording fares, at any moment.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RecorderStatus {
    /// Messages offered so far.
    pub offered: u64,
    /// Messages known to be on disk.
    pub written: u64,
    /// Messages that were not taken so far.
    pub dropped: u64,
    /// Bytes that wait for the disk.
    pub queued_bytes: usize,
    /// Why recording stopped by itself; `None` while it goes on.
    pub fault: Option<String>,
}

/// One topic of a finished recording.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TopicSummary {
    /// Topic name.
    pub name: String,
    /// Message type.
    pub type_name: String,
    /// Messages in the bag.
    pub written: u64,
    /// Messages offered that are not in the bag.
    pub dropped: u64,
}

/// A finished recording.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Summary {
    /// The bag's folder.
    pub folder: PathBuf,
    /// Topics in the order of their declaration.
    pub topics: Vec<TopicSummary>,
    /// Size of all files, bytes.
    pub bytes: u64,
    /// First and last stamp, ns, if there is any message.
    pub span_ns: Option<(u64, u64)>,
}

impl Summary {
    /// Messages in the bag, over all topics.
    pub fn written(&self) -> u64 {
        self.topics.iter().map(|topic| topic.written).sum()
    }

    /// Messages offered that are not in the bag, over all topics.
    pub fn dropped(&self) -> u64 {
        self.topics.iter().map(|topic| topic.dropped).sum()
    }
}

/// Serialises a message as a bag keeps it: the four bytes that say "CDR, little-endian", then the CDR.
///
/// `name` is only used in the error.
///
/// # Errors
/// [`BagError::Cdr`] for a value that CDR has no form for (a map, for example).
pub fn to_cdr<T: Serialize>(name: &str, message: &T) -> Result<Vec<u8>, BagError> {
    let body = cdr_encoding::to_vec::<T, byteorder::LittleEndian>(message).map_err(|error| BagError::Cdr {
        name: name.to_owned(),
        action: "written as",
        reason: error.to_string(),
    })?;
    let mut cdr = Vec::with_capacity(body.len() + 4);
    cdr.extend_from_slice(&[0, 1, 0, 0]);
    cdr.extend_from_slice(&body);
    Ok(cdr)
}

impl Recorder {
    /// Begins a bag in `folder`, which is made if it is not there and must be empty if it is. The files in it are
    /// called after the folder, as `ros2 bag record` does: `walk/walk_0.mcap`.
    ///
    /// # Errors
    /// [`BagError::Exists`] if something is in the folder, [`BagError::Io`] if it cannot be written,
    /// [`BagError::BadOption`].
    pub fn start(folder: impl AsRef<Path>, options: RecorderOptions) -> Result<Recorder, BagError> {
        let folder = folder.as_ref().to_owned();
        let shared = Arc::new(Shared::default());
        let (queue_messages, queue_bytes, when_full) = (options.queue_messages, options.queue_bytes, options.when_full);
        // The first file is opened here, so that a folder that cannot be written is an error of `start`.
        let mut writer = Writer::open(folder.clone(), options, shared.clone())?;
        let (sender, receiver) = sync_channel(queue_messages);
        let thread = std::thread::Builder::new()
            .name("bag writer".into())
            .spawn(move || {
                let result = writer.run(&receiver).and_then(|()| writer.finish());
                if let Err(error) = &result {
                    // A second error cannot come: the thread ends here.
                    let _ = writer.shared.fault.set(error.to_string());
                }
                result
            })
            .map_err(BagError::io(&folder, "start the writer thread for"))?;
        Ok(Recorder { folder, queue_bytes, when_full, shared, sender, thread: Mutex::new(Some(thread)) })
    }

    /// The bag's folder.
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// Declares a topic whose type is one of ours or a common standard message. Declaring it again gives the same
    /// topic.
    ///
    /// # Errors
    /// [`BagError::UnknownType`], [`BagError::TopicConflict`].
    pub fn topic(&self, name: &str, type_name: &str, qos: Qos) -> Result<Topic, BagError> {
        self.topic_with_definition(name, type_name, &full_definition(type_name)?, qos)
    }

    /// Declares a topic of one of the Rust message types.
    ///
    /// # Errors
    /// As [`Recorder::topic`].
    pub fn topic_of<M: tandem_msgs::Message>(&self, name: &str, qos: Qos) -> Result<Topic, BagError> {
        self.topic(name, &M::full_name(), qos)
    }

    /// Declares a topic of any type, with its complete `ros2msg` text.
    ///
    /// # Errors
    /// [`BagError::BadDefinition`] if the text cannot be parsed, [`BagError::TopicConflict`].
    pub fn topic_with_definition(
        &self,
        name: &str,
        type_name: &str,
        definition: &str,
        qos: Qos,
    ) -> Result<Topic, BagError> {
        self.shared.declare(name, type_name, definition, qos).map(Topic)
    }

    /// Hands one message over: `stamp_ns` nanoseconds since the epoch of the recording's clock, `cdr` with its
    /// four-byte encapsulation header. Returns at once (unless [`WhenFull::Wait`] was asked for); `false` means the
    /// message was dropped, because the queue is full or recording stopped, and counted as such.
    pub fn push(&self, topic: &Topic, stamp_ns: u64, cdr: impl Into<Vec<u8>>) -> bool {
        topic.0.offered.fetch_add(1, Ordering::Relaxed);
        let drop_it = || {
            self.shared.dropped.fetch_add(1, Ordering::Relaxed);
            false
        };
        if self.shared.closed.load(Ordering::Acquire) || self.shared.fault.get().is_some() {
            return drop_it();
        }
        let mut cdr = cdr.into();
        loop {
            match self.try_push(topic, stamp_ns, cdr) {
                Ok(()) => return true,
                Err(returned) if self.when_full == WhenFull::Wait && self.shared.fault.get().is_none() => {
                    std::thread::sleep(Duration::from_micros(200));
                    cdr = returned;
                }
                Err(_) => return drop_it(),
            }
        }
    }

    /// Gives the message back if it does not fit.
    fn try_push(&self, topic: &Topic, stamp_ns: u64, cdr: Vec<u8>) -> Result<(), Vec<u8>> {
        let size = cdr.len();
        let waiting = self.shared.queued_bytes.fetch_add(size, Ordering::AcqRel);
        // An empty queue takes one message of any size, or a large one could never be recorded.
        let result = if waiting == 0 || waiting + size <= self.queue_bytes {
            self.sender.try_send(Order::Message { topic: topic.0.clone(), stamp_ns, cdr }).map_err(
                |error| match error {
                    TrySendError::Full(Order::Message { cdr, .. })
                    | TrySendError::Disconnected(Order::Message { cdr, .. }) => cdr,
                    TrySendError::Full(Order::Finish) | TrySendError::Disconnected(Order::Finish) => Vec::new(),
                },
            )
        } else {
            Err(cdr)
        };
        if result.is_err() {
            self.shared.queued_bytes.fetch_sub(size, Ordering::AcqRel);
        }
        result
    }

    /// Serialises and hands over one message. `Ok(false)` as for [`Recorder::push`].
    ///
    /// # Errors
    /// [`BagError::Cdr`] if the value has no CDR form.
    pub fn push_message<T: Serialize>(&self, topic: &Topic, stamp_ns: u64, message: &T) -> Result<bool, BagError> {
        Ok(self.push(topic, stamp_ns, to_cdr(&topic.0.type_name, message)?))
    }

    /// How the recording fares. A fault belongs in the node's diagnostics; walking goes on without it.
    pub fn status(&self) -> RecorderStatus {
        let topics = self.shared.topics.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
        RecorderStatus {
            offered: topics.iter().map(|topic| topic.offered.load(Ordering::Relaxed)).sum(),
            written: topics.iter().map(|topic| topic.written.load(Ordering::Relaxed)).sum(),
            dropped: self.shared.dropped.load(Ordering::Relaxed),
            queued_bytes: self.shared.queued_bytes.load(Ordering::Relaxed),
            fault: self.shared.fault.get().cloned(),
        }
    }

    /// Writes everything that was taken, closes the files and writes `metadata.yaml`.
    ///
    /// # Errors
    /// [`BagError::Stopped`] if recording stopped by itself before; what is on disk then needs `tandem bag recover`.
    pub fn finish(self) -> Result<Summary, BagError> {
        self.close()
    }

    fn close(&self) -> Result<Summary, BagError> {
        let stopped = |reason: String| BagError::Stopped { reason };
        let thread = self.thread.lock().unwrap_or_else(|poisoned| poisoned.into_inner()).take();
        let Some(thread) = thread else { return Err(stopped("it was already finished".into())) };
        self.shared.closed.store(true, Ordering::Release);
        // Waits for a place in the queue; if the thread has ended the order has no receiver, and the join says why it
        // ended.
        let _ = self.sender.send(Order::Finish);
        let files = thread
            .join()
            .map_err(|_| stopped("the writer thread panicked; this is a fault of the program".into()))?
            .map_err(|error| stopped(error.to_string()))?;
        let topics = self.shared.topics.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
        let topics = topics
            .iter()
            .map(|topic| {
                let written = topic.written.load(Ordering::Acquire);
                let dropped = topic.offered.load(Ordering::Acquire) - written;
                TopicSummary { name: topic.name.clone(), type_name: topic.type_name.clone(), written, dropped }
            })
            .collect();
        let mut bytes = 0;
        for file in &files {
            let path = self.folder.join(&file.name);
            bytes += fs::metadata(&path).map_err(BagError::io(&path, "look at"))?.len();
        }
        let span_ns = files.iter().filter_map(|file| file.span_ns).reduce(|a, b| (a.0.min(b.0), a.1.max(b.1)));
        Ok(Summary { folder: self.folder.clone(), topics, bytes, span_ns })
    }
}

impl Drop for Recorder {
    fn drop(&mut self) {
        // After `finish` there is nothing left to do. Without it, the error has no one to go to.
        let _ = self.close();
    }
}
