//! The recorder: a bounded queue, and a thread that writes MCAP files.

use std::collections::BTreeMap;
use std::fs::{self, File};
use std::io::BufWriter;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, TrySendError, sync_channel};
use std::sync::{Arc, Mutex, OnceLock};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use serde::Serialize;

use crate::metadata::{self, FilePart, TopicCount};
use crate::{BagError, Qos, full_definition};

/// What [`Recorder::push`] does when the queue is full.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum WhenFull {
    /// Drops the message and counts it: beside a robot, which waits for nothing.
    #[default]
    Drop,
    /// Waits for the disk: for simulations and conversions, which can.
    Wait,
}

/// How a recording is made. `Default` is right for a robot at 1 kHz.
#[derive(Clone, Debug)]
pub struct RecorderOptions {
    /// Messages that may wait for the disk.
    pub queue_messages: usize,
    /// Bytes of messages that may wait for the disk.
    pub queue_bytes: usize,
    /// What happens to a message that does not fit.
    pub when_full: WhenFull,
    /// A crash loses at most this much: how often the open chunk is closed and the file synchronised to disk.
    pub flush_interval: Duration,
    /// Uncompressed bytes after which a chunk is closed before its time.
    pub chunk_bytes: u64,
    /// zstd level, 1 (fast) to 19.
    pub compression_level: u32,
    /// Begin a further file when the present one has this size in bytes, looked at after every chunk.
    pub split_bytes: Option<u64>,
    /// Begin a further file when the present one spans this much time, by the messages' stamps.
    pub split_duration: Option<Duration>,
}

impl Default for RecorderOptions {
    fn default() -> Self {
        RecorderOptions {
            queue_messages: 8192,
            queue_bytes: 8 << 20,
            when_full: WhenFull::Drop,
            flush_interval: Duration::from_millis(500),
            chunk_bytes: 1 << 20,
            compression_level: 1,
            split_bytes: None,
            split_duration: None,
        }
    }
}

impl RecorderOptions {
    fn check(&self) -> Result<(), BagError> {
        let bad = |name, value: String, expected| Err(BagError::BadOption { name, value, expected });
        if self.queue_messages == 0 || self.queue_messages > 1 << 20 {
            return bad("queue_messages", self.queue_messages.to_string(), "1 to 1048576");
        }
        if self.queue_bytes == 0 {
            return bad("queue_bytes", self.queue_bytes.to_string(), "at least 1");
        }
        if self.flush_interval.is_zero() || self.flush_interval > Duration::from_secs(60) {
            return bad("flush_interval", format!("{:?}", self.flush_interval), "above 0 and at most 60 s");
        }
        if !(1024..=1 << 28).contains(&self.chunk_bytes) {
            return bad("chunk_bytes", self.chunk_bytes.to_string(), "1024 to 268435456");
        }
        if !(1..=19).contains(&self.compression_level) {
            return bad("compression_level", self.compression_level.to_string(), "1 to 19");
        }
        if self.split_bytes.is_some_and(|bytes| bytes < 4096) {
            return bad("split_bytes", format!("{:?}", self.split_bytes), "at least 4096");
        }
        if self.split_duration.is_some_and(|duration| duration.is_zero()) {
            return bad("split_duration", format!("{:?}", self.split_duration), "above 0");
        }
        Ok(())
    }
}

/// What producers and the writer thread share about one topic.
#[derive(Debug)]
pub(crate) struct TopicShared {
    /// Index in the order of declaration; the MCAP channel is `index + 1`.
    index: u16,
    name: String,
    type_name: String,
    definition: String,
    qos: Qos,
    /// Messages handed to `push`, taken or not.
    offered: AtomicU64,
    /// Messages known to be on disk.
    written: AtomicU64,
}

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

enum Order {
    Message { topic: Arc<TopicShared>, stamp_ns: u64, cdr: Vec<u8> },
    Finish,
}

#[derive(Debug, Default)]
pub(crate) struct Shared {
    topics: Mutex<Vec<Arc<TopicShared>>>,
    queued_bytes: AtomicUsize,
    /// Messages that `push` did not take.
    dropped: AtomicU64,
    closed: AtomicBool,
    fault: OnceLock<String>,
}

impl Shared {
    pub(crate) fn declare(
        &self,
        name: &str,
        type_name: &str,
        definition: &str,
        qos: Qos,
    ) -> Result<Arc<TopicShared>, BagError> {
        crate::Definition::parse(type_name, definition)?;
        let mut topics = self.topics.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
        if let Some(known) = topics.iter().find(|topic| topic.name == name) {
            if known.type_name != type_name {
                return Err(BagError::TopicConflict {
                    topic: name.to_owned(),
                    first: known.type_name.clone(),
                    second: type_name.to_owned(),
                });
            }
            return Ok(known.clone());
        }
        let index = u16::try_from(topics.len()).ok().filter(|index| *index < u16::MAX).ok_or(BagError::BadOption {
            name: "topics",
            value: topics.len().to_string(),
            expected: "at most 65534 in one bag",
        })?;
        let topic = Arc::new(TopicShared {
            index,
            name: name.to_owned(),
            type_name: type_name.to_owned(),
            definition: definition.to_owned(),
            qos,
            offered: AtomicU64::new(0),
            written: AtomicU64::new(0),
        });
        topics.push(topic.clone());
        Ok(topic)
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
    /// Begins a bag in `folder`, which is made if it is not there and must be empty if it is. The files in it are called after
    /// the folder, as `ros2 bag record` does: `walk/walk_0.mcap`.
    ///
    /// # Errors
    /// [`BagError::Exists`] if something is in the folder, [`BagError::Io`] if it cannot be written, [`BagError::BadOption`].
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

    /// Declares a topic whose type is one of ours or a common standard message. Declaring it again gives the same topic.
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

    /// Hands one message over: `stamp_ns` nanoseconds since the epoch of the recording's clock, `cdr` with its four-byte
    /// encapsulation header. Returns at once (unless [`WhenFull::Wait`] was asked for); `false` means the message was
    /// dropped, because the queue is full or recording stopped, and counted as such.
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
        // Waits for a place in the queue; if the thread has ended the order has no receiver, and the join says why it ended.
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

/// The thread's side, also used without a thread where nothing may be dropped.
pub(crate) struct Writer {
    folder: PathBuf,
    stem: String,
    options: RecorderOptions,
    shared: Arc<Shared>,
    /// Topics in use, by index, with their count of messages in this bag that are not yet known to be on disk.
    topics: Vec<(Arc<TopicShared>, u64)>,
    files: Vec<FilePart>,
    open: OpenFile,
    next_flush: Instant,
    /// Bytes of messages since the file's size was last looked at.
    unmeasured_bytes: u64,
}

/// The file being written.
pub(crate) struct OpenFile {
    pub(crate) path: PathBuf,
    /// Device and inode, to notice that the file was taken away.
    identity: (u64, u64),
    pub(crate) mcap: mcap::Writer<BufWriter<File>>,
    /// The same file, to synchronise and to ask its size.
    handle: File,
    sequence: BTreeMap<u16, u32>,
    channels: BTreeMap<u16, u16>,
    pub(crate) messages: u64,
    pub(crate) span_ns: Option<(u64, u64)>,
}

impl Writer {
    /// Begins a bag in a folder that is empty or not there.
    pub(crate) fn open(folder: PathBuf, options: RecorderOptions, shared: Arc<Shared>) -> Result<Writer, BagError> {
        options.check()?;
        fs::create_dir_all(&folder).map_err(BagError::io(&folder, "create"))?;
        let mut entries = fs::read_dir(&folder).map_err(BagError::io(&folder, "list"))?;
        if entries.next().is_some() {
            return Err(BagError::Exists { path: folder });
        }
        let name = folder.canonicalize().map_err(BagError::io(&folder, "resolve"))?;
        let stem = name.file_name().map_or("bag".into(), |name| name.to_string_lossy().into_owned());
        let open = OpenFile::create(&folder, &stem, 0, &options)?;
        let next_flush = Instant::now() + options.flush_interval;
        Ok(Writer {
            folder,
            stem,
            options,
            shared,
            topics: Vec::new(),
            files: Vec::new(),
            open,
            next_flush,
            unmeasured_bytes: 0,
        })
    }

    fn run(&mut self, receiver: &Receiver<Order>) -> Result<(), BagError> {
        loop {
            match receiver.recv_timeout(self.next_flush.saturating_duration_since(Instant::now())) {
                Ok(Order::Message { topic, stamp_ns, cdr }) => {
                    self.shared.queued_bytes.fetch_sub(cdr.len(), Ordering::AcqRel);
                    self.write(&topic, stamp_ns, &cdr)?;
                }
                Ok(Order::Finish) | Err(RecvTimeoutError::Disconnected) => return Ok(()),
                Err(RecvTimeoutError::Timeout) => {}
            }
            if Instant::now() >= self.next_flush {
                self.flush()?;
                self.next_flush = Instant::now() + self.options.flush_interval;
            }
        }
    }

    pub(crate) fn write(&mut self, topic: &Arc<TopicShared>, stamp_ns: u64, cdr: &[u8]) -> Result<(), BagError> {
        if let (Some(limit), Some((start, _))) = (self.options.split_duration, self.open.span_ns)
            && u128::from(stamp_ns.saturating_sub(start)) >= limit.as_nanos()
        {
            self.split()?;
        }
        while self.topics.len() <= usize::from(topic.index) {
            // Topics are declared in order, and all of them stand in the bag even if nothing came on some.
            let declared = self.shared.topics.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
            self.topics.push((declared[self.topics.len()].clone(), 0));
        }
        self.open.write(topic, stamp_ns, cdr)?;
        self.topics[usize::from(topic.index)].1 += 1;
        self.unmeasured_bytes += cdr.len() as u64;
        if self.unmeasured_bytes >= self.options.chunk_bytes {
            self.split_if_large()?;
        }
        Ok(())
    }

    fn split_if_large(&mut self) -> Result<(), BagError> {
        self.unmeasured_bytes = 0;
        match self.options.split_bytes {
            Some(limit) if self.open.messages > 0 && self.open.size()? >= limit => self.split(),
            _ => Ok(()),
        }
    }

    /// Closes the chunk and brings it to disk; then counts what is in it as written.
    fn flush(&mut self) -> Result<(), BagError> {
        self.open.flush()?;
        self.count_written();
        self.split_if_large()
    }

    fn count_written(&mut self) {
        for (topic, pending) in &mut self.topics {
            topic.written.fetch_add(std::mem::take(pending), Ordering::AcqRel);
        }
    }

    fn split(&mut self) -> Result<(), BagError> {
        self.close_file()?;
        self.open = OpenFile::create(&self.folder, &self.stem, self.files.len(), &self.options)?;
        Ok(())
    }

    fn close_file(&mut self) -> Result<(), BagError> {
        let topics = self.topic_counts();
        self.open.finish(&topics, &self.files)?;
        self.files.push(self.open.part());
        self.count_written();
        // A bag whose recorder is killed later is then whole up to here.
        metadata::write(&self.folder, &metadata::to_yaml(&self.topic_counts(), &self.files))
    }

    /// Counts of what was handed to the files so far.
    fn topic_counts(&self) -> Vec<TopicCount> {
        let declared = self.shared.topics.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
        declared
            .iter()
            .enumerate()
            .map(|(index, topic)| {
                let pending = self.topics.get(index).map_or(0, |(_, pending)| *pending);
                let messages = topic.written.load(Ordering::Acquire) + pending;
                TopicCount::cdr(&topic.name, &topic.type_name, topic.qos, messages)
            })
            .collect()
    }

    pub(crate) fn finish(&mut self) -> Result<Vec<FilePart>, BagError> {
        // Topics on which nothing came are still part of the bag.
        let declared = self.shared.topics.lock().unwrap_or_else(|poisoned| poisoned.into_inner()).clone();
        for topic in &declared {
            self.open.channel(topic)?;
        }
        self.close_file()?;
        Ok(self.files.clone())
    }
}

impl OpenFile {
    pub(crate) fn create(folder: &Path, stem: &str, part: usize, with: &RecorderOptions) -> Result<OpenFile, BagError> {
        let path = folder.join(format!("{stem}_{part}.mcap"));
        let file = File::options().write(true).create_new(true).open(&path).map_err(BagError::io(&path, "create"))?;
        let handle = file.try_clone().map_err(BagError::io(&path, "open twice"))?;
        let attributes = file.metadata().map_err(BagError::io(&path, "look at"))?;
        let writer = concat!("tandem bag ", env!("CARGO_PKG_VERSION"));
        let mcap = mcap::WriteOptions::library(mcap::WriteOptions::new(), writer)
            .profile("ros2")
            .compression(Some(mcap::Compression::Zstd))
            .compression_level(with.compression_level)
            .compression_threads(0)
            .chunk_size(Some(with.chunk_bytes))
            // A chunk then reaches the file whole, in one piece: a killed process leaves no half-described chunk behind.
            .disable_seeking(true)
            .create(BufWriter::new(file))
            .map_err(|error| mcap_error(&path, error))?;
        Ok(OpenFile {
            identity: (attributes.dev(), attributes.ino()),
            path,
            mcap,
            handle,
            sequence: BTreeMap::new(),
            channels: BTreeMap::new(),
            messages: 0,
            span_ns: None,
        })
    }

    fn channel(&mut self, topic: &TopicShared) -> Result<u16, BagError> {
        if let Some(channel) = self.channels.get(&topic.index) {
            return Ok(*channel);
        }
        let wrap = |error| mcap_error(&self.path, error);
        let schema = self.mcap.add_schema(&topic.type_name, "ros2msg", topic.definition.as_bytes()).map_err(wrap)?;
        let about = BTreeMap::from([
            ("offered_qos_profiles".to_owned(), topic.qos.to_yaml()),
            ("topic_type_hash".to_owned(), String::new()),
        ]);
        let channel = self.mcap.add_channel(schema, &topic.name, "cdr", &about).map_err(wrap)?;
        self.channels.insert(topic.index, channel);
        Ok(channel)
    }

    fn write(&mut self, topic: &TopicShared, stamp_ns: u64, cdr: &[u8]) -> Result<(), BagError> {
        let channel_id = self.channel(topic)?;
        let sequence = self.sequence.entry(topic.index).or_insert(0);
        let header = mcap::records::MessageHeader {
            channel_id,
            sequence: *sequence,
            log_time: stamp_ns,
            publish_time: stamp_ns,
        };
        self.mcap.write_to_known_channel(&header, cdr).map_err(|error| mcap_error(&self.path, error))?;
        *sequence = sequence.wrapping_add(1);
        self.messages += 1;
        let (start, end) = self.span_ns.unwrap_or((stamp_ns, stamp_ns));
        self.span_ns = Some((start.min(stamp_ns), end.max(stamp_ns)));
        Ok(())
    }

    fn flush(&mut self) -> Result<(), BagError> {
        self.mcap.flush().map_err(|error| mcap_error(&self.path, error))?;
        self.handle.sync_data().map_err(BagError::io(&self.path, "synchronise to disk"))?;
        self.check_still_there()
    }

    /// Writing to a file that was removed succeeds and goes nowhere, so its name is looked up again.
    fn check_still_there(&self) -> Result<(), BagError> {
        let found =
            fs::metadata(&self.path).map_err(BagError::io(&self.path, "find again (was the folder removed?)"))?;
        if (found.dev(), found.ino()) != self.identity {
            return Err(BagError::bad_file(
                &self.path,
                "another file has taken this one's place while it was recorded",
            ));
        }
        Ok(())
    }

    fn size(&self) -> Result<u64, BagError> {
        Ok(self.handle.metadata().map_err(BagError::io(&self.path, "look at"))?.len())
    }

    pub(crate) fn part(&self) -> FilePart {
        let name = self.path.file_name().map_or(String::new(), |name| name.to_string_lossy().into_owned());
        FilePart { name, messages: self.messages, span_ns: self.span_ns }
    }

    pub(crate) fn finish(&mut self, topics: &[TopicCount], earlier: &[FilePart]) -> Result<(), BagError> {
        let files: Vec<FilePart> = earlier.iter().cloned().chain([self.part()]).collect();
        let about = BTreeMap::from([("serialized_metadata".to_owned(), metadata::information_yaml(topics, &files))]);
        let wrap = |error| mcap_error(&self.path, error);
        self.mcap.write_metadata(&mcap::records::Metadata { name: "rosbag2".into(), metadata: about }).map_err(wrap)?;
        self.mcap.finish().map_err(wrap)?;
        self.handle.sync_all().map_err(BagError::io(&self.path, "synchronise to disk"))?;
        self.check_still_there()
    }
}

pub(crate) fn mcap_error(path: &Path, error: mcap::McapError) -> BagError {
    match error {
        mcap::McapError::Io(source) => BagError::io(path, "write")(source),
        other => BagError::bad_file(path, format!("cannot write: {other}")),
    }
}
