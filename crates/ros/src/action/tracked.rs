//! Goals as their server keeps them.

use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::Instant;

use ros2_client::RmwRequestId;
use ros2_client::action_msgs::{CancelGoalRequest, GoalStatusEnum};
use ros2_client::builtin_interfaces;
use tandem_msgs::action_msgs;

/// A goal, from its acceptance until its result is forgotten.
pub(super) struct Tracked<R> {
    pub status: GoalStatusEnum,
    pub accepted: builtin_interfaces::Time,
    pub cancelled: Arc<AtomicBool>,
    pub result: Option<(R, Instant)>,
    pub asked: Vec<RmwRequestId>,
}

pub(super) fn now() -> builtin_interfaces::Time {
    let time = crate::wall_time();
    builtin_interfaces::Time::new(time.sec, time.nanosec)
}

pub(super) fn is_over(status: GoalStatusEnum) -> bool {
    matches!(status, GoalStatusEnum::Succeeded | GoalStatusEnum::Aborted | GoalStatusEnum::Canceled)
}

/// What a cancel request names. The middleware keeps that field to itself; the same bytes are ours to read.
pub(super) fn cancel_target(request: &CancelGoalRequest) -> Result<action_msgs::GoalInfo, String> {
    let bytes = cdr_encoding::to_vec::<_, byteorder::LittleEndian>(request).map_err(|error| error.to_string())?;
    cdr_encoding::from_bytes::<action_msgs::GoalInfo, byteorder::LittleEndian>(&bytes)
        .map(|(info, _)| info)
        .map_err(|error| error.to_string())
}
