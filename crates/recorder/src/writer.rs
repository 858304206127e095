//! The writer thread's side: files in MCAP, one after the other.

use std::collections::BTreeMap;
use std::fs::{self, File};
use std::io::BufWriter;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::sync::mpsc::{Receiver, RecvTimeoutError};
use std::time::Instant;

use crate::channel::{OFFERED, TYPE_HASH};
use crate::metadata::{self, FilePart, TopicCount};
use crate::shared::{Order, Shared, TopicShared};
use crate::{BagError, RecorderOptions};

/// The thread's side, also used without a thread where nothing may be dropped.
pub(crate) struct Writer {
    folder: PathBuf,
    stem: String,
    options: RecorderOptions,
    pub(crate) shared: Arc<Shared>,
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

    pub(crate) fn run(&mut self, receiver: &Receiver<Order>) -> Result<(), BagError> {
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

    fn write(&mut self, topic: &Arc<TopicShared>, stamp_ns: u64, cdr: &[u8]) -> Result<(), BagError> {
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
                TopicCount::recorded(topic, messages)
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
            // A chunk then reaches the file whole, in one piece: a killed process leaves no half-described chunk
            // behind.
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
            (OFFERED.to_owned(), topic.qos.to_yaml()),
            (TYPE_HASH.to_owned(), topic.type_hash.clone()),
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
