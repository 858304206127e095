//! Recording beside a walking controller: the cycle allocates nothing, the bag runs again to the bit, and whatever
//! happens to the disk is a fault of the recording alone.

use bag::Bag;
use control::{Config, Controller, Input, JointState, Mode, PreparedGait, Request};
use gait::Gait;
use replay::verify;
use robot::Robot;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::{Duration, Instant};
use tandem_controller::recording::{self, CycleLog, Recording, Subject, Writer, folder_name};

#[global_allocator]
static ALLOCATOR: realtime::CountingAllocator = realtime::CountingAllocator;

/// A robot that follows its commands, its controller, and the recording beside it.
struct Bench {
    cycle_log: CycleLog,
    recording: Arc<Recording>,
    writer: Option<JoinHandle<()>>,
    controller: Controller,
    gait: PreparedGait,
    state: JointState,
    now: Duration,
}

impl Bench {
    fn new(record_root: &Path, split_bytes: Option<u64>) -> Self {
        let (mut bench, writer) = Self::without_writer(record_root, split_bytes);
        bench.writer = Some(std::thread::spawn(move || writer.run()));
        bench
    }

    /// Whoever calls it turns the writer.
    fn without_writer(record_root: &Path, split_bytes: Option<u64>) -> (Self, Writer) {
        let root = Path::new(env!("CARGO_MANIFEST_DIR"));
        let robot = Robot::load(&root.join("../../config/robots/vision60")).unwrap();
        let text = std::fs::read_to_string(root.join("../../tests/gaits/amble.json")).unwrap();
        let gait = Gait::from_json(&text).unwrap();
        let config = Config { simulation_start: true, ..Config::for_robot(&robot) };
        let prepared = PreparedGait::new(&gait, &config).unwrap();
        let (cycle_log, recording, writer) = recording::open(Subject {
            config: config.clone(),
            robot_description: robot.urdf.clone(),
            leg_names: std::array::from_fn(|leg| robot.legs[leg].name.clone()),
            epoch_ns: 0,
            record_root: Some(record_root.to_owned()),
            split_bytes,
            split_duration: None,
        });
        recording.gait(1, &gait, &prepared);
        let bench = Self {
            cycle_log,
            recording: Arc::new(recording),
            writer: None,
            controller: Controller::new(config).unwrap(),
            gait: prepared,
            state: JointState {
                stamp: Duration::ZERO,
                arrived: [Duration::ZERO; 12],
                position_rad: gait.initial.joint_position_rad,
                velocity_rad_s: gait.initial.joint_velocity_rad_s,
                temperature_c: None,
                drive_error: [0; 12],
            },
            now: Duration::ZERO,
        };
        (bench, writer)
    }

    /// One control cycle as the node's thread does it. Gives how often it allocated.
    fn cycle(&mut self) -> u64 {
        self.now += Duration::from_millis(1);
        self.state.stamp = self.now;
        self.state.arrived = [self.now; 12];
        let state = self.state.to_resolution();
        let before = realtime::allocations_of_this_thread();
        let first = self.controller.gait().is_none();
        let input = Input {
            joints: Some(&state),
            requests: if first { &[Request::StartOnGait] } else { &[] },
            gait: first.then_some(&self.gait),
            ..Input::default()
        };
        self.cycle_log.begin_cycle(&self.controller);
        let output = self.controller.step(&input, self.now);
        self.cycle_log.end_cycle(self.now, &input, u64::from(first), Some(output.torque_nm), &output);
        let allocations = realtime::allocations_of_this_thread() - before;
        assert_eq!(output.mode, Mode::Walking, "{:?}", output.report);
        for joint in 0..12 {
            let error = output.command.position_rad[joint] - self.state.position_rad[joint];
            self.state.position_rad[joint] += 0.5 * error;
            self.state.velocity_rad_s[joint] = output.command.velocity_rad_s[joint] + 0.1 * error;
        }
        allocations
    }

    /// So many cycles, at ten times real time.
    fn run(&mut self, cycles: u64) {
        for n in 0..cycles {
            assert_eq!(self.cycle(), 0, "cycle {n} allocated");
            if n % 10 == 0 {
                std::thread::sleep(Duration::from_millis(1));
            }
        }
    }

    /// Cycles until the recording has failed.
    fn run_until_fault(&mut self) -> String {
        let deadline = Instant::now() + Duration::from_secs(60);
        loop {
            self.run(50);
            if let Some(fault) = self.recording.status().fault {
                return fault;
            }
            assert!(Instant::now() < deadline, "no fault within a minute: {:?}", self.recording.status());
        }
    }
}

impl Drop for Bench {
    fn drop(&mut self) {
        self.recording.end();
        if let Some(writer) = self.writer.take() {
            let ended = writer.join();
            assert!(ended.is_ok() || std::thread::panicking(), "the recording's thread panicked");
        }
    }
}

#[test]
fn a_recorded_cycle_allocates_nothing_and_runs_again_to_the_bit() {
    let folder = tempfile::tempdir().unwrap();
    let mut bench = Bench::new(folder.path(), None);
    let whole = folder.path().join("whole");
    bench.recording.start("whole").unwrap();
    assert!(bench.recording.start("second").unwrap_err().contains("is being recorded"));
    bench.run(3000);
    let done = bench.recording.stop().unwrap();
    assert_eq!((done.dropped, done.folder.as_str()), (0, whole.to_str().unwrap()));
    let verification = verify(&whole).unwrap();
    assert_eq!((verification.cycles, verification.different), (3000, 0), "{:?}", verification.first);
    assert_eq!(Bag::open(&whole).unwrap().message_count(), done.messages);
    assert!(bench.recording.stop().unwrap_err().contains("nothing is being recorded"));

    // A second recording begins in the middle of the walk.
    bench.run(500);
    let later = folder.path().join("later");
    bench.recording.start("later").unwrap();
    bench.run(2000);
    bench.recording.stop().unwrap();
    let verification = verify(&later).unwrap();
    assert!((1900..=2000).contains(&verification.cycles), "{}", verification.cycles);
    assert_eq!(verification.different, 0, "{:?}", verification.first);
    let run = replay::read_run(&later).unwrap();
    assert_eq!(run.gait.map(|gait| gait.name), Some("amble".into()));
}

#[test]
fn the_node_s_end_completes_the_recording() {
    let folder = tempfile::tempdir().unwrap();
    let mut bench = Bench::new(folder.path(), Some(200_000));
    bench.recording.start("run").unwrap();
    bench.run(4000);
    drop(bench);
    let bag = Bag::open(folder.path().join("run")).unwrap();
    assert!(bag.files() > 1, "split by size");
    let verification = verify(folder.path().join("run")).unwrap();
    assert_eq!((verification.cycles, verification.different), (4000, 0));
}

#[test]
fn a_writer_that_falls_behind_never_holds_the_cycle_up_and_every_drop_is_counted() {
    let folder = tempfile::tempdir().unwrap();
    let mut bench = Bench::new(folder.path(), None);
    bench.recording.start("run").unwrap();
    // Far faster than any writer.
    let cycles = 100_000;
    for _ in 0..cycles {
        assert_eq!(bench.cycle(), 0);
    }
    let done = bench.recording.stop().unwrap();
    assert!(done.dropped > 0 && done.message.contains("too slow"), "{done:?}");
    let written = Bag::open(&done.folder).unwrap().topic("/control_cycle").unwrap().1.messages;
    assert!(written + done.dropped >= cycles, "{written} written, {} dropped", done.dropped);
    let error = verify(&done.folder).unwrap_err().to_string();
    assert!(error.contains("dropped"), "{error}");
}

#[test]
fn a_folder_that_cannot_be_written_is_a_fault_and_the_robot_walks_on() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::create_dir(folder.path().join("full")).unwrap();
    std::fs::write(folder.path().join("full/precious"), "x").unwrap();
    let mut bench = Bench::new(folder.path(), None);
    bench.run(100);
    let elsewhere = tempfile::tempdir().unwrap();
    std::os::unix::fs::symlink(elsewhere.path(), folder.path().join("link")).unwrap();
    for (name, words) in [
        ("/etc/cron.d", "record_root"),
        ("../out", "record_root"),
        ("run\n[INFO] armed", "record_root"),
        ("link", "is a link"),
        ("full", "not an empty folder"),
    ] {
        let error = bench.recording.start(name).unwrap_err();
        assert!(error.contains(words) && !error.contains('\n'), "{error}");
        assert_eq!(bench.recording.status().fault.as_ref(), Some(&error));
        bench.run(100);
    }
    // Nobody may write there, not even root.
    let error = Bench::new(Path::new("/proc/recordings"), None).recording.start("run").unwrap_err();
    assert!(error.contains("cannot create"), "{error}");
    assert_eq!(std::fs::read_dir(elsewhere.path()).unwrap().count(), 0, "something was written");
    assert_eq!(std::fs::read_dir(folder.path().join("full")).unwrap().count(), 1, "something was written");
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 2, "something was written");
    bench.recording.start("run").unwrap();
    assert_eq!(bench.recording.status().fault, None);
}

#[test]
fn a_removed_folder_is_a_fault_and_the_next_recording_works() {
    let folder = tempfile::tempdir().unwrap();
    let mut bench = Bench::new(folder.path(), None);
    bench.recording.start("run").unwrap();
    bench.run(200);
    std::fs::remove_dir_all(folder.path().join("run")).unwrap();
    let fault = bench.run_until_fault();
    assert!(fault.contains("was the folder removed?"), "{fault}");
    assert!(bench.recording.stop().unwrap_err().contains("the recording stopped"));
    bench.recording.start("run").unwrap();
    bench.run(200);
    bench.recording.stop().unwrap();
    assert_eq!(verify(folder.path().join("run")).unwrap().different, 0);
}

/// A file system of its own that is soon full, where this process may mount one.
struct SmallDisk(PathBuf);

impl SmallDisk {
    fn mount(place: PathBuf) -> Option<Self> {
        std::fs::create_dir(&place).unwrap();
        let mounted = std::process::Command::new("mount")
            .args(["-t", "tmpfs", "-o", "size=300k", "tmpfs"])
            .arg(&place)
            .output()
            .is_ok_and(|output| output.status.success());
        mounted.then_some(Self(place))
    }

    /// From now on nobody can write there.
    fn make_read_only(&self) {
        let output = std::process::Command::new("mount").args(["-o", "remount,ro"]).arg(&self.0).output().unwrap();
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    }
}

impl Drop for SmallDisk {
    fn drop(&mut self) {
        // A mount left behind shows in the list of mounts; there is nothing else to do about it here.
        let _ = std::process::Command::new("umount").arg("--lazy").arg(&self.0).status();
    }
}

#[test]
fn a_full_disk_is_a_fault_and_what_is_on_it_is_recovered() {
    let folder = tempfile::tempdir().unwrap();
    let Some(disk) = SmallDisk::mount(folder.path().join("disk")) else {
        println!(
            "skipped: this process may not mount a small file system; run as root. The recorder's own test fills a disk by a limit."
        );
        return;
    };
    let mut bench = Bench::new(&disk.0, None);
    bench.recording.start("run").unwrap();
    let fault = bench.run_until_fault();
    assert!(fault.contains("cannot write") && fault.contains("No space left"), "{fault}");
    bench.run(500);
    assert!(bench.recording.stop().unwrap_err().contains("No space left"));
    let recovered = bag::recover(disk.0.join("run"), folder.path().join("recovered")).unwrap();
    assert!(recovered.messages > 100, "{recovered:?}");
    assert_eq!(verify(&recovered.folder).unwrap().different, 0);
}

#[test]
fn a_read_only_folder_is_a_fault_and_the_robot_walks_on() {
    let folder = tempfile::tempdir().unwrap();
    let Some(disk) = SmallDisk::mount(folder.path().join("disk")) else {
        println!(
            "skipped: this process may not mount a file system; run as root. /proc stands for a read-only folder above."
        );
        return;
    };
    disk.make_read_only();
    let mut bench = Bench::new(folder.path(), None);
    let error = bench.recording.start("disk").unwrap_err();
    assert!(error.contains("cannot create") && error.contains("Read-only file system"), "{error}");
    assert_eq!(bench.recording.status().fault.as_ref(), Some(&error));
    bench.run(300);
    bench.recording.start("run").unwrap();
    bench.run(100);
    assert_eq!(bench.recording.stop().unwrap().dropped, 0);
}

/// The writer's thread does not run for 9.5 s: a machine that is too busy. Two seconds fit into the buffer; what does
/// not is a number, while it is recorded, in the answer, and in the bag.
#[test]
fn a_writer_that_is_stalled_leaves_a_hole_of_known_size() {
    const BUFFER: u64 = 2048;
    let folder = tempfile::tempdir().unwrap();
    let (mut bench, mut writer) = Bench::without_writer(folder.path(), None);
    let recording = Arc::clone(&bench.recording);
    turn_while(&mut writer, move || recording.start("run")).unwrap();
    for _ in 0..500 {
        bench.cycle();
        writer.turn();
    }
    for _ in 0..BUFFER + 7500 {
        assert_eq!(bench.cycle(), 0, "the cycle allocated");
    }
    assert!(writer.turn());
    for _ in 0..500 {
        bench.cycle();
        writer.turn();
    }
    let hole = Duration::from_millis(7501);
    let status = bench.recording.status();
    assert_eq!((status.dropped, status.missing_cycles, status.longest_hole, &status.fault), (7500, 7500, hole, &None));
    let recording = Arc::clone(&bench.recording);
    let done = turn_while(&mut writer, move || recording.stop()).unwrap();
    assert_eq!(done.dropped, 7500);
    assert!(done.message.contains("7500 were dropped") && done.message.contains("at most 7.501 s"), "{}", done.message);
    let found = replay::continuity(&Bag::open(&done.folder).unwrap()).unwrap().unwrap();
    assert_eq!((found.cycles, found.missing, found.longest), (500 + BUFFER + 500, 7500, hole));
    let run = replay::read_run(&done.folder).unwrap();
    assert_eq!(run.missing_cycles, 7500);
    assert!(run.events.iter().any(|(_, what)| what == "7500 cycles not recorded, 7.501 s"), "{:?}", run.events);
    let error = verify(&done.folder).unwrap_err().to_string();
    assert!(error.contains("dropped"), "{error}");
}

/// Lets the writer work until something that waits for it has its answer.
fn turn_while<T: Send + 'static>(writer: &mut Writer, ask: impl FnOnce() -> T + Send + 'static) -> T {
    let asking = std::thread::spawn(ask);
    while !asking.is_finished() {
        assert!(writer.turn());
    }
    asking.join().unwrap()
}

#[test]
fn folders_are_named_by_the_moment() {
    for (seconds, name) in [
        (0, "1970-01-01T00_00_00"),
        (951_782_399, "2000-02-28T23_59_59"),
        (951_782_400, "2000-02-29T00_00_00"),
        (1_795_327_800, "2026-11-22T06_10_00"),
        (4_107_542_400, "2100-03-01T00_00_00"),
    ] {
        assert_eq!(folder_name(Duration::from_secs(seconds)), name);
    }
}
