//! Publishers of other participants on a topic: counted, and reported as they come and go.

use std::collections::BTreeSet;
use std::sync::Arc;
use std::time::Duration;

use ros2_client::MessageTypeName;
use ros2_client::dds::rustdds::RTPSEntity;
use tandem_msgs::Message;

use crate::matches::{Departure, PublisherId};
use crate::names::Subject;
use crate::shared::Core;
use crate::{Node, RosError};

/// How often the count is taken anew: the middleware drops news where many come at once.
const REVIEW: Duration = Duration::from_secs(1);
/// Publishers that are distinguished, at most: whoever announces more of them holds no more memory.
const MAX_TOLD_APART: usize = 64;

impl Core {
    /// The publishers of other participants that announce a topic (the middleware's name of it) with a type.
    fn writers_of_others(&self, topic: &str, type_name: &str, at_most: usize) -> BTreeSet<PublisherId> {
        let writers =
            self.context().map(|context| context.domain_participant().discovered_writers()).unwrap_or_default();
        writers
            .into_iter()
            .filter(|writer| {
                let topic_data = &writer.publication_topic_data;
                topic_data.topic_name == topic && topic_data.type_name == type_name
            })
            .map(|writer| PublisherId(writer.writer_proxy.remote_writer_guid.to_bytes()))
            .filter(|publisher| !self.is_own(*publisher))
            .take(at_most)
            .collect()
    }

    /// Whether a publisher is this participant's. Once it has ended, all are: nobody is left to notify.
    fn is_own(&self, publisher: PublisherId) -> bool {
        self.context().is_none_or(|context| {
            let own = context.domain_participant().guid().to_bytes();
            publisher.0[..Departure::PARTICIPANT] == own[..Departure::PARTICIPANT]
        })
    }
}

impl Node {
    /// Reports how many publishers of other participants announce this topic with this type: first how many there are,
    /// then each time that the number changes. `report` runs on the node's threads and must be short.
    ///
    /// # Errors
    /// A wrong name.
    pub fn watch_publishers_of_others<M: Message>(
        &self,
        topic: &str,
        mut report: impl FnMut(usize) + Send + 'static,
    ) -> Result<(), RosError> {
        let core = Arc::clone(&self.core);
        let topic = format!("rt{}", core.full_name(topic, Subject::Topic)?);
        let type_name = MessageTypeName::new(M::PACKAGE, M::NAME).dds_msg_type();
        // Watched from before the first count, so that none comes between.
        let mut came = core.matches.announcements().listen(&topic, &type_name);
        let mut gone = core.departures();
        self.spawn(async move {
            let mut reviews = tokio::time::interval(REVIEW);
            let mut others = BTreeSet::<PublisherId>::new();
            let mut last = None;
            loop {
                tokio::select! {
                    biased;
                    _ = reviews.tick() => others = core.writers_of_others(&topic, &type_name, MAX_TOLD_APART),
                    Some(publisher) = came.recv() => {
                        if others.len() < MAX_TOLD_APART && !core.is_own(publisher) {
                            others.insert(publisher);
                        }
                    }
                    Some(departure) = gone.recv() => others.retain(|publisher| !departure.covers(*publisher)),
                }
                if last.replace(others.len()) != Some(others.len()) {
                    report(others.len());
                }
            }
        });
        Ok(())
    }
}
