//! What all actions share.

use crate::builtin_interfaces::Time;
use crate::unique_identifier_msgs::UUID;

messages! { "action_msgs";
    /// A goal and when it was accepted.
    #[derive(Copy)]
    GoalInfo {
        /// The goal.
        goal_id: UUID,
        /// When it was accepted.
        stamp: Time,
    }
    /// How a goal fares.
    #[derive(Copy)]
    GoalStatus {
        /// The goal.
        goal_info: GoalInfo,
        /// One of the constants.
        status: i8,
    }
    /// How all goals fare.
    GoalStatusArray {
        /// One for each.
        status_list: Vec<GoalStatus>,
    }
    /// Which goals are to stop.
    #[derive(Copy)]
    CancelGoalRequest {
        /// One goal, or all up to a time.
        goal_info: GoalInfo,
    }
    /// Which will.
    CancelGoalResponse {
        /// 0: these will.
        return_code: i8,
        /// These.
        goals_canceling: Vec<GoalInfo>,
    }
}

service! {
    /// Stops goals.
    "action_msgs" CancelGoal: CancelGoalRequest -> CancelGoalResponse
}

impl GoalStatus {
    /// Not known.
    pub const UNKNOWN: i8 = 0;
    /// Accepted, waits.
    pub const ACCEPTED: i8 = 1;
    /// Runs.
    pub const EXECUTING: i8 = 2;
    /// Asked to stop.
    pub const CANCELING: i8 = 3;
    /// Done.
    pub const SUCCEEDED: i8 = 4;
    /// Stopped on request.
    pub const CANCELED: i8 = 5;
    /// Failed.
    pub const ABORTED: i8 = 6;
}
