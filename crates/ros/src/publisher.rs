//! Publishers.

use std::sync::{Arc, PoisonError, RwLock};

use ros2_client::error::WriteError;
use tandem_msgs::Message;

use crate::PublishError;

/// Holds the middleware's publisher until the node takes it away at its end.
pub(crate) struct Slot<M: Message>(RwLock<Option<ros2_client::Publisher<M>>>);

impl<M: Message> Slot<M> {
    pub(crate) fn new(inner: ros2_client::Publisher<M>) -> Self {
        Slot(RwLock::new(Some(inner)))
    }

    pub(crate) fn close(&self) {
        drop(self.0.write().unwrap_or_else(PoisonError::into_inner).take());
    }
}

/// Sends messages to a topic. Clones send through the same endpoint.
///
/// Publishing takes locks, allocates and makes a system call (about 13 µs): never from a control thread. Hand the data to one
/// of the node's threads through a wait-free queue and publish there.
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
    /// When a reliable subscriber has stalled, after the node's end, or with the middleware's reason.
    pub fn publish(&self, message: M) -> Result<(), PublishError> {
        let slot = self.slot.0.read().unwrap_or_else(PoisonError::into_inner);
        let topic = || self.topic.to_string();
        let Some(publisher) = slot.as_ref() else {
            return Err(PublishError::ShutDown { topic: topic() });
        };
        publisher.publish(message).map_err(|error| match error {
            WriteError::WouldBlock { .. } => PublishError::Full { topic: topic() },
            other => PublishError::Middleware { topic: topic(), reason: other.forget_data().to_string() },
        })
    }
}
