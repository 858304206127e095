//! The cycle's end: wait-free.

use control::{Controller, InertialState, Input, JOINTS, JointState, MAX_REQUESTS, Output, Request, Snapshot};
use rtrb::Producer;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

/// One cycle: all that its step saw, and its output.
#[derive(Clone, Copy, Debug)]
pub struct LoggedCycle {
    pub(super) recording: u64,
    pub(super) now: Duration,
    pub(super) joints: Option<JointState>,
    pub(super) sensed: (Option<InertialState>, Option<control::VelocityCommand>),
    pub(super) body_pose: Option<control::BodyPose>,
    pub(super) requests: [Request; MAX_REQUESTS],
    pub(super) request_count: usize,
    /// Number of the gait that arrived, as the services count them; 0: none did.
    pub(super) gait: u64,
    pub(super) emergency_stop: bool,
    pub(super) fault: Option<control::FaultReport>,
    pub(super) effort_nm: Option<[f64; JOINTS]>,
    pub(super) output: Output,
}

/// The cycle's end.
pub struct CycleLog {
    pub(super) cycles: Producer<LoggedCycle>,
    pub(super) beginnings: Producer<(u64, Snapshot)>,
    pub(super) shared: Arc<Shared>,
    /// The recording that this end is in; 0: none.
    pub(super) recording: u64,
}

/// What both ends see.
#[derive(Debug, Default)]
pub(super) struct Shared {
    /// The recording that is wanted; 0: none.
    pub(super) wanted: AtomicU64,
    /// Cycles of the present recording that found the buffer full.
    pub(super) dropped_cycles: AtomicU64,
}

impl CycleLog {
    /// Before a step: notices that a recording begins or ends.
    pub fn begin_cycle(&mut self, controller: &Controller) {
        let wanted = self.shared.wanted.load(Ordering::Acquire);
        // A full buffer of beginnings: tried again in the next cycle.
        if wanted != self.recording && (wanted == 0 || self.beginnings.push((wanted, controller.snapshot())).is_ok()) {
            self.recording = wanted;
        }
    }

    /// After a step.
    pub fn end_cycle(
        &mut self,
        now: Duration,
        input: &Input,
        gait: u64,
        effort_nm: Option<[f64; JOINTS]>,
        output: &Output,
    ) {
        if self.recording == 0 {
            return;
        }
        let mut requests = [Request::Stop; MAX_REQUESTS];
        let request_count = input.requests.len().min(MAX_REQUESTS);
        requests[..request_count].copy_from_slice(&input.requests[..request_count]);
        let logged = LoggedCycle {
            recording: self.recording,
            now,
            joints: input.joints.copied(),
            sensed: (input.inertial, input.velocity),
            body_pose: input.body_pose,
            requests,
            request_count,
            gait,
            emergency_stop: input.emergency_stop,
            fault: input.fault,
            effort_nm,
            output: *output,
        };
        if self.cycles.push(logged).is_err() {
            self.shared.dropped_cycles.fetch_add(1, Ordering::Relaxed);
        }
    }
}
