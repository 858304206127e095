//! Publishers.

use std::sync::{Arc, PoisonError, RwLock};

use ros2_client::error::WriteError;
use serde::Serialize;
use serde::ser::SerializeTuple;
use tandem_msgs::Message;

use crate::PublishError;

/// Holds the middleware's publisher until the node takes it away at its end.
pub(crate) struct Slot<M: Serialize>(RwLock<Option<ros2_client::Publisher<M>>>);

impl<M: Serialize> Slot<M> {
    pub(crate) fn new(inner: ros2_client::Publisher<M>) -> Self {
        Slot(RwLock::new(Some(inner)))
    }

    pub(crate) fn close(&self) {
        drop(self.0.write().unwrap_or_else(PoisonError::into_inner).take());
    }

    fn publish(&self, topic: &str, message: M) -> Result<(), PublishError> {
        let slot = self.0.read().unwrap_or_else(PoisonError::into_inner);
        let topic = || topic.to_owned();
        let Some(publisher) = slot.as_ref() else {
            return Err(PublishError::ShutDown { topic: topic() });
        };
        publisher.publish(message).map_err(|error| match error {
            WriteError::WouldBlock { .. } => PublishError::Full { topic: topic() },
            other => PublishError::Middleware { topic: topic(), reason: other.forget_data().to_string() },
        })
    }
}

/// Sends messages to a topic. Clones send through the same endpoint.
///
/// Publishing takes locks, allocates and makes a system call (about 13 µs): never from a control thread. Hand the data
/// to one of the node's threads through a wait-free queue and publish there.
pub struct Publisher<M: Message> {
    topic: Arc<str>,
    slot: Arc<Slot<M>>,
}

impl<M: Message> Clone for Publisher<M> {
    fn clone(&self) -> Self {
        Publisher { topic: Arc::clone(&self.topic), slot: Arc::clone(&self.slot) }
    }
}

impl<M: Message> Publisher<M> {
    pub(crate) fn new(topic: String, slot: Arc<Slot<M>>) -> Self {
        Publisher { topic: topic.into(), slot }
    }

    /// The topic's full name.
    #[must_use]
    pub fn topic(&self) -> &str {
        &self.topic
    }

    /// Sends a message. Never waits for a subscriber.
    ///
    /// # Errors
    /// After the node's end, when a publisher that keeps all has no room left, or with the middleware's reason.
    pub fn publish(&self, message: M) -> Result<(), PublishError> {
        self.slot.publish(&self.topic, message)
    }
}

/// Sends messages that are serialised already, as they stand in a bag.
#[derive(Clone)]
pub struct RawPublisher {
    topic: Arc<str>,
    slot: Arc<Slot<Raw>>,
}

impl RawPublisher {
    pub(crate) fn new(topic: String, slot: Arc<Slot<Raw>>) -> Self {
        RawPublisher { topic: topic.into(), slot }
    }

    /// The topic's full name.
    #[must_use]
    pub fn topic(&self) -> &str {
        &self.topic
    }

    /// Sends a message: little-endian CDR with its four-byte encapsulation header (`00 01`, and two bytes that do not
    /// matter). Never waits for a subscriber.
    ///
    /// # Errors
    /// When the header is another one, after the node's end, when a publisher that keeps all has no room left, or with
    /// the middleware's reason.
    pub fn publish(&self, cdr: &[u8]) -> Result<(), PublishError> {
        match cdr.split_at_checked(4) {
            Some(([0, 1, ..], body)) => self.slot.publish(&self.topic, Raw(body.to_vec())),
            _ => Err(PublishError::Middleware {
                topic: self.topic.to_string(),
                reason: format!(
                    "the message begins with the bytes {:02x?}; expected 00 01, little-endian CDR",
                    cdr.get(..2).unwrap_or(cdr)
                ),
            }),
        }
    }
}

/// The bytes of a message behind its encapsulation header. They serialise to themselves: bytes have no alignment, and
/// the first stands where the message begins.
pub(crate) struct Raw(Vec<u8>);

impl Serialize for Raw {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut bytes = serializer.serialize_tuple(self.0.len())?;
        for byte in &self.0 {
            bytes.serialize_element(byte)?;
        }
        bytes.end()
    }
}
