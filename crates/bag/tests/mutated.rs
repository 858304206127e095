//! Bags of other recorders' forms with bytes changed anywhere: an error or messages, no panic, and nothing is written.
//!
//! `BAG_MUTATIONS` sets how many of each form (CI: 60); `BAG_MUTATIONS_SEED` where they begin.

mod common;

use std::fs;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};

use bag::{Bag, Offer, Qos, Recorder, RecorderOptions, recover};
use common::{Random, text_cdr};
use rusqlite::Connection;

fn number(variable: &str, otherwise: u64) -> u64 {
    std::env::var(variable).map_or(otherwise, |text| text.parse().unwrap())
}

const METADATA: &str = "rosbag2_bagfile_information:\n  version: 5\n  storage_identifier: 'ID'\n  relative_file_paths: [FILES]\n  \
                        compression_format: FORMAT\n  compression_mode: MODE\n  topics_with_message_count:\n  - message_count: 20\n    \
                        topic_metadata:\n      name: /words\n      type: std_msgs/msg/String\n      serialization_format: cdr\n      \
                        offered_qos_profiles: \"- history: 1\\n  depth: 1\\n  reliability: 1\\n  durability: 1\\n- history: 2\\n  \
                        depth: 5\\n  reliability: 2\\n  durability: 2\"\n";

fn metadata(id: &str, files: &str, mode: &str) -> (&'static str, Vec<u8>) {
    let format = if mode == "''" { "''" } else { "zstd" };
    let text = METADATA.replace("ID", id).replace("FILES", files).replace("FORMAT", format).replace("MODE", mode);
    ("metadata.yaml", text.into_bytes())
}

fn db3(folder: &Path, mode: &str) -> (Vec<u8>, Vec<u8>) {
    let path = folder.join(format!("{mode}.db3"));
    let db = Connection::open(&path).unwrap();
    db.execute_batch(&format!(
        "PRAGMA journal_mode={mode}; PRAGMA wal_autocheckpoint=0; PRAGMA page_size=512;
         CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT, type TEXT, serialization_format TEXT, offered_qos_profiles TEXT);
         CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, data BLOB);
         INSERT INTO topics VALUES(1, '/words', 'std_msgs/msg/String', 'cdr', '');"
    ))
    .unwrap();
    for number in 0..20_i64 {
        let row = (number, text_cdr("x"));
        db.execute("INSERT INTO messages VALUES(NULL, 1, ?1, ?2)", row).unwrap();
    }
    let wal = fs::read(folder.join(format!("{mode}.db3-wal"))).unwrap_or_default();
    (fs::read(&path).unwrap(), wal)
}

fn mcap(folder: &Path, language: &str) -> Vec<u8> {
    let path = folder.join(format!("{language}.mcap"));
    let mut writer = mcap::Writer::new(fs::File::create(&path).unwrap()).unwrap();
    let schema = writer.add_schema("std_msgs/msg/String", language, b"string data").unwrap();
    let channel_id = writer.add_channel(schema, "/words", "cdr", &Default::default()).unwrap();
    for n in 0..20_u32 {
        let time = u64::from(n);
        let header = mcap::records::MessageHeader { channel_id, sequence: n, log_time: time, publish_time: time };
        writer.write_to_known_channel(&header, &text_cdr("x")).unwrap();
    }
    writer.finish().unwrap();
    fs::read(path).unwrap()
}

fn compressed_messages(folder: &Path) -> Vec<u8> {
    let recorder = Recorder::start(folder.join("r"), RecorderOptions::default()).unwrap();
    let topic = recorder.topic("/words", "std_msgs/msg/String", Qos::reliable(10)).unwrap();
    for number in 0..20 {
        assert!(recorder.push(&topic, number, zstd::encode_all(text_cdr("x").as_slice(), 1).unwrap()));
    }
    recorder.finish().unwrap();
    fs::read(folder.join("r/r_0.mcap")).unwrap()
}

type Files = Vec<(&'static str, Vec<u8>)>;

/// Each form's name and its folder's files.
fn forms(folder: &Path) -> Vec<(&'static str, Files)> {
    let ((plain, _), (killed, wal)) = (db3(folder, "delete"), db3(folder, "wal"));
    let (message, idl) = (mcap(folder, "ros2msg"), mcap(folder, "ros2idl"));
    let packed = |bytes: &[u8]| zstd::encode_all(bytes, 3).unwrap();
    vec![
        ("db3 as zstd", vec![("b.db3.zstd", packed(&plain)), metadata("sqlite3", "b.db3.zstd", "FILE")]),
        ("mcap as zstd", vec![("b.mcap.zstd", packed(&message)), metadata("mcap", "b.mcap.zstd", "FILE")]),
        ("db3 without metadata", vec![("b.db3", plain.clone())]),
        ("no identifier", vec![("b.mcap", message.clone()), metadata("", "b.mcap", "''")]),
        ("write-ahead log", vec![("b.db3", killed), ("b.db3-wal", wal)]),
        (
            "empty part",
            vec![("b_0.db3", plain), ("b_1.db3", Vec::new()), metadata("sqlite3", "b_0.db3, b_1.db3, b_2.db3", "''")],
        ),
        ("idl", vec![("b.mcap", idl)]),
        ("compressed messages", vec![("b.mcap", compressed_messages(folder)), metadata("mcap", "b.mcap", "MESSAGE")]),
        ("mcap without metadata", vec![("b.mcap", message)]),
    ]
}

/// Changes one file: bytes, its end, or what stands in its middle.
fn mutate(files: &mut Files, random: &mut Random) {
    let which = random.below(files.len());
    let bytes = &mut files[which].1;
    for _ in 0..=random.below(4) {
        let place = random.below(bytes.len() + 1);
        let length = random.below(40).min(bytes.len() - place);
        match random.below(7) {
            0 => bytes.truncate(place),
            1 => bytes[place..place + length].fill(0),
            2 => bytes[place..place + length].fill(0xff),
            3 => drop(bytes.drain(place..place + length)),
            4 => bytes.extend((0..length).map(|_| random.next() as u8)),
            _ if length > 0 => bytes[place] ^= 1 << random.below(8),
            _ => {}
        }
    }
}

/// Names and contents, of subfolders only the names.
fn listing(folder: &Path) -> Vec<(PathBuf, Vec<u8>)> {
    let entries = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    let mut files: Vec<_> = entries.map(|path| (path.clone(), fs::read(&path).unwrap_or_default())).collect();
    files.sort();
    files
}

/// Reads it, and saves it where it can be: the way of every command. Whether all of it could be had.
fn use_bag(path: &Path, saved: &Path) -> bool {
    let readable =
        Bag::open(path).is_ok_and(|bag| bag.messages().is_ok_and(|mut messages| messages.all(|one| one.is_ok())));
    let recovery = recover(path, saved);
    if recovery.is_ok() {
        Bag::open(saved).unwrap().messages().unwrap().for_each(|message| drop(message.unwrap()));
    }
    readable || recovery.is_ok_and(|recovery| recovery.damage.is_empty())
}

#[test]
fn mutated_bags_of_every_form_give_an_error_or_messages_and_nothing_is_written() {
    let (count, seed) = (number("BAG_MUTATIONS", 60), number("BAG_MUTATIONS_SEED", 1));
    let home = tempfile::tempdir().unwrap();
    let private = home.path().join("private");
    fs::create_dir(&private).unwrap();
    tempfile::env::override_temp_dir(&private).unwrap();
    let (place, saved) = (home.path().join("bag"), home.path().join("saved"));
    for (name, files) in forms(home.path()) {
        let (mut whole, mut random) = (0_u64, Random(seed));
        for round in 0..count {
            let mut changed = files.clone();
            if round > 0 {
                mutate(&mut changed, &mut random);
            }
            fs::create_dir(&place).unwrap();
            changed.iter().for_each(|(file, bytes)| fs::write(place.join(file), bytes).unwrap());
            let before = listing(&place);
            let used = catch_unwind(AssertUnwindSafe(|| use_bag(&place, &saved)));
            let used = used.unwrap_or_else(|_| panic!("{name}: round {round} of seed {seed} panicked"));
            assert!(used || round > 0, "{name}: unchanged, it cannot be read");
            assert!(listing(&place) == before, "{name}: round {round} of seed {seed} wrote to the bag's folder");
            assert!(listing(&private).is_empty(), "{name}: round {round} of seed {seed} left a private copy behind");
            whole += u64::from(used);
            fs::remove_dir_all(&place).unwrap();
            if saved.exists() {
                fs::remove_dir_all(&saved).unwrap();
            }
        }
        println!("{name}: {count} bags, {whole} of them could be read to the end");
        assert!(whole < count, "{name}: no change was ever noticed");
    }
}

#[test]
fn mutated_overrides_and_offers_are_refused_or_read() {
    let text = "/a:\n  reliability: best_effort\n  history: keep_all\n  deadline: {sec: 1, nsec: 5}\n/b: {depth: 3, lifespan: {sec: \
                2147483647, nsec: 4294967295}, liveliness: manual_by_topic}\n";
    let mut random = Random(number("BAG_MUTATIONS_SEED", 1));
    for _ in 0..number("BAG_MUTATIONS", 60) * 10 {
        let mut files = vec![("overrides", text.as_bytes().to_vec())];
        mutate(&mut files, &mut random);
        // Refused or read: only a panic is wrong.
        let _ = Offer::overrides_from_yaml(&String::from_utf8_lossy(&files[0].1));
    }
}
