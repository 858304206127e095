//! Odometry.

use crate::geometry_msgs::{PoseWithCovariance, TwistWithCovariance};
use crate::std_msgs::Header;

messages! { "nav_msgs";
    /// Pose in the header's frame, velocity in the child's.
    Odometry {
        /// Time, and the frame of the pose.
        header: Header,
        /// The frame of the twist.
        child_frame_id: String,
        /// Pose of the child frame.
        pose: PoseWithCovariance,
        /// Velocity, in the axes of the child frame.
        twist: TwistWithCovariance,
    }
}
