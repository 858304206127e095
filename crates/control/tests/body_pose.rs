//! The body's pose while standing: who is heeded, how fast it goes, and that it is undone before a walk.

mod common;

use common::balanced;
use control::{BodyPose, BodyPoseAnswer, Config, Controller, Input, JointState, Mode, Output, Request, Snapshot};
use std::time::Duration;

const LOW: BodyPose = BodyPose { height_m: -0.05, roll_rad: 0.08, pitch_rad: -0.1, yaw_rad: 0.08 };

/// A robot whose joints are always where they were commanded.
struct Bench {
    controller: Controller,
    position_rad: [f64; 12],
    now: Duration,
}

impl Bench {
    fn standing() -> Self {
        let config = Config { simulation_start: false, ..balanced::config(false) };
        let position_rad = config.stand.position_rad;
        let mut bench = Self { controller: Controller::new(config).unwrap(), position_rad, now: Duration::ZERO };
        bench.step(&[Request::Arm], None);
        bench.step(&[Request::Stand], None);
        bench.run(1.0);
        assert_eq!(bench.controller.mode(), Mode::Standing);
        bench
    }

    fn step(&mut self, requests: &[Request], body_pose: Option<BodyPose>) -> Output {
        self.now += Duration::from_millis(1);
        let joints = JointState {
            stamp: self.now,
            arrived: [self.now; 12],
            position_rad: self.position_rad,
            velocity_rad_s: [0.0; 12],
            temperature_c: None,
            drive_error: [0; 12],
        };
        let input = Input { joints: Some(&joints), requests, body_pose, ..Input::default() };
        let output = self.controller.step(&input, self.now);
        if output.mode.is_moving() {
            self.position_rad = output.command.position_rad;
        }
        output
    }

    fn run(&mut self, seconds: f64) -> Output {
        (0..(seconds * 1e3) as usize).map(|_| self.step(&[], None)).last().unwrap()
    }
}

#[test]
fn the_body_goes_where_it_is_asked_and_stays_there() {
    let mut bench = Bench::standing();
    let held = bench.run(0.1).command;
    assert_eq!(bench.step(&[], Some(LOW)).body_pose_answer, Some(BodyPoseAnswer::Taken));
    let arrived = bench.run(3.0);
    assert_eq!(arrived.body_pose, LOW);
    assert_ne!(arrived.command.position_rad, held.position_rad);
    // Nobody asks again: the robot does not move by itself.
    assert_eq!(bench.run(60.0).command, arrived.command);
    bench.step(&[], Some(BodyPose::default()));
    assert_eq!(bench.run(3.0).command, held, "to the bit the posture itself");
}

/// Position and velocity of the command agree, and no joint is faster than a posture's own motions.
#[test]
fn the_body_moves_without_a_jump_also_when_it_is_asked_for_something_else_on_the_way() {
    let mut bench = Bench::standing();
    let mut last = bench.step(&[], Some(LOW)).command;
    for n in 1..6000 {
        let up = BodyPose { height_m: 0.04, roll_rad: -0.2, pitch_rad: 0.2, yaw_rad: -0.3 };
        let output = bench.step(&[], (n == 300).then_some(up));
        for j in 0..12 {
            let moved = output.command.position_rad[j] - last.position_rad[j];
            let mean = 0.5 * (output.command.velocity_rad_s[j] + last.velocity_rad_s[j]);
            assert!((moved - 1e-3 * mean).abs() < 2e-5, "{n}, joint {j}: {moved} at {mean}");
            assert!(mean.abs() < 3.0, "{n}, joint {j}: {mean}");
        }
        last = output.command;
    }
}

#[test]
fn beyond_the_range_or_the_joints_it_goes_as_far_as_they_do() {
    let mut bench = Bench::standing();
    let far = BodyPose { height_m: -5.0, roll_rad: 2.0, pitch_rad: 2.0, yaw_rad: -2.0 };
    assert_eq!(bench.step(&[], Some(far)).body_pose_answer, Some(BodyPoseAnswer::Limited));
    let output = bench.run(4.0);
    let range = bench.controller.config().body_range;
    assert!(output.body_pose.height_m < 0.0 && output.body_pose.height_m >= range.height_m[0]);
    let Config { position_min_rad, position_max_rad, .. } = bench.controller.config();
    for j in 0..12 {
        let q = output.command.position_rad[j];
        assert!(q > position_min_rad[j] && q < position_max_rad[j], "joint {j}: {q}");
    }
    let nan = BodyPose { roll_rad: f64::NAN, ..LOW };
    assert_eq!(bench.step(&[], Some(nan)).body_pose_answer, Some(BodyPoseAnswer::NotFinite));
    assert_eq!(bench.run(1.0).body_pose, output.body_pose);
}

#[test]
fn only_a_robot_that_stands_heeds_a_pose() {
    let mut bench = Bench::standing();
    bench.step(&[Request::Sit], None);
    let output = bench.step(&[], Some(LOW));
    assert_eq!(output.body_pose_answer, Some(BodyPoseAnswer::NotStanding));
    assert_eq!(bench.run(1.0).body_pose, BodyPose::default());
    bench.run(5.0);
    assert_eq!(bench.controller.mode(), Mode::Disarmed);
    assert_eq!(bench.step(&[], Some(LOW)).body_pose_answer, Some(BodyPoseAnswer::NotStanding));
}

/// `stand` undoes it; sitting goes on from it, without a jump; damping forgets it.
#[test]
fn what_follows_a_pose_begins_where_the_body_is() {
    let mut bench = Bench::standing();
    bench.step(&[], Some(LOW));
    bench.run(3.0);
    bench.step(&[Request::Stand], None);
    assert_eq!(bench.run(3.0).body_pose, BodyPose::default());
    bench.step(&[], Some(LOW));
    let before = bench.run(3.0).command;
    let after = bench.step(&[Request::Sit], None).command;
    for j in 0..12 {
        assert!((after.position_rad[j] - before.position_rad[j]).abs() < 1e-3, "joint {j}");
    }
    bench.run(6.0);
    assert_eq!(bench.controller.mode(), Mode::Disarmed);
}

/// A recording that begins while the body moves is run again to the bit.
#[test]
fn a_controller_that_goes_on_from_a_snapshot_moves_the_body_the_same() {
    let mut bench = Bench::standing();
    bench.step(&[], Some(LOW));
    bench.run(0.4);
    let text = serde_json::to_string(&bench.controller.snapshot()).unwrap();
    let snapshot: Snapshot = serde_json::from_str(&text).unwrap();
    let controller = Controller::resume(bench.controller.config().clone(), &snapshot).unwrap();
    let mut again = Bench { controller, position_rad: bench.position_rad, now: bench.now };
    for _ in 0..3000 {
        assert_eq!(bench.step(&[], None).command, again.step(&[], None).command);
    }
}
