//! Recording a run: what each cycle saw and put out goes through a wait-free buffer to a thread that writes a bag.
//!
//! The cycle's end ([`CycleLog`]) takes no lock, allocates nothing and never waits: what does not fit is counted.
//! The writer's end ([`Recording`]) has its own thread; a full or missing disk is its fault, not one of the walk.

mod cycle_log;
mod handle;
mod topics;
mod writer;

pub use cycle_log::{CycleLog, LoggedCycle};
pub use handle::{Recording, RecordingStatus};
pub use topics::{DIAGNOSTICS, IMU, THINNED_NS, Thinning};
pub use writer::{Subject, Writer};

use cycle_log::Shared;
use handle::Gaits;
use rtrb::RingBuffer;
use std::sync::atomic::{AtomicBool, AtomicU64};
use std::sync::mpsc::channel;
use std::sync::{Arc, Mutex};
use std::time::Duration;

/// Cycles that may wait for the writer: two seconds at 1 kHz.
const CYCLES: usize = 2048;

/// The two ends and the writer between.
pub fn open(subject: Subject) -> (CycleLog, Recording, Writer) {
    let (cycles_in, cycles) = RingBuffer::new(CYCLES);
    let (beginnings_in, beginnings) = RingBuffer::new(2);
    let (orders_in, orders) = channel();
    let shared = Arc::new(Shared::default());
    let dropped_others = Arc::new(AtomicU64::new(0));
    let (others, active) = (Arc::new(AtomicU64::new(0)), Arc::new(AtomicBool::new(false)));
    let status = Arc::new(Mutex::new(RecordingStatus::default()));
    let gaits = Gaits::default();
    let log = CycleLog { cycles: cycles_in, beginnings: beginnings_in, shared: Arc::clone(&shared), recording: 0 };
    let recording = Recording {
        orders: orders_in,
        others: Arc::clone(&others),
        dropped_others: Arc::clone(&dropped_others),
        active: Arc::clone(&active),
        gaits: Arc::clone(&gaits),
        status: Arc::clone(&status),
    };
    let writer = Writer {
        orders,
        cycles,
        beginnings,
        shared,
        others,
        dropped_others,
        active,
        status,
        subject,
        gaits,
        recordings: 0,
        run: None,
    };
    (log, recording, writer)
}

/// Folder for the recording of a run that begins now: the moment in UTC, as 2026-11-22T06_10_00.
pub fn folder_name(since_epoch: Duration) -> String {
    let seconds = since_epoch.as_secs();
    let (mut days, of_day) = (seconds / 86_400, seconds % 86_400);
    let leap = |year: u64| year.is_multiple_of(4) && (!year.is_multiple_of(100) || year.is_multiple_of(400));
    let mut year = 1970;
    while days >= 365 + u64::from(leap(year)) {
        days -= 365 + u64::from(leap(year));
        year += 1;
    }
    let mut month = 1;
    for length in [31, 28 + u64::from(leap(year)), 31, 30, 31, 30, 31, 31, 30, 31, 30, 31] {
        if days < length {
            break;
        }
        days -= length;
        month += 1;
    }
    format!("{year:04}-{month:02}-{:02}T{:02}_{:02}_{:02}", days + 1, of_day / 3600, of_day / 60 % 60, of_day % 60)
}
