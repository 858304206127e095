//! What callers and the writer thread share.

use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize};
use std::sync::{Arc, Mutex, OnceLock};

use tandem_msgs::TypeHash;

use crate::{BagError, Qos};

/// What producers and the writer thread share about one topic.
#[derive(Debug)]
pub(crate) struct TopicShared {
    /// Index in the order of declaration; the MCAP channel is `index + 1`.
    pub(crate) index: u16,
    pub(crate) name: String,
    pub(crate) type_name: String,
    pub(crate) definition: String,
    /// Of the type's description (REP 2016).
    pub(crate) type_hash: String,
    pub(crate) qos: Qos,
    /// Messages handed to `push`, taken or not.
    pub(crate) offered: AtomicU64,
    /// Messages known to be on disk.
    pub(crate) written: AtomicU64,
}

pub(crate) enum Order {
    Message { topic: Arc<TopicShared>, stamp_ns: u64, cdr: Vec<u8> },
    Finish,
}

#[derive(Debug, Default)]
pub(crate) struct Shared {
    pub(crate) topics: Mutex<Vec<Arc<TopicShared>>>,
    pub(crate) queued_bytes: AtomicUsize,
    /// Messages that `push` did not take.
    pub(crate) dropped: AtomicU64,
    pub(crate) closed: AtomicBool,
    pub(crate) fault: OnceLock<String>,
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
            type_hash: TypeHash::of_definition(type_name, definition).hash,
            qos,
            offered: AtomicU64::new(0),
            written: AtomicU64::new(0),
        });
        topics.push(topic.clone());
        Ok(topic)
    }
}
