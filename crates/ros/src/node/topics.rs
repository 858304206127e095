//! A node's publishers and subscriptions.

use std::collections::HashMap;
use std::sync::Arc;

use futures::StreamExt;
use ros2_client::MessageTypeName;
use tandem_msgs::Message;

use super::Node;
use crate::matches::{Departure, PublisherId};
use crate::names::Subject;
use crate::occasionally::Occasionally;
use crate::publisher::{Publisher, Raw, RawPublisher, Slot};
use crate::shared::dds_name;
use crate::type_hash::announce_message;
use crate::{Qos, RosError};

impl Node {
    /// A publisher. Names are expanded and remapped as in ROS 2.
    ///
    /// # Errors
    /// A wrong name, or the middleware's reason.
    pub fn publisher<M: Message>(&self, topic: &str, qos: Qos) -> Result<Publisher<M>, RosError> {
        let full = self.core.full_name(topic, Subject::Topic)?;
        let create = |reason: String| RosError::Create { what: format!("publisher on {full}"), reason };
        let name = dds_name(&full)?;
        announce_message::<M>();
        let inner = self
            .core
            .with_node(|node| {
                let topic = node.create_topic(&name, MessageTypeName::new(M::PACKAGE, M::NAME), &qos.profile())?;
                node.create_publisher::<M>(&topic, Some(qos.profile()))
            })
            .ok_or_else(|| self.shut_down(&full))?
            .map_err(|error| create(error.to_string()))?;
        let slot = Arc::new(Slot::new(inner));
        self.close_with(Arc::downgrade(&slot), Slot::close);
        Ok(Publisher::new(full, slot))
    }

    /// A publisher of messages that are serialised already, of any type: `package/msg/Type`. For playing bags.
    ///
    /// # Errors
    /// A wrong name or type, or the middleware's reason.
    pub fn raw_publisher(&self, topic: &str, type_name: &str, qos: Qos) -> Result<RawPublisher, RosError> {
        let full = self.core.full_name(topic, Subject::Topic)?;
        let create = |reason: String| RosError::Create { what: format!("publisher on {full}"), reason };
        let name = dds_name(&full)?;
        let parts: Vec<&str> = type_name.split('/').collect();
        let [package, "msg", type_in_package] = parts.as_slice() else {
            return Err(create(format!("type '{type_name}'; expected package/msg/Type")));
        };
        let inner = self
            .core
            .with_node(|node| {
                let topic = node.create_topic(&name, MessageTypeName::new(package, type_in_package), &qos.profile())?;
                node.create_publisher::<Raw>(&topic, Some(qos.profile()))
            })
            .ok_or_else(|| self.shut_down(&full))?
            .map_err(|error| create(error.to_string()))?;
        let slot = Arc::new(Slot::new(inner));
        self.close_with(Arc::downgrade(&slot), Slot::close);
        Ok(RawPublisher::new(full, slot))
    }

    /// A subscription that lives as long as the node. Messages of publishers that announce another type, and messages
    /// that do not decode, are dropped with a warning; arrays' lengths and values are the callback's to check.
    ///
    /// # Errors
    /// A wrong name, or the middleware's reason.
    pub fn subscribe<M: Message>(
        &self,
        topic: &str,
        qos: Qos,
        mut callback: impl FnMut(M) + Send + 'static,
    ) -> Result<(), RosError> {
        self.subscribe_from(topic, qos, move |_, message| callback(message), |_| {})
    }

    /// As [`Node::subscribe`], with each message's publisher, and notified of every publisher (of any topic) that is
    /// gone. A publisher's messages come before its departure.
    ///
    /// # Errors
    /// A wrong name, or the middleware's reason.
    pub fn subscribe_from<M: Message>(
        &self,
        topic: &str,
        qos: Qos,
        mut callback: impl FnMut(PublisherId, M) + Send + 'static,
        mut left: impl FnMut(Departure) + Send + 'static,
    ) -> Result<(), RosError> {
        let full = self.core.full_name(topic, Subject::Topic)?;
        let create = |reason: String| RosError::Create { what: format!("subscription to {full}"), reason };
        let name = dds_name(&full)?;
        let type_name = MessageTypeName::new(M::PACKAGE, M::NAME);
        let expected = type_name.dds_msg_type();
        announce_message::<M>();
        let subscription = self
            .core
            .with_node(|node| {
                let topic = node.create_topic(&name, type_name, &qos.profile())?;
                node.create_subscription::<M>(&topic, Some(qos.profile()))
            })
            .ok_or_else(|| self.shut_down(&full))?
            .map_err(|error| create(error.to_string()))?;
        let core = Arc::clone(&self.core);
        let mut departures = core.departures();
        self.spawn(async move {
            let mut known = HashMap::new();
            let mut undecoded = Occasionally::default();
            let mut messages = Box::pin(subscription.async_stream());
            loop {
                let received = tokio::select! {
                    // What a publisher reported comes before its leave.
                    biased;
                    received = messages.next() => received,
                    Some(departure) = departures.recv() => {
                        known.retain(|publisher, _| !departure.covers(*publisher));
                        left(departure);
                        continue;
                    }
                };
                match received {
                    None => return,
                    Some(Ok((message, info))) => {
                        let gid = info.publisher_gid();
                        let publisher = PublisherId::from(gid);
                        let right = known.get(&publisher).copied().unwrap_or_else(|| {
                            // Not known yet: take it, and ask again at its next message.
                            let Some(announced) = core.announced_type(gid) else { return true };
                            let right = announced == expected;
                            if !right {
                                tracing::warn!(
                                    "topic {full}: a publisher sends {announced}, expected {expected}: its messages are dropped"
                                );
                            }
                            known.insert(publisher, right);
                            right
                        });
                        if right {
                            callback(publisher, message);
                        }
                    }
                    Some(Err(error)) => {
                        if let Some(count) = undecoded.now() {
                            tracing::warn!("topic {full}: {count} messages could not be read, the last: {error}");
                        }
                    }
                }
            }
        });
        Ok(())
    }

    /// How many publishers of other nodes are seen on a topic.
    #[must_use]
    pub fn publisher_count(&self, topic: &str) -> usize {
        self.count(topic, |node, full| node.publisher_count(full))
    }

    /// How many subscriptions of other nodes are seen on a topic.
    #[must_use]
    pub fn subscription_count(&self, topic: &str) -> usize {
        self.count(topic, |node, full| node.subscription_count(full))
    }

    fn count(&self, topic: &str, count: impl FnOnce(&ros2_client::Node, &str) -> usize) -> usize {
        match self.core.full_name(topic, Subject::Topic) {
            Ok(full) => self.core.with_node(|node| count(node, &full)).unwrap_or_default(),
            Err(_) => 0,
        }
    }
}
