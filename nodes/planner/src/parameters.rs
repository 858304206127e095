//! The table of the node's parameters: name, type, default, range, unit and text of each.

use ros::table::{flag, integer, number, string};

ros::parameters! {
    /// The planner's parameters, all set when the node is started.
    pub struct Table {
        robot: String = string(robot::DEFAULT_FOLDER, robot::FOLDER_TEXT),
        time_limit_s: f64 = number(20.0, 0.1..=600.0, "s", "A solve that takes longer is given up."),
        waiting_requests: i64 = integer(8, 0..=1000,
            "How many requests may wait behind those that are planned; more are answered with status busy."),
        parallel_requests: i64 = integer(2, 1..=1000,
            "How many requests are planned at once, so that the search for a nearest request holds up nobody else."),
        find_nearest: bool = flag(true,
            "Answer a request that cannot be planned with the nearest one that can; takes a few solves."),
    }
}
