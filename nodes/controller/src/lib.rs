//! ROS 2 node: walks a gait with the paper's PD law.
