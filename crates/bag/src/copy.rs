//! Messages of one bag in another, byte for byte: whatever they are serialised in and whatever describes their types.

use std::path::{Path, PathBuf};

use recorder::BagCopy;

use crate::BagError;
use crate::read::{Bag, BagTopic};

/// Which messages are copied.
#[derive(Clone, Debug, Default)]
pub struct Filter {
    /// Only these topics; empty: all.
    pub topics: Vec<String>,
    /// Nothing before this, ns.
    pub from_ns: u64,
    /// Nothing after this, ns; `None`: to the end.
    pub to_ns: Option<u64>,
}

/// What was copied.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Filtered {
    /// The new bag's folder.
    pub folder: PathBuf,
    /// Topics in it.
    pub topics: usize,
    /// Messages in it.
    pub messages: u64,
    /// First and last stamp, ns, if there is any message.
    pub span_ns: Option<(u64, u64)>,
}

/// Copies a part of a bag into a new one (MCAP) in `target`.
///
/// # Errors
/// [`BagError::Exists`] if something is in `target`; [`BagError::Io`]; [`BagError::BadFile`] if the source cannot be
/// read on.
pub fn filter(bag: &Bag, target: impl AsRef<Path>, filter: &Filter) -> Result<Filtered, BagError> {
    let target = target.as_ref();
    let mut copy = BagCopy::open(target)?;
    let wanted = |topic: &BagTopic| filter.topics.is_empty() || filter.topics.contains(&topic.name);
    let mut topics = Vec::new();
    for topic in bag.topics() {
        topics.push(if wanted(topic) { Some(copy.topic(&topic.channel)?) } else { None });
    }
    let mut messages = 0;
    for message in bag.messages()? {
        let message = message?;
        if filter.to_ns.is_some_and(|end| message.stamp_ns > end) {
            break;
        }
        let Some(topic) = topics[message.topic].filter(|_| message.stamp_ns >= filter.from_ns) else { continue };
        copy.write(topic, &message)?;
        messages += 1;
    }
    let topics = topics.iter().flatten().count();
    let file = copy.finish()?;
    Ok(Filtered { folder: target.to_owned(), topics, messages, span_ns: file.span_ns })
}
