//! How the links to the drives are.

use joints::JOINTS;
use std::time::Duration;

/// Counts of one link.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LinkHealth {
    /// Frames sent.
    pub sent: u64,
    /// Replies taken.
    pub received: u64,
    /// Frames lost to a full queue.
    pub full: u64,
    /// Frames that were no reply of a drive here, or damaged.
    pub foreign: u64,
    /// Commands to drives here that somebody else sent.
    pub commands_of_others: u64,
    /// Error frames.
    pub bus_errors: u64,
    /// Times that the link went down or off the bus.
    pub breaks: u64,
    /// Times that it was opened again.
    pub reopened: u64,
    /// Since when it is down, if it is.
    pub down_since: Option<Duration>,
}

/// Counts of all links; the first four legs' where there is one a leg.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct BusHealth {
    /// Each link's.
    pub links: [LinkHealth; JOINTS],
    /// How many links there are.
    pub count: usize,
    /// Frames sent to each drive.
    pub requests: [u64; JOINTS],
    /// Its replies.
    pub replies: [u64; JOINTS],
}
