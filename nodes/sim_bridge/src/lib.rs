//! ROS 2 node: MuJoCo behind DDS topics.
