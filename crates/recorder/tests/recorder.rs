//! The recorder beside a caller that must not be held up: limits, faults, and what it says about them.

use std::fs;
use std::time::{Duration, Instant};

use recorder::{BagError, Qos, Recorder, RecorderOptions, RecorderStatus, WhenFull};

fn wait_for(recorder: &Recorder, mut done: impl FnMut(&RecorderStatus) -> bool) -> RecorderStatus {
    let end = Instant::now() + Duration::from_secs(20);
    loop {
        let status = recorder.status();
        if done(&status) || Instant::now() > end {
            return status;
        }
        std::thread::sleep(Duration::from_millis(10));
    }
}

fn quick() -> RecorderOptions {
    RecorderOptions { flush_interval: Duration::from_millis(20), ..RecorderOptions::default() }
}

#[test]
fn every_offered_message_is_either_written_or_counted_as_dropped() {
    let folder = tempfile::tempdir().unwrap();
    let options = RecorderOptions { queue_messages: 4, queue_bytes: 4096, ..RecorderOptions::default() };
    let recorder = Recorder::start(folder.path().join("b"), options).unwrap();
    let topic = recorder.topic("/t", "std_msgs/msg/String", Qos::reliable(10)).unwrap();
    let mut taken = 0;
    for stamp in 0..20_000 {
        taken += u64::from(recorder.push(&topic, stamp, vec![7; 1000]));
    }
    let summary = recorder.finish().unwrap();
    assert_eq!(summary.written(), taken);
    assert_eq!(summary.written() + summary.dropped(), 20_000);
    assert!(summary.dropped() > 0, "a queue of four cannot hold 20000 messages offered at once");
}

#[test]
fn a_caller_that_can_wait_loses_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let options = RecorderOptions {
        queue_messages: 4,
        queue_bytes: 4096,
        when_full: WhenFull::Wait,
        ..RecorderOptions::default()
    };
    let recorder = Recorder::start(folder.path().join("b"), options).unwrap();
    let topic = recorder.topic("/t", "std_msgs/msg/String", Qos::reliable(10)).unwrap();
    assert!((0..5000).all(|stamp| recorder.push(&topic, stamp, vec![7; 1000])));
    let summary = recorder.finish().unwrap();
    assert_eq!((summary.written(), summary.dropped()), (5000, 0));
}

#[test]
fn one_message_larger_than_the_queue_is_recorded() {
    let folder = tempfile::tempdir().unwrap();
    let options = RecorderOptions { queue_bytes: 100, ..RecorderOptions::default() };
    let recorder = Recorder::start(folder.path().join("b"), options).unwrap();
    let topic = recorder.topic("/t", "std_msgs/msg/String", Qos::reliable(10)).unwrap();
    assert!(recorder.push(&topic, 1, vec![0; 5000]));
    assert_eq!(recorder.finish().unwrap().written(), 1);
}

#[test]
fn a_bag_is_split_by_time_and_metadata_lists_every_file() {
    let folder = tempfile::tempdir().unwrap();
    let options = RecorderOptions { split_duration: Some(Duration::from_secs(10)), ..RecorderOptions::default() };
    let recorder = Recorder::start(folder.path().join("walk"), options).unwrap();
    let topic = recorder.topic("/t", "std_msgs/msg/Bool", Qos::reliable(10)).unwrap();
    for second in 0..35 {
        assert!(recorder.push(&topic, second * 1_000_000_000, [0, 1, 0, 0, 1]));
    }
    let summary = recorder.finish().unwrap();
    assert_eq!(summary.written(), 35);
    assert_eq!(summary.span_ns, Some((0, 34_000_000_000)));
    let text = fs::read_to_string(folder.path().join("walk/metadata.yaml")).unwrap();
    for file in 0..4 {
        assert!(folder.path().join(format!("walk/walk_{file}.mcap")).exists());
        assert!(text.contains(&format!("path: walk_{file}.mcap")), "{text}");
    }
}

#[test]
fn a_bag_is_split_by_size() {
    let folder = tempfile::tempdir().unwrap();
    let options = RecorderOptions { split_bytes: Some(20_000), chunk_bytes: 4096, ..RecorderOptions::default() };
    let recorder = Recorder::start(folder.path().join("b"), options).unwrap();
    let topic = recorder.topic("/t", "std_msgs/msg/String", Qos::reliable(10)).unwrap();
    let mut noise = 1_u64; // does not compress
    for stamp in 0..200 {
        let mut bytes = Vec::new();
        for _ in 0..125 {
            noise = noise.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            bytes.extend_from_slice(&(noise ^ (noise >> 29)).to_le_bytes());
        }
        assert!(recorder.push(&topic, stamp, bytes));
    }
    recorder.finish().unwrap();
    let files = fs::read_dir(folder.path().join("b")).unwrap().count() - 1;
    assert!((7..=12).contains(&files), "200 kB in files of 20 kB: {files} files");
}

#[test]
fn nothing_is_written_over() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("precious"), "x").unwrap();
    let error = Recorder::start(folder.path(), RecorderOptions::default()).unwrap_err();
    assert!(matches!(error, BagError::Exists { .. }), "{error}");
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
}

#[test]
fn a_place_that_is_no_folder_is_one_clear_error() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("file");
    fs::write(&file, "x").unwrap();
    let error = Recorder::start(file.join("bag"), RecorderOptions::default()).unwrap_err();
    assert!(error.to_string().contains("cannot create"), "{error}");
}

#[test]
fn a_removed_folder_is_a_fault_and_pushing_goes_on() {
    let folder = tempfile::tempdir().unwrap();
    let recorder = Recorder::start(folder.path().join("b"), quick()).unwrap();
    let topic = recorder.topic("/t", "std_msgs/msg/Bool", Qos::reliable(10)).unwrap();
    assert!(recorder.push(&topic, 1, [0, 1, 0, 0, 1]));
    fs::remove_dir_all(folder.path().join("b")).unwrap();
    let status = wait_for(&recorder, |status| status.fault.is_some());
    let fault = status.fault.expect("a fault within 20 s");
    assert!(fault.contains("was the folder removed?"), "{fault}");
    assert!(!recorder.push(&topic, 2, [0, 1, 0, 0, 1]));
    let error = recorder.finish().unwrap_err();
    assert!(error.to_string().contains("the recording stopped"), "{error}");
}

#[test]
fn a_file_replaced_by_another_is_a_fault() {
    let folder = tempfile::tempdir().unwrap();
    let recorder = Recorder::start(folder.path().join("b"), quick()).unwrap();
    let file = folder.path().join("b/b_0.mcap");
    fs::remove_file(&file).unwrap();
    fs::write(&file, "someone else's").unwrap();
    let status = wait_for(&recorder, |status| status.fault.is_some());
    assert!(status.fault.is_some_and(|fault| fault.contains("taken this one's place")));
    drop(recorder);
    assert_eq!(fs::read_to_string(&file).unwrap(), "someone else's");
}

#[test]
fn options_out_of_range_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let bad = |options: RecorderOptions| Recorder::start(folder.path().join("b"), options).unwrap_err().to_string();
    assert!(bad(RecorderOptions { queue_messages: 0, ..quick() }).contains("queue_messages"));
    assert!(bad(RecorderOptions { flush_interval: Duration::ZERO, ..quick() }).contains("flush_interval"));
    assert!(bad(RecorderOptions { compression_level: 40, ..quick() }).contains("compression_level"));
    assert!(bad(RecorderOptions { split_bytes: Some(1), ..quick() }).contains("split_bytes"));
    assert!(!folder.path().join("b").exists());
}

#[test]
fn a_topic_keeps_its_type() {
    let folder = tempfile::tempdir().unwrap();
    let recorder = Recorder::start(folder.path().join("b"), quick()).unwrap();
    recorder.topic("/t", "std_msgs/msg/Bool", Qos::reliable(10)).unwrap();
    recorder.topic("/t", "std_msgs/msg/Bool", Qos::reliable(10)).unwrap();
    let error = recorder.topic("/t", "std_msgs/msg/String", Qos::reliable(10)).unwrap_err();
    assert!(matches!(error, BagError::TopicConflict { .. }), "{error}");
}

/// A full disk, by the kernel's own limit on a file's size, in a child process because the limit is the whole
/// process's.
#[test]
fn a_full_disk_is_a_fault_and_pushing_goes_on() {
    const CHILD: &str = "BAG_TEST_FULL_DISK";
    if let Ok(folder) = std::env::var(CHILD) {
        let limit = libc::rlimit { rlim_cur: 64 << 10, rlim_max: 64 << 10 };
        // SAFETY: plain system calls on a local structure.
        unsafe {
            libc::signal(libc::SIGXFSZ, libc::SIG_IGN);
            assert_eq!(libc::setrlimit(libc::RLIMIT_FSIZE, &limit), 0);
        }
        let recorder = Recorder::start(folder, RecorderOptions { chunk_bytes: 4096, ..quick() }).unwrap();
        let topic = recorder.topic("/t", "std_msgs/msg/String", Qos::reliable(10)).unwrap();
        let mut noise = 1_u64;
        let mut stamp = 0;
        let status = wait_for(&recorder, |status| {
            let mut bytes = vec![0; 1000];
            for byte in &mut bytes {
                noise = noise.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
                *byte = (noise >> 56) as u8;
            }
            stamp += 1;
            recorder.push(&topic, stamp, bytes);
            status.fault.is_some()
        });
        let fault = status.fault.expect("a fault within 20 s");
        assert!(fault.contains("cannot write"), "{fault}");
        assert!(!recorder.push(&topic, 0, [0; 5]));
        assert!(status.written > 0 && status.written < status.offered);
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let output = std::process::Command::new(std::env::current_exe().unwrap())
        .args(["--exact", "a_full_disk_is_a_fault_and_pushing_goes_on", "--nocapture"])
        .env(CHILD, folder.path().join("b"))
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
}
