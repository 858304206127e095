//! What goes wrong, and how many cycles it takes until the robot is safe. Safe: the command is damping.

mod common;
use common::*;
use control::*;
use std::time::Duration;

#[test]
fn nan_from_any_joint_and_field_is_a_fault_in_the_same_cycle() {
    for j in 0..JOINTS {
        for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
            for field in 0..3 {
                let mut b = Bench::walking(config());
                let (cycles, output) = cycles_to_safe(&mut b, 2, |_, state, _, _| match field {
                    0 => state.position_rad[j] = bad,
                    1 => state.velocity_rad_s[j] = bad,
                    _ => {
                        let mut t = [30.0; JOINTS];
                        t[j] = bad;
                        state.temperature_c = Some(t);
                    }
                });
                assert_eq!(cycles, 1);
                assert_fault(&output, Fault::InvalidInput, Some(j));
            }
        }
    }
    // Each of them.
    measured("nan_from_any_joint_and_field_is_a_fault_in_the_same_cycle", 1);
}

#[test]
fn what_cannot_be_is_a_fault_in_the_same_cycle() {
    type Case = (Fault, fn(&mut JointState));
    let cases: [Case; 5] = [
        (Fault::PositionOutOfRange, |s| s.position_rad[5] = 3.3),
        (Fault::PositionOutOfRange, |s| s.position_rad[5] = -9.0),
        (Fault::VelocityOutOfRange, |s| s.velocity_rad_s[5] = 91.0),
        (Fault::EncoderJump, |s| s.position_rad[5] += 0.2),
        (Fault::DriveError, |s| s.drive_error[5] = 3),
    ];
    for (fault, spoil) in cases {
        let mut b = Bench::walking(config());
        let (cycles, output) = cycles_to_safe(&mut b, 2, |_, state, _, _| spoil(state));
        assert_eq!(cycles, 1);
        assert_fault(&output, fault, Some(5));
    }
    // Each of them.
    measured("what_cannot_be_is_a_fault_in_the_same_cycle", 1);
}

#[test]
fn a_robot_that_fell_after_the_stop_and_rests_on_its_mechanical_stops_has_no_encoder_fault() {
    let mut b = Bench::walking(config());
    b.obeys = false;
    b.emergency_stop = true;
    assert_eq!(b.cycle(&[], None).mode, Mode::Damping);
    // A knee sinks to 0.4 rad beyond its limit, and stays there.
    let outside = config().position_max_rad[5] + 0.4;
    while b.position_rad[5] < outside {
        b.position_rad[5] += 0.005;
        b.velocity_rad_s[5] = 5.0;
        let output = b.cycle(&[], None);
        assert!(output.faults.is_empty() && is_damping(&output), "{:?} at {}", output.report, b.position_rad[5]);
    }
    b.velocity_rad_s = [0.0; JOINTS];
    b.emergency_stop = false;
    b.run(10);
    assert_eq!(b.ask(Request::Stand), Err(Refusal::JointOutside { joint: 5 }));
    assert_eq!(b.ask(Request::Disarm), Ok(Mode::Disarmed));
    assert_eq!(b.ask(Request::Arm), Err(Refusal::JointOutside { joint: 5 }));
    // Back where it can be, it is armed; what an encoder alone can do is a fault all the same.
    b.position_rad[5] = config().position_max_rad[5];
    assert_eq!(b.ask(Request::Arm), Ok(Mode::Damping));
    b.position_rad[5] += 0.5;
    assert_fault(&b.cycle(&[], None), Fault::EncoderJump, Some(5));
}

#[test]
fn joint_states_that_stop_mean_damping_after_the_timeout() {
    let mut b = Bench::walking(config());
    b.measures = false;
    let (cycles, output) = cycles_to_safe(&mut b, 40, |_, _, _, _| {});
    assert_eq!(cycles, 21, "20 ms are allowed");
    measured("joint_states_that_stop_mean_damping_after_the_timeout", cycles);
    assert_eq!(output.mode, Mode::Damping);
    assert_eq!(output.damping_reason, Some(DampingReason::StaleJointState));
    assert!(output.faults.is_empty());
    // When they come again it stays damped until someone asks.
    b.measures = true;
    assert_eq!(b.run(100).mode, Mode::Damping);
    assert_eq!(b.ask(Request::Stand), Ok(Mode::StandingUp));
}

#[test]
fn one_silent_drive_is_enough() {
    let mut b = Bench::walking(config());
    let silent_since = b.now;
    let (cycles, output) = cycles_to_safe(&mut b, 40, |_, state, _, _| state.arrived[7] = silent_since);
    assert_eq!(cycles, 21);
    measured("one_silent_drive_is_enough", cycles);
    assert_eq!(output.damping_reason, Some(DampingReason::StaleJointState));
}

#[test]
fn states_late_by_up_to_ten_milliseconds_are_walked_on() {
    for late_ms in [1, 4, 10] {
        let mut b = Bench::walking(config());
        let mut history = vec![b.state()];
        for _ in 0..2000 {
            b.now += PERIOD;
            history.push(b.state());
            let state = history[history.len().saturating_sub(1 + late_ms)];
            let output = b.controller.step(&Input { joints: Some(&state), ..Input::default() }, b.now);
            assert_eq!(output.mode, Mode::Walking, "{late_ms} ms: {:?}", output.report);
            b.position_rad = output.command.position_rad;
            b.velocity_rad_s = output.command.velocity_rad_s;
        }
    }
}

#[test]
fn lost_and_repeated_states_are_walked_on() {
    for share in [0.05, 0.3] {
        let mut b = Bench::walking(config());
        let mut random = 7_u32;
        let mut held = b.state();
        for n in 0..5000 {
            b.now += PERIOD;
            random = random.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            let lost = f64::from(random >> 8) / f64::from(1 << 24) < share;
            if !lost {
                held = b.state();
            }
            let output = b.controller.step(&Input { joints: Some(&held), ..Input::default() }, b.now);
            assert_eq!(output.mode, Mode::Walking, "cycle {n}: {:?}", output.report);
            b.position_rad = output.command.position_rad;
            b.velocity_rad_s = output.command.velocity_rad_s;
        }
        assert!(b.controller.step(&Input::default(), b.now).stale_inputs > (4000.0 * share) as u64);
    }
}

#[test]
fn states_in_the_wrong_order_are_a_clock_jump() {
    let mut b = Bench::walking(config());
    let old = b.state();
    b.run(3);
    let (cycles, output) = cycles_to_safe(&mut b, 2, |_, state, _, _| state.stamp = old.stamp - PERIOD);
    assert_eq!(cycles, 1);
    assert_fault(&output, Fault::ClockJump, None);
    measured("states_in_the_wrong_order_are_a_clock_jump", 1);
}

#[test]
fn a_hot_drive_stops_the_walk_and_a_hotter_one_damps() {
    let mut b = Bench::walking(config());
    b.run(50);
    let mut standing = None;
    for n in 0..1000 {
        b.now += PERIOD;
        let mut state = b.state();
        let mut t = [40.0; JOINTS];
        t[8] = 85.0;
        state.temperature_c = Some(t);
        let output = b.controller.step(&Input { joints: Some(&state), ..Input::default() }, b.now);
        b.position_rad = output.command.position_rad;
        b.velocity_rad_s = output.command.velocity_rad_s;
        assert!(matches!(output.mode, Mode::Stopping | Mode::Standing), "{:?}", output.mode);
        if output.mode == Mode::Standing && standing.is_none() {
            standing = Some(n);
        }
    }
    measured("a_hot_drive_stops_the_walk_and_a_hotter_one_damps", standing.unwrap());
    assert!(standing.unwrap() <= 404, "one step at most");
    assert_eq!(b.ask(Request::Walk), Err(Refusal::FaultLatched));
    assert_eq!(b.ask(Request::ClearFault(Fault::DriveHot)), Ok(Mode::Standing));
    assert_eq!(b.ask(Request::Walk), Ok(Mode::Starting));

    let mut b = Bench::walking(config());
    let (cycles, output) = cycles_to_safe(&mut b, 2, |_, state, _, _| {
        let mut t = [40.0; JOINTS];
        t[8] = 96.0;
        state.temperature_c = Some(t);
    });
    assert_eq!(cycles, 1);
    measured("a_hot_drive_stops_the_walk_and_a_hotter_one_damps", cycles);
    assert_fault(&output, Fault::OverTemperature, Some(8));
}

#[test]
fn tilt_and_a_spoiled_tilt_are_faults_in_the_same_cycle() {
    for (roll_rad, pitch_rad, fault) in
        [(0.9, 0.0, Fault::Tilt), (0.0, -0.81, Fault::Tilt), (f64::NAN, 0.0, Fault::InvalidInput)]
    {
        let mut b = Bench::walking(config());
        let (cycles, output) = cycles_to_safe(&mut b, 2, |_, _, input, now| {
            input.inertial = Some(InertialState::tilted(Tilt { roll_rad, pitch_rad }, *now))
        });
        assert_eq!(cycles, 1);
        assert_fault(&output, fault, None);
    }
    let level = rolled(0.0);
    for spoiled in [
        InertialState { attitude_xyzw: Some([0.0; 4]), ..level },
        InertialState { angular_velocity_rad_s: Some([0.0, f64::NAN, 0.0]), ..level },
        InertialState { acceleration_m_s2: Some([0.0, 0.0, f64::INFINITY]), ..level },
    ] {
        let mut b = Bench::walking(config());
        let (cycles, output) = cycles_to_safe(&mut b, 2, |_, _, input, _| input.inertial = Some(spoiled));
        assert_eq!(cycles, 1);
        assert_fault(&output, Fault::InvalidInput, None);
    }
    // Each of them.
    measured("tilt_and_a_spoiled_tilt_are_faults_in_the_same_cycle", 1);
}

#[test]
fn a_bus_that_is_down_is_a_fault_in_the_same_cycle() {
    let mut b = Bench::walking(config());
    let report = FaultReport { fault: Fault::BusDown, joint: Some(3), value: 0.006, limit: 0.005 };
    let (cycles, output) = cycles_to_safe(&mut b, 2, |_, _, input, _| input.fault = Some(report));
    assert_eq!(cycles, 1);
    measured("a_bus_that_is_down_is_a_fault_in_the_same_cycle", cycles);
    assert_fault(&output, Fault::BusDown, Some(3));
}

#[test]
fn clocks_that_jump_are_faults_in_the_same_cycle() {
    let mut b = Bench::walking(config());
    let (cycles, output) = cycles_to_safe(&mut b, 2, |_, state, _, now| {
        *now -= Duration::from_millis(500);
        state.arrived = [*now; JOINTS];
    });
    assert_eq!(cycles, 1);
    assert_fault(&output, Fault::ClockJump, None);

    let mut b = Bench::walking(config());
    let (cycles, output) = cycles_to_safe(&mut b, 2, |_, state, _, now| {
        *now += Duration::from_millis(60);
        state.arrived = [*now; JOINTS];
    });
    assert_eq!(cycles, 1);
    measured("clocks_that_jump_are_faults_in_the_same_cycle", cycles);
    assert_fault(&output, Fault::Overrun, None);
}

#[test]
fn a_late_cycle_makes_no_larger_step_and_the_command_catches_up() {
    // As late as is allowed, in every twentieth of the gait's two steps.
    let late = Duration::from_millis(48);
    for n in 0..40 {
        let mut b = Bench::walking(config());
        let (c, before) = (config(), b.run(1 + 20 * n));
        b.now += late;
        let (mut last, mut farthest) = (before, 0.0_f64);
        for cycle in 0..60 {
            let output = b.run(1);
            assert_eq!(output.mode, Mode::Walking, "{:?}", output.report);
            for j in 0..JOINTS {
                let step = (output.command.position_rad[j] - last.command.position_rad[j]).abs();
                let limit = c.velocity_limit_rad_s[j] * c.control_period_s;
                assert!(step <= limit + 1e-12, "{cycle} cycles after it, joint {j}: {step}");
                farthest = farthest.max((output.command.position_rad[j] - before.command.position_rad[j]).abs());
            }
            last = output;
        }
        // It is where a robot is that was never late.
        let mut punctual = Bench::walking(config());
        punctual.run(1 + 20 * n);
        let there = punctual.run(48 + 60);
        for j in 0..JOINTS {
            let off = (there.command.position_rad[j] - last.command.position_rad[j]).abs();
            assert!(off < 1e-9, "joint {j}: {off}, moved {farthest}");
        }
    }
}

#[test]
fn the_emergency_stop_damps_in_the_same_cycle_from_every_mode() {
    let mut reached = Vec::new();
    let day: [(Option<Request>, usize); 8] = [
        (Some(Request::Arm), 5),
        (Some(Request::Stand), 100),
        (None, 4000),
        (Some(Request::Walk), 100),
        (None, 1500),
        (Some(Request::Stop), 10),
        (None, 1000),
        (Some(Request::Sit), 300),
    ];
    for press_in in 0..day.len() {
        let mut b = Bench::new(config());
        b.load(&prepared());
        for (request, cycles) in &day[..=press_in] {
            if let Some(request) = request {
                b.ask(*request).unwrap();
            }
            b.run(*cycles);
        }
        reached.push(b.controller.mode());
        b.emergency_stop = true;
        let output = b.cycle(&[], None);
        assert!(is_damping(&output), "{:?}", reached.last());
        assert_eq!(output.damping_reason, Some(DampingReason::EmergencyStop));
        assert_eq!(b.ask(Request::Stand), Err(Refusal::EmergencyStop));
        b.emergency_stop = false;
        assert_eq!(b.run(100).mode, Mode::Damping, "releasing moves nothing");
        assert_eq!(b.ask(Request::Disarm), Ok(Mode::Disarmed));
    }
    use Mode as M;
    assert_eq!(
        reached,
        [M::Damping, M::StandingUp, M::Standing, M::Starting, M::Walking, M::Stopping, M::Standing, M::SittingDown]
    );
}

#[test]
fn faults_latch_until_they_are_cleared_by_their_names() {
    let mut b = Bench::walking(config());
    let (_, output) = cycles_to_safe(&mut b, 2, |_, state, input, _| {
        state.drive_error[1] = 9;
        input.inertial = Some(rolled(1.0));
    });
    assert!(output.faults.contains(Fault::DriveError) && output.faults.contains(Fault::Tilt));
    assert_eq!(b.run(500).mode, Mode::Fault);
    assert!(b.ask(Request::Stand).is_err() && b.ask(Request::Walk).is_err() && b.ask(Request::Arm).is_err());
    assert_eq!(b.ask(Request::ClearFault(Fault::Overspeed)), Err(Refusal::FaultNotLatched));
    assert_eq!(b.ask(Request::ClearFault(Fault::Tilt)), Ok(Mode::Fault), "one is left");
    assert_eq!(b.ask(Request::ClearFault(Fault::DriveError)), Ok(Mode::Damping));
    assert_eq!(b.ask(Request::Stand), Ok(Mode::StandingUp));
    // A robot may be switched off with a fault latched, and is not armed with one.
    let mut b = Bench::walking(config());
    cycles_to_safe(&mut b, 2, |_, state, _, _| state.drive_error[1] = 9);
    assert_eq!(b.ask(Request::Disarm), Ok(Mode::Disarmed));
    assert_eq!(b.ask(Request::Arm), Err(Refusal::FaultLatched));
    assert_eq!(b.ask(Request::ClearFault(Fault::DriveError)), Ok(Mode::Disarmed));
    assert_eq!(b.ask(Request::Arm), Ok(Mode::Damping));
}

#[test]
fn arming_asks_for_fresh_and_believable_joints() {
    let mut b = Bench::new(config());
    b.measures = false;
    assert_eq!(b.ask(Request::Arm), Err(Refusal::NotFresh));
    b.measures = true;
    b.position_rad[4] = 2.6;
    assert_eq!(b.ask(Request::Arm), Err(Refusal::JointOutside { joint: 4 }));
    b.position_rad[4] = 0.2;
    b.obeys = false;
    b.velocity_rad_s[3] = 2.0;
    let refusal = b.ask(Request::Arm).unwrap_err();
    assert_eq!(refusal, Refusal::JointMoves { joint: 3 });
    assert!(refusal.to_string().contains("the rear left hip roll is moving"), "{refusal}");
    b.velocity_rad_s[3] = 0.0;
    assert_eq!(b.ask(Request::Arm), Ok(Mode::Damping));
}

#[test]
fn damping_never_gives_more_than_its_torque() {
    let mut b = Bench::walking(config());
    b.emergency_stop = true;
    b.obeys = false;
    for v in [0.1_f64, 3.0, 12.0, 29.0] {
        b.velocity_rad_s = [v.min(8.0); JOINTS];
        b.velocity_rad_s[2] = v;
        let output = b.cycle(&[], None);
        let torque = output.command.torque(&b.position_rad, &b.velocity_rad_s);
        for (j, torque) in torque.into_iter().enumerate() {
            assert!(torque.abs() <= 40.0 + 1e-9 && torque * b.velocity_rad_s[j] <= 0.0, "{torque}");
        }
    }
}
