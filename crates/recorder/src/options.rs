//! How a recording is made.

use std::time::Duration;

use crate::BagError;

/// What [`Recorder::push`](crate::Recorder::push) does when the queue is full.
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
    pub(crate) fn check(&self) -> Result<(), BagError> {
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
