//! What a service's endpoints on one side are connected with.

use std::sync::Arc;

use ros2_client::RmwRequestId;
use ros2_client::dds::rustdds::GUID;

use crate::shared::Core;

/// What a service's endpoints on one side are connected with.
pub(crate) struct Peers {
    core: Arc<Core>,
    requests: String,
    replies: String,
    /// Matches from before are those of endpoints that had these names earlier.
    since: u64,
}

impl Peers {
    /// Of the service with this full name, whose endpoints are about to be made.
    pub(crate) fn new(core: &Arc<Core>, service: &str) -> Self {
        Peers {
            core: Arc::clone(core),
            requests: format!("rq{service}Request"),
            replies: format!("rr{service}Reply"),
            since: core.matches.now(),
        }
    }

    /// Whether a server receives our requests and its answers reach us.
    pub(crate) fn server_is_matched(&self) -> bool {
        let (readers, writers) =
            (self.core.discovered_readers(&self.requests), self.core.discovered_writers(&self.replies));
        let table = self.core.matches.table();
        readers.iter().any(|reader| self.is_recent(table.readers.get(reader)))
            && writers.iter().any(|writer| self.is_recent(table.writers.get(writer)))
    }

    /// Whether an answer to this request would reach the caller: an answer sent earlier is lost.
    pub(crate) fn caller_is_matched(&self, request: RmwRequestId) -> bool {
        let caller = GUID::from(request.writer_gid);
        if caller.entity_id.entity_kind.is_reader() {
            // Fast DDS's clients name the reader that waits for the answer.
            return self.is_recent(self.core.matches.table().readers.get(&caller));
        }
        // Others, ours among them, name the writer of the request.
        let readers = self.core.discovered_readers(&self.replies);
        let table = self.core.matches.table();
        readers.iter().any(|reader| reader.prefix == caller.prefix && self.is_recent(table.readers.get(reader)))
    }

    /// Waits until [`Peers::caller_is_matched`].
    pub(crate) async fn caller_matched(&self, request: RmwRequestId) {
        let mut changes = self.core.matches.changes();
        while !self.caller_is_matched(request) {
            // The sender lives as long as the core, so waiting cannot fail.
            let _ = changes.changed().await;
        }
    }

    fn is_recent(&self, event: Option<&u64>) -> bool {
        event.is_some_and(|event| *event > self.since)
    }
}
