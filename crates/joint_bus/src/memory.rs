//! A bus within the process: two ends joined by wait-free queues.

use crate::{Frame, Incoming, Link, LinkError};
use rtrb::{Consumer, Producer, RingBuffer};
use std::time::Duration;

/// Frames that wait, each way.
const DEPTH: usize = 128;

/// One end.
#[derive(Debug)]
pub struct MemoryLink {
    out: Producer<Frame>,
    into: Consumer<Frame>,
}

/// Both ends of a bus.
pub fn pair() -> (MemoryLink, MemoryLink) {
    let (a_out, b_in) = RingBuffer::new(DEPTH);
    let (b_out, a_in) = RingBuffer::new(DEPTH);
    (MemoryLink { out: a_out, into: a_in }, MemoryLink { out: b_out, into: b_in })
}

impl Link for MemoryLink {
    fn send(&mut self, frame: &Frame, _: Duration) -> Result<(), LinkError> {
        self.out.push(*frame).map_err(|_| LinkError::Full)
    }

    fn receive(&mut self, _: Duration) -> Result<Option<Incoming>, LinkError> {
        Ok(self.into.pop().ok().map(|frame| Incoming::Frame(frame, None)))
    }

    fn reopen(&mut self) -> Result<(), LinkError> {
        Ok(())
    }
}
