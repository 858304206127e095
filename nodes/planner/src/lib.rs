//! ROS 2 node: generates decomposed gaits on request.
