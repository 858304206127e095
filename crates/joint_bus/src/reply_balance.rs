//! Replies against requests: who gets more than was asked for is not the only one who asks.

use core::time::Duration;

/// Twice as many replies as requests in so many cycles on end: somebody else asks too. Repeated frames come singly.
const SURPLUS_CYCLES: u32 = 5;
/// A reply that comes later than this, or twice this, after its request answers nobody's.
const LATE_REPLY: Duration = Duration::from_millis(500);

/// Of one link.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct ReplyBalance {
    /// Requests since the last reading, and replies in this one.
    pub requested: u32,
    pub replied: u32,
    /// Requests without a reply: of the last [`LATE_REPLY`] but one, and since `counted_since`.
    unanswered: [u32; 2],
    counted_since: Duration,
    /// Cycles on end with a surplus.
    surplus_cycles: u32,
}

impl ReplyBalance {
    /// At the end of a reading: whether there have been, for [`SURPLUS_CYCLES`], more replies than requests without
    /// one, by as many as were asked for. Replies that were late are none. Not `steady`, behind the opening of a link,
    /// replies that had waited come at once.
    pub fn weigh(&mut self, now: Duration, steady: bool) -> bool {
        let (requested, replied) = (core::mem::take(&mut self.requested), core::mem::take(&mut self.replied));
        if now.saturating_sub(self.counted_since) >= LATE_REPLY {
            self.unanswered = [self.unanswered[1], 0];
            self.counted_since = now;
        }
        self.unanswered[1] += requested;
        let mut surplus = replied;
        for unanswered in &mut self.unanswered {
            let answered = surplus.min(*unanswered);
            *unanswered -= answered;
            surplus -= answered;
        }
        let doubled = steady && requested > 0 && surplus >= requested;
        self.surplus_cycles = if doubled { self.surplus_cycles + 1 } else { 0 };
        self.surplus_cycles >= SURPLUS_CYCLES
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: Duration = Duration::from_millis(1);

    /// How many cycles, from the first of `replied` on, it takes to notice somebody else, where each cycle asks three
    /// drives.
    fn noticed(balance: &mut ReplyBalance, from: Duration, replied: impl IntoIterator<Item = u32>) -> Option<usize> {
        replied.into_iter().enumerate().find_map(|(n, replied)| {
            (balance.requested, balance.replied) = (3, replied);
            balance.weigh(from + MS * n as u32, true).then_some(n + 1)
        })
    }

    #[test]
    fn replies_that_waited_and_come_at_once_are_no_second_controller() {
        for silent in [10, 40, 400] {
            let mut balance = ReplyBalance::default();
            assert_eq!(noticed(&mut balance, MS, vec![3; 100]), None);
            assert_eq!(noticed(&mut balance, 101 * MS, vec![0; silent]), None);
            // Sixteen frames are read in a cycle.
            let waited = 3 * silent as u32;
            let mut burst = vec![16; (waited / 13) as usize];
            burst.extend([3; 50]);
            assert_eq!(
                noticed(&mut balance, MS * (101 + silent as u32), burst),
                None,
                "{silent} cycles without a reply"
            );
        }
    }

    #[test]
    fn twice_as_many_replies_as_requests_are_noticed_in_five_cycles() {
        let mut balance = ReplyBalance::default();
        assert_eq!(noticed(&mut balance, MS, vec![3; 100]), None);
        assert_eq!(noticed(&mut balance, 101 * MS, vec![6; 10]), Some(5));
    }

    #[test]
    fn requests_that_were_lost_hide_somebody_else_for_a_second_at_most() {
        let mut balance = ReplyBalance::default();
        assert_eq!(noticed(&mut balance, MS, vec![0; 600]), None);
        let found = noticed(&mut balance, 601 * MS, vec![6; 2000]).expect("it is noticed");
        assert!(found <= 1005, "{found}");
    }
}
