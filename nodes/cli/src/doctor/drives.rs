//! What the drives say when they are asked, at rest, where they are.

use super::{Finding, failure, good, warning};
use control::{Config, JOINTS, JointCommand};
use joint_bus::{BusConfig, JointBus, Readings};
use std::time::Duration;

/// How many cycles are listened to before anything is sent.
const LISTENED: u32 = 300;
/// A joint at rest does not seem to move by more than this, rad.
const STILL_RAD: f64 = 0.02;
/// Nor faster than this, rad/s.
const STILL_RAD_S: f64 = 0.5;
/// A measured position this far outside its limits is no longer within the mechanical stops, rad.
const BEYOND_STOPS_RAD: f64 = 0.1;
/// A healthy drive answers at least this share of questions.
const ANSWERED: f64 = 0.99;

/// What was seen of the drives.
pub struct Seen {
    /// Frames that were on the buses before anything was sent.
    foreign_frames: u64,
    /// Questions put to each drive.
    asked: u32,
    answered: [u32; JOINTS],
    lowest_rad: [f64; JOINTS],
    highest_rad: [f64; JOINTS],
    fastest_rad_s: [f64; JOINTS],
    last: Readings,
    bus_errors: u64,
    queue_full: u64,
}

/// Listens first; then asks every drive, at rest, where it is, once a cycle. `wait` waits for the next cycle and says
/// when it is.
pub fn ask(bus: &mut dyn JointBus, cycles: u32, wait: &mut dyn FnMut() -> Duration) -> Seen {
    let mut seen = Seen {
        foreign_frames: 0,
        asked: 0,
        answered: [0; JOINTS],
        lowest_rad: [f64::INFINITY; JOINTS],
        highest_rad: [f64::NEG_INFINITY; JOINTS],
        fastest_rad_s: [0.0; JOINTS],
        last: Readings::default(),
        bus_errors: 0,
        queue_full: 0,
    };
    let frames = |bus: &dyn JointBus| {
        let health = bus.health();
        health.links[..health.count].iter().map(|link| link.received + link.foreign).sum::<u64>()
    };
    for _ in 0..LISTENED {
        bus.read(wait(), &mut seen.last);
    }
    seen.foreign_frames = frames(bus);
    if seen.foreign_frames > 0 {
        // Somebody's robot may be standing: a frame sent here would make it fall.
        return seen;
    }
    // The answer to one cycle's question is there in the next.
    for cycle in 0..=cycles {
        let now = wait();
        let before = seen.last.arrived;
        bus.read(now, &mut seen.last);
        for j in 0..JOINTS {
            if seen.last.arrived[j] == before[j] {
                continue;
            }
            let (q, v) = (seen.last.position_rad[j], seen.last.velocity_rad_s[j]);
            seen.answered[j] += 1;
            seen.lowest_rad[j] = seen.lowest_rad[j].min(q);
            seen.highest_rad[j] = seen.highest_rad[j].max(q);
            seen.fastest_rad_s[j] = seen.fastest_rad_s[j].max(v.abs());
        }
        if cycle < cycles {
            bus.write(&JointCommand::LIMP, false, now);
            seen.asked += 1;
        }
    }
    let health = bus.health();
    seen.bus_errors = health.links[..health.count].iter().map(|link| link.bus_errors + link.breaks).sum();
    seen.queue_full = health.links[..health.count].iter().map(|link| link.full).sum();
    seen
}

/// What follows from it.
pub fn findings(seen: &Seen, bus: &BusConfig, config: &Config) -> Vec<Finding> {
    if seen.foreign_frames > 0 {
        return vec![failure(
            format!(
                "another program sends on the buses ({} frames in {} ms): the drives were not asked",
                seen.foreign_frames, LISTENED
            ),
            "stop the controller first (it must be disarmed, the robot sitting or hung up), then look again",
        )];
    }
    let mut found = Vec::new();
    if seen.bus_errors > 0 {
        found.push(failure(
            format!("{} errors on the buses while the drives were asked", seen.bus_errors),
            "ip -details -statistics link show; look at the wiring, at 120 ohms at both ends and at the bit rates",
        ));
    }
    if seen.queue_full > 0 {
        found.push(failure(
            format!("{} frames found the queue to the bus full", seen.queue_full),
            "frames do not leave: is any drive powered? Do bit rates agree? Else txqueuelen 64",
        ));
    }
    let before = found.len();
    for j in 0..JOINTS {
        found.extend(joint(seen, j, bus, config));
    }
    if found.len() == before {
        let hottest = seen.last.temperature_c.map_or("they report no temperature".into(), |t| {
            format!("the hottest has {:.0} °C", t.into_iter().fold(f64::MIN, f64::max))
        });
        found.push(good(format!(
            "twelve drives answer, without errors, at rest and within their joints' limits; {hottest}"
        )));
    }
    found
}

fn joint(seen: &Seen, j: usize, bus: &BusConfig, config: &Config) -> Vec<Finding> {
    let wiring = &bus.joints[j];
    let interface = &bus.interfaces[wiring.interface];
    let name = format!("{} (drive {} on {interface})", wiring.name, wiring.id);
    let (asked, answered) = (seen.asked, seen.answered[j]);
    if answered == 0 {
        return vec![failure(
            format!("{name} does not answer"),
            format!(
                "is it powered, is its number {}, its bit rate that of {interface}, its reply's identifier {}? Is the wiring file \
                 right? `candump {interface}` shows what is there",
                wiring.id, bus.host_id
            ),
        )];
    }
    let mut found = Vec::new();
    if f64::from(answered) < ANSWERED * f64::from(asked) {
        found.push(failure(
            format!("{name} answered {answered} of {asked} questions"),
            "look at its connector, at 120 ohms at both ends of the bus, and whether two drives have one number",
        ));
    }
    let q = seen.last.position_rad[j];
    if !(q.is_finite() && seen.fastest_rad_s[j].is_finite()) {
        found.push(failure(format!("{name} reports {q} rad"), "replace the encoder or its cable"));
        return found;
    }
    let spread = seen.highest_rad[j] - seen.lowest_rad[j];
    if spread > STILL_RAD || seen.fastest_rad_s[j] > STILL_RAD_S {
        found.push(failure(
            format!("{name} moves at rest: by {spread:.3} rad, at up to {:.2} rad/s", seen.fastest_rad_s[j]),
            "hold the robot still and look again; if it stays, the encoder or its cable is bad",
        ));
    }
    let (low, high) = (config.position_min_rad[j], config.position_max_rad[j]);
    let outside = (low - q).max(q - high);
    if outside > BEYOND_STOPS_RAD {
        let what = format!("{name} stands at {q:.3} rad, the joint goes from {low:.2} to {high:.2}");
        let cure = "set zero_rad and sign as docs/hardware.md says (calibration), or the drive's own zero";
        // Beyond this the controller would not believe it either; up to it a joint may be pressed into its stop.
        found.push(if outside > config.position_fault_rad { failure(what, cure) } else { warning(what, cure) });
    }
    let error = seen.last.drive_error[j];
    if error != 0 {
        found.push(failure(
            format!("{name} reports error {error}"),
            "look it up in the drive's manual; switch the drive off and on",
        ));
    }
    if let Some(t) = seen.last.temperature_c.map(|t| t[j]) {
        if !(-40.0..=150.0).contains(&t) {
            found.push(failure(format!("{name} reports {t:.0} °C"), "its thermometer is broken: replace the drive"));
        } else if t > config.hot_c {
            found.push(failure(
                format!("{name} has {t:.0} °C, more than {:.0}", config.hot_c),
                "let it cool, find out why",
            ));
        } else if t > config.hot_c - 20.0 {
            found.push(warning(
                format!("{name} has {t:.0} °C"),
                "it will not be long before it stops the walk: let it cool",
            ));
        }
    }
    found
}

#[cfg(test)]
pub mod tests {
    use super::super::Verdict;
    use super::*;
    use joint_bus::memory::{MemoryLink, pair};
    use joint_bus::{DriveBus, DriveModel, Faults, Faulty, Link};
    use robot::Robot;
    use simulator::drives::{DriveBench, DriveProtocol};
    use std::path::Path;

    fn vision60() -> Robot {
        Robot::load(&Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config/robots/vision60")).unwrap()
    }

    pub fn wiring(protocol: &str) -> BusConfig {
        let text = include_str!("../../../../config/hardware/vision60_can.toml");
        let text = text.replacen("protocol = \"mit\"", &format!("protocol = \"{protocol}\""), 1);
        let wiring = BusConfig::from_toml_str(&text, "vision60", &vision60().joint_names()).unwrap();
        BusConfig { ask_before_arming: true, ..wiring }
    }

    /// Asks emulated drives that sit, changed by `change`; `q` is where the joints are in cycle n.
    fn examine(
        model: DriveModel,
        change: impl Fn(&mut DriveBus<DriveProtocol, Faulty<MemoryLink>>),
        q: impl Fn(u32, &mut [f64; JOINTS]),
    ) -> Vec<Finding> {
        let (robot, bus) = (vision60(), wiring("mit"));
        let (near, far): (Vec<_>, Vec<Box<dyn Link + Send>>) = (0..4)
            .map(|n| {
                let (near, far) = pair();
                (Faulty::new(near, n), Box::new(far) as Box<dyn Link + Send>)
            })
            .unzip();
        let mut drives = DriveBus::new(bus.clone(), DriveProtocol::of(&bus), near);
        change(&mut drives);
        let mut bench = DriveBench::new(bus.clone(), model, far);
        let mut n = 0;
        let mut wait = || {
            n += 1;
            let now = Duration::from_millis(n.into());
            let mut position = robot.sit_rad();
            q(n, &mut position);
            bench.answer(now, &position, &[0.0; JOINTS]);
            now
        };
        let seen = ask(&mut drives, 500, &mut wait);
        findings(&seen, &bus, &Config::for_robot(&robot))
    }

    fn sits(_: u32, _: &mut [f64; JOINTS]) {}

    #[test]
    fn a_healthy_robot_is_healthy() {
        let found = examine(DriveModel::default(), |_| {}, sits);
        assert_eq!(found.len(), 1, "{found:?}");
        assert_eq!(found[0].verdict, Verdict::Good);
        assert!(found[0].what.contains("twelve drives") && found[0].what.contains("25 °C"), "{found:?}");
    }

    #[test]
    fn each_thing_wrong_with_a_drive_is_named_with_its_cure() {
        let only = |found: Vec<Finding>, what: &str, cure: &str| {
            assert_eq!(found.len(), 1, "{found:?}");
            assert_eq!(found[0].verdict, Verdict::Failure);
            assert!(found[0].what.contains(what) && found[0].cure.contains(cure), "{found:?}");
        };
        let silent = |drives: &mut DriveBus<DriveProtocol, Faulty<MemoryLink>>| {
            drives.link_mut(2).faults = Faults { silence: Some(3), ..Faults::default() };
        };
        only(
            examine(DriveModel::default(), silent, sits),
            "front_right_knee (drive 3 on can2) does not answer",
            "candump can2",
        );
        let far = |_: u32, q: &mut [f64; JOINTS]| q[5] += 3.0;
        only(examine(DriveModel::default(), |_| {}, far), "rear_left_knee (drive 3 on can1) stands at", "zero_rad");
        let pressed = examine(DriveModel::default(), |_| {}, |_, q| q[5] = 0.07);
        assert!(pressed.len() == 1 && pressed[0].verdict == Verdict::Warning, "{pressed:?}");
        assert!(pressed[0].what.contains("rear_left_knee (drive 3 on can1) stands at 0.07"), "{pressed:?}");
        let jumpy = |n: u32, q: &mut [f64; JOINTS]| q[1] += if n.is_multiple_of(97) { 0.1 } else { 0.0 };
        only(examine(DriveModel::default(), |_| {}, jumpy), "front_left_hip_pitch (drive 2 on can0) moves", "encoder");

        let lossy = |drives: &mut DriveBus<DriveProtocol, Faulty<MemoryLink>>| {
            drives.link_mut(1).faults = Faults { lose: 0.2, ..Faults::default() };
        };
        let found = examine(DriveModel::default(), lossy, sits);
        assert_eq!(found.len(), 3, "{found:?}");
        assert!(found.iter().all(|f| f.what.contains("on can1) answered") && f.cure.contains("120 ohms")), "{found:?}");

        let hot = examine(DriveModel { ambient_c: 90.0, ..DriveModel::default() }, |_| {}, sits);
        assert_eq!(hot.len(), 12);
        assert!(hot.iter().all(|f| f.verdict == Verdict::Failure && f.what.contains("90 °C")), "{hot:?}");
        let warm = examine(DriveModel { ambient_c: 70.0, ..DriveModel::default() }, |_| {}, sits);
        assert!(warm.iter().all(|f| f.verdict == Verdict::Warning && f.what.contains("70 °C")), "{warm:?}");
        let burnt = examine(DriveModel { ambient_c: 120.0, ..DriveModel::default() }, |_| {}, sits);
        assert!(burnt.iter().any(|f| f.what.contains("reports error 2")), "{burnt:?}");

        let full = |drives: &mut DriveBus<DriveProtocol, Faulty<MemoryLink>>| {
            drives.link_mut(3).faults = Faults { full: true, ..Faults::default() };
        };
        let found = examine(DriveModel::default(), full, sits);
        assert!(found[0].what.contains("queue to the bus full"), "{found:?}");
        let down = |drives: &mut DriveBus<DriveProtocol, Faulty<MemoryLink>>| {
            drives.link_mut(0).faults = Faults { down: true, ..Faults::default() };
        };
        let found = examine(DriveModel::default(), down, sits);
        assert!(found[0].what.contains("errors on the buses"), "{found:?}");
    }

    /// Drives of a robot that may be standing are not spoken to: the first word would be "rest".
    #[test]
    fn where_a_controller_sends_the_doctor_sends_nothing() {
        let (robot, bus) = (vision60(), wiring("mit"));
        let (near, mut far): (Vec<_>, Vec<_>) = (0..4).map(|_| pair()).unzip();
        let mut drives = DriveBus::new(bus.clone(), DriveProtocol::of(&bus), near);
        // A request of another program, as a CAN socket sees it.
        let frame = joint_bus::Protocol::encode_request(
            &DriveProtocol::of(&bus),
            2,
            &bus.joints[0].ranges,
            &joint_bus::DriveRequest::Command(joint_bus::DriveCommand::default()),
        )
        .unwrap();
        far[1].send(&frame, Duration::ZERO).unwrap();
        let mut n = 0;
        let seen = ask(&mut drives, 500, &mut || {
            n += 1;
            Duration::from_millis(n)
        });
        let found = findings(&seen, &bus, &Config::for_robot(&robot));
        assert_eq!(found.len(), 1);
        assert!(
            found[0].what.contains("another program") && found[0].cure.contains("stop the controller"),
            "{found:?}"
        );
        for end in &mut far {
            assert!(end.receive(Duration::from_secs(1)).unwrap().is_none(), "it spoke");
        }
    }
}
