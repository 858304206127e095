//! What a controller remembers from one step to the next: the parts' own memories, and nothing else.

use crate::body_pose::Body;
use crate::course::{Course, Then};
use crate::day::{Day, Heed};
use crate::gait_clock::{GaitClock, Offset};
use crate::law::Law;
use crate::limits::Limits;
use crate::motion::Motion;
use crate::ramp::Ramp;
use crate::watch::{Still, Watch};
use crate::{DampingReason, FaultReport, FaultSet, JOINTS, JointCommand, JointState, Mode, PreparedGait};
use estimator::Estimator;
use std::time::Duration;

/// A controller's memory at one moment: [`crate::Controller::snapshot`]. Everything that the next step depends on
/// besides the configuration and its input.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Snapshot {
    pub(crate) day: Day,
    pub(crate) watch: Watch,
    pub(crate) motion: Motion,
    pub(crate) law: Law,
    /// Of the base; it waits for data where there is no balance.
    #[serde(default)]
    pub(crate) estimate: Estimator,
    pub(crate) limits: Limits,
    /// What was sent last.
    pub(crate) command: JointCommand,
    pub(crate) cycles: u64,
    pub(crate) stale_inputs: u64,
}

impl Snapshot {
    /// Before the first step.
    pub(crate) const BEGINNING: Self = Self {
        day: Day::BEGINNING,
        watch: Watch::NOTHING,
        motion: Motion::NONE,
        law: Law::Paper,
        estimate: Estimator::WAITING,
        limits: Limits::NOTHING,
        command: JointCommand::LIMP,
        cycles: 0,
        stale_inputs: 0,
    };

    /// Steps of the controller until then.
    pub fn cycles(&self) -> u64 {
        self.cycles
    }
}

/// The form in which a snapshot stands in bags of versions before the memory was split; what is recorded now has
/// [`Snapshot`]'s.
#[derive(Clone, Copy, Debug, PartialEq, serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SnapshotVersion1 {
    limiter: Limits,
    mode: Mode,
    damping_reason: Option<DampingReason>,
    faults: FaultSet,
    report: Option<FaultReport>,
    walk_wanted: bool,
    motion: CourseVersion1,
    gait: Option<PreparedGait>,
    pending: Option<PreparedGait>,
    joints: Option<JointState>,
    command: JointCommand,
    last_now: Option<Duration>,
    tracking_error_s: [f64; JOINTS],
    overspeed_s: [f64; JOINTS],
    still: [Option<Still>; JOINTS],
    step_index: u64,
    step_phase: f64,
    cycles: u64,
    stale_inputs: u64,
}

#[allow(clippy::large_enum_variant)]
#[derive(Clone, Copy, Debug, PartialEq, serde::Deserialize)]
enum CourseVersion1 {
    None,
    Ramp { ramp: Ramp, start: Duration, then: Then },
    Gait(GaitClockVersion1),
}

#[derive(Clone, Copy, Debug, PartialEq, serde::Deserialize)]
#[serde(deny_unknown_fields)]
struct GaitClockVersion1 {
    start: Duration,
    base_s: f64,
    base_index: u64,
    steps: u64,
    offset: Option<Offset>,
    grows: bool,
}

impl From<SnapshotVersion1> for Snapshot {
    fn from(old: SnapshotVersion1) -> Self {
        let course = match (old.motion, &old.gait) {
            (CourseVersion1::Ramp { ramp, start, then }, _) => Course::Ramp { ramp, start, then },
            (CourseVersion1::Gait(clock), Some(gait)) => {
                let GaitClockVersion1 { start, base_s, base_index, steps, offset, grows } = clock;
                Course::Gait(GaitClock { base_s, base_index, steps, offset, ..GaitClock::new(start, gait, grows) })
            }
            (CourseVersion1::None, _) | (CourseVersion1::Gait(_), None) => Course::None,
        };
        Self {
            day: Day {
                mode: old.mode,
                damping_reason: old.damping_reason,
                faults: old.faults,
                report: old.report,
                walk_wanted: old.walk_wanted,
                // The next input says it anew.
                emergency_stop: false,
                heed: Heed::NOT_YET,
            },
            watch: Watch {
                joints: old.joints,
                last_now: old.last_now,
                tracking_error_s: old.tracking_error_s,
                overspeed_s: old.overspeed_s,
                still: old.still,
                tilted: None,
            },
            motion: Motion {
                course,
                gait: old.gait,
                pending: old.pending,
                step_index: old.step_index,
                step_phase: old.step_phase,
                body: Body::NEUTRAL,
            },
            law: Law::Paper,
            estimate: Estimator::WAITING,
            limits: old.limiter,
            command: old.command,
            cycles: old.cycles,
            stale_inputs: old.stale_inputs,
        }
    }
}
