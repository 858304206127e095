//! Joints that do not follow their commands, and how many cycles it takes until the robot is safe.

mod common;
use common::*;
use control::*;

#[test]
fn a_stuck_drive_is_noticed_within_the_step_in_which_it_should_swing() {
    let mut b = Bench::walking(config());
    while b.run(1).step_phase > 0.02 || b.last.unwrap().step_index % 2 == 1 {}
    let stuck_at = b.position_rad[2];
    let (cycles, output) = cycles_to_safe(&mut b, 500, |_, state, _, _| {
        state.position_rad[2] = stuck_at;
        state.velocity_rad_s[2] = 0.0;
    });
    assert!(cycles < 150, "{cycles}");
    measured("a_stuck_drive_is_noticed_within_the_step_in_which_it_should_swing", cycles);
    assert_fault(&output, Fault::JointStuck, Some(2));
}

/// A knee that sticks half-way through its swing is never far from its command, on either side.
#[test]
fn a_joint_that_sticks_at_any_phase_is_noticed_within_two_steps() {
    let mut longest = 0;
    for n in 0..16 {
        let mut b = Bench::walking(config());
        b.run(1 + 50 * n);
        let stuck_at = b.position_rad[2];
        let (cycles, output) = cycles_to_safe(&mut b, 1000, |_, state, _, _| {
            state.position_rad[2] = stuck_at;
            state.velocity_rad_s[2] = 0.0;
        });
        assert!(cycles <= 808, "{n}: {cycles}");
        assert_fault(&output, Fault::JointStuck, Some(2));
        longest = longest.max(cycles);
    }
    measured("a_joint_that_sticks_at_any_phase_is_noticed_within_two_steps", longest);
}

/// A stuck joint stops the robot from standing up, too: by the distance from its command.
#[test]
fn a_knee_that_is_stuck_while_standing_up_is_a_tracking_error() {
    let mut b = Bench::new(config());
    b.ask(Request::Arm).unwrap();
    b.ask(Request::Stand).unwrap();
    b.run(1000);
    let stuck_at = b.position_rad[2];
    let (_, output) = cycles_to_safe(&mut b, 4000, |_, state, _, _| {
        state.position_rad[2] = stuck_at;
        state.velocity_rad_s[2] = 0.0;
    });
    assert_fault(&output, Fault::TrackingError, Some(2));
    let off = (output.report.unwrap().value - config().tracking_error_rad).abs();
    assert!(off < 0.1, "noticed {off} rad late");
}

/// Friction holds a foot that carries the robot: the same distance that is a stuck joint in a walk is none from posture
/// to posture.
#[test]
fn a_joint_that_friction_holds_while_sitting_down_is_not_stuck() {
    let c = config();
    let mut b = Bench::new(c.clone());
    b.ask(Request::Arm).unwrap();
    b.ask(Request::Stand).unwrap();
    b.until(Mode::Standing, 6.0);
    b.ask(Request::Sit).unwrap();
    let start = b.position_rad;
    let mut furthest = 0.0_f64;
    for _ in 0..2000 {
        // Each joint stays until its command is 0.3 rad away, then is dragged along behind it.
        let output = b.run(1);
        assert_eq!(output.faults, FaultSet::default(), "{:?}", output.report);
        if output.mode != Mode::SittingDown {
            break;
        }
        for j in 0..JOINTS {
            let commanded = output.command.position_rad[j];
            let moved = commanded - start[j];
            furthest = furthest.max(moved.abs().min(0.3));
            b.position_rad[j] = if moved.abs() < 0.3 { start[j] } else { commanded - 0.3 * moved.signum() };
            b.velocity_rad_s[j] = 0.0;
        }
    }
    assert!(furthest > c.stuck_rad, "{furthest}");
}

/// A simulation that stands still for a while is no stuck joint when it goes on.
#[test]
fn a_pause_of_the_states_is_no_stuck_joint() {
    let mut c = config();
    c.state_timeout_s = 0.1;
    // The bench's gait is a slow one.
    c.stuck_rad = 0.1;
    let mut b = Bench::walking(c.clone());
    let mut furthest = 0.0_f64;
    for pause in 0..60 {
        let before = b.run(11 + pause);
        b.measures = false;
        b.obeys = false;
        let after = b.run(90);
        assert_eq!(after.mode, Mode::Walking, "pause {pause}: {:?}", after.report);
        b.measures = true;
        // It goes on where it was, and is with its command again 20 ms later.
        let behind: [f64; JOINTS] =
            std::array::from_fn(|j| before.command.position_rad[j] - after.command.position_rad[j]);
        furthest = behind.iter().fold(furthest, |most, rad| most.max(rad.abs()));
        let mut command = after.command.position_rad;
        for n in 0..20 {
            b.position_rad = std::array::from_fn(|j| command[j] + behind[j] * f64::from(20 - n) / 20.0);
            let output = b.run(1);
            assert_eq!(output.mode, Mode::Walking, "pause {pause}, {n} ms after it: {:?}", output.report);
            command = output.command.position_rad;
        }
        b.obeys = true;
    }
    assert!(furthest > c.stuck_rad, "{furthest}");
}

#[test]
fn a_joint_that_moves_but_does_not_follow_is_a_tracking_error() {
    let mut b = Bench::walking(config());
    let (cycles, output) = cycles_to_safe(&mut b, 500, |n, state, _, _| {
        // Pushed away at 4 rad/s.
        state.position_rad[4] += 0.004 * n as f64;
        state.velocity_rad_s[4] = 4.0;
    });
    assert!(cycles < 200, "{cycles}");
    measured("a_joint_that_moves_but_does_not_follow_is_a_tracking_error", cycles);
    assert_fault(&output, Fault::TrackingError, Some(4));
}

#[test]
fn a_joint_that_runs_away_is_an_overspeed() {
    let mut b = Bench::walking(config());
    let (cycles, output) = cycles_to_safe(&mut b, 100, |_, state, _, _| state.velocity_rad_s[0] = 10.0);
    assert!((30..=32).contains(&cycles), "{cycles}: 30 ms are allowed");
    measured("a_joint_that_runs_away_is_an_overspeed", cycles);
    assert_fault(&output, Fault::Overspeed, Some(0));
}
