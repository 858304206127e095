//! rosbag2 (MCAP) recording and reading.
