//! What a node publishes in the moment it made the publisher arrives, while its middleware is busy with others.

use std::sync::Arc;
use std::sync::mpsc::channel;
use std::time::{Duration, Instant};

use ros::{Arguments, Node, Qos};
use tandem_msgs::std_msgs::String as Text;

const DOMAIN: u16 = 96;
const TOPICS: usize = 150;
const PATIENCE: Duration = Duration::from_secs(30);

fn topic(index: usize) -> String {
    format!("/at_once/t{index}")
}

/// A latched message that was written once, at the start, used to be lost for good: about one in seventy on a busy
/// machine.
#[test]
fn a_latched_message_that_is_published_at_once_is_never_lost() {
    let arguments = Arguments::default().with_domain_id(DOMAIN);
    let talker = Node::start("talker", &arguments).unwrap();
    let listener = Arc::new(Node::start("listener", &arguments).unwrap());
    let (sender, received) = channel();
    let subscribing = Arc::clone(&listener);
    let subscriptions = std::thread::spawn(move || {
        for index in 0..TOPICS {
            let sender = sender.clone();
            let callback = move |text: Text| sender.send((index, text.data)).unwrap_or_default();
            subscribing.subscribe(&topic(index), Qos::latched(), callback).unwrap();
        }
    });
    let publishers: Vec<_> = (0..TOPICS)
        .map(|index| {
            let publisher = talker.publisher::<Text>(&topic(index), Qos::latched()).unwrap();
            publisher.publish(Text { data: topic(index) }).unwrap();
            publisher
        })
        .collect();
    subscriptions.join().unwrap();

    let mut missing: Vec<usize> = (0..TOPICS).collect();
    let begun = Instant::now();
    while let Some(left) = PATIENCE.checked_sub(begun.elapsed()).filter(|_| !missing.is_empty()) {
        let Ok((index, text)) = received.recv_timeout(left) else { break };
        assert_eq!(text, topic(index));
        missing.retain(|other| *other != index);
    }
    println!("all in {:.1} s", begun.elapsed().as_secs_f64());
    assert!(missing.is_empty(), "{} of {TOPICS} never came: {missing:?}", missing.len());
    drop(publishers);
}
