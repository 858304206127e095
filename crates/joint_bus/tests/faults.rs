//! The controller walking on emulated drives behind a bus that misbehaves, with a bound on the cycles until the robot
//! is safe. The robot here is twelve flywheels: what is tested is the way from a fault to damping, not the walk.

mod common;
#[path = "../../control/tests/common/mod.rs"]
mod walk;

use common::Bench;
use control::{Config, Controller, Fault, Input, JOINTS, Mode, Output, PreparedGait, Request};
use joint_bus::*;
use std::time::Duration;

const MS: Duration = Duration::from_millis(1);
const INERTIA_KG_M2: f64 = 0.3;
/// The default timeout of joint states.
const TIMEOUT_CYCLES: usize = 20;

struct Robot {
    bench: Bench<Mit>,
    controller: Controller,
    config: Config,
    readings: Readings,
    now: Duration,
    q: [f64; JOINTS],
    v: [f64; JOINTS],
    torque_nm: [f64; JOINTS],
    stuck: Option<usize>,
    last: Option<Output>,
}

impl Robot {
    fn new() -> Self {
        let config = Config {
            overrun_s: 0.01,
            // Flywheels carry nothing: no torque to support.
            stand: control::Posture { support_torque_nm: [0.0; JOINTS], ..walk::config().stand },
            sit: control::Posture { support_torque_nm: [0.0; JOINTS], ..walk::config().sit },
            posture_speed_rad_s: 2.0,
            ..walk::config()
        };
        let bus = common::bus_config("mit", 1.0);
        bus.check_ranges(&config.command_range()).unwrap();
        Self {
            bench: Bench::new(Mit::default(), bus, 0.0, 0.0),
            controller: Controller::new(config.clone()).unwrap(),
            q: config.sit.position_rad,
            config,
            readings: Readings::default(),
            now: Duration::from_secs(1),
            v: [0.0; JOINTS],
            torque_nm: [0.0; JOINTS],
            stuck: None,
            last: None,
        }
    }

    fn gait() -> PreparedGait {
        let mut gait = walk::gait();
        gait.reference_coefficients_rad = gait.coefficients_rad;
        PreparedGait::new(&gait, &walk::config()).unwrap()
    }

    fn physics(&mut self) {
        for _ in 0..2 {
            for j in 0..JOINTS {
                if self.stuck == Some(j) {
                    self.v[j] = 0.0;
                    continue;
                }
                self.v[j] += self.torque_nm[j] / INERTIA_KG_M2 * 5e-4;
                self.q[j] += self.v[j] * 5e-4;
            }
        }
    }

    fn cycle(&mut self, requests: &[Request]) -> Output {
        self.now += MS;
        self.bench.bus().read(self.now, &mut self.readings);
        let state = self.readings.joint_state();
        let gait = Self::gait();
        let output = self.controller.step(
            &Input {
                joints: state.as_ref(),
                requests,
                gait: (self.last.is_none()).then_some(&gait),
                fault: self.bench.bus().fault(self.now),
                ..Input::default()
            },
            self.now,
        );
        for j in 0..JOINTS {
            assert!(output.torque_nm[j].abs() <= self.config.torque_limit_nm[j] + 1e-9);
            if let Some(last) = &self.last
                && last.mode.is_moving()
                && output.mode.is_moving()
            {
                let step = (output.command.position_rad[j] - last.command.position_rad[j]).abs();
                assert!(step <= self.config.velocity_limit_rad_s[j] * 1e-3 + 1e-12, "joint {j} stepped {step}");
            }
        }
        let now = self.now;
        self.bench.bus().write(&output.command, output.drives_on, now);
        self.torque_nm = self.bench.act(now, &self.q.clone(), &self.v.clone(), None);
        self.physics();
        self.last = Some(output);
        output
    }

    fn until(&mut self, mode: Mode, cycles: usize) -> usize {
        for n in 1..=cycles {
            if self.cycle(&[]).mode == mode {
                return n;
            }
        }
        panic!(
            "{mode:?} not reached in {cycles} cycles: {:?}, {:?}",
            self.controller.mode(),
            self.last.unwrap().report
        );
    }

    fn walking() -> Self {
        let mut robot = Self::new();
        for _ in 0..5 {
            robot.cycle(&[]);
        }
        for request in [Request::Arm, Request::Stand, Request::Walk] {
            robot.cycle(&[request]).replies[0].unwrap().unwrap();
        }
        robot.until(Mode::Walking, 5000);
        // Until the whole gait is walked, and half a second.
        for _ in 0..2500 {
            robot.cycle(&[]);
        }
        assert_eq!(robot.controller.mode(), Mode::Walking);
        robot
    }

    fn walks_on(&mut self, cycles: usize) {
        for n in 0..cycles {
            let output = self.cycle(&[]);
            assert_eq!(output.mode, Mode::Walking, "cycle {n}: {:?} {:?}", output.report, output.damping_reason);
        }
    }

    /// Cycles until the controller is safe; the drives are asked too.
    fn until_safe(&mut self, at_most: usize) -> (usize, Output) {
        for n in 1..=at_most {
            let output = self.cycle(&[]);
            if !output.mode.is_moving() {
                assert_eq!(output.command.kp, [0.0; JOINTS]);
                assert!(output.command.kd[0] > 0.0);
                return (n, output);
            }
        }
        panic!("not safe after {at_most} cycles");
    }

    /// Clears what is latched until nothing latches again.
    fn clear_everything(&mut self) {
        for _ in 0..3 {
            for _ in 0..120 {
                self.cycle(&[]);
            }
            let latched: Vec<Fault> = self.cycle(&[]).faults.iter().collect();
            for fault in latched {
                self.cycle(&[Request::ClearFault(fault)]).replies[0].unwrap().unwrap();
            }
        }
        let output = self.cycle(&[]);
        assert_eq!(output.mode, Mode::Damping, "{:?}", output.report);
    }

    /// Every joint is damped or at rest: no drive gives power.
    fn assert_no_drive_pushes(&mut self) {
        for _ in 0..30 {
            self.cycle(&[]);
        }
        for j in 0..JOINTS {
            assert!(
                self.torque_nm[j] * self.v[j] <= 0.2,
                "joint {j}: {} N m at {} rad/s",
                self.torque_nm[j],
                self.v[j]
            );
        }
    }
}

#[test]
fn one_silent_drive() {
    let mut robot = Robot::walking();
    robot.bench.faults(1).silence = Some(2);
    let (cycles, output) = robot.until_safe(40);
    assert!(cycles <= TIMEOUT_CYCLES + 2, "{cycles}");
    walk::measured("one_silent_drive", cycles);
    assert_eq!(output.mode, Mode::Damping);
    robot.assert_no_drive_pushes();
}

#[test]
fn one_silent_bus() {
    let mut robot = Robot::walking();
    robot.bench.faults(2).lose = 1.0;
    let (cycles, _) = robot.until_safe(40);
    assert!(cycles <= TIMEOUT_CYCLES + 2, "{cycles}");
    walk::measured("one_silent_bus", cycles);
    robot.assert_no_drive_pushes();
}

#[test]
fn lost_repeated_and_disordered_frames_are_walked_on() {
    let none = Faults::default();
    for faults in [
        Faults { lose: 0.05, ..none },
        Faults { lose: 0.3, ..none },
        Faults { duplicate: 0.3, ..none },
        Faults { reorder: 0.3, ..none },
        Faults { lose: 0.1, duplicate: 0.1, reorder: 0.1, ..none },
    ] {
        let mut robot = Robot::walking();
        robot.bench.all_faults(faults);
        robot.walks_on(3000);
    }
}

#[test]
fn frames_late_by_one_to_ten_milliseconds_are_walked_on() {
    for late in [1, 2, 4, 10] {
        let mut robot = Robot::walking();
        robot.bench.all_faults(Faults { delay: late * MS, ..Faults::default() });
        robot.walks_on(2000);
    }
}

/// A second controller on the bus: its commands are received, and the replies to them.
#[test]
fn a_second_controller_on_the_bus_is_a_fault_within_five_cycles() {
    let mut slowest = 0;
    for link in 0..4 {
        for request in [DriveRequest::Exit, DriveRequest::Enter, DriveRequest::Command(DriveCommand::default())] {
            let mut robot = Robot::walking();
            let ranges = robot.bench.config.joints[3 * link].ranges;
            let frame = Mit::default().encode_request(1, &ranges, &request).unwrap();
            robot.bench.far[link].send(&frame, robot.now).unwrap();
            let (cycles, output) = robot.until_safe(5);
            assert!(output.faults.contains(Fault::SecondController), "{:?}", output.report);
            assert_eq!(output.report.unwrap().joint, Some(3 * link));
            slowest = slowest.max(cycles);
        }
    }
    walk::measured("a_second_controller_on_the_bus_is_a_fault_within_five_cycles", slowest);
}

#[test]
fn an_interface_has_one_master_and_the_second_learns_which() {
    let interface = format!("can-test-{}", std::process::id());
    let lock = CanLock::take(&interface).unwrap();
    let error = CanLock::take(&interface).unwrap_err().to_string();
    let holder = format!("{interface} has a master already, process {}", std::process::id());
    assert!(error.contains(&holder), "{error}");
    let other = CanLock::take(&format!("{interface}x")).expect("another interface is free");
    drop((lock, other));
    CanLock::take(&interface).expect("free again");
}

#[test]
fn a_bus_is_listened_to_before_the_first_frame() {
    let mut robot = Robot::new();
    assert_eq!(robot.bench.bus.listen_for_second_master(robot.now), None);
    let ranges = robot.bench.config.joints[4].ranges;
    let reply = Mit::default().encode_reply(2, &ranges, &DriveReply::default());
    robot.bench.far[1].send(&reply, robot.now).unwrap();
    assert_eq!(robot.bench.bus.listen_for_second_master(robot.now), None, "a reply is no command");
    let frame = Mit::default().encode_request(2, &ranges, &DriveRequest::Exit).unwrap();
    robot.bench.far[1].send(&frame, robot.now).unwrap();
    assert_eq!(robot.bench.bus.listen_for_second_master(robot.now), Some(("can1", "rear_left_hip_pitch")));
    assert!(robot.bench.bus().health().links.iter().all(|link| link.sent == 0));
}

/// Where its commands are not received, the surplus of replies is.
#[test]
fn twice_as_many_replies_as_requests_are_a_fault_within_five_cycles() {
    let mut robot = Robot::walking();
    robot.bench.faults(2).duplicate = 1.0;
    let (cycles, output) = robot.until_safe(6);
    assert!(cycles <= 5, "{cycles}");
    walk::measured("twice_as_many_replies_as_requests_are_a_fault_within_five_cycles", cycles);
    assert!(output.faults.contains(Fault::SecondController), "{:?}", output.report);
}

#[test]
fn a_disarmed_controller_is_silent_beside_another_master_and_sends_when_it_is_gone() {
    let mut robot = Robot::new();
    let sent = |robot: &mut Robot| robot.bench.bus().health().links.iter().map(|link| link.sent).sum::<u64>();
    let ranges = robot.bench.config.joints[0].ranges;
    let frame = Mit::default().encode_request(1, &ranges, &DriveRequest::Exit).unwrap();
    for _ in 0..1000 {
        robot.bench.far[0].send(&frame, robot.now).unwrap();
        let output = robot.cycle(&[]);
        assert!(output.faults.contains(Fault::SecondController));
    }
    assert_eq!(sent(&mut robot), 0, "frames beside another master");
    assert!(robot.cycle(&[Request::Arm]).replies[0].unwrap().is_err());
    for _ in 0..600 {
        robot.cycle(&[]);
    }
    assert!(sent(&mut robot) > 0, "the other is gone");
}

/// A CAN chip drops frames with a wrong checksum; here they come through, as from a drive whose firmware errs.
#[test]
fn corrupted_frames_end_in_a_fault_and_never_in_a_wild_command() {
    let mut ended = 0;
    for link in 0..4 {
        let mut robot = Robot::walking();
        robot.bench.faults(link).corrupt = 0.02;
        for _ in 0..2000 {
            let output = robot.cycle(&[]);
            if !output.mode.is_moving() {
                ended += 1;
                robot.assert_no_drive_pushes();
                break;
            }
        }
    }
    assert!(ended >= 3, "two frames in a hundred with a wrong bit must not go unnoticed: {ended} of 4");
}

#[test]
fn a_full_queue_is_bridged_when_short_and_damped_when_long() {
    let mut robot = Robot::walking();
    for _ in 0..20 {
        robot.bench.all_faults(Faults { full: true, ..Faults::default() });
        robot.walks_on(5);
        robot.bench.all_faults(Faults::default());
        robot.walks_on(50);
    }
    assert!(robot.bench.bus().health().links[0].full >= 20 * 3 * 4);
    robot.bench.all_faults(Faults { full: true, ..Faults::default() });
    let (cycles, _) = robot.until_safe(40);
    assert!(cycles <= TIMEOUT_CYCLES + 2, "{cycles}");
    walk::measured("a_full_queue_is_bridged_when_short_and_damped_when_long", cycles);
    for j in 0..JOINTS {
        assert!(!robot.bench.drives[j].is_following() || robot.torque_nm[j] * robot.v[j] <= 0.2);
    }
    robot.assert_no_drive_pushes();
}

#[test]
fn an_interface_that_goes_down_is_a_fault_and_is_opened_again_with_patience() {
    let mut robot = Robot::walking();
    robot.bench.faults(3).down = true;
    let (cycles, output) = robot.until_safe(20);
    assert!(cycles <= 8, "{cycles}");
    walk::measured("an_interface_that_goes_down_is_a_fault_and_is_opened_again_with_patience", cycles);
    assert!(output.faults.contains(Fault::BusDown));
    assert_eq!(output.report.unwrap().joint, Some(9), "the first joint on that interface");
    for _ in 0..3000 {
        robot.cycle(&[]);
    }
    // 10, 20, 40 … 640, 1000 ms apart.
    let tried = robot.bench.bus.link_mut(3).reopened;
    assert!((5..=10).contains(&tried), "{tried} attempts in 3 s");
    robot.bench.faults(3).down = false;
    for _ in 0..1100 {
        robot.cycle(&[]);
    }
    let health = robot.bench.bus().health().links[3];
    assert_eq!((health.breaks, health.down_since), (1, None));
    // Cleared, the robot can be stood up again: its drives were entered anew.
    robot.clear_everything();
    assert_eq!(robot.cycle(&[Request::Stand]).replies[0], Some(Ok(Mode::StandingUp)));
}

/// Seen on a kernel's CAN: the frame that commanded a drive to enter was lost as the interface came up, and its
/// watchdog's error could not be cleared by any means.
#[test]
fn a_drive_that_missed_being_entered_is_entered_again_once_it_is_only_damped() {
    let mut robot = Robot::walking();
    // Nothing is sent for longer than the drives' watchdogs wait, and the bus does not know.
    robot.now += 40 * MS;
    let (now, q, v) = (robot.now, robot.q, robot.v);
    robot.bench.act(now, &q, &v, None);
    robot.until_safe(5);
    robot.clear_everything();
    assert!(robot.bench.drives.iter().all(EmulatedDrive::is_following));
    assert_eq!(robot.cycle(&[Request::Stand]).replies[0], Some(Ok(Mode::StandingUp)));
}

#[test]
fn bus_off_is_a_fault_and_is_recovered() {
    let mut robot = Robot::walking();
    robot.bench.faults(0).bus_off = true;
    let (cycles, output) = robot.until_safe(20);
    assert!(cycles <= 8, "{cycles}");
    walk::measured("bus_off_is_a_fault_and_is_recovered", cycles);
    assert!(output.faults.contains(Fault::BusDown));
    for _ in 0..50 {
        robot.cycle(&[]);
    }
    let health = robot.bench.bus().health().links[0];
    assert_eq!((health.breaks, health.reopened, health.down_since), (1, 1, None));
    robot.assert_no_drive_pushes();
}

#[test]
fn a_stuck_joint() {
    let mut robot = Robot::walking();
    robot.stuck = Some(2);
    let (cycles, output) = robot.until_safe(1000);
    assert!(cycles <= 808, "{cycles}: within two steps");
    walk::measured("a_stuck_joint", cycles);
    assert!(output.faults.contains(Fault::JointStuck), "{:?}", output.report);
    assert_eq!(output.report.unwrap().joint, Some(2));
}

#[test]
fn a_hot_drive() {
    let mut robot = Robot::walking();
    robot.bench.drives[8].set_temperature_c(85.0);
    let cycles = robot.until(Mode::Standing, 450);
    assert!(cycles <= 410, "{cycles}: one step at most");
    walk::measured("a_hot_drive", cycles);
    robot.bench.drives[8].set_temperature_c(97.0);
    let (cycles, output) = robot.until_safe(5);
    assert!(cycles <= 3, "{cycles}");
    walk::measured("a_hot_drive", cycles);
    assert!(output.faults.contains(Fault::OverTemperature));
}

#[test]
fn a_controller_that_dies_and_comes_back() {
    let mut robot = Robot::walking();
    // Crashed: nothing is sent. The drives' own watchdogs damp within their 20 ms.
    let mut damped = 0;
    for n in 1..=40 {
        robot.now += MS;
        let (now, q, v) = (robot.now, robot.q, robot.v);
        robot.torque_nm = robot.bench.act(now, &q, &v, None);
        robot.physics();
        // The first cycle after the last in which a drive pushed.
        if (0..JOINTS).any(|j| robot.torque_nm[j] * robot.v[j] > 0.0) {
            damped = n + 1;
        }
    }
    assert!(damped <= 22, "a drive still pushed {damped} ms after the death");
    walk::measured("a_controller_that_dies_and_comes_back", damped);
    // Back: disarmed, and it commands the drives to rest before anything else.
    robot.controller = Controller::new(robot.config.clone()).unwrap();
    robot.last = None;
    robot.readings = Readings::default();
    let output = robot.cycle(&[]);
    assert_eq!((output.mode, output.drives_on), (Mode::Disarmed, false));
    robot.cycle(&[]);
    assert!(robot.bench.drives.iter().all(|drive| !drive.is_following()));
    assert_eq!(robot.torque_nm, [0.0; JOINTS]);
}

#[test]
fn reading_and_writing_allocate_nothing_whatever_state_the_links_are_in() {
    let states = [
        Faults::default(),
        Faults { down: true, ..Faults::default() },
        Faults { bus_off: true, ..Faults::default() },
        Faults { full: true, ..Faults::default() },
    ];
    for faults in states {
        let mut robot = Robot::walking();
        let command = robot.last.unwrap().command;
        let before = realtime::allocations_of_this_thread();
        for _ in 0..10_000 {
            // Reopening a link would mend it.
            robot.bench.all_faults(faults);
            robot.now += MS;
            let now = robot.now;
            robot.bench.bus.read(now, &mut robot.readings);
            robot.bench.bus.write(&command, true, now);
            robot.bench.act(now, &robot.q.clone(), &robot.v.clone(), None);
        }
        assert_eq!(realtime::allocations_of_this_thread(), before, "{faults:?}");
    }
}

#[global_allocator]
static ALLOCATOR: realtime::CountingAllocator = realtime::CountingAllocator;
