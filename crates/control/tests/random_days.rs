//! 10⁵ random events against a random robot: no illegal transition, no unbounded command, and no allocation.

mod common;
use common::*;
use control::*;
use std::time::Duration;

#[global_allocator]
static ALLOCATOR: realtime::CountingAllocator = realtime::CountingAllocator;

struct Random(u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        self.0
    }
    fn share(&mut self) -> f64 {
        (self.next() >> 11) as f64 / (1_u64 << 53) as f64
    }
    fn one_in(&mut self, n: u64) -> bool {
        self.next().is_multiple_of(n)
    }
}

/// The modes that may follow each mode from one cycle to the next, whatever happens. More than one transition can happen in
/// a cycle, hence the closure below.
fn may_follow(from: Mode, to: Mode) -> bool {
    use Mode as M;
    // Damping and fault from anywhere that is armed; everything armed is left for disarmed only from rest.
    let one_step = |a: Mode, b: Mode| {
        a == b
            || match b {
                M::Damping => a != M::Disarmed || b == M::Damping,
                M::Fault => a != M::Disarmed,
                M::Disarmed => matches!(a, M::Damping | M::Fault | M::SittingDown),
                M::StandingUp => matches!(a, M::Damping | M::SittingDown),
                M::Standing => matches!(a, M::StandingUp | M::Starting | M::Stopping),
                M::Starting => a == M::Standing,
                M::Walking => matches!(a, M::Starting | M::Stopping),
                M::Stopping => a == M::Walking,
                M::SittingDown => matches!(a, M::Standing | M::StandingUp),
            }
    };
    let mut reached = vec![from];
    for _ in 0..8 {
        for to in Mode::ALL {
            if !reached.contains(&to) && reached.iter().any(|a| one_step(*a, to)) {
                reached.push(to);
            }
        }
    }
    reached.contains(&to)
}

#[test]
fn a_hundred_thousand_random_events_break_nothing() {
    let c = config();
    let gaits = [
        prepared(),
        PreparedGait::new(&gait_at("other", [0.12, 1.0, 2.03], 0.37), &c).unwrap(),
        PreparedGait::new(&gait_at("far", [0.15, 1.1, 2.2], 0.31), &c).unwrap(),
    ];
    let mut seen = [0_u64; 9];
    let mut events = 0_u64;
    let mut seed = 1;
    while events < 100_000 {
        seed += 1;
        let mut random = Random((seed * 0x9e37_79b9_7f4a_7c15) | 1);
        let mut b = Bench::new(Config { posture_speed_rad_s: 5.0, ..c.clone() });
        // Half of the robots are left alone most of the time, so that they get far.
        let calm = random.one_in(2);
        let mut last: Option<Output> = None;
        for _ in 0..20_000 {
            b.now += PERIOD;
            let mut requests = [Request::Stop; 2];
            let mut count = 0;
            let mut gait = None;
            let mut tilt = None;
            let mut state = b.state();
            let mut present = true;
            if random.one_in(if calm { 400 } else { 40 }) {
                events += 1;
                let pick = random.next() % if calm { 9 } else { 20 };
                count = 1;
                match pick {
                    0 | 1 => requests[0] = Request::Arm,
                    2 | 3 => requests[0] = Request::Stand,
                    4 | 5 => requests[0] = Request::Walk,
                    6 => requests[0] = Request::Stop,
                    7 => requests[0] = Request::Sit,
                    8 => gait = Some(&gaits[(random.next() % 3) as usize]),
                    9 => requests[0] = Request::Disarm,
                    10 | 11 => {
                        let fault = Fault::ALL[(random.next() % Fault::ALL.len() as u64) as usize];
                        requests[0] = Request::ClearFault(fault);
                    }
                    12 => state.position_rad[(random.next() % 12) as usize] = f64::NAN,
                    13 => state.velocity_rad_s[(random.next() % 12) as usize] = 200.0 * (random.share() - 0.5),
                    14 => state.position_rad[(random.next() % 12) as usize] += random.share() - 0.5,
                    15 => tilt = Some(Tilt { roll_rad: 2.0 * random.share(), pitch_rad: 0.0 }),
                    16 => b.now += Duration::from_millis(random.next() % 100),
                    17 => state.drive_error[3] = random.next() as u8,
                    18 => b.emergency_stop = !b.emergency_stop,
                    _ => present = false,
                }
                if pick >= 8 {
                    count = usize::from(matches!(pick, 9..=11));
                }
            } else if !calm && b.emergency_stop && random.one_in(50) {
                b.emergency_stop = false;
            }
            let input = Input {
                joints: present.then_some(&state),
                tilt,
                requests: &requests[..count],
                gait,
                emergency_stop: b.emergency_stop,
                fault: None,
            };
            let before = realtime::allocations_of_this_thread();
            let output = b.controller.step(&input, b.now);
            assert_eq!(realtime::allocations_of_this_thread(), before, "a step allocated");

            seen[Mode::ALL.iter().position(|m| *m == output.mode).unwrap()] += 1;
            assert!(output.command.is_finite());
            if let Some(last) = last {
                assert!(may_follow(last.mode, output.mode), "{:?} → {:?}", last.mode, output.mode);
                // Straight out of walking nothing may lead to switched-off drives.
                assert!(!(last.mode == Mode::Walking && output.mode == Mode::Disarmed && count == 0));
            }
            match output.mode {
                Mode::Disarmed => assert_eq!(output.command, JointCommand::LIMP),
                Mode::Damping | Mode::Fault => {
                    assert_eq!(output.command.kp, [0.0; JOINTS]);
                    assert_eq!(output.command.torque_nm, [0.0; JOINTS]);
                }
                _ => {
                    assert!(output.faults.iter().all(|f| f.severity() == Severity::ControlledStop));
                    let (q, v) = (state.position_rad, state.velocity_rad_s);
                    for j in 0..JOINTS {
                        let position = output.command.position_rad[j];
                        assert!((c.position_min_rad[j]..=c.position_max_rad[j]).contains(&position));
                        assert!(output.command.velocity_rad_s[j].abs() <= c.velocity_limit_rad_s[j]);
                        assert!(output.torque_nm[j].abs() <= c.torque_limit_nm[j]);
                        assert!(output.command.torque_nm[j].abs() <= c.torque_limit_nm[j] + 1e-9);
                        if present && q[j].is_finite() {
                            let torque = output.command.joint_torque(j, q[j], v[j]);
                            assert!(torque.abs() <= c.torque_limit_nm[j] + 1e-6, "joint {j}: {torque} N m");
                        }
                    }
                }
            }
            // A robot that follows with some noise, and stays where it is when nothing holds it.
            for j in 0..JOINTS {
                if output.mode.is_moving() {
                    b.position_rad[j] = output.command.position_rad[j] + 0.01 * (random.share() - 0.5);
                    b.velocity_rad_s[j] = output.command.velocity_rad_s[j].clamp(-0.9, 0.9);
                } else {
                    b.velocity_rad_s[j] = 0.0;
                }
            }
            last = Some(output);
        }
    }
    for (mode, count) in Mode::ALL.iter().zip(seen) {
        assert!(count > 1000, "{mode:?} was hardly reached ({count} cycles): the test does not test it");
    }
}

#[test]
fn a_hundred_thousand_cycles_of_walking_allocate_nothing() {
    let mut b = Bench::walking(config());
    let mut state = b.state();
    let before = realtime::allocations_of_this_thread();
    for _ in 0..100_000 {
        b.now += PERIOD;
        state.stamp = b.now;
        state.arrived = [b.now; JOINTS];
        let output = b.controller.step(&Input { joints: Some(&state), ..Input::default() }, b.now);
        state.position_rad = output.command.position_rad;
        state.velocity_rad_s = output.command.velocity_rad_s;
        assert_eq!(output.mode, Mode::Walking);
    }
    assert_eq!(realtime::allocations_of_this_thread(), before);
}
