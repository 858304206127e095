//! What a crash, a power cut or a broken disk leaves, and what is made of it.

mod common;

use std::fs;
use std::io::{Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use bag::{Bag, BagError, Qos, Recorder, RecorderOptions, recover};
use common::{Random, read, text_cdr, write};

const CHILD: &str = "BAG_TEST_KILLED_RECORDER";

/// The child: records at 1 kHz until it is killed, and keeps saying how far it is (messages pushed; known to be on
/// disk).
fn record_until_killed(folder: &Path) -> ! {
    let recorder = Recorder::start(folder.join("b"), RecorderOptions::default()).unwrap();
    let topic = recorder.topic("/words", "std_msgs/msg/String", Qos::reliable(10)).unwrap();
    let mut progress = fs::File::create(folder.join("progress")).unwrap();
    let begun = Instant::now();
    let mut pushed = 0_u64;
    loop {
        while begun.elapsed() >= Duration::from_millis(pushed) {
            assert!(recorder.push(
                &topic,
                pushed * 1_000_000,
                text_cdr(&format!("message {pushed}, as long as a joint state: {:300}", ""))
            ));
            pushed += 1;
        }
        let mut say = pushed.to_le_bytes().to_vec();
        say.extend_from_slice(&recorder.status().written.to_le_bytes());
        progress.seek(SeekFrom::Start(0)).unwrap();
        progress.write_all(&say).unwrap();
        std::thread::sleep(Duration::from_micros(500));
    }
}

fn start_child(folder: &Path) -> Child {
    Command::new(std::env::current_exe().unwrap())
        .args(["--exact", "a_recorder_killed_at_any_time_loses_less_than_a_second", "--nocapture"])
        .env(CHILD, folder)
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap()
}

#[test]
fn a_recorder_killed_at_any_time_loses_less_than_a_second() {
    if let Ok(folder) = std::env::var(CHILD) {
        record_until_killed(Path::new(&folder));
    }
    let folder = tempfile::tempdir().unwrap();
    let mut random = Random(1);
    let mut worst_ms = 0;
    for batch in 0..25 {
        let mut children: Vec<(PathBuf, Child, Duration)> = (0..4)
            .map(|number| {
                let home = folder.path().join(format!("{batch}_{number}"));
                fs::create_dir(&home).unwrap();
                let child = start_child(&home);
                (home, child, Duration::from_millis(20 + random.below(1500) as u64))
            })
            .collect();
        children.sort_by_key(|(_, _, life)| *life);
        let begun = Instant::now();
        for (_, child, life) in &mut children {
            std::thread::sleep(life.saturating_sub(begun.elapsed()));
            child.kill().unwrap(); // SIGKILL
            child.wait().unwrap();
        }
        for (home, _, _) in &children {
            let Ok(progress) = fs::read(home.join("progress")) else { continue }; // killed before the recorder began
            let Some((pushed, written)) = progress.split_at_checked(8).filter(|(_, rest)| rest.len() == 8) else {
                continue;
            };
            let (pushed, written) =
                (u64::from_le_bytes(pushed.try_into().unwrap()), u64::from_le_bytes(written.try_into().unwrap()));
            let left = home.join("b");
            // It may have been killed between making the folder and the first byte.
            let saved = match recover(&left, home.join("saved")) {
                Ok(recovery) => recovery.messages,
                Err(BagError::BadFile { reason, .. }) if written == 0 => {
                    assert!(reason.contains("empty") || reason.contains("no .mcap"), "{reason}");
                    continue;
                }
                Err(error) => panic!("{error}"),
            };
            assert!(saved >= written, "{saved} saved of {written} that were reported to be on disk");
            // The child may have pushed a few more than it had time to say.
            let messages = read(&home.join("saved")).unwrap();
            assert_eq!(messages.len() as u64, saved);
            for (number, (_, message)) in messages.iter().enumerate() {
                assert!(message.data.starts_with(&[0, 1, 0, 0]) && message.stamp_ns == number as u64 * 1_000_000);
            }
            worst_ms = worst_ms.max(pushed.saturating_sub(saved)); // a message a millisecond
        }
    }
    println!("100 kills: at worst {worst_ms} ms were lost");
    assert!(worst_ms <= 1000, "{worst_ms} ms lost");
}

#[test]
fn a_file_cut_anywhere_gives_every_whole_chunk_before_the_cut() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("whole");
    write(&path, 2000, RecorderOptions { chunk_bytes: 8192, ..RecorderOptions::default() });
    let whole = read(&path).unwrap();
    let bytes = fs::read(path.join("whole_0.mcap")).unwrap();
    let cut = folder.path().join("cut.mcap");
    let mut random = Random(2);
    let mut places: Vec<usize> = (0..150).map(|_| random.below(bytes.len())).collect();
    places.extend((0..60).chain(bytes.len() - 60..bytes.len()));
    places.sort_unstable();
    let mut before = 0;
    for (number, place) in places.into_iter().enumerate() {
        fs::write(&cut, &bytes[..place]).unwrap();
        let target = folder.path().join(format!("saved_{number}"));
        if place < 8 {
            assert!(matches!(recover(&cut, &target), Err(BagError::BadFile { .. })));
            assert!(!target.exists(), "nothing was to be written");
            continue;
        }
        let recovery = recover(&cut, &target).unwrap();
        let saved = read(&target).unwrap();
        assert_eq!(saved.len() as u64, recovery.messages);
        assert!(saved.len() >= before, "a longer file gives fewer messages");
        before = saved.len();
        for (a, b) in saved.iter().zip(&whole) {
            assert_eq!((&a.0, a.1.stamp_ns, &a.1.data), (&b.0, b.1.stamp_ns, &b.1.data));
        }
        // Either all the data is there, or the bag is refused with the way out.
        match Bag::open(&cut) {
            Ok(bag) => assert_eq!(bag.message_count(), 4000),
            Err(error) => {
                assert!(error.to_string().contains("tandem bag recover"), "{error}");
                assert!(!recovery.damage.is_empty());
            }
        }
    }
    assert!(before > 3900, "almost the whole file gives almost all messages, not {before}");
}

#[test]
fn a_broken_chunk_in_the_middle_costs_only_itself() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("b");
    write(&path, 2000, RecorderOptions { chunk_bytes: 8192, ..RecorderOptions::default() });
    let file = path.join("b_0.mcap");
    let mut bytes = fs::read(&file).unwrap();
    let third = bytes.len() / 3;
    let chunk = third + bytes[third..].windows(4).position(|w| w == [0x28, 0xb5, 0x2f, 0xfd]).unwrap(); // zstd's mark
    bytes[chunk + 30] ^= 0x10;
    fs::write(&file, &bytes).unwrap();
    let error = Bag::open(&path).unwrap_err().to_string();
    assert!(error.contains("damaged") && error.contains("tandem bag recover"), "{error}");
    let recovery = recover(&path, folder.path().join("saved")).unwrap();
    assert_eq!(recovery.damage.len(), 1, "{:?}", recovery.damage);
    assert!(recovery.messages > 3600 && recovery.messages < 4000, "{}", recovery.messages);
    assert_eq!(fs::read(&file).unwrap(), bytes, "the source was written to");
}

#[test]
fn recovering_writes_over_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("b");
    write(&path, 10, RecorderOptions::default());
    let target = folder.path().join("target");
    fs::create_dir(&target).unwrap();
    fs::write(target.join("precious"), "x").unwrap();
    assert!(matches!(recover(&path, &target), Err(BagError::Exists { .. })));
    assert!(matches!(recover(&path, &path), Err(BagError::Exists { .. })));
    assert_eq!(fs::read_dir(&target).unwrap().count(), 1);
    assert_eq!(read(&path).unwrap().len(), 20);
}
