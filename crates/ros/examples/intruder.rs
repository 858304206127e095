//! Sends what no one expects, for `tests/ros2/test_abuse.py`: on every topic given as an argument a message of another
//! type, whose bytes are anything, a hundred times a second.

use ros::{Arguments, Node, Qos};
use std::time::Duration;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let (arguments, topics) = Arguments::from_process()?;
    let node = Node::start("intruder", &arguments)?;
    for topic in &topics[1..] {
        let publisher = node.raw_publisher(topic, "std_msgs/msg/String", Qos::latched())?;
        // A linear congruential generator: the same garbage in every run.
        let mut state = 1_u64;
        node.every(Duration::from_millis(10), move || {
            let mut message = vec![0, 1, 0, 0];
            for _ in 0..(state % 512) {
                state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                message.push((state >> 56) as u8);
            }
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            if let Err(error) = publisher.publish(&message) {
                tracing::debug!("{error}");
            }
        });
    }
    tracing::info!("ready");
    node.run();
    Ok(())
}
