//! `tandem bag play` serves every subscriber that was served while the bag was recorded: over real DDS between two
//! processes, with bags whose publishers offered different things.

mod common;

use ros::{Arguments, Node, Qos};
use std::collections::BTreeMap;
use std::fs::File;
use std::io::Write;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::sync::mpsc::{Receiver, channel};
use std::time::{Duration, Instant};
use tandem_msgs::std_msgs::String as Text;

const DOMAIN: u16 = 93;
const PATIENCE: Duration = Duration::from_secs(40);

fn cdr(text: &str) -> Vec<u8> {
    let mut cdr = vec![0, 1, 0, 0];
    cdr.extend_from_slice(&(text.len() as u32 + 1).to_le_bytes());
    cdr.extend_from_slice(text.as_bytes());
    cdr.push(0);
    cdr
}

/// A publisher's offer as rosbag2 wrote it before version 9.
fn offer(depth: u32, latched: bool, reliable: bool) -> String {
    let (durability, reliability) = (if latched { 1 } else { 2 }, if reliable { 1 } else { 2 });
    format!(
        "- history: 1\n  depth: {depth}\n  reliability: {reliability}\n  durability: {durability}\n  liveliness: 1\n"
    )
}

/// Topics with their offers, and the times of their messages in ms.
fn write_bag(path: &Path, topics: &[(&str, &str, &str, String, Vec<u64>)]) {
    let mut writer = mcap::Writer::new(File::create(path).unwrap()).unwrap();
    for (topic, type_name, encoding, offers, times_ms) in topics {
        let language = if type_name.starts_with("std_msgs") { "ros2msg" } else { "ros2idl" };
        let schema = writer.add_schema(type_name, language, b"string data").unwrap();
        let about = BTreeMap::from([("offered_qos_profiles".to_owned(), offers.clone())]);
        let channel_id = writer.add_channel(schema, topic, encoding, &about).unwrap();
        for (number, time_ms) in times_ms.iter().enumerate() {
            let time = 1_000_000_000 + time_ms * 1_000_000;
            let header = mcap::records::MessageHeader { channel_id, sequence: 0, log_time: time, publish_time: time };
            writer.write_to_known_channel(&header, &cdr(&number.to_string())).unwrap();
        }
    }
    writer.finish().unwrap();
}

struct Player(Child);

impl Player {
    fn start(arguments: &[&str], folder: &Path) -> Player {
        let mut command = Command::new(env!("CARGO_BIN_EXE_tandem"));
        command.args(["bag", "play"]).args(arguments).current_dir(folder).stdin(Stdio::piped());
        command.env("ROS_DOMAIN_ID", DOMAIN.to_string()).env("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST");
        Player(command.stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap())
    }

    fn say(&mut self, line: &str) {
        writeln!(self.0.stdin.as_mut().unwrap(), "{line}").unwrap();
    }

    /// Waits for its end; gives its standard error.
    fn ends(mut self) -> String {
        let begun = Instant::now();
        while self.0.try_wait().unwrap().is_none() {
            assert!(begun.elapsed() < PATIENCE, "it does not end");
            std::thread::sleep(Duration::from_millis(20));
        }
        let mut errors = String::new();
        std::io::Read::read_to_string(self.0.stderr.as_mut().unwrap(), &mut errors).unwrap();
        assert!(!errors.contains("panicked"), "{errors}");
        errors
    }
}

impl Drop for Player {
    fn drop(&mut self) {
        // Already ended is as good.
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

fn subscribe(node: &Node, topic: &str, qos: Qos) -> Receiver<String> {
    let (sender, receiver) = channel();
    node.subscribe(topic, qos, move |message: Text| {
        // The test may have ended.
        let _ = sender.send(message.data);
    })
    .unwrap();
    receiver
}

fn next(received: &Receiver<String>, count: usize) -> Vec<String> {
    (0..count).map(|_| received.recv_timeout(PATIENCE).expect("a message comes")).collect()
}

/// One test, because a process has one node.
#[test]
fn every_original_subscriber_is_served_at_the_start_after_a_seek_and_in_a_loop() {
    let folder = tempfile::tempdir().unwrap();
    let node = Node::start("listener", &Arguments::default().with_domain_id(DOMAIN)).unwrap();
    mixed_offers_serve_both_and_overrides_are_followed(&node, folder.path());
    latched_messages_of_all_publishers_come_first(&node, folder.path());
    what_cannot_be_played_is_named_and_the_rest_played(&node, folder.path());
    node.shutdown();
}

fn mixed_offers_serve_both_and_overrides_are_followed(node: &Node, folder: &Path) {
    let offers = offer(5, false, false) + &offer(10, false, true);
    let times: Vec<u64> = (0..300).map(|n| 10 * n).collect();
    write_bag(&folder.join("two.mcap"), &[("/two", "std_msgs/msg/String", "cdr", offers, times)]);
    let (reliable, sensor) =
        (subscribe(node, "/two", Qos::reliable(1000)), subscribe(node, "/two", Qos::best_effort(1000)));
    Player::start(&["two.mcap", "--rate", "2", "--delay", "3"], folder).ends();
    let expected: Vec<String> = (0..300).map(|n| n.to_string()).collect();
    assert_eq!(next(&reliable, 300), expected, "a reliable subscriber gets every message");
    assert!(sensor.try_iter().count() > 0, "a best-effort subscriber is served as well");
    // Offered with best effort a reliable subscriber is not served: the override is what counts.
    std::fs::write(
        folder.join("overrides.yaml"),
        "/two:\n  reliability: best_effort\n  history: keep_last\n  depth: 5\n",
    )
    .unwrap();
    let arguments = ["two.mcap", "--rate", "10", "--delay", "3", "--qos-profile-overrides-path", "overrides.yaml"];
    Player::start(&arguments, folder).ends();
    assert!(sensor.try_iter().count() > 0, "a best-effort subscriber is served");
    assert_eq!(reliable.try_iter().count(), 0, "the override offers no reliability");
    std::fs::write(folder.join("overrides.yaml"), "/two:\n  reliability: perhaps\n").unwrap();
    let errors = Player::start(&arguments, folder).ends();
    assert!(errors.contains("overrides.yaml: /two: reliability is perhaps"), "{errors}");
}

fn latched_messages_of_all_publishers_come_first(node: &Node, folder: &Path) {
    let latched = offer(1, true, true).repeat(3);
    let words: Vec<u64> = (0..200).map(|n| 50 * n).collect();
    let notes = ("/notes", "std_msgs/msg/String", "cdr", latched, vec![0, 10, 20]);
    let words = ("/beat", "std_msgs/msg/String", "cdr", offer(10, false, true), words);
    write_bag(&folder.join("latched.mcap"), &[notes, words]);
    let received = subscribe(node, "/notes", Qos::transient_local(10));
    let beat = subscribe(node, "/beat", Qos::reliable(1000));
    let mut player = Player::start(&["latched.mcap", "--start", "8", "--rate", "2", "--loop", "--delay", "3"], folder);
    assert_eq!(next(&received, 3), ["0", "1", "2"], "at the start");
    assert_eq!(next(&beat, 1), ["160"], "then from the start on");
    let late = subscribe(node, "/notes", Qos::transient_local(10));
    assert_eq!(next(&late, 3), ["0", "1", "2"], "for one who comes late");
    assert_eq!(next(&received, 3), ["0", "1", "2"], "when it begins again");
    while next(&beat, 1) != ["160"] {}
    player.say("seek 9");
    assert_eq!(next(&received, 3), ["0", "1", "2"], "after a seek");
    while next(&beat, 1) != ["180"] {}
    player.say("quit");
    player.ends();
}

fn what_cannot_be_played_is_named_and_the_rest_played(node: &Node, folder: &Path) {
    let all = || offer(10, false, true);
    let topics = [
        ("/idl", "own_msgs/msg/Angle", "cdr", all(), vec![0]),
        ("/json", "own_msgs/msg/Angle", "json", all(), vec![0]),
        ("/proto", "foxglove.Pose", "cdr", all(), vec![0]),
        ("/rest", "std_msgs/msg/String", "cdr", all(), vec![5, 10]),
    ];
    write_bag(&folder.join("mixed.mcap"), &topics);
    let received = subscribe(node, "/rest", Qos::reliable(10));
    let errors = Player::start(&["mixed.mcap", "--delay", "3"], folder).ends();
    assert_eq!(next(&received, 2), ["0", "1"]);
    assert!(errors.contains("/json is not played: its messages are in 'json'"), "{errors}");
    assert!(errors.contains("/proto is not played: its type is 'foxglove.Pose'"), "{errors}");
    assert!(!errors.contains("/idl is not played"), "{errors}");
}
