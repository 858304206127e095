//! The inertial unit behind its frames, and the balanced walk on what comes through them.

#[path = "../../control/tests/common/balanced.rs"]
#[allow(dead_code)]
mod balanced;
mod common;

use balanced::{Bench, PERIOD};
use control::{Fault, InertialState, Mode};
use joint_bus::memory::{MemoryLink, pair};
use joint_bus::{
    BusConfig, CanInertialUnit, DriveBus, DriveProtocol, EmulatedInertialUnit, Frame, Incoming, InertialFrames,
    InertialUnit, JointBus, Link, LinkError, Readings,
};
use std::time::Duration;

const MS: Duration = Duration::from_millis(1);
const FRAMES: InertialFrames = InertialFrames { id: 0x100_0000 };

fn measured(stamp: Duration) -> InertialState {
    InertialState {
        stamp,
        arrived: stamp,
        attitude_xyzw: Some([0.2, -0.4, 0.1, -0.888_819_441_731_558_9]),
        angular_velocity_rad_s: Some([0.5, -34.9, 0.001]),
        acceleration_m_s2: Some([-1.0, 159.0, 9.81]),
    }
}

/// Both ends.
fn unit() -> (CanInertialUnit<MemoryLink>, EmulatedInertialUnit) {
    let (near, far) = pair();
    (CanInertialUnit::new(FRAMES, near), EmulatedInertialUnit::new(FRAMES, far))
}

fn assert_near(got: Option<[f64; 3]>, sent: [f64; 3], within: f64) {
    let got = got.unwrap();
    assert!((0..3).all(|axis| (got[axis] - sent[axis]).abs() <= within), "{got:?} for {sent:?}");
}

#[test]
fn what_is_measured_comes_through_with_its_time() {
    let (mut near, mut far) = unit();
    let mut first = None;
    // Longer than the frames' time takes to begin anew.
    for n in 0..2000 {
        let (sent, now) = (measured(n * 5 * MS), n * 5 * MS + 2 * MS);
        far.send(&sent);
        let got = near.read(now).unwrap();
        assert_eq!(near.read(now), None);
        assert_near(got.angular_velocity_rad_s, sent.angular_velocity_rad_s.unwrap(), 0.6e-3);
        assert_near(got.acceleration_m_s2, sent.acceleration_m_s2.unwrap(), 2.5e-3);
        // The same rotation with a w that is not negative.
        let [x, y, z, w] = got.attitude_xyzw.unwrap();
        assert_near(Some([x, y, z]), [-0.2, 0.4, -0.1], 2e-5);
        assert!((w - 0.8888).abs() < 1e-4);
        let first = first.get_or_insert(got.stamp);
        assert_eq!((got.stamp - *first, got.arrived), (sent.stamp, now));
    }
}

/// Of two measurements of which parts were lost none is made.
#[test]
fn parts_of_two_measurements_are_never_taken_for_one() {
    let (near, mut far) = pair();
    let mut near = CanInertialUnit::new(FRAMES, near);
    let (first, second) = (FRAMES.encode(&measured(5 * MS)), FRAMES.encode(&measured(10 * MS)));
    for frame in [&first[0], &first[1], &second[2], &second[1], &second[1]] {
        far.send(frame, 10 * MS).unwrap();
        assert_eq!(near.read(10 * MS), None);
    }
    // The unit's time comes again, and the rest of a measurement with it.
    far.send(&second[0], 6600 * MS).unwrap();
    assert_eq!(near.read(6600 * MS), None);
    for frame in second {
        far.send(&frame, 6601 * MS).unwrap();
    }
    assert!(near.read(6601 * MS).is_some());
}

#[test]
fn what_the_unit_cannot_measure_is_not_a_number() {
    let (mut near, mut far) = unit();
    let state = InertialState { angular_velocity_rad_s: None, attitude_xyzw: None, ..measured(MS) };
    far.send(&state);
    let got = near.read(MS).unwrap();
    assert!(got.not_finite().is_some());
    assert!(got.angular_velocity_rad_s.unwrap().iter().all(|value| value.is_nan()));
    assert!(got.tilt().unwrap().roll_rad.is_nan());
    // Beyond its range it says the range's end.
    far.send(&InertialState { angular_velocity_rad_s: Some([1e9, -1e9, 0.0]), ..measured(2 * MS) });
    assert_near(near.read(2 * MS).unwrap().angular_velocity_rad_s, [35.0, -35.0, 0.0], 1e-9);
}

struct Broken(MemoryLink, bool);

impl Link for Broken {
    fn send(&mut self, frame: &Frame, now: Duration) -> Result<(), LinkError> {
        self.0.send(frame, now)
    }
    fn receive(&mut self, now: Duration) -> Result<Option<Incoming>, LinkError> {
        if !self.1 {
            return self.0.receive(now);
        }
        Err(LinkError::Down { interface: "can0".into(), source: std::io::Error::from_raw_os_error(100) })
    }
    fn reopen(&mut self) -> Result<(), LinkError> {
        self.1 = false;
        Ok(())
    }
}

#[test]
fn a_link_that_was_down_is_opened_again() {
    let (near, far) = pair();
    let mut near = CanInertialUnit::new(FRAMES, Broken(near, true));
    let mut far = EmulatedInertialUnit::new(FRAMES, far);
    far.send(&measured(MS));
    assert_eq!((near.read(MS), near.read(50 * MS)), (None, None));
    assert!(near.read(110 * MS).is_some());
}

/// The unit's frames are no drive's, whatever the drives speak, and nobody else's commands.
#[test]
fn on_a_drives_interface_the_units_frames_disturb_nobody() {
    for protocol in ["mit", "registers"] {
        let text =
            common::bus_text(protocol, 1.0).replace("[ranges]", "[inertial]\ninterface = 1\nid = 16777216\n[ranges]");
        let config = BusConfig::from_toml_str(&text, "vision60", &common::joint_names()).unwrap();
        let (near, mut far): (Vec<_>, Vec<_>) = (0..4).map(|_| pair()).unzip();
        let mut bus = DriveBus::new(config.clone(), DriveProtocol::of(&config), near);
        for frame in config.inertial.unwrap().frames.encode(&measured(MS)) {
            far[1].send(&frame, MS).unwrap();
            far[2].send(&frame, MS).unwrap();
        }
        bus.read(MS, &mut Readings::default());
        let links = bus.health().links;
        assert_eq!((links[1].foreign, links[1].commands_of_others), (0, 0));
        assert_eq!((links[2].foreign, links[2].commands_of_others), (3, 0));
        assert_eq!(bus.fault(MS), None);
    }
}

#[test]
fn wiring_that_cannot_be_is_refused_by_name() {
    for (table, key) in
        [("interface = 4\nid = 16777216", "inertial.interface"), ("interface = 0\nid = 6", "inertial.id")]
    {
        let text = common::bus_text("mit", 1.0).replace("[ranges]", &format!("[inertial]\n{table}\n[ranges]"));
        let error = BusConfig::from_toml_str(&text, "vision60", &common::joint_names()).unwrap_err().to_string();
        assert!(error.contains(key), "{error}");
    }
}

/// As a topic's: 20 ms until the data are stale, 50 ms of patience.
#[test]
fn a_unit_that_falls_silent_is_estimate_lost() {
    let (mut near, mut far) = unit();
    let mut bench = Bench::walking(balanced::config(true));
    bench.unit_sends = false;
    let level = InertialState {
        attitude_xyzw: Some([0.0, 0.0, 0.0, 1.0]),
        angular_velocity_rad_s: Some([0.0; 3]),
        acceleration_m_s2: Some([0.0, 0.0, 9.81]),
        ..measured(MS)
    };
    let mut cycle = |bench: &mut Bench, sends: bool| {
        let now = bench.now + PERIOD;
        if sends && now.as_millis().is_multiple_of(5) {
            far.send(&InertialState { stamp: now, ..level });
        }
        bench.unit = near.read(now).map(InertialState::to_resolution).or(bench.unit);
        bench.cycle(&[])
    };
    for _ in 0..1000 {
        assert_eq!(cycle(&mut bench, true).mode, Mode::Walking);
    }
    let cycles = (1..200).find(|_| cycle(&mut bench, false).mode == Mode::Fault).expect("it walks on");
    assert!(cycles <= 20 + 50 + 2, "{cycles} cycles");
    let faults: Vec<Fault> = bench.cycle(&[]).faults.iter().collect();
    assert_eq!(faults, [Fault::EstimateLost]);
}
