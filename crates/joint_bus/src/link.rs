//! Something that frames go through.

use crate::Frame;
use std::io;
use std::sync::Arc;
use std::time::Duration;

/// What came in.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Incoming {
    /// A frame, and when it arrived on the monotonic clock, where the link knows better than its reader.
    Frame(Frame, Option<Duration>),
    /// The controller chip has left the bus: nothing goes through until it is restarted.
    BusOff,
    /// The controller chip is back on the bus.
    Restarted,
    /// Errors have piled up on the bus; frames still go through.
    ErrorPassive,
    /// Another error that the bus reported.
    BusError,
}

/// Why a frame did not go through.
#[derive(Debug, thiserror::Error)]
pub enum LinkError {
    /// The queue to the bus is full (ENOBUFS, EAGAIN): normal on a loaded bus. The frame is lost; the next one will do.
    #[error("the queue to the bus is full")]
    Full,
    /// The interface is down or gone.
    #[error("{interface} is down: {source}. Bring it up: ip link set {interface} up")]
    Down {
        /// The interface's name, shared: the control cycle, which meets this while a link is down, must not allocate.
        interface: Arc<str>,
        /// Why.
        source: io::Error,
    },
    /// The frame does not fit the link (a CAN FD frame on a classical bus).
    #[error("{interface} does not carry such frames: {source}")]
    Unfit {
        /// The interface's name.
        interface: Arc<str>,
        /// Why.
        source: io::Error,
    },
}

/// A bus's end. Nothing here ever blocks.
pub trait Link {
    /// Sends a frame at time `now`.
    fn send(&mut self, frame: &Frame, now: Duration) -> Result<(), LinkError>;
    /// What has come in by `now`, one at a time; `None`: nothing more.
    fn receive(&mut self, now: Duration) -> Result<Option<Incoming>, LinkError>;
    /// Tries to bring the link up again after it was down or off the bus.
    fn reopen(&mut self) -> Result<(), LinkError>;
}
