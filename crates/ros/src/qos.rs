//! Quality of service: always stated, never a default.

use ros2_client::qos::{Durability, History, QosProfile, Reliability, WhenFull};

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
