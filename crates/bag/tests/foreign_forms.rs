//! Forms that bags of other recorders come in: each is read as it is, and nothing is left beside it.

use std::fs;
use std::path::Path;

use bag::Bag;
use rusqlite::Connection;

fn fill(db: &Connection, first: i64, count: i64) {
    for number in first..first + count {
        let cdr = [0, 1, 0, 0, 2, 0, 0, 0, b'x', 0];
        db.execute("INSERT INTO messages VALUES(NULL, 1, ?1, ?2)", (number, cdr)).unwrap();
    }
}

fn write_db3(path: &Path, mode: &str) -> Connection {
    let db = Connection::open(path).unwrap();
    db.execute_batch(&format!(
        "PRAGMA journal_mode={mode}; PRAGMA wal_autocheckpoint=0;
         CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT, type TEXT, serialization_format TEXT, offered_qos_profiles TEXT);
         CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, data BLOB);
         INSERT INTO topics VALUES(1, '/words', 'std_msgs/msg/String', 'cdr', '');"
    ))
    .unwrap();
    fill(&db, 0, 20);
    db
}

fn write_metadata(folder: &Path, identifier: &str, files: &str, more: &str) {
    let text = format!(
        "rosbag2_bagfile_information:\n  version: 5\n  storage_identifier: '{identifier}'\n  relative_file_paths: [{files}]\n{more}"
    );
    fs::write(folder.join("metadata.yaml"), text).unwrap();
}

/// All messages can be read, and the folder is byte for byte as it was.
fn read_without_a_trace(path: &Path, messages: usize) -> Bag {
    let folder = if path.is_dir() { path } else { path.parent().unwrap() };
    let listing = || {
        let mut files: Vec<_> = fs::read_dir(folder)
            .unwrap()
            .map(|entry| entry.unwrap().path())
            .map(|path| (path.clone(), fs::read(path).unwrap()))
            .collect();
        files.sort();
        files
    };
    let before = listing();
    let bag = Bag::open(path).unwrap();
    assert_eq!(bag.message_count(), messages as u64);
    assert_eq!(bag.messages().unwrap().map(Result::unwrap).count(), messages);
    assert!(before == listing(), "{} changed", folder.display());
    bag
}

const WHOLE_FILE: &str = "  compression_format: zstd\n  compression_mode: FILE\n";

#[test]
fn a_db3_compressed_as_a_whole_is_read_as_it_is() {
    let folder = tempfile::tempdir().unwrap();
    let plain = folder.path().join("b_0.db3");
    drop(write_db3(&plain, "delete"));
    let packed = zstd::encode_all(fs::read(&plain).unwrap().as_slice(), 3).unwrap();
    fs::remove_file(&plain).unwrap();
    fs::write(folder.path().join("b_0.db3.zstd"), &packed).unwrap();
    write_metadata(folder.path(), "sqlite3", "b_0.db3.zstd", WHOLE_FILE);
    assert_eq!(read_without_a_trace(folder.path(), 20).storage(), "sqlite3");
    read_without_a_trace(&folder.path().join("b_0.db3.zstd"), 20);
    fs::write(folder.path().join("b_0.db3.zstd"), &packed[..packed.len() / 2]).unwrap();
    let error = Bag::open(folder.path()).unwrap_err().to_string();
    assert!(error.contains("cannot unpack"), "{error}");
}

#[test]
fn an_mcap_compressed_as_a_whole_and_an_empty_identifier_are_read() {
    let folder = tempfile::tempdir().unwrap();
    let recorder = bag::Recorder::start(folder.path().join("r"), bag::RecorderOptions::default()).unwrap();
    let topic = recorder.topic("/words", "std_msgs/msg/String", bag::Qos::reliable(10)).unwrap();
    for number in 0..20 {
        assert!(recorder.push(&topic, number, [0, 1, 0, 0, 2, 0, 0, 0, b'x', 0]));
    }
    recorder.finish().unwrap();
    let bytes = fs::read(folder.path().join("r/r_0.mcap")).unwrap();
    let made = folder.path().join("b");
    fs::create_dir(&made).unwrap();
    fs::write(made.join("b_0.mcap"), &bytes).unwrap();
    write_metadata(&made, "", "b_0.mcap", "");
    assert_eq!(read_without_a_trace(&made, 20).storage(), "mcap");
    fs::remove_file(made.join("b_0.mcap")).unwrap();
    fs::write(made.join("b_0.mcap.zstd"), zstd::encode_all(bytes.as_slice(), 3).unwrap()).unwrap();
    write_metadata(&made, "mcap", "b_0.mcap.zstd", WHOLE_FILE);
    read_without_a_trace(&made, 20);
}

#[test]
fn a_db3_folder_without_metadata_is_read_with_a_line() {
    let folder = tempfile::tempdir().unwrap();
    drop(write_db3(&folder.path().join("b_0.db3"), "delete"));
    let bag = read_without_a_trace(folder.path(), 20);
    assert_eq!(bag.notes().len(), 1);
    assert!(bag.notes()[0].contains("no metadata.yaml"));
}

#[test]
fn messages_in_the_write_ahead_log_of_a_killed_recorder_are_read_without_a_trace() {
    let folder = tempfile::tempdir().unwrap();
    let db = write_db3(&folder.path().join("live.db3"), "wal");
    let killed = folder.path().join("killed 100%?#");
    fs::create_dir(&killed).unwrap();
    for suffix in ["", "-wal"] {
        fs::copy(folder.path().join(format!("live.db3{suffix}")), killed.join(format!("b.db3{suffix}"))).unwrap();
    }
    assert!(fs::metadata(killed.join("b.db3-wal")).unwrap().len() > 0);
    read_without_a_trace(&killed.join("b.db3"), 20);
    drop(db);
    // Closed properly: the log is gone, and the file still says that it is in write-ahead mode.
    let closed = folder.path().join("closed 100%?#");
    fs::create_dir(&closed).unwrap();
    fs::copy(folder.path().join("live.db3"), closed.join("b.db3")).unwrap();
    read_without_a_trace(&closed.join("b.db3"), 20);
}

#[test]
fn a_split_bag_with_a_missing_or_an_empty_part_gives_the_others_and_a_line() {
    let folder = tempfile::tempdir().unwrap();
    drop(write_db3(&folder.path().join("b_0.db3"), "delete"));
    fs::write(folder.path().join("b_1.db3"), "").unwrap();
    write_metadata(folder.path(), "sqlite3", "b_0.db3, b_1.db3, b_2.db3", "");
    let bag = read_without_a_trace(folder.path(), 20);
    assert!(
        bag.notes()[0].contains("part is empty") && bag.notes()[1].contains("part is missing"),
        "{:?}",
        bag.notes()
    );
    fs::remove_file(folder.path().join("b_0.db3")).unwrap();
    let error = Bag::open(folder.path()).unwrap_err().to_string();
    assert!(error.contains("every part of this bag is missing or empty"), "{error}");
}

#[test]
fn a_ros_1_bag_is_named_as_such() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("walk.bag");
    fs::write(&path, "#ROSBAG V2.0\nand so on").unwrap();
    let error = Bag::open(&path).unwrap_err().to_string();
    assert!(error.contains("ROS 1 bag") && error.contains("rosbags-convert"), "{error}");
}
