//! Frames.

use crate::geometry_msgs::TransformStamped;

messages! { "tf2_msgs";
    /// Poses of frames in their parents.
    TFMessage {
        /// One for each frame.
        transforms: Vec<TransformStamped>,
    }
}
