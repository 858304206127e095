//! A run recorded, read and run again.

use std::path::Path;
use std::time::{Duration, Instant};

use bag::{Bag, Qos, Recorder, RecorderOptions, from_cdr, to_cdr};
use control::{Config, Controller, InertialState, Input, JointState, PreparedGait, Request, Tilt};
use gait::{Gains, Gait, InitialState, Mirror};
use replay::{ReplayError, read_run, verify};
use robot::Robot;
use run_recorder::{BodySample, RunInfo, RunRecorder};

fn robot() -> Robot {
    Robot::load(Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../../config/robots/vision60"))).unwrap()
}

/// A stepping gait: legs 0 and 3 lift, the reference is a little off the plan.
fn gait(robot: &Robot) -> Gait {
    let stand = robot.stand_rad();
    let lift = |j: usize| -> f64 {
        let side = if j < 6 { 1.0 } else { -1.0 };
        if matches!(j / 3, 1 | 2) { 0.0 } else { [0.2 * side, 0.0, -0.4][j % 3] }
    };
    let shape = [0.0, 0.0, 1.0, 1.0, 0.0, 0.0];
    let rows: [[f64; 6]; 12] = std::array::from_fn(|j| std::array::from_fn(|i| stand[j] + lift(j) * shape[i]));
    let gait = Gait {
        robot: robot.name.clone(),
        name: "gait1".into(),
        joint_names: robot.joint_names(),
        step_duration_s: 0.404,
        step_length_m: 0.0,
        coefficients_rad: rows,
        mirror: Mirror { leg: [2, 3, 0, 1], sign: [-1.0, 1.0, 1.0] },
        initial: InitialState {
            base_position_m: [0.0, 0.0, 0.58],
            base_quaternion_xyzw: [0.0, 0.0, 0.0, 1.0],
            base_linear_velocity_world: [0.0; 3],
            base_angular_velocity_body: [0.0; 3],
            joint_position_rad: stand,
            joint_velocity_rad_s: [0.0; 12],
        },
        reference_coefficients_rad: rows.map(|row| row.map(|c| c + 0.01)),
        gains: Gains {
            kp: std::array::from_fn(|j| robot.gains.kp_nm_per_rad[j % 3]),
            kd: std::array::from_fn(|j| robot.gains.kd_nm_s_per_rad[j % 3]),
        },
        torque_limit_nm: [50.0; 12],
        ..Gait::from_json(include_str!("../../../tests/gaits/amble.json")).unwrap()
    };
    gait.validate().unwrap();
    gait
}

/// Records a whole day: arm, stand, walk, with joints that follow their commands noisily, repeated and late states.
fn record(folder: &Path, seconds: u64) -> u64 {
    record_from(folder, seconds, 1, &gait(&robot()))
}

/// The same, recorded from a later cycle on.
fn record_from(folder: &Path, seconds: u64, first: u64, gait: &Gait) -> u64 {
    let robot = robot();
    let config = Config::for_robot(&robot);
    let prepared = PreparedGait::new(gait, &config).unwrap();
    let mut controller = Controller::new(config.clone()).unwrap();
    let info = RunInfo {
        config: &config,
        robot_description: &robot.urdf,
        leg_names: ["front_left", "rear_left", "front_right", "rear_right"],
        epoch_ns: 1_700_000_000_000_000_000,
    };
    let start = || {
        let options = RecorderOptions { queue_messages: 1 << 20, queue_bytes: 1 << 30, ..Default::default() };
        RunRecorder::start(folder, &info, options).unwrap()
    };
    let mut run = None;
    let mut noise = 7_u64;
    let mut random = move || {
        noise = noise.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (noise >> 11) as f64 / (1_u64 << 53) as f64 - 0.5
    };
    let mut state = JointState {
        stamp: Duration::ZERO,
        arrived: [Duration::ZERO; 12],
        position_rad: robot.sit_rad(),
        velocity_rad_s: [0.0; 12],
        temperature_c: None,
        drive_error: [0; 12],
    };
    let (mut held, mut modes) = (None, Vec::new());
    for cycle in 1..=seconds * 1000 {
        let jitter_ns = (random() * 40_000.0) as i64 + 20_000;
        let now = Duration::from_millis(cycle) + Duration::from_nanos(jitter_ns as u64);
        // Every 50th state comes late, so that the same one is seen twice.
        if !cycle.is_multiple_of(50) {
            state.stamp = Duration::from_millis(cycle);
            state.arrived = [now; 12];
        }
        let requests: &[Request] = match cycle {
            10 => &[Request::Arm],
            20 => &[Request::Stand],
            30 => &[Request::Walk],
            _ => &[],
        };
        let loaded = (cycle == 5).then_some(&prepared);
        if loaded.is_some() {
            run.iter_mut().for_each(|run: &mut RunRecorder| assert!(run.gait(gait).unwrap()));
        }
        let inertial = inertial(cycle, now, &mut held, &mut random);
        let input = Input { joints: Some(&state), inertial, requests, gait: loaded, ..Input::default() };
        if cycle == first {
            let mut started = start();
            if first > 5 {
                started.gait(gait).unwrap();
            }
            if first > 1 {
                started.snapshot(&controller.snapshot()).unwrap();
            }
            run = Some(started);
        }
        let output = controller.step(&input, now);
        let Some(run) = &mut run else {
            follow(&mut state, &output, &mut random);
            continue;
        };
        assert!(run.cycle(now, &input, &output, Some(&output.torque_nm)).unwrap());
        if cycle % 10 == 0 {
            let body = BodySample {
                time: now,
                position_m: [0.0, 0.0, 0.58],
                quaternion_xyzw: [0.0, 0.0, 0.0, 1.0],
                linear_velocity_body: [0.1, 0.0, 0.0],
                angular_velocity_body: [0.0; 3],
                ground_force_n: Some([[0.0, 0.0, 93.0]; 4]),
            };
            assert!(run.body(&body).unwrap());
        }
        if modes.last() != Some(&output.mode.name()) {
            modes.push(output.mode.name());
        }
        if cycle % 500 == 0 {
            std::thread::sleep(Duration::from_millis(1)); // lets the writer catch up
        }
        follow(&mut state, &output, &mut random);
    }
    let reached = if seconds >= 8 { "walking" } else { "standing_up" };
    assert!(modes.contains(&reached), "{modes:?}");
    let run = run.unwrap();
    assert_eq!(run.status().fault, None);
    let summary = run.finish().unwrap();
    assert_eq!(summary.dropped(), 0);
    summary.bytes
}

/// A unit at a fifth of the cycles' rate, silent for a while.
fn inertial(
    cycle: u64,
    now: Duration,
    held: &mut Option<InertialState>,
    random: &mut impl FnMut() -> f64,
) -> Option<InertialState> {
    if held.is_none() || cycle.is_multiple_of(5) {
        *held = Some(inertial_message(cycle, now, random));
    }
    held.filter(|_| !(300..340).contains(&cycle))
}

/// Every third message is of a unit that measures no acceleration.
fn inertial_message(cycle: u64, now: Duration, random: &mut impl FnMut() -> f64) -> InertialState {
    let tilt = Tilt { roll_rad: 0.01 * random(), pitch_rad: 0.01 * random() };
    InertialState {
        stamp: now + Duration::from_secs(1_700_000_000),
        angular_velocity_rad_s: Some([0.01 * random(), 0.0, 0.0]),
        acceleration_m_s2: (!cycle.is_multiple_of(3)).then_some([0.0, 0.1 * random(), 9.81]),
        ..InertialState::tilted(tilt, now)
    }
    .to_resolution()
}

fn follow(state: &mut JointState, output: &control::Output, random: &mut impl FnMut() -> f64) {
    if output.drives_on && output.command.kp[0] > 0.0 {
        for j in 0..12 {
            let before = state.position_rad[j];
            state.position_rad[j] += 0.3 * (output.command.position_rad[j] - before) + 1e-4 * random();
            state.velocity_rad_s[j] = (state.position_rad[j] - before) / 0.001;
        }
        *state = state.to_resolution();
    }
}

#[test]
fn a_recording_that_begins_in_the_middle_runs_again_to_the_bit() {
    let folder = tempfile::tempdir().unwrap();
    // Before the gait, while standing up, while walking.
    for (number, first) in [3, 1000, 7777].into_iter().enumerate() {
        let bag = folder.path().join(number.to_string());
        record_from(&bag, 9, first, &gait(&robot()));
        let verification = verify(&bag).unwrap();
        assert_eq!((verification.cycles, verification.different), (9001 - first, 0), "{:?}", verification.first);
        // Without the controller's memory it is refused.
        let bare = folder.path().join(format!("bare{number}"));
        copy(&bag, &bare, |topic, _, _| topic != "/controller_snapshot");
        let error = verify(&bare).unwrap_err().to_string();
        assert!(error.contains("does not begin with the controller's first cycle"), "{error}");
    }
}

/// Recorded from before the gait came, and from while it is walked.
fn assert_runs_again_to_the_bit(gait: &gait::Gait) {
    let folder = tempfile::tempdir().unwrap();
    for (number, first) in [3, 7777].into_iter().enumerate() {
        let bag = folder.path().join(number.to_string());
        record_from(&bag, 9, first, gait);
        let verification = verify(&bag).unwrap();
        assert_eq!((verification.cycles, verification.different), (9001 - first, 0), "{:?}", verification.first);
    }
}

#[test]
fn a_recording_of_a_walk_with_a_lead_runs_again_to_the_bit() {
    let mut gait = gait(&robot());
    gait.lead = gait.schedule().into_iter().map(|step| gait::Domain { duration_s: 0.3, ..step }).collect();
    assert_runs_again_to_the_bit(&gait);
}

#[test]
fn a_recording_of_a_walk_over_a_cycle_of_domains_runs_again_to_the_bit() {
    let trot = gait(&robot());
    let shares = [1.1, 0.9, 0.95, 1.05];
    let steps = trot.schedule().into_iter().cycle().zip(shares);
    let cycle = steps.map(|(step, share)| gait::Domain { duration_s: share * trot.step_duration_s, ..step }).collect();
    let gait = gait::Gait { cycle, ..trot };
    assert_runs_again_to_the_bit(&gait);
}

#[test]
fn a_recorded_minute_runs_again_to_the_bit() {
    let folder = tempfile::tempdir().unwrap();
    let bytes = record(&folder.path().join("run"), 60);
    let begun = Instant::now();
    let verification = verify(folder.path().join("run")).unwrap();
    // How long depends on who else uses the machine, so nothing fails by it.
    println!("60 s verified in {:.2} s; {:.1} MB", begun.elapsed().as_secs_f64(), bytes as f64 / 1e6);
    assert!(bytes < 15_000_000, "{bytes} bytes");
    assert_eq!((verification.cycles, verification.different), (60_000, 0), "{:?}", verification.first);
    assert!((verification.duration_s - 60.0).abs() < 0.1);
}

/// Copies a bag message by message, with a change to those that the closure picks.
fn copy(from: &Path, to: &Path, mut change: impl FnMut(&str, u64, &mut Vec<u8>) -> bool) {
    let bag = Bag::open(from).unwrap();
    let options = RecorderOptions { queue_messages: 1 << 20, queue_bytes: 1 << 30, ..RecorderOptions::default() };
    let recorder = Recorder::start(to, options).unwrap();
    let topics: Vec<_> = bag
        .topics()
        .iter()
        .map(|topic| {
            let definition = topic.definition.as_deref().unwrap();
            recorder
                .topic_with_definition(
                    &topic.name,
                    &topic.type_name,
                    definition,
                    topic.qos.unwrap_or(Qos::reliable(10)),
                )
                .unwrap()
        })
        .collect();
    let mut numbers = vec![0; topics.len()];
    for message in bag.messages().unwrap() {
        let mut message = message.unwrap();
        numbers[message.topic] += 1;
        if change(&bag.topics()[message.topic].name, numbers[message.topic], &mut message.data) {
            assert!(recorder.push(&topics[message.topic], message.stamp_ns, message.data));
        }
    }
    recorder.finish().unwrap();
}

#[test]
fn one_flipped_bit_is_found_and_named() {
    let folder = tempfile::tempdir().unwrap();
    let (whole, flipped) = (folder.path().join("whole"), folder.path().join("flipped"));
    record(&whole, 4);
    copy(&whole, &flipped, |topic, number, data| {
        if topic == "/joint_command" && number == 3210 {
            let mut command: tandem_msgs::JointCommand = from_cdr("JointCommand", data).unwrap();
            command.torque[8] = f64::from_bits(command.torque[8].to_bits() ^ 1);
            *data = to_cdr("JointCommand", &command).unwrap();
        }
        true
    });
    assert_eq!(verify(&whole).unwrap().different, 0);
    let verification = verify(&flipped).unwrap();
    assert_eq!((verification.cycles, verification.different), (4000, 1));
    let first = verification.first.unwrap();
    assert_eq!((first.cycle, first.joint.as_str(), first.what), (3210, "front_right_knee", "torque"));
    // Since the bag's first message, which is stamped as the first cycle is: at 1 ms, and up to 40 µs more as every
    // one.
    assert!((first.time_s - 3.209).abs() < 1e-4, "{}", first.time_s);
    assert_ne!(first.recorded, first.computed);
}

#[test]
fn a_bag_with_a_hole_is_never_called_verified() {
    let folder = tempfile::tempdir().unwrap();
    let whole = folder.path().join("whole");
    record(&whole, 2);
    for (topic, words) in [
        ("/control_cycle", "the recorder dropped what lies between"),
        ("/joint_command", "expected 1"),
        ("/joint_states", "the recorder dropped some"),
    ] {
        let holed = folder.path().join(topic.trim_start_matches('/'));
        copy(&whole, &holed, |name, number, _| name != topic || number != 777);
        let error = verify(&holed).unwrap_err();
        assert!(matches!(error, ReplayError::BadMessage { .. }) && error.to_string().contains(words), "{error}");
    }
    let headless = folder.path().join("headless");
    copy(&whole, &headless, |name, number, _| !matches!(name, "/control_cycle" | "/joint_command") || number > 100);
    assert!(verify(&headless).unwrap_err().to_string().contains("does not begin with the controller's first cycle"));
    let bare = folder.path().join("bare");
    copy(&whole, &bare, |name, _, _| name != "/controller_config");
    assert!(verify(&bare).unwrap_err().to_string().contains("no message on 'controller_config'"));
}

#[test]
fn a_gait_of_another_version_or_robot_is_one_clear_error() {
    let folder = tempfile::tempdir().unwrap();
    let whole = folder.path().join("whole");
    record(&whole, 1);
    for (from, to, words) in [
        ("\"version\": 1", "\"version\": 9", "version is 9, expected 1"),
        ("\"robot\": \"vision60\"", "\"robot\": \"spot\"", "planned for robot \"spot\""),
    ] {
        let other = folder.path().join(to.replace(['"', ' ', ':'], ""));
        copy(&whole, &other, |topic, _, data| {
            if topic == "/gait_file" {
                let mut text: tandem_msgs::std_msgs::String = from_cdr("String", data).unwrap();
                let value: serde_json::Value = serde_json::from_str(&text.data).unwrap();
                text.data =
                    serde_json::to_string(&value).unwrap().replace(&from.replace(": ", ":"), &to.replace(": ", ":"));
                *data = to_cdr("String", &text).unwrap();
            }
            true
        });
        let error = verify(&other).unwrap_err().to_string();
        assert!(error.contains(words), "{error}");
    }
}

#[test]
fn a_run_is_read_for_a_report() {
    let folder = tempfile::tempdir().unwrap();
    record(&folder.path().join("run"), 8);
    let run = read_run(folder.path().join("run")).unwrap();
    assert!(run.has_body && run.has_ground && run.has_torque);
    assert_eq!(run.gait.as_ref().map(|gait| gait.name.as_str()), Some("gait1"));
    assert_eq!(run.samples.len(), 8000 - 8 * 20, "one sample for each new state");
    assert!(run.walking_from_s > 0.5 && run.walking_from_s < 7.0, "{}", run.walking_from_s);
    // To the steps in which it is recorded.
    assert!((run.samples[4000].base_linear_velocity_m_s[0] - 0.1).abs() <= 0.5 / 16_384.0);
    assert_eq!(run.samples[4000].ground_force_n, [93.0; 4]);
    let events: Vec<&str> = run.events.iter().map(|(_, event)| event.as_str()).collect();
    for expected in ["gait gait1", "asked to arm", "asked to walk", "standing up", "walking"] {
        assert!(events.contains(&expected), "{expected} in {events:?}");
    }
    // What was asked for stands before what it led to, in one cycle too.
    let place = |wanted| events.iter().position(|event| *event == wanted);
    assert!(place("asked to arm") < place("damping"), "{events:?}");
    assert_eq!((run.cycle_intervals_s.len(), run.missing_cycles), (7999, 0));
    assert!(run.robot_description.is_some_and(|urdf| urdf.contains("<robot")));
}

#[test]
fn a_bag_without_a_run_is_one_clear_error() {
    let folder = tempfile::tempdir().unwrap();
    let recorder = Recorder::start(folder.path().join("b"), RecorderOptions::default()).unwrap();
    let topic = recorder.topic("/chatter", "std_msgs/msg/Bool", Qos::reliable(1)).unwrap();
    recorder.push(&topic, 1, [0, 1, 0, 0, 1]);
    recorder.finish().unwrap();
    assert!(verify(folder.path().join("b")).unwrap_err().to_string().contains("no message on 'control_cycle'"));
    assert!(read_run(folder.path().join("b")).unwrap_err().to_string().contains("no joint state of twelve joints"));
}
