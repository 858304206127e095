//! The robot's day: from lying to walking and back, and what must hold on the way.

mod common;
use common::*;
use control::resolution;
use control::*;
use gait::StepSide;
use std::time::Duration;

/// No motion here rights a robot: it is told so, and that a person turns it, whatever else would have to be done first.
#[test]
fn a_robot_on_its_side_is_asked_in_vain_until_it_was_turned_by_hand() {
    let mut b = Bench::walking(config());
    b.roll_rad = Some(-1.5);
    assert_eq!(b.run(1).mode, Mode::Fault);
    let on_its_side = Err(Refusal::Tilted(Tilted { roll_deg: -86, pitch_deg: 0 }));
    assert_eq!(b.ask(Request::Stand), on_its_side);
    assert_eq!(b.ask(Request::Arm), on_its_side);
    // Cleared too early: the fault is back in the next cycle, and the answer is the same.
    assert_eq!(b.ask(Request::ClearFault(Fault::Tilt)), Ok(Mode::Damping));
    assert_eq!((b.ask(Request::Stand), b.controller.mode()), (on_its_side, Mode::Fault));
    // Nor is it armed so; lying on its side with the drives off is no fault.
    assert_eq!(b.ask(Request::ClearFault(Fault::Tilt)), Ok(Mode::Damping));
    assert_eq!(b.ask(Request::Disarm), Ok(Mode::Disarmed));
    let _ = b.ask(Request::ClearFault(Fault::Tilt));
    assert!(b.run(100).faults.is_empty());
    assert_eq!(b.ask(Request::Arm), on_its_side);
    assert_eq!(b.ask(Request::Stand), on_its_side);
    b.roll_rad = Some(0.1);
    assert_eq!(b.ask(Request::Arm), Ok(Mode::Damping));
    assert_eq!(b.ask(Request::Stand), Ok(Mode::StandingUp));
    b.until(Mode::Standing, 6.0);
}

#[test]
fn from_sitting_to_walking_and_back_to_disarmed() {
    let mut b = Bench::new(config());
    assert_eq!(b.cycle(&[], None).command, JointCommand::LIMP);
    b.load(&prepared());
    assert!(matches!(b.ask(Request::Walk), Err(Refusal::Mode { .. })));
    assert_eq!(b.ask(Request::Arm), Ok(Mode::Damping));
    let damped = b.run(1);
    assert!(damped.drives_on && damped.command.kp == [0.0; JOINTS] && damped.command.kd[0] > 0.0);
    assert_eq!(b.ask(Request::Stand), Ok(Mode::StandingUp));
    b.until(Mode::Standing, 6.0);
    assert_eq!(b.run(10).command.position_rad, config().stand.position_rad.map(resolution::position_rad));
    assert_eq!(b.ask(Request::Walk), Ok(Mode::Starting));
    let cycles = b.until(Mode::Walking, 2.0);
    assert!((599..=601).contains(&cycles), "start took {cycles} cycles");
    let walked = b.run(5000);
    assert_eq!(walked.mode, Mode::Walking);
    assert_eq!(walked.step_index, (5.0_f64 / 0.404) as u64);
    assert_eq!(b.ask(Request::Stop), Ok(Mode::Stopping));
    let cycles = b.until(Mode::Standing, 1.0);
    assert!(cycles <= 404, "a stop waits for one switch at most, took {cycles} cycles");
    b.run(500);
    assert_eq!(b.ask(Request::Sit), Ok(Mode::SittingDown));
    b.until(Mode::Disarmed, 6.0);
    let off = b.run(1);
    assert!(!off.drives_on);
    assert_eq!(off.command, JointCommand::LIMP);
}

#[test]
fn walk_asked_while_standing_up_is_a_goal() {
    let mut b = Bench::new(config());
    b.load(&prepared());
    b.ask(Request::Arm).unwrap();
    b.ask(Request::Stand).unwrap();
    assert_eq!(b.ask(Request::Walk), Ok(Mode::StandingUp));
    b.until(Mode::Walking, 6.0);

    let mut b = Bench::new(config());
    b.load(&prepared());
    b.ask(Request::Arm).unwrap();
    b.ask(Request::Stand).unwrap();
    b.ask(Request::Walk).unwrap();
    b.ask(Request::Stop).unwrap();
    assert_eq!(b.run(8000).mode, Mode::Standing, "stop takes the goal back");
}

#[test]
fn all_requests_in_one_cycle_are_taken_in_order() {
    let mut b = Bench::new(config());
    let output = b.cycle(&[Request::Arm, Request::Stand, Request::Walk], Some(&prepared()));
    assert_eq!(output.replies[0], Some(Ok(Mode::Damping)));
    assert_eq!(output.replies[1], Some(Ok(Mode::StandingUp)));
    assert_eq!(output.replies[2], Some(Ok(Mode::StandingUp)));
    assert_eq!(output.replies[3], None);
    b.until(Mode::Walking, 6.0);
    let many = [Request::Stop; MAX_REQUESTS + 1];
    let output = b.cycle(&many, None);
    assert_eq!(output.replies, [Some(Ok(Mode::Stopping)); MAX_REQUESTS], "no reply takes another's place");
    assert_eq!(output.reply(MAX_REQUESTS - 1), Some(Ok(Mode::Stopping)));
    assert_eq!(output.reply(MAX_REQUESTS), Some(Err(Refusal::TooMany)));
    assert_eq!((output.reply(MAX_REQUESTS + 1), output.requests_refused_unseen), (None, 1));
}

#[test]
fn commanded_positions_never_step_and_torques_never_leave_their_limit_on_any_day() {
    let c = config();
    let mut b = Bench::new(c.clone());
    b.load(&prepared());
    let mut last: Option<Output> = None;
    let plan: [(usize, Option<Request>); 9] = [
        (5, Some(Request::Arm)),
        (50, Some(Request::Stand)),
        (4000, Some(Request::Walk)),
        (2500, Some(Request::Stop)),
        (150, Some(Request::Walk)),
        (2000, Some(Request::Stand)),
        (1500, Some(Request::Sit)),
        (300, Some(Request::Stand)),
        (5000, Some(Request::Sit)),
    ];
    for (cycles, request) in plan {
        for n in 0..cycles {
            let requests: &[Request] = match (&request, n + 1 == cycles) {
                (Some(r), true) => &[*r],
                _ => &[],
            };
            let output = b.cycle(requests, None);
            if let Some(Err(e)) = output.replies[0] {
                panic!("{request:?}: {e}");
            }
            for j in 0..JOINTS {
                assert!(output.torque_nm[j].abs() <= c.torque_limit_nm[j] + 1e-9);
                if let Some(last) = last
                    && last.mode.is_moving()
                    && output.mode.is_moving()
                {
                    let step = (output.command.position_rad[j] - last.command.position_rad[j]).abs();
                    assert!(step <= c.velocity_limit_rad_s[j] * 0.001 + 1e-12, "{:?} joint {j}: {step}", output.mode);
                    // Every ramp meets its neighbours: nothing here moves faster than the gait itself.
                    assert!(step < 0.006, "{:?} joint {j}: {step}", output.mode);
                }
            }
            last = Some(output);
        }
    }
    b.until(Mode::Disarmed, 6.0);
}

#[test]
fn standing_up_starts_with_no_torque_wherever_the_legs_are() {
    let c = config();
    for offset in [-0.2, 0.1, 0.7] {
        let mut b = Bench::new(c.clone());
        b.position_rad = std::array::from_fn(|j| {
            (c.sit.position_rad[j] + if j % 3 == 0 { 0.3 * offset } else { offset })
                .clamp(c.position_min_rad[j], c.position_max_rad[j])
        });
        b.ask(Request::Arm).unwrap();
        let output = b.cycle(&[Request::Stand], None);
        assert_eq!(output.mode, Mode::StandingUp);
        assert_eq!(output.torque_nm, [0.0; JOINTS]);
        assert_eq!(output.command.position_rad, b.position_rad);
        b.until(Mode::Standing, 8.0);
    }
}

/// The command says the paper's law on the compensated reference, split into plan and torque: same torque at any state.
#[test]
fn a_nominal_walk_leaves_unaltered_and_gives_the_paper_s_torque() {
    let mut c = config();
    c.simulation_start = true;
    let (gait, prepared) = (gait(), prepared());
    let mut b = Bench::new(c);
    let (position, velocity) = gait.planned(StepSide::First, 0.0);
    (b.position_rad, b.velocity_rad_s) = (position, velocity);
    let first = b.cycle(&[Request::StartOnGait], Some(&prepared));
    assert_eq!(first.replies[0], Some(Ok(Mode::Walking)));
    let start = b.now;
    for n in 0..20_000_u64 {
        let output = if n == 0 { first } else { b.cycle(&[], None) };
        let elapsed = (b.now - start).as_secs_f64();
        let steps = (elapsed / 0.404 + 1e-9).floor();
        let s = ((elapsed - steps * 0.404).max(0.0)) / 0.404;
        let side = StepSide::of_step(steps as u64);
        assert_eq!(output.step_index, steps as u64);
        assert!((output.step_phase - s).abs() < 1e-12);
        // To the bit: nothing but its rounding has touched it.
        let at = prepared.at(side, s);
        assert_eq!(output.command.position_rad, at.position_rad.map(resolution::position_rad), "cycle {n}");
        assert_eq!(output.command.velocity_rad_s, at.velocity_rad_s.map(resolution::velocity_rad_s), "cycle {n}");
        assert_eq!(output.command.torque_nm, at.torque_nm.map(resolution::torque_nm), "cycle {n}");
        // At some other state, too.
        let q: [f64; JOINTS] = std::array::from_fn(|j| at.position_rad[j] + 0.01 * (j as f64 - 5.0));
        let v: [f64; JOINTS] = std::array::from_fn(|j| at.velocity_rad_s[j] - 0.3 * (j as f64 - 5.0));
        let law = law(&gait, side, s, &q, &v);
        for (sent, law) in output.command.torque(&q, &v).iter().zip(law) {
            assert!((sent - law).abs() < 4e-3, "cycle {n}: {sent} against {law}");
        }
    }
}

/// T = 0.35372… s is no multiple of 1 ms. After an hour the switches still lie at k T.
#[test]
fn switches_do_not_drift() {
    let duration = 0.353_721_987_3;
    let mut c = config();
    c.simulation_start = true;
    let gait = gait_at("odd", [0.0977, 0.985, 1.997], duration);
    let prepared = PreparedGait::new(&gait, &c).unwrap();
    let mut b = Bench::new(c);
    b.position_rad = gait.initial.joint_position_rad;
    b.cycle(&[Request::StartOnGait], Some(&prepared));
    let start = b.now;
    let mut last = 0;
    for _ in 0..3_600_000 / 8 {
        b.now += Duration::from_millis(7);
        let output = b.cycle(&[], None);
        if output.step_index != last {
            last = output.step_index;
            let elapsed = (b.now - start).as_secs_f64();
            let late = elapsed - last as f64 * duration;
            assert!((-1e-9..0.008 + 1e-9).contains(&late), "step {last} began {late} s late");
            assert!((output.step_phase - late.max(0.0) / duration).abs() < 1e-8);
        }
    }
    assert!(last > 10_000);
}

/// Out of standing the gait's motion about its middle posture grows; velocities are the positions' derivatives all the
/// way.
#[test]
fn out_of_standing_the_walk_grows_to_the_gait() {
    let c = config();
    let mut b = Bench::new(c.clone());
    b.load(&prepared());
    for request in [Request::Arm, Request::Stand, Request::Walk] {
        b.ask(request).unwrap();
    }
    b.until(Mode::Walking, 6.0);
    let (first, second) = (prepared().at(StepSide::First, 0.0), prepared().at(StepSide::Mirrored, 0.0));
    let mut last = b.last.unwrap();
    let size = |output: &Output| {
        let at = prepared().at(StepSide::of_step(output.step_index), output.step_phase);
        let (mut walked, mut planned) = (0.0_f64, 0.0_f64);
        for j in 0..JOINTS {
            let middle = 0.5 * (first.position_rad[j] + second.position_rad[j]);
            walked = walked.max((output.command.position_rad[j] - middle).abs());
            planned = planned.max((at.position_rad[j] - middle).abs());
        }
        (walked / planned, planned)
    };
    let mut share = 0.0;
    let cycles = (c.start_growth_s * 1e3) as usize;
    for n in 0..cycles - 1 {
        let output = b.run(1);
        let (now, planned) = size(&output);
        if planned > 0.05 {
            assert!(now > share - 1e-3 && now < 1.0 + 1e-3, "cycle {n}: {now} of the gait after {share}");
            share = now;
        }
        for j in 0..JOINTS {
            let moved = (output.command.position_rad[j] - last.command.position_rad[j]) * 1e3;
            let mean = 0.5 * (output.command.velocity_rad_s[j] + last.command.velocity_rad_s[j]);
            // Over a switch the plan's velocity may step; rounding is 3.8e-3 rad/s of a millisecond's motion.
            let switch = output.step_index != last.step_index;
            assert!(switch || (moved - mean).abs() < 0.02, "cycle {n} joint {j}: {moved} against {mean}");
        }
        last = output;
    }
    assert!(share > 0.95, "{share}");
    let whole = b.run(50);
    let at = prepared().at(StepSide::of_step(whole.step_index), whole.step_phase);
    assert_eq!(whole.command.position_rad, at.position_rad.map(resolution::position_rad));
    assert_eq!(whole.command.velocity_rad_s, at.velocity_rad_s.map(resolution::velocity_rad_s));
}

#[test]
fn a_walk_that_still_grows_stops_at_a_switch_and_takes_no_other_gait_yet() {
    let mut b = Bench::new(config());
    b.load(&prepared());
    for request in [Request::Arm, Request::Stand, Request::Walk] {
        b.ask(request).unwrap();
    }
    b.until(Mode::Walking, 6.0);
    b.run(100);
    let other = PreparedGait::new(&gait_at("other", [0.12, 1.0, 2.03], 0.37), &config()).unwrap();
    b.cycle(&[], Some(&other));
    let mut last = b.last.unwrap();
    let mut taken = None;
    for n in 0..4000 {
        let output = b.run(1);
        assert_eq!(output.mode, Mode::Walking);
        for j in 0..JOINTS {
            let step = output.command.position_rad[j] - last.command.position_rad[j];
            assert!(step.abs() < 0.006, "cycle {n} joint {j} stepped {step}");
        }
        let at = other.at(StepSide::of_step(output.step_index), output.step_phase);
        if taken.is_none() && output.command.position_rad == at.position_rad.map(resolution::position_rad) {
            taken = Some(n);
        }
        last = output;
    }
    assert!((1900..2900).contains(&taken.unwrap()), "{taken:?}");

    let mut b = Bench::new(config());
    b.load(&prepared());
    for request in [Request::Arm, Request::Stand, Request::Walk] {
        b.ask(request).unwrap();
    }
    b.until(Mode::Walking, 6.0);
    b.run(700);
    assert_eq!(b.ask(Request::Stop), Ok(Mode::Stopping));
    let mut last = b.last.unwrap();
    for n in 0..1000 {
        let output = b.run(1);
        for j in 0..JOINTS {
            let step = output.command.position_rad[j] - last.command.position_rad[j];
            assert!(step.abs() < 0.003, "cycle {n} joint {j} stepped {step}");
        }
        last = output;
    }
    assert_eq!(last.mode, Mode::Standing);
    assert_eq!(last.command.velocity_rad_s, [0.0; JOINTS]);
}

#[test]
fn torque_mode_sends_the_same_torque_without_gains() {
    let mut c = config();
    c.simulation_start = true;
    let mut impedance = Bench::new(c.clone());
    c.drive_mode = DriveMode::Torque;
    let mut torque = Bench::new(c);
    let gait = gait();
    for b in [&mut impedance, &mut torque] {
        b.position_rad = gait.initial.joint_position_rad;
        b.disturbance_rad = std::array::from_fn(|j| 0.01 * (j as f64 - 6.0));
        b.cycle(&[Request::StartOnGait], Some(&prepared()));
    }
    for _ in 0..2000 {
        let state = impedance.state();
        let (a, b) = (impedance.cycle(&[], None), torque.cycle(&[], None));
        assert_eq!(b.command.kp, [0.0; JOINTS]);
        assert_eq!(b.command.kd, [0.0; JOINTS]);
        let law = a.command.torque(&state.position_rad, &state.velocity_rad_s);
        for (law, sent) in law.iter().zip(b.command.torque_nm) {
            assert!((law - sent).abs() < 1e-9);
        }
    }
    // Damping is the drive's own in either mode.
    torque.emergency_stop = true;
    let damped = torque.cycle(&[], None);
    assert!(damped.command.kd[0] > 0.0 && damped.command.torque_nm == [0.0; JOINTS]);
}

#[test]
fn the_same_inputs_give_the_same_outputs_to_the_bit() {
    let run = || {
        let mut b = Bench::walking(config());
        b.disturbance_rad = std::array::from_fn(|j| 0.003 * j as f64);
        let mut bytes = Vec::new();
        for _ in 0..3000 {
            let output = b.cycle(&[], None);
            for v in output.command.torque_nm.iter().chain(&output.command.position_rad) {
                bytes.extend(v.to_bits().to_le_bytes());
            }
        }
        bytes
    };
    assert_eq!(run(), run());
}
