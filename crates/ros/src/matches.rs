//! Which endpoints of other participants the middleware has connected with this node's, known by its own events.

use std::collections::BTreeMap;
use std::sync::{Mutex, PoisonError};

use ros2_client::Gid;
use ros2_client::dds::rustdds::{DomainParticipantStatusEvent as Event, GUID, LostReason};
use tokio::sync::mpsc::{UnboundedReceiver, UnboundedSender, unbounded_channel};
use tokio::sync::watch;

/// Each remote endpoint with the number of the event that reported its latest match.
#[derive(Default)]
pub(crate) struct Table {
    pub(crate) readers: BTreeMap<GUID, u64>,
    pub(crate) writers: BTreeMap<GUID, u64>,
    events: u64,
}

impl Table {
    /// Returns whether it has changed anything.
    fn note(&mut self, event: &Event) -> bool {
        self.events += 1;
        let before = (self.readers.len(), self.writers.len());
        match event {
            Event::RemoteReaderMatched { remote_reader, .. } => {
                self.readers.insert(*remote_reader, self.events);
                return true;
            }
            Event::RemoteWriterMatched { remote_writer, .. } => {
                self.writers.insert(*remote_writer, self.events);
                return true;
            }
            Event::ReaderLost { guid, .. } => drop(self.readers.remove(guid)),
            Event::WriterLost { guid, .. } => drop(self.writers.remove(guid)),
            // Its endpoints are not taken leave of one by one.
            Event::ParticipantLost { id, .. } => {
                self.readers.retain(|guid, _| guid.prefix != *id);
                self.writers.retain(|guid, _| guid.prefix != *id);
            }
            _ => {}
        }
        before != (self.readers.len(), self.writers.len())
    }
}

/// A publisher's identity, as long as it lives.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct PublisherId(pub [u8; 16]);

impl PublisherId {
    /// The program that it belongs to.
    #[must_use]
    pub fn program(self) -> ProgramId {
        let [program @ .., _, _, _, _] = self.0;
        ProgramId(program)
    }
}

impl From<Gid> for PublisherId {
    fn from(gid: Gid) -> Self {
        PublisherId(gid.to_bytes16())
    }
}

/// A program on the network, as long as it lives there: its DDS participant, which its publishers and clients share.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ProgramId(pub [u8; Departure::PARTICIPANT]);

impl ProgramId {
    /// Whose request it is, by its writer or by the reader that waits for the answer.
    pub(crate) fn of(endpoint: Gid) -> Self {
        PublisherId::from(endpoint).program()
    }
}

/// One publisher, or all those of one participant, are gone.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Departure {
    id: [u8; 16],
    /// How much of the identity counts.
    length: usize,
    /// They announced it; else they were not received for their lease.
    pub in_order: bool,
}

impl Departure {
    /// Bytes of an identity that are its participant's.
    pub const PARTICIPANT: usize = 12;

    /// A whole program is gone.
    #[must_use]
    pub fn of_program(program: ProgramId, in_order: bool) -> Self {
        let mut id = [0; 16];
        id[..Self::PARTICIPANT].copy_from_slice(&program.0);
        Departure { id, length: Self::PARTICIPANT, in_order }
    }

    /// One publisher is gone.
    #[must_use]
    pub fn of_publisher(publisher: PublisherId, in_order: bool) -> Self {
        Departure { id: publisher.0, length: publisher.0.len(), in_order }
    }

    /// Whether this publisher is gone with it.
    #[must_use]
    pub fn covers(&self, publisher: PublisherId) -> bool {
        publisher.0[..self.length] == self.id[..self.length]
    }

    /// Whether this program is gone with it.
    #[must_use]
    pub fn covers_program(&self, program: ProgramId) -> bool {
        self.length == Self::PARTICIPANT && self.id[..Self::PARTICIPANT] == program.0
    }

    pub(crate) fn of(event: &Event) -> Option<Self> {
        match event {
            Event::WriterLost { guid, reason } => {
                Some(Self::of_publisher(PublisherId(guid.to_bytes()), matches!(reason, LostReason::Disposed)))
            }
            Event::ParticipantLost { id, reason } => {
                let mut any_endpoint = GUID::from_bytes([0; 16]);
                any_endpoint.prefix = *id;
                let in_order = matches!(reason, LostReason::Disposed);
                Some(Departure { id: any_endpoint.to_bytes(), length: Self::PARTICIPANT, in_order })
            }
            _ => None,
        }
    }
}

/// Who wants to know of publishers of one topic (the middleware's name of it) and type.
struct Listener {
    topic: String,
    type_name: String,
    came: UnboundedSender<PublisherId>,
}

/// What other participants say that they publish.
#[derive(Default)]
pub(crate) struct Announcements(Mutex<Vec<Listener>>);

impl Announcements {
    /// Reports every publisher of this topic and type that is announced from now on, as often as it is.
    pub(crate) fn listen(&self, topic: &str, type_name: &str) -> UnboundedReceiver<PublisherId> {
        let (came, receiver) = unbounded_channel();
        let listener = Listener { topic: topic.into(), type_name: type_name.into(), came };
        self.0.lock().unwrap_or_else(PoisonError::into_inner).push(listener);
        receiver
    }

    fn note(&self, event: &Event) {
        let Event::WriterDetected { writer } = event else { return };
        let mut listeners = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        listeners.retain(|listener| {
            let meant = listener.topic == writer.topic_name && listener.type_name == writer.type_name;
            if meant {
                listener.came.send(PublisherId(writer.guid.to_bytes())).is_ok()
            } else {
                !listener.came.is_closed()
            }
        });
    }
}

/// The matches of all endpoints of a node.
#[derive(Default)]
pub(crate) struct Matches(watch::Sender<Table>, Announcements);

impl Matches {
    /// What others say that they publish, matched or not.
    pub(crate) fn announcements(&self) -> &Announcements {
        &self.1
    }

    /// Takes note of an event of the middleware.
    pub(crate) fn note(&self, event: &Event) {
        self.0.send_if_modified(|table| table.note(event));
        self.announcements().note(event);
    }

    /// The table as it stands.
    pub(crate) fn table(&self) -> watch::Ref<'_, Table> {
        self.0.borrow()
    }

    /// Reports changes of the table.
    pub(crate) fn changes(&self) -> watch::Receiver<Table> {
        self.0.subscribe()
    }

    /// How many events there have been. An endpoint made now is matched by later ones only.
    pub(crate) fn now(&self) -> u64 {
        self.0.borrow().events
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn guid(participant: u8, entity: u8, kind: u8) -> GUID {
        let mut bytes = [participant; 16];
        bytes[12..].copy_from_slice(&[0, 0, entity, kind]);
        GUID::from_bytes(bytes)
    }

    #[test]
    fn endpoints_are_matched_until_they_or_their_participant_are_lost() {
        let mut table = Table::default();
        let writer = guid(0, 1, 3);
        let (first, second, other) = (guid(1, 1, 4), guid(1, 2, 4), guid(2, 1, 4));
        for remote_reader in [first, second, other] {
            assert!(table.note(&Event::RemoteReaderMatched { local_writer: writer, remote_reader }));
        }
        assert!(table.note(&Event::RemoteWriterMatched { local_reader: first, remote_writer: guid(1, 3, 3) }));
        assert_eq!(
            table.readers.iter().map(|(guid, event)| (*guid, *event)).collect::<Vec<_>>(),
            [(first, 1), (second, 2), (other, 3)]
        );
        // Matched once more, by an endpoint made later.
        assert!(table.note(&Event::RemoteReaderMatched { local_writer: writer, remote_reader: first }));
        assert_eq!(table.readers[&first], 5);
        assert!(table.note(&Event::ReaderLost { guid: first, reason: LostReason::Disposed }));
        assert!(!table.note(&Event::ReaderLost { guid: first, reason: LostReason::Disposed }));
        assert!(table.note(&Event::ParticipantLost { id: second.prefix, reason: LostReason::Disposed }));
        assert_eq!(table.readers.keys().collect::<Vec<_>>(), [&other]);
        assert!(table.writers.is_empty());
    }

    #[test]
    fn a_departure_covers_its_publisher_or_all_of_its_participant() {
        let (first, second, other) = (guid(1, 1, 3), guid(1, 2, 3), guid(2, 1, 3));
        let id = |guid: GUID| PublisherId(guid.to_bytes());
        let one = Departure::of(&Event::WriterLost { guid: first, reason: LostReason::Disposed }).unwrap();
        assert_eq!([first, second, other].map(|guid| one.covers(id(guid))), [true, false, false]);
        assert!(one.in_order);
        let all = Departure::of(&Event::ParticipantLost { id: first.prefix, reason: LostReason::Disposed }).unwrap();
        assert_eq!([first, second, other].map(|guid| all.covers(id(guid))), [true, true, false]);
        let program = |guid: GUID| ProgramId::of(Gid::from(guid));
        assert_eq!([first, second, other].map(|guid| all.covers_program(program(guid))), [true, true, false]);
        assert!(!one.covers_program(program(first)), "one of its publishers is not the program");
        assert_eq!(Departure::of_program(program(first), true), all);
        assert_eq!(Departure::of(&Event::RemoteWriterMatched { local_reader: first, remote_writer: second }), None);
    }
}
