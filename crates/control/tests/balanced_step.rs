//! The balanced law in the controller's own step: off it is the paper's law to the bit, on it allocates nothing, goes
//! on from its record to the bit, and what keeps it from going on is a fault with a name within a bound.

mod common;
use common::balanced::{Bench, PERIOD, config, drive};
use common::measured;
use control::{Controller, Fault, Mode, Output, Refusal, Request, Snapshot, Velocity, VelocityCommand};
use std::time::{Duration, Instant};

#[global_allocator]
static ALLOCATOR: realtime::CountingAllocator = realtime::CountingAllocator;

#[test]
fn without_an_inertial_unit_balance_walks_the_papers_law_to_the_bit() {
    let (mut off, mut on) = (Bench::walking(config(false)), {
        let mut bench = Bench::new(config(true));
        bench.unit = None;
        bench.cycle(&[Request::StartOnGait]);
        bench
    });
    off.unit = None;
    let commands =
        |bench: &mut Bench| bench.run(3000).iter().map(|output| (output.command, output.mode)).collect::<Vec<_>>();
    assert_eq!(commands(&mut off), commands(&mut on));
}

#[test]
fn with_balance_off_a_unit_and_a_velocity_change_nothing_to_the_bit() {
    let (mut alone, mut driven) = (Bench::walking(config(false)), Bench::walking(config(false)));
    alone.unit = None;
    driven.velocity = Some(VelocityCommand { velocity: drive(0.3, 0.1, 0.2), arrived: driven.now });
    assert_eq!(alone.run(3000), driven.run(3000));
}

/// Over switches, a stop, standing, and walking out of standing, driven.
#[test]
fn a_balanced_cycle_allocates_nothing() {
    let mut bench = Bench::walked_out_of_standing(config(true));
    let before = realtime::allocations_of_this_thread();
    let mut steps = 0;
    let mut spent = [Duration::ZERO; 3000];
    for (n, spent) in spent.iter_mut().enumerate() {
        bench.velocity = Some(VelocityCommand { velocity: drive(0.3, 0.05, 0.2), arrived: bench.now });
        let begun = Instant::now();
        let output = bench.cycle(match n {
            2000 => &[Request::Stop],
            2200 => &[Request::Walk],
            _ => &[],
        });
        *spent = begun.elapsed();
        steps = steps.max(output.step_index);
    }
    assert_eq!(realtime::allocations_of_this_thread(), before);
    assert!(steps >= 4, "{steps} steps");
    spent.sort_unstable();
    println!("a balanced step: median {:?}, 99 % {:?}", spent[1500], spent[2970]);
}

#[test]
fn a_balanced_walk_goes_on_from_its_record_to_the_bit() {
    for at in [1, 250, 404, 1111] {
        let mut first = Bench::walked_out_of_standing(config(true));
        first.velocity = Some(VelocityCommand { velocity: drive(0.2, -0.05, 0.3), arrived: first.now });
        first.run(at);
        first.force_m_s2[1] = 3.0;
        first.run(40);
        first.force_m_s2[1] = 0.0;
        let text = serde_json::to_string(&first.controller.snapshot()).unwrap();
        let snapshot: Snapshot = serde_json::from_str(&text).unwrap();
        let mut second = first.clone();
        second.controller = Controller::resume(first.controller.config().clone(), &snapshot).unwrap();
        assert!(first.run(1).iter().all(|output| output.balance.is_some()), "it does not walk in balance");
        second.run(1);
        assert_eq!(first.run(1500), second.run(1500), "from cycle {at}");
    }
}

#[test]
fn a_memory_of_a_version_without_balance_is_read() {
    let mut memory = serde_json::to_value(Bench::walking(config(false)).controller.snapshot()).unwrap();
    memory.as_object_mut().unwrap().remove("estimate").expect("the memory has the estimate");
    let read: Snapshot = serde_json::from_value(memory).unwrap();
    assert_eq!(read, Bench::walking(config(false)).controller.snapshot());
}

#[test]
fn an_old_velocity_is_walked_in_place() {
    let mut bench = Bench::walking(config(true));
    let timeout_s = bench.controller.config().balance.unwrap().command_timeout_s;
    let command = VelocityCommand { velocity: drive(0.3, 0.1, 0.4), arrived: bench.now };
    let at = |after_s: f64| command.at(bench.now + Duration::from_secs_f64(after_s), timeout_s);
    assert_eq!(at(timeout_s), command.velocity);
    assert_eq!(at(timeout_s + 0.001), Velocity::default());
    assert_eq!(command.at(bench.now - PERIOD, timeout_s), Velocity::default());
    let nan = VelocityCommand { velocity: drive(f64::NAN, 0.0, 0.0), ..command };
    assert_eq!(nan.at(bench.now, timeout_s), Velocity::default());
    // The same message for good: walked as long as it is fresh, and the stance stands still some time after.
    bench.velocity = Some(command);
    let speed = |outputs: &[Output]| {
        let v = outputs.last().unwrap().estimate.unwrap().velocity_m_s();
        v[0].hypot(v[1])
    };
    let (driven, after) = (bench.run(450), bench.run(2500));
    assert!(speed(&driven) > 0.2, "{}", speed(&driven));
    assert!(speed(&after) < 0.1, "{}", speed(&after));
    assert_eq!(bench.controller.mode(), Mode::Walking);
}

/// Timeout of the data (20), patience (50), and the cycle that notices.
#[test]
fn a_unit_that_falls_silent_is_estimate_lost() {
    let mut bench = Bench::walking(config(true));
    bench.run(700);
    bench.unit_sends = false;
    let (cycles, output) = bench.until_fault(100);
    assert!(output.faults.contains(Fault::EstimateLost), "{:?}", output.faults);
    assert!(cycles <= 20 + 50 + 2, "{cycles}");
    measured("a_unit_that_falls_silent_is_estimate_lost", cycles);
    // It does not walk again before inertial data is received.
    bench.cycle(&[Request::ClearFault(Fault::EstimateLost)]);
    bench.cycle(&[Request::Disarm]);
    let refused = bench.cycle(&[Request::StartOnGait]);
    assert_eq!(refused.reply(0), Some(Err(Refusal::NoEstimate)));
}

#[test]
fn a_unit_that_reports_what_cannot_be_is_estimate_lost() {
    let mut bench = Bench::walking(config(true));
    bench.run(700);
    bench.turning_rad_s[0] = 90.0;
    let (cycles, output) = bench.until_fault(100);
    assert!(output.faults.contains(Fault::EstimateLost), "{:?}", output.faults);
    assert!(cycles <= 50 + 2, "{cycles}");
    measured("a_unit_that_reports_what_cannot_be_is_estimate_lost", cycles);
}

/// A short gap, as of lost messages, is walked over.
#[test]
fn a_unit_that_is_silent_for_a_moment_is_walked_on() {
    let mut bench = Bench::walking(config(true));
    for _ in 0..10 {
        bench.run(100);
        bench.unit_sends = false;
        bench.run(40);
        bench.unit_sends = true;
    }
    assert_eq!(bench.controller.mode(), Mode::Walking);
}

/// The unit has no attitude of its own; the estimate says how far the base is tilted.
#[test]
fn a_base_that_turns_over_by_its_estimate_is_a_tilt() {
    let mut bench = Bench::walking(config(true));
    bench.run(300);
    bench.unit.as_mut().unwrap().attitude_xyzw = None;
    bench.turning_rad_s[0] = 10.0;
    let (cycles, output) = bench.until_fault(200);
    assert!(output.faults.contains(Fault::Tilt), "{:?}", output.faults);
    // 0.8 rad at 10 rad/s.
    assert!(cycles <= 90, "{cycles}");
}

/// A base that is pushed without end: the steps are at their limits, and no longer than they may be.
#[test]
fn a_push_without_end_is_balance_lost() {
    let mut config = config(true);
    // Joints that go where they are commanded never meet these.
    config.balance.as_mut().unwrap().estimator.speed_limit_m_s = 100.0;
    config.tilt_limit_rad = 1.5;
    let mut bench = Bench::walking(config);
    bench.run(300);
    bench.force_m_s2[1] = 60.0;
    let (cycles, output) = bench.until_fault(3000);
    assert!(output.faults.contains(Fault::BalanceLost), "{:?}", output.faults);
    let patience_s = bench.controller.config().balance.unwrap().limited_patience_s;
    println!("balance_lost after {cycles} cycles of a push");
    assert!(output.report.unwrap().value <= patience_s + 0.002);
}

/// A body that was pushed is thrown off its standing legs: where 0.35 rad for 40 ms is a fault else, 0.5 for 100 is.
#[test]
fn while_a_step_is_caught_a_joint_may_be_further_from_its_command_but_not_for_good() {
    const KNEE: usize = 2;
    let fault_after = |push_m_s2: f64, off_rad: f64| {
        let mut bench = Bench::walking(config(true));
        bench.run(700);
        (0..300_u16).find_map(|n| {
            // To and fro, so that it stays a push that can be caught.
            bench.force_m_s2[1] = if n / 60 % 2 == 0 { push_m_s2 } else { -push_m_s2 };
            bench.joints.position_rad[KNEE] += off_rad * f64::min(f64::from(n) / 150.0, 1.0);
            let output = bench.cycle(&[]);
            (output.mode == Mode::Fault).then(|| (usize::from(n), output.report.unwrap()))
        })
    };
    assert_eq!(fault_after(0.0, 0.3), None);
    let (calm, report) = fault_after(0.0, 0.6).unwrap();
    assert_eq!((report.fault, report.joint, report.limit), (Fault::TrackingError, Some(KNEE), 0.35));
    assert_eq!(fault_after(10.0, 0.45), None);
    let (caught, report) = fault_after(10.0, 0.6).unwrap();
    assert_eq!((report.fault, report.joint, report.limit), (Fault::TrackingError, Some(KNEE), 0.5));
    assert!(calm < caught && caught <= 150 + 100, "{calm} {caught}");
    measured("while_a_step_is_caught_a_joint_may_be_further_from_its_command_but_not_for_good", caught);
}

/// A leg that the ground held off its command flies back to it when it lifts off: near its velocity limit what drives
/// it on turns into damping. The paper's law is let be, to the bit.
#[test]
fn a_joint_at_its_velocity_limit_is_driven_no_faster() {
    const ROLL: usize = 0;
    let torque_nm = |balanced: bool, share: f64| {
        let mut settings = config(balanced);
        if let Some(balance) = settings.balance.as_mut() {
            balance.speed_fade_share = share;
        }
        let mut bench = Bench::walking(settings);
        for n in 0..150 {
            bench.joints.position_rad[ROLL] -= 0.3 * f64::min(f64::from(n) / 100.0, 1.0);
            bench.cycle(&[]);
        }
        bench.joints.position_rad[ROLL] -= 0.3;
        bench.joints.velocity_rad_s[ROLL] = 0.99 * bench.controller.config().velocity_limit_rad_s[ROLL];
        let output = bench.cycle(&[]);
        assert_eq!(output.mode, Mode::Walking);
        output.torque_nm[ROLL]
    };
    assert!(torque_nm(true, 0.2) < -10.0, "{}", torque_nm(true, 0.2));
    assert!(torque_nm(true, 0.0) > 10.0, "{}", torque_nm(true, 0.0));
    assert!(torque_nm(false, 0.0) > 10.0, "{}", torque_nm(false, 0.0));
}

/// To the right and to the left, on both sides of the robot; and not where a recording that is older has every leg
/// shift alike.
#[test]
fn the_room_of_the_toes_is_mirrored_and_older_recordings_know_of_none() {
    let room = |config| Bench::new(config).gait.lateral_room_m().copied();
    let mut older = config(true);
    older.balance.as_mut().unwrap().pairs_share_shift = false;
    assert_eq!((room(older), room(config(false))), (None, None));
    let [front_left, rear_left, front_right, rear_right] = room(config(true)).unwrap();
    for (left, right) in [(front_left, front_right), (rear_left, rear_right)] {
        assert!(left[0] < 0.0 && left[1] > 0.0, "{left:?}");
        assert!((left[0] + right[1]).abs() < 2e-3 && (left[1] + right[0]).abs() < 2e-3, "{left:?} {right:?}");
        // It stands wide: outward there is less room.
        assert!(left[1] < -left[0] && right[1] > -right[0], "{left:?} {right:?}");
    }
}
