//! A link of a bus: whether it is up, and when it is opened again.

use crate::reply_balance::ReplyBalance;
use crate::{Link, LinkHealth};
use std::time::Duration;

/// First pause before a link is opened again, doubled up to [`LONGEST_PAUSE`].
const FIRST_PAUSE: Duration = Duration::from_millis(10);
const LONGEST_PAUSE: Duration = Duration::from_secs(1);
/// A link that breaks again this soon has not been mended: the pauses go on growing.
const STEADY: Duration = Duration::from_secs(2);

/// A link and what is known of it.
pub(crate) struct LinkState<L> {
    pub link: L,
    pub health: LinkHealth,
    pub retry_at: Duration,
    pub pause: Duration,
    pub opened_at: Duration,
    pub balance: ReplyBalance,
    /// When somebody else commanded a drive here last, and its joint.
    pub second_master: Option<(Duration, usize)>,
    /// Which joint a drive's number belongs to.
    pub joint_of: [Option<u8>; 128],
}

impl<L> LinkState<L> {
    /// Never used.
    pub fn new(link: L, joint_of: [Option<u8>; 128]) -> Self {
        Self {
            link,
            health: LinkHealth::default(),
            retry_at: Duration::ZERO,
            pause: FIRST_PAUSE,
            opened_at: Duration::ZERO,
            balance: ReplyBalance::default(),
            second_master: None,
            joint_of,
        }
    }

    /// It is down from now on.
    pub fn broke(&mut self, now: Duration) {
        if self.health.down_since.is_none() {
            self.health.down_since = Some(now);
            self.health.breaks += 1;
            // An interface that is down can often be opened and fails at the first frame.
            let again = self.health.reopened > 0 && self.was_opened_lately(now);
            self.pause = if again { (self.pause * 2).min(LONGEST_PAUSE) } else { FIRST_PAUSE };
            self.retry_at = now + self.pause;
        }
    }

    /// It is up again.
    pub fn mended(&mut self) {
        self.health.down_since = None;
    }

    /// It was opened so short a time ago that it may fail again.
    pub fn was_opened_lately(&self, now: Duration) -> bool {
        now.saturating_sub(self.opened_at) < STEADY
    }
}

impl<L: Link> LinkState<L> {
    /// Opens a link that is down once more, when it is time.
    pub fn reopen(&mut self, now: Duration) {
        if self.health.down_since.is_none() || now < self.retry_at {
            return;
        }
        match self.link.reopen() {
            Ok(()) => {
                self.health.reopened += 1;
                self.opened_at = now;
                self.mended();
            }
            Err(_) => {
                self.pause = (self.pause * 2).min(LONGEST_PAUSE);
                self.retry_at = now + self.pause;
            }
        }
    }
}
