//! A periodic loop for control: absolute-time sleep on the monotonic clock, real-time scheduling where the system
//! grants it, histograms without allocation, and an allocation guard for tests.
//!
//! [`RealtimeRequest::apply`] asks the system for what a control loop wants and returns one [`Warning`] for each thing
//! it refuses, each naming what to grant. [`Periodic`] wakes at start + k · period, however long a cycle took.
//! [`Histogram`] holds latencies and computing times.

mod clock;
mod guard;
mod histogram;
mod periodic;
mod scheduling;

pub use clock::monotonic_now;
pub use guard::{CountingAllocator, allocations_of_this_thread};
pub use histogram::Histogram;
pub use periodic::{Periodic, Wake};
pub use scheduling::{RealtimeRequest, Warning, raise_threads};
