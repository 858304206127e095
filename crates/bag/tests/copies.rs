//! What `recover` and `filter` make: every message as it was, whatever it is serialised in.

mod common;

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use bag::{Bag, Filter, Qos, Recorder, RecorderOptions, filter, recover};
use common::{read, text_cdr};

/// A channel: topic, encoding of its messages, name, language and text of its schema.
type Kind = (&'static str, &'static str, &'static str, &'static str, &'static [u8]);

const KINDS: [Kind; 6] = [
    (
        "/angle",
        "cdr",
        "own_msgs/msg/Angle",
        "ros2idl",
        b"module own_msgs { module msg { struct Angle { double radians; }; }; };",
    ),
    ("/words", "cdr", "std_msgs/msg/String", "ros2msg", b"string data"),
    ("/wide", "cdr", "own_msgs/msg/Wide", "ros2msg", b"wstring<=8[] more\nstring B='a # b'"),
    ("/proto", "protobuf", "foxglove.Pose", "protobuf", &[10, 0, 0xff, 0xfe]),
    ("/json", "json", "", "", b""),
    ("/bare", "cdr", "own_msgs/msg/Nowhere", "", b""),
];

const OFFERED: &str = "- history: keep_last\n  depth: 3\n  reliability: best_effort\n  durability: transient_local\n";

/// Twenty messages on each but the third, which has none.
fn write_mixed(path: &Path) {
    let mut writer = mcap::Writer::new(fs::File::create(path).unwrap()).unwrap();
    let about = BTreeMap::from([
        ("offered_qos_profiles".to_owned(), OFFERED.to_owned()),
        ("topic_type_hash".to_owned(), "RIHS01_5".to_owned()),
        ("maker".to_owned(), "another".to_owned()),
    ]);
    for (number, (topic, encoding, name, language, text)) in KINDS.iter().enumerate() {
        let schema = if name.is_empty() { 0 } else { writer.add_schema(name, language, text).unwrap() };
        let channel_id = writer.add_channel(schema, topic, encoding, &about).unwrap();
        for n in (0..20).filter(|_| *topic != "/wide") {
            let header = mcap::records::MessageHeader {
                channel_id,
                sequence: 7 + n,
                log_time: 1_000 * u64::from(n) + number as u64,
                publish_time: 900 * u64::from(n),
            };
            writer.write_to_known_channel(&header, &[0, 1, 2, 3, number as u8, n as u8, 0x80]).unwrap();
        }
    }
    writer.finish().unwrap();
}

/// Topic, encoding, schema, what else is reported of the topic, times and number, content.
type ForeignMessage = (String, String, Option<mcap::Schema<'static>>, BTreeMap<String, String>, [u64; 3], Vec<u8>);

/// Everything that an MCAP file says of its messages, by another reader than ours.
fn foreign_reading(folder: &Path) -> Vec<ForeignMessage> {
    let mut files = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    let file = files.find(|path| path.extension().is_some_and(|end| end == "mcap")).unwrap();
    let bytes = fs::read(file).unwrap();
    let messages = mcap::MessageStream::new(&bytes).unwrap().map(|message| {
        let message = message.unwrap();
        let channel = &message.channel;
        let schema = channel.schema.as_ref().map(|schema| mcap::Schema {
            id: 0,
            name: schema.name.clone(),
            encoding: schema.encoding.clone(),
            data: schema.data.clone().into_owned().into(),
        });
        let numbers = [message.log_time, message.publish_time, message.sequence.into()];
        let about = channel.metadata.clone();
        (channel.topic.clone(), channel.message_encoding.clone(), schema, about, numbers, message.data.to_vec())
    });
    let mut messages: Vec<_> = messages.collect();
    messages.sort_by_key(|message| message.4);
    messages
}

#[test]
fn idl_and_unknown_types_are_kept_byte_for_byte() {
    let folder = tempfile::tempdir().unwrap();
    let source = folder.path().join("source");
    fs::create_dir(&source).unwrap();
    write_mixed(&source.join("mixed.mcap"));
    let recovery = recover(source.join("mixed.mcap"), folder.path().join("recovered")).unwrap();
    assert_eq!((recovery.messages, &recovery.damage), (100, &Vec::new()));
    let bag = Bag::open(source.join("mixed.mcap")).unwrap();
    let filtered = filter(&bag, folder.path().join("filtered"), &Filter::default()).unwrap();
    assert_eq!((filtered.messages, filtered.topics, filtered.span_ns), (100, 6, Some((0, 19_005))));
    let before = foreign_reading(&source);
    assert_eq!(before.len(), 100);
    for made in ["recovered", "filtered"] {
        assert_eq!(foreign_reading(&folder.path().join(made)), before, "{made}");
        let bag = Bag::open(folder.path().join(made)).unwrap();
        let wide = bag.topic("/wide").unwrap().1;
        assert_eq!((bag.topics().len(), wide.messages, wide.qos.unwrap().depth), (6, 0, 3), "{made}");
        let metadata = fs::read_to_string(folder.path().join(made).join("metadata.yaml")).unwrap();
        assert!(metadata.contains("serialization_format: protobuf") && metadata.contains("RIHS01_5"), "{metadata}");
        assert!(metadata.contains("best_effort") && metadata.contains("message_count: 100"), "{metadata}");
    }
}

#[test]
fn a_filter_takes_the_topics_and_the_time_that_were_asked_for() {
    let folder = tempfile::tempdir().unwrap();
    write_mixed(&folder.path().join("mixed.mcap"));
    let bag = Bag::open(folder.path().join("mixed.mcap")).unwrap();
    let wanted = Filter { topics: vec!["/angle".into(), "/json".into()], from_ns: 5_000, to_ns: Some(9_000) };
    let filtered = filter(&bag, folder.path().join("part"), &wanted).unwrap();
    // /angle at 5000 to 9000, /json at 5004 to 8004.
    assert_eq!((filtered.messages, filtered.topics, filtered.span_ns), (9, 2, Some((5_000, 9_000))));
    let error = filter(&bag, folder.path(), &wanted).unwrap_err().to_string();
    assert!(error.contains("already exists"), "{error}");
}

#[test]
fn a_recovered_bag_of_compressed_messages_can_be_read() {
    let folder = tempfile::tempdir().unwrap();
    let recorder = Recorder::start(folder.path().join("r"), RecorderOptions::default()).unwrap();
    let topic = recorder.topic("/words", "std_msgs/msg/String", Qos::reliable(10)).unwrap();
    for number in 0..20 {
        let packed = zstd::encode_all(text_cdr(&format!("message {number}")).as_slice(), 1).unwrap();
        assert!(recorder.push(&topic, number, packed));
    }
    recorder.finish().unwrap();
    // Without its metadata nothing says that messages are compressed.
    fs::remove_file(folder.path().join("r/metadata.yaml")).unwrap();
    recover(folder.path().join("r"), folder.path().join("saved")).unwrap();
    let saved = read(&folder.path().join("saved")).unwrap();
    assert_eq!(saved.len(), 20);
    assert_eq!(saved[7].1.data, text_cdr("message 7"));
}

#[test]
fn what_mixed_publishers_offered_is_listed_one_by_one_and_together() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("two.mcap");
    let mut writer = mcap::Writer::new(fs::File::create(&path).unwrap()).unwrap();
    let schema = writer.add_schema("std_msgs/msg/String", "ros2msg", b"string data").unwrap();
    let profile = |depth: u32, durability: u32, reliability: u32| {
        format!(
            "- history: 1\n  depth: {depth}\n  reliability: {reliability}\n  durability: {durability}\n  deadline:\n    sec: \
             2147483647\n    nsec: 4294967295\n"
        )
    };
    for (topic, offered) in
        [("/mixed", profile(5, 2, 2) + &profile(10, 2, 1)), ("/latched", profile(1, 1, 1).repeat(3))]
    {
        let about = BTreeMap::from([("offered_qos_profiles".to_owned(), offered)]);
        writer.add_channel(schema, topic, "cdr", &about).unwrap();
    }
    writer.finish().unwrap();
    let bag = Bag::open(&path).unwrap();
    let mixed = bag.topic("/mixed").unwrap().1;
    assert_eq!((mixed.offers.len(), mixed.qos), (2, Some(Qos::reliable(10))));
    let latched = bag.topic("/latched").unwrap().1;
    assert_eq!((latched.offers.len(), latched.qos), (3, Some(Qos { depth: 3, ..Qos::latched() })));
}
