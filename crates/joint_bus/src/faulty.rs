//! A link that misbehaves as configured, for tests. The same seed misbehaves the same way.

use crate::{Frame, Incoming, Link, LinkError};
use std::collections::VecDeque;
use std::io;
use std::sync::Arc;
use std::time::Duration;

/// What goes wrong with frames that come in. Shares are of all frames, 0 to 1.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Faults {
    /// Lost.
    pub lose: f64,
    /// A bit turned over. (A real controller chip drops such a frame by its checksum; a firmware's own error would
    /// not.)
    pub corrupt: f64,
    /// Delivered twice.
    pub duplicate: f64,
    /// Delivered after the one behind it.
    pub reorder: f64,
    /// Delivered later.
    pub delay: Duration,
    /// The only frames lost are those of this drive, by the reply's first byte.
    pub silence: Option<u8>,
    /// The interface is down.
    pub down: bool,
    /// The queue to the bus is full.
    pub full: bool,
    /// The controller chip is off the bus; reopening brings it back.
    pub bus_off: bool,
}

/// A link with faults.
#[derive(Debug)]
pub struct Faulty<L> {
    inner: L,
    name: Arc<str>,
    /// What goes wrong; change it at any time.
    pub faults: Faults,
    random: u64,
    late: VecDeque<(Duration, Frame)>,
    held: Option<Frame>,
    said_bus_off: bool,
    /// How often it was reopened.
    pub reopened: u64,
}

impl<L> Faulty<L> {
    /// A faultless link so far.
    pub fn new(inner: L, seed: u64) -> Self {
        Self {
            inner,
            name: "faulty".into(),
            faults: Faults::default(),
            random: seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1,
            late: VecDeque::new(),
            held: None,
            said_bus_off: false,
            reopened: 0,
        }
    }

    fn draw(&mut self) -> u64 {
        // Marsaglia's xorshift.
        self.random ^= self.random << 13;
        self.random ^= self.random >> 7;
        self.random ^= self.random << 17;
        self.random
    }

    fn happens(&mut self, share: f64) -> bool {
        share > 0.0 && (self.draw() >> 11) as f64 / (1_u64 << 53) as f64 <= share
    }

    fn down(&self) -> LinkError {
        LinkError::Down { interface: Arc::clone(&self.name), source: io::Error::from_raw_os_error(libc::ENETDOWN) }
    }
}

impl<L: Link> Link for Faulty<L> {
    fn send(&mut self, frame: &Frame, now: Duration) -> Result<(), LinkError> {
        if self.faults.down {
            return Err(self.down());
        }
        if self.faults.full {
            return Err(LinkError::Full);
        }
        if self.faults.bus_off {
            // Frames go into the chip and no further.
            return Ok(());
        }
        self.inner.send(frame, now)
    }

    fn receive(&mut self, now: Duration) -> Result<Option<Incoming>, LinkError> {
        if self.faults.down {
            return Err(self.down());
        }
        if self.faults.bus_off {
            let first = !std::mem::replace(&mut self.said_bus_off, true);
            return Ok(first.then_some(Incoming::BusOff));
        }
        while let Some(incoming) = self.inner.receive(now)? {
            let Incoming::Frame(mut frame, _) = incoming else { return Ok(Some(incoming)) };
            let silent = self.faults.silence.is_some_and(|id| frame.data().first() == Some(&id));
            if silent || self.happens(self.faults.lose) {
                continue;
            }
            if self.happens(self.faults.corrupt) {
                let bit = self.draw();
                let data = frame.data_mut();
                let byte = (bit >> 8) as usize % data.len().max(1);
                if let Some(byte) = data.get_mut(byte) {
                    *byte ^= 1 << (bit & 7);
                }
            }
            if self.held.is_none() && self.happens(self.faults.reorder) {
                self.held = Some(frame);
                continue;
            }
            let due = now + self.faults.delay;
            self.late.push_back((due, frame));
            if self.happens(self.faults.duplicate) {
                self.late.push_back((due, frame));
            }
            if let Some(held) = self.held.take() {
                self.late.push_back((due, held));
            }
        }
        if self.late.front().is_some_and(|(due, _)| *due <= now) {
            return Ok(self.late.pop_front().map(|(_, frame)| Incoming::Frame(frame, None)));
        }
        Ok(None)
    }

    fn reopen(&mut self) -> Result<(), LinkError> {
        self.reopened += 1;
        if self.faults.down {
            return Err(self.down());
        }
        self.faults.bus_off = false;
        self.said_bus_off = false;
        self.inner.reopen()
    }
}
