//! What a node's publishers, clients, services and tasks share.

use std::pin::pin;
use std::sync::{Arc, Mutex, PoisonError};

use futures::StreamExt;
use ros2_client::dds::rustdds::{DomainParticipantStatusListener, GUID, StatusEvented};
use ros2_client::{Context, Gid, Name};
use tokio::runtime::Handle;
use tokio::sync::mpsc::{UnboundedReceiver, UnboundedSender, unbounded_channel};

use crate::RosError;
use crate::matches::{Departure, Matches};
use crate::names::{self, Subject};

/// What publishers, clients and the tasks of a node share.
pub(crate) struct Core {
    /// None once the node is shut down.
    pub(crate) node: Mutex<Option<ros2_client::Node>>,
    pub(crate) handle: Handle,
    pub(crate) name: String,
    pub(crate) namespace: String,
    pub(crate) remaps: Vec<names::Remap>,
    pub(crate) context: Mutex<Option<Context>>,
    pub(crate) matches: Matches,
    /// Who wants to know of publishers that are gone.
    pub(crate) departures: Mutex<Vec<UnboundedSender<Departure>>>,
}

impl Core {
    pub(crate) fn with_node<T>(&self, action: impl FnOnce(&mut ros2_client::Node) -> T) -> Option<T> {
        // The middleware's node is a list of endpoints: usable after a panic elsewhere.
        let mut guard = self.node.lock().unwrap_or_else(PoisonError::into_inner);
        guard.as_mut().map(action)
    }

    pub(crate) fn context(&self) -> Option<Context> {
        self.context.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// The type that the publisher with this identity announces, if it is known.
    pub(crate) fn announced_type(&self, publisher: Gid) -> Option<String> {
        self.context()?
            .domain_participant()
            .discovered_writers()
            .into_iter()
            .find(|writer| Gid::from(writer.writer_proxy.remote_writer_guid) == publisher)
            .map(|writer| writer.publication_topic_data.type_name)
    }

    /// The other participants' readers on a topic (the middleware's name of it), as far as they are known.
    pub(crate) fn discovered_readers(&self, topic: &str) -> Vec<GUID> {
        let readers =
            self.context().map(|context| context.domain_participant().discovered_readers()).unwrap_or_default();
        let on_topic = readers.into_iter().filter(|reader| reader.subscription_topic_data.topic_name() == topic);
        on_topic.map(|reader| reader.reader_proxy.remote_reader_guid).collect()
    }

    /// The writers on a topic (the middleware's name of it), as far as they are known, this node's included.
    pub(crate) fn discovered_writers(&self, topic: &str) -> Vec<GUID> {
        let writers =
            self.context().map(|context| context.domain_participant().discovered_writers()).unwrap_or_default();
        let on_topic = writers.into_iter().filter(|writer| writer.publication_topic_data.topic_name == topic);
        on_topic.map(|writer| writer.writer_proxy.remote_writer_guid).collect()
    }

    /// Keeps the matches up to date until it is aborted. The middleware has one queue of events: nobody else may read
    /// it.
    pub(crate) async fn follow(core: Arc<Core>, listener: DomainParticipantStatusListener) {
        let mut events = pin!(listener.as_async_status_stream());
        while let Some(event) = events.next().await {
            core.matches.note(&event);
            if let Some(departure) = Departure::of(&event) {
                core.note_departure(departure);
            }
        }
    }

    /// Reports every publisher, or whole participant, that is gone from now on.
    pub(crate) fn departures(&self) -> UnboundedReceiver<Departure> {
        let (sender, receiver) = unbounded_channel();
        self.departures.lock().unwrap_or_else(PoisonError::into_inner).push(sender);
        receiver
    }

    /// Notifies every subscription that a publisher, or a whole participant, is gone.
    pub(crate) fn note_departure(&self, departure: Departure) {
        let mut departures = self.departures.lock().unwrap_or_else(PoisonError::into_inner);
        departures.retain(|subscription| subscription.send(departure).is_ok());
    }

    pub(crate) fn full_name(&self, name: &str, subject: Subject) -> Result<String, RosError> {
        names::resolve(name, subject, &self.namespace, &self.name, &self.remaps)
    }
}

pub(crate) fn dds_name(full: &str) -> Result<Name, RosError> {
    Name::parse(full).map_err(|error| RosError::Name { name: full.to_string(), reason: error.to_string() })
}
