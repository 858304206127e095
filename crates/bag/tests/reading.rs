//! Reading: what was written comes back, from every storage, and anything else is one clear error.

mod common;

use std::fs;
use std::path::Path;

use bag::{Bag, Durability, Reliability, Value, decode};
use common::{Random, read, text_cdr, write};
use rusqlite::Connection;

fn options(chunk_bytes: u64) -> bag::RecorderOptions {
    bag::RecorderOptions { chunk_bytes, ..bag::RecorderOptions::default() }
}

#[test]
fn what_was_written_comes_back_in_order() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("b");
    write(&path, 3000, options(4096));
    let bag = Bag::open(&path).unwrap();
    assert_eq!((bag.message_count(), bag.storage(), bag.files()), (6000, "mcap", 1));
    assert_eq!(bag.span_ns(), Some((1000, 1000 + 2999 * 1_000_000)));
    let (_, words) = bag.topic("/words").unwrap();
    assert_eq!(
        words.qos.map(|qos| (qos.reliability, qos.durability, qos.depth)),
        Some((Reliability::Reliable, Durability::Volatile, 10))
    );
    let definition = words.parsed_definition().unwrap();
    let mut number = 0;
    for (topic, message) in read(&path).unwrap() {
        if topic == "/words" {
            let value = decode(&definition, &message.data).unwrap();
            assert_eq!(value.field("data"), Some(&Value::Text(format!("message {number}"))));
            assert_eq!(message.stamp_ns, 1000 + number * 1_000_000);
        } else {
            number += 1;
        }
    }
    assert_eq!(number, 3000);
    // The file by itself gives the same.
    assert_eq!(read(&path.join("b_0.mcap")).unwrap(), read(&path).unwrap());
}

#[test]
fn the_files_of_a_split_bag_are_one() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("b");
    let split = bag::RecorderOptions { split_duration: Some(std::time::Duration::from_secs(1)), ..options(4096) };
    write(&path, 3500, split);
    assert_eq!(Bag::open(&path).unwrap().files(), 4);
    let stamps: Vec<u64> = read(&path).unwrap().iter().map(|(_, message)| message.stamp_ns).collect();
    assert_eq!(stamps.len(), 7000);
    assert!(stamps.is_sorted());
}

/// Messages out of order, in overlapping chunks, come out sorted.
#[test]
fn disorder_in_a_file_is_put_in_order() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("b.mcap");
    for chunks in [true, false] {
        let mut writer = mcap::WriteOptions::new()
            .profile("ros2")
            .chunk_size(Some(2000))
            .use_chunks(chunks)
            .create(fs::File::create(&path).unwrap())
            .unwrap();
        let schema = writer.add_schema("std_msgs/msg/String", "ros2msg", b"string data").unwrap();
        let channel = writer.add_channel(schema, "/t", "cdr", &Default::default()).unwrap();
        let mut random = Random(5);
        let mut stamps: Vec<u64> = (0..2000).map(|_| random.below(10_000) as u64).collect();
        for (sequence, stamp) in stamps.iter().enumerate() {
            let header = mcap::records::MessageHeader {
                channel_id: channel,
                sequence: sequence as u32,
                log_time: *stamp,
                publish_time: *stamp,
            };
            writer.write_to_known_channel(&header, &text_cdr(&stamp.to_string())).unwrap();
        }
        writer.finish().unwrap();
        stamps.sort_unstable();
        let found = read(&path).unwrap();
        assert_eq!(found.iter().map(|(_, message)| message.stamp_ns).collect::<Vec<_>>(), stamps);
        assert!(found.iter().all(|(_, message)| message.data == text_cdr(&message.stamp_ns.to_string())));
    }
}

/// A recording as rosbag2's sqlite3 storage makes it, of the older or the newer layout.
fn write_db3(path: &Path, newer: bool, messages: i64) {
    let db = Connection::open(path).unwrap();
    db.execute_batch(
        "CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT NOT NULL, type TEXT NOT NULL, serialization_format TEXT NOT NULL, offered_qos_profiles TEXT NOT NULL);
         CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER NOT NULL, timestamp INTEGER NOT NULL, data BLOB NOT NULL);
         CREATE INDEX timestamp_idx ON messages (timestamp ASC);
         INSERT INTO topics VALUES(7, '/words', 'std_msgs/msg/String', 'cdr', '- history: 1\n  depth: 3\n  reliability: 2\n  durability: 2');
         INSERT INTO topics VALUES(9, '/silent', 'foreign_msgs/msg/Thing', 'cdr', '');",
    )
    .unwrap();
    if newer {
        db.execute_batch(
            "CREATE TABLE message_definitions(id INTEGER PRIMARY KEY, topic_type TEXT, encoding TEXT, encoded_message_definition TEXT, type_description_hash TEXT);
             INSERT INTO message_definitions VALUES(1, 'foreign_msgs/msg/Thing', 'ros2msg', 'int32 x', '');",
        )
        .unwrap();
    }
    db.execute_batch("BEGIN").unwrap();
    for number in 0..messages {
        let stamp = 1000 + (messages - number) * 10; // written last to first
        db.execute("INSERT INTO messages VALUES(NULL, 7, ?1, ?2)", (stamp, text_cdr(&stamp.to_string()))).unwrap();
    }
    db.execute_batch("COMMIT").unwrap();
}

#[test]
fn sqlite3_bags_of_both_layouts_are_read() {
    let folder = tempfile::tempdir().unwrap();
    for newer in [false, true] {
        let path = folder.path().join(format!("{newer}.db3"));
        write_db3(&path, newer, 2000);
        let bag = Bag::open(&path).unwrap();
        assert_eq!((bag.storage(), bag.message_count()), ("sqlite3", 2000));
        let (_, words) = bag.topic("/words").unwrap();
        assert!(
            words.definition.as_deref().is_some_and(|text| text.contains("string data")),
            "ours, for want of its own"
        );
        assert_eq!(words.qos.map(|qos| (qos.reliability, qos.depth)), Some((Reliability::BestEffort, 3)));
        let (_, silent) = bag.topic("/silent").unwrap();
        assert_eq!(silent.definition.is_some(), newer);
        if !newer {
            assert!(silent.parsed_definition().unwrap_err().to_string().contains("holds no ros2msg text"));
        }
        let messages = read(&path).unwrap();
        assert_eq!(messages.len(), 2000);
        assert!(messages.is_sorted_by_key(|(_, message)| message.stamp_ns));
        assert!(messages.iter().all(|(_, message)| message.data == text_cdr(&message.stamp_ns.to_string())));
    }
}

#[test]
fn what_is_no_bag_is_one_clear_error() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let message = |name: &str| Bag::open(at(name)).unwrap_err().to_string();
    fs::write(at("empty.mcap"), "").unwrap();
    assert!(message("empty.mcap").contains("the file is empty"));
    fs::write(at("text.mcap"), "this is a text and no recording").unwrap();
    assert!(message("text.mcap").contains("this is not an MCAP file"));
    fs::write(at("text.db3"), "this is a text and no recording, long enough to be looked at by sqlite itself, really")
        .unwrap();
    assert!(message("text.db3").contains("cannot be read as a sqlite3 bag"), "{}", message("text.db3"));
    Connection::open(at("other.db3")).unwrap().execute_batch("CREATE TABLE t(x)").unwrap();
    assert!(message("other.db3").contains("no table 'topics'"));
    assert!(message("nothing").contains("cannot open"));
    fs::create_dir(at("folder")).unwrap();
    assert!(message("folder").contains("no .mcap or .db3 file"));
    fs::write(at("folder/a_0.mcap"), "").unwrap();
    assert!(message("folder").contains("run 'tandem bag recover'"));
    let metadata = |text: &str| {
        fs::write(at("folder/metadata.yaml"), format!("rosbag2_bagfile_information:\n{text}")).unwrap();
        message("folder")
    };
    assert!(
        metadata("  version: 42\n  storage_identifier: mcap\n  relative_file_paths: [a_0.mcap]")
            .contains("version 42; expected 1 to 9")
    );
    assert!(
        metadata("  version: 9\n  storage_identifier: tape\n  relative_file_paths: [a_0.mcap]")
            .contains("storage 'tape'")
    );
    assert!(metadata("  version: 9\n  storage_identifier: mcap\n  relative_file_paths: []").contains("lists no file"));
    assert!(
        metadata("  version: 9\n  storage_identifier: mcap\n  relative_file_paths: [../../secret.mcap]")
            .contains("outside the bag's folder")
    );
    assert!(metadata("  version: 9\n").contains("is not rosbag2's metadata"));
    let packed = "  version: 9\n  storage_identifier: mcap\n  relative_file_paths: [a_0.mcap]\n  compression_format: zstd\n  compression_mode: FILE\n";
    assert!(metadata(packed).contains("the file is empty"));
}

#[test]
fn messages_compressed_one_by_one_are_read() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("b");
    fs::create_dir(&path).unwrap();
    let db = path.join("b_0.db3");
    write_db3(&db, true, 0);
    let packed = zstd::encode_all(text_cdr("packed").as_slice(), 3).unwrap();
    Connection::open(&db).unwrap().execute("INSERT INTO messages VALUES(NULL, 7, 5, ?1)", (packed,)).unwrap();
    let text = "rosbag2_bagfile_information:\n  version: 5\n  storage_identifier: sqlite3\n  relative_file_paths: [b/b_0.db3]\n  \
                compression_format: zstd\n  compression_mode: MESSAGE\n";
    fs::write(path.join("metadata.yaml"), text).unwrap();
    assert_eq!(read(&path).unwrap()[0].1.data, text_cdr("packed"));
}

#[test]
fn a_message_that_does_not_fit_its_definition_is_an_error_not_a_panic() {
    let definition = bag::Definition::parse(
        "sensor_msgs/msg/JointState",
        &bag::full_definition("sensor_msgs/msg/JointState").unwrap(),
    )
    .unwrap();
    let mut random = Random(3);
    for _ in 0..50_000 {
        let length = random.below(200);
        let mut bytes: Vec<u8> = (0..length).map(|_| (random.next() >> 20) as u8).collect();
        for (byte, head) in bytes.iter_mut().zip([0, 1, 0, 0]) {
            *byte = head;
        }
        if random.below(4) == 0 {
            // Short lengths let it get further.
            for index in (7..length).step_by(4) {
                bytes[index] = 0;
                bytes[index - 1] = 0;
            }
        }
        let _ = decode(&definition, &bytes); // either is fine; a panic or an endless loop is not
    }
    let huge = [[0, 1, 0, 0].as_slice(), &[0; 12], &[0xff; 4], &[0; 64]].concat();
    assert!(
        decode(&definition, &huge).unwrap_err().to_string().contains("does not fit"),
        "a length of 2^32 - 1 is not allocated"
    );
    assert!(decode(&definition, &[0, 9, 0, 0, 1]).unwrap_err().to_string().contains("encapsulation 0009"));
    assert!(decode(&definition, &[]).is_err());
}

#[test]
fn big_endian_messages_are_decoded() {
    let definition = bag::Definition::parse("p/msg/T", "uint8 a\nfloat64 b\nstring c\nint16[2] d").unwrap();
    let mut cdr = vec![0, 0, 0, 0, 7, 0, 0, 0, 0, 0, 0, 0];
    cdr.extend_from_slice(&1.5_f64.to_be_bytes());
    cdr.extend_from_slice(&3_u32.to_be_bytes());
    cdr.extend_from_slice(b"hi\0\0");
    cdr.extend_from_slice(&(-2_i16).to_be_bytes());
    cdr.extend_from_slice(&300_i16.to_be_bytes());
    let value = decode(&definition, &cdr).unwrap();
    assert_eq!(value.field("b"), Some(&Value::Number(1.5)));
    assert_eq!(value.field("c"), Some(&Value::Text("hi".into())));
    assert_eq!(value.field("d"), Some(&Value::List(vec![Value::Integer(-2), Value::Integer(300)])));
    let mut leaves = Vec::new();
    value.for_each_leaf(&mut |path, _| leaves.push(path.to_owned()));
    assert_eq!(leaves, ["a", "b", "c", "d[0]", "d[1]"]);
}

/// A file small enough that changes hit everything in it, compressed or not, with checksums or without.
fn seed_file(path: &Path, compression: Option<mcap::Compression>, checksums: bool, chunks: bool) -> Vec<u8> {
    let mut writer = mcap::WriteOptions::new()
        .profile("ros2")
        .compression(compression)
        .calculate_chunk_crcs(checksums)
        .use_chunks(chunks)
        .chunk_size(Some(300))
        .create(fs::File::create(path).unwrap())
        .unwrap();
    let schema = writer.add_schema("std_msgs/msg/String", "ros2msg", b"string data").unwrap();
    let channel = writer
        .add_channel(schema, "/t", "cdr", &[("offered_qos_profiles".to_owned(), "- depth: 1".to_owned())].into())
        .unwrap();
    for number in 0..12 {
        let header = mcap::records::MessageHeader {
            channel_id: channel,
            sequence: number,
            log_time: number.into(),
            publish_time: 0,
        };
        writer.write_to_known_channel(&header, &text_cdr("twelve messages of some length")).unwrap();
    }
    writer.finish().unwrap();
    fs::read(path).unwrap()
}

fn change(bytes: &mut Vec<u8>, random: &mut Random) {
    for _ in 0..=random.below(3) {
        if bytes.is_empty() {
            return;
        }
        let at = random.below(bytes.len());
        match random.below(7) {
            0 => bytes[at] ^= 1 << random.below(8),
            1 => bytes[at] = random.next() as u8,
            2 => bytes.truncate(at),
            3 => {
                let end = (at + 1 + random.below(40)).min(bytes.len());
                bytes.drain(at..end);
            }
            4 => {
                let end = (at + 1 + random.below(40)).min(bytes.len());
                let piece = bytes[at..end].to_vec();
                let to = random.below(bytes.len());
                bytes.splice(to..to, piece);
            }
            5 => {
                // A length or a number somewhere becomes extreme.
                let extreme = [0, 1, u64::MAX, u64::MAX / 2, 1 << 32, 1 << 31][random.below(6)].to_le_bytes();
                let end = (at + 8).min(bytes.len());
                bytes[at..end].copy_from_slice(&extreme[..end - at]);
            }
            _ => {
                let end = (at + random.below(60)).min(bytes.len());
                bytes[at..end].fill(0);
            }
        }
    }
}

/// How many cases: more by the environment variable BAG_FUZZ_CASES, for a long run now and then.
fn cases(usual: usize) -> usize {
    std::env::var("BAG_FUZZ_CASES").ok().and_then(|text| text.parse().ok()).unwrap_or(usual)
}

#[test]
fn any_bytes_are_a_bag_or_an_error_never_a_panic() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("seed.mcap");
    let seeds = [
        seed_file(&path, Some(mcap::Compression::Zstd), true, true),
        seed_file(&path, Some(mcap::Compression::Zstd), false, true),
        seed_file(&path, None, false, true),
        seed_file(&path, None, true, false),
    ];
    let fuzzed = folder.path().join("fuzzed.mcap");
    let mut random = Random(20);
    let (mut opened, mut refused, mut saved) = (0, 0, 0);
    for round in 0..cases(6000) {
        let mut bytes = seeds[round % seeds.len()].clone();
        change(&mut bytes, &mut random);
        fs::write(&fuzzed, &bytes).unwrap();
        match Bag::open(&fuzzed) {
            Ok(bag) => {
                opened += 1;
                let definitions: Vec<_> = bag.topics().iter().map(|topic| topic.parsed_definition()).collect();
                for message in bag.messages().unwrap() {
                    let message = message.unwrap();
                    if let Ok(definition) = &definitions[message.topic] {
                        let _ = decode(definition, &message.data); // an error is fine
                    }
                }
            }
            Err(error) => {
                refused += 1;
                let text = error.to_string();
                assert!(text.contains("fuzzed.mcap") && text.len() < 600, "{text}");
            }
        }
        if round % 40 == 0 && round < 6000 {
            let target = folder.path().join(format!("saved_{round}"));
            saved += u64::from(bag::recover(&fuzzed, &target).is_ok());
        }
        assert_eq!(fs::read(&fuzzed).unwrap(), bytes, "reading wrote to the file");
    }
    println!("{opened} opened, {refused} refused, {saved} saved");
    assert!(opened > 500 && refused > 500 && saved > 60);
}

#[test]
fn any_sqlite3_bytes_are_a_bag_or_an_error_never_a_panic() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("seed.db3");
    write_db3(&path, true, 20);
    let seed = fs::read(&path).unwrap();
    let fuzzed = folder.path().join("fuzzed.db3");
    let mut random = Random(21);
    for _ in 0..cases(1500) {
        let mut bytes = seed.clone();
        change(&mut bytes, &mut random);
        fs::write(&fuzzed, &bytes).unwrap();
        let _ = read(&fuzzed); // either is fine
    }
}
