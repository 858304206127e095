//! Before anybody has armed the robot its drives are ordered nothing.

mod common;
#[path = "../../control/tests/common/mod.rs"]
mod walk;

use common::Bench;
use control::{Controller, Input, JOINTS, JointCommand, Mode, Output, Request};
use joint_bus::*;
use std::time::Duration;

const MS: Duration = Duration::from_millis(1);

/// A robot that sits, on drives that know no question.
struct Robot {
    bench: Bench<Mit>,
    controller: Controller,
    readings: Readings,
    now: Duration,
}

impl Robot {
    fn new() -> Self {
        let config = BusConfig { ask_before_arming: false, ..common::bus_config("mit", 1.0) };
        Self {
            bench: Bench::new(Mit::default(), config, 0.0, 0.0),
            controller: Controller::new(walk::config()).unwrap(),
            readings: Readings::default(),
            now: Duration::from_secs(1),
        }
    }

    fn cycle(&mut self, requests: &[Request]) -> Output {
        self.now += MS;
        self.bench.bus().read(self.now, &mut self.readings);
        let state = self.readings.joint_state();
        let fault = self.bench.bus().fault(self.now);
        let input = Input { joints: state.as_ref(), requests, fault, ..Input::default() };
        let output = self.controller.step(&input, self.now);
        self.bench.bus().write(&output.command, output.drives_on, self.now);
        self.bench.act(self.now, &walk::config().sit.position_rad, &[0.0; JOINTS], None);
        output
    }

    /// As the control cycle does when the next request is to arm.
    fn prepare_to_arm(&mut self) -> bool {
        self.bench.bus().prepare_to_arm(&self.readings, self.now)
    }
}

/// The frames that left for the drives so far.
fn sent<P: Protocol + Copy>(bench: &mut Bench<P>) -> u64 {
    bench.bus().health().links.iter().map(|link| link.sent).sum()
}

/// "Rest and say where you are" is an order: it would drop a robot that somebody holds whose frames have not arrived.
#[test]
fn a_controller_that_was_never_armed_sends_nothing_to_drives_without_a_query() {
    let mut robot = Robot::new();
    for _ in 0..1000 {
        robot.cycle(&[]);
    }
    assert_eq!(sent(&mut robot.bench), 0);
    let mut waited = 0;
    while !robot.prepare_to_arm() {
        robot.cycle(&[]);
        waited += 1;
    }
    assert!((1..=4).contains(&waited), "{waited}");
    assert_eq!(robot.cycle(&[Request::Arm]).replies[0], Some(Ok(Mode::Damping)));
    robot.cycle(&[Request::Disarm]);
    let before = sent(&mut robot.bench);
    robot.cycle(&[]);
    assert_eq!(sent(&mut robot.bench), before + 12, "what it has armed it asks");
}

#[test]
fn drives_that_do_not_answer_refuse_the_arming_and_are_left_alone_again() {
    let mut robot = Robot::new();
    robot.cycle(&[]);
    for n in 0..robot.bench.config.interfaces.len() {
        robot.bench.faults(n).lose = 1.0;
    }
    let mut waited = 0;
    while !robot.prepare_to_arm() {
        robot.cycle(&[]);
        waited += 1;
    }
    assert!((90..=110).contains(&waited), "{waited}");
    assert!(robot.cycle(&[Request::Arm]).replies[0].unwrap().is_err());
    for _ in 0..1000 {
        robot.cycle(&[]);
    }
    let before = sent(&mut robot.bench);
    robot.cycle(&[]);
    assert_eq!(sent(&mut robot.bench), before);
}

#[test]
fn register_drives_are_asked_without_an_order_until_someone_arms() {
    let config = common::bus_config("registers", 1.0);
    let protocol = Registers { host_id: 0 };
    let (near, mut far): (Vec<_>, Vec<_>) = (0..4).map(|_| memory::pair()).unzip();
    let mut bus = DriveBus::new(BusConfig { ask_before_arming: false, ..config.clone() }, protocol, near);
    for on in [false, true] {
        bus.write(&JointCommand::LIMP, on, MS);
        let mut frames = 0;
        for (n, link) in far.iter_mut().enumerate() {
            while let Some(Incoming::Frame(frame, _)) = link.receive(MS).unwrap() {
                let joint = config.joints.iter().find(|j| {
                    j.interface == n && protocol.decode_request(j.id, &j.ranges, &frame) == Some(DriveRequest::Query)
                });
                assert_eq!(joint.is_some(), !on);
                frames += 1;
            }
        }
        assert_eq!(frames, JOINTS);
    }
}
