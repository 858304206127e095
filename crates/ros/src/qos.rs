//! Quality of service: always stated, never a default.

use std::time::Duration;

use ros2_client::qos::{Durability, History, Liveliness, QosProfile, Reliability, WhenFull};

/// Requests that the middleware keeps for a server, and answers for a client: more than those of a burst, so that none
/// is overwritten.
const SERVICE_DEPTH: usize = 1024;

/// The quality of service of a publisher or a subscription.
///
/// A best-effort publisher does not match a reliable subscription, nor a volatile publisher a transient-local one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Qos {
    reliable: bool,
    transient_local: bool,
    /// `None`: everything is kept until every reliable subscription has it.
    depth: Option<usize>,
    promises: Promises,
}

/// What a publisher promises besides, for subscriptions that demand it. `None`: nothing.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Promises {
    /// Longest time from one message to the next.
    pub deadline: Option<Duration>,
    /// How long a message is of use.
    pub lifespan: Option<Duration>,
    /// The program itself shows for each topic that it lives, by publishing.
    pub manual_liveliness: bool,
    /// Longest time between two signs of life.
    pub lease: Option<Duration>,
}

impl Promises {
    const NONE: Promises = Promises { deadline: None, lifespan: None, manual_liveliness: false, lease: None };
}

impl Qos {
    /// A subscription for which only the newest data matters: joint states and commands in a control loop.
    #[must_use]
    pub const fn best_effort(depth: usize) -> Self {
        Qos { reliable: false, transient_local: false, depth: Some(depth), promises: Promises::NONE }
    }

    /// Every message arrives, in order, at a subscription that keeps up: the last `depth` messages are kept for it,
    /// newer ones overwrite them. A publisher waits for nobody, and serves best-effort subscriptions as well.
    #[must_use]
    pub const fn reliable(depth: usize) -> Self {
        Qos { reliable: true, transient_local: false, depth: Some(depth), promises: Promises::NONE }
    }

    /// Reliable, and nothing is overwritten: a publisher whose subscriptions have fallen behind by 8192 messages gets
    /// [`PublishError::Full`](crate::PublishError::Full). For one that can wait.
    #[must_use]
    pub const fn keep_all() -> Self {
        Qos { reliable: true, transient_local: false, depth: None, promises: Promises::NONE }
    }

    /// Reliable, and the last message is kept for those who come later: `gait`, `robot_description`.
    #[must_use]
    pub const fn latched() -> Self {
        Qos { reliable: true, transient_local: true, depth: Some(1), promises: Promises::NONE }
    }

    /// Reliable and transient-local with a depth, as `/rosout` and `/tf_static` have it.
    #[must_use]
    pub const fn transient_local(depth: usize) -> Self {
        Qos { reliable: true, transient_local: true, depth: Some(depth), promises: Promises::NONE }
    }

    /// Every policy by its value, as a bag or a file states them. `depth`: `None` keeps all.
    #[must_use]
    pub const fn stated(reliable: bool, transient_local: bool, depth: Option<usize>, promises: Promises) -> Self {
        Qos { reliable, transient_local, depth, promises }
    }

    /// Both ways of a service.
    pub(crate) fn service() -> QosProfile {
        Qos::reliable(SERVICE_DEPTH).profile()
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
            .history(self.depth.map_or(History::KeepAll, |depth| History::KeepLast { depth }))
            .deadline(self.promises.deadline)
            .lifespan(self.promises.lifespan)
            .liveliness(if self.promises.manual_liveliness { Liveliness::ManualByTopic } else { Liveliness::Automatic })
            .liveliness_lease(self.promises.lease)
    }
}
