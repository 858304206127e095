//! Quality of service: always stated, never a default.

use std::time::Duration;

use ros2_client::qos::{Durability, History, QosProfile, Reliability, WhenFull};

/// Requests that the middleware keeps for a server, and answers for a client: more than those of a burst, so that none is overwritten.
const SERVICE_DEPTH: usize = 1024;

/// Longer than other implementations' leases, after which a client that has stalled is forgotten.
const PATIENCE: Duration = Duration::from_secs(60);

/// The quality of service of a publisher or a subscription.
///
/// A best-effort publisher does not match a reliable subscription, nor a volatile publisher a transient-local one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Qos {
    reliable: bool,
    transient_local: bool,
    depth: usize,
}

impl Qos {
    /// Newest data matters, lost data does not: joint states and commands, anything above 150 Hz.
    #[must_use]
    pub const fn best_effort(depth: usize) -> Self {
        Qos { reliable: false, transient_local: false, depth }
    }

    /// Every message arrives, in order. A publisher never waits for a stalled subscriber: see
    /// [`PublishError::Full`](crate::PublishError::Full).
    #[must_use]
    pub const fn reliable(depth: usize) -> Self {
        Qos { reliable: true, transient_local: false, depth }
    }

    /// Reliable, and the last message is kept for those who come later: `gait`, `robot_description`.
    #[must_use]
    pub const fn latched() -> Self {
        Qos { reliable: true, transient_local: true, depth: 1 }
    }

    /// Reliable and transient-local with a depth, as `/rosout` and `/tf_static` have it.
    #[must_use]
    pub const fn transient_local(depth: usize) -> Self {
        Qos { reliable: true, transient_local: true, depth }
    }

    /// Both ways of a service.
    pub(crate) fn service() -> QosProfile {
        Qos::reliable(SERVICE_DEPTH).profile()
    }

    /// The answers of a service that awaits their sending: they wait while a stalled client has left no room, until it goes on or
    /// its lease ends.
    pub(crate) fn patient_answers() -> QosProfile {
        Qos::service().reliability(Reliability::Reliable { when_full: WhenFull::Wait(PATIENCE) })
    }

    pub(crate) fn profile(self) -> QosProfile {
        let reliability = if self.reliable {
            // Waiting inside publish would let one stalled subscriber hold up everyone.
            Reliability::Reliable { when_full: WhenFull::Fail }
        } else {
            Reliability::BestEffort
        };
        QosProfile::default()
            .reliability(reliability)
            .durability(if self.transient_local { Durability::TransientLocal } else { Durability::Volatile })
            .history(History::KeepLast { depth: self.depth })
    }
}
