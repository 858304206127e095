//! What happens often is logged seldom.

use std::time::{Duration, Instant};

/// Says at most every five seconds how often something happened since it last did.
#[derive(Default)]
pub(crate) struct Occasionally {
    count: u64,
    last: Option<Instant>,
}

impl Occasionally {
    pub(crate) fn now(&mut self) -> Option<u64> {
        self.count += 1;
        if self.last.is_none_or(|last| last.elapsed() >= Duration::from_secs(5)) {
            self.last = Some(Instant::now());
            Some(std::mem::take(&mut self.count))
        } else {
            None
        }
    }
}
