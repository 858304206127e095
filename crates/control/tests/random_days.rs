//! 10⁵ random events against a random robot: no illegal transition, no unbounded command, and no allocation.

mod common;
use common::*;
use control::*;
use std::time::Duration;

#[global_allocator]
static ALLOCATOR: realtime::CountingAllocator = realtime::CountingAllocator;

/// Whether one mode may follow another from one cycle to the next, when an operator asked this in between, and wants it
/// to walk or not. Written down anew, not taken from the controller's own table.
fn may_follow(from: Mode, to: Mode, request: Option<Request>, wanted: bool) -> bool {
    use Mode as M;
    let asked = |wanted: &[Request]| request.is_some_and(|request| wanted.contains(&request));
    from == to
        || match (from, to) {
            // Out of rest and out of trouble nothing leads but a person.
            (M::Disarmed, M::Damping) => asked(&[Request::Arm]),
            (M::Disarmed, _) => false,
            (M::Fault, M::Damping) => matches!(request, Some(Request::ClearFault(_))),
            (M::Fault | M::Damping, M::Disarmed) => asked(&[Request::Disarm]),
            (M::Damping, M::StandingUp) => asked(&[Request::Stand]),
            (M::Damping, M::Fault) => true,
            (M::Fault | M::Damping, _) => false,
            // Everything that moves ends in trouble at any time.
            (_, M::Damping | M::Fault) => true,
            (M::StandingUp, M::Standing) => true,
            (M::StandingUp | M::Standing, M::SittingDown) => asked(&[Request::Sit]),
            // Asked for just now, or before: it is begun as soon as the robot stands.
            (M::StandingUp | M::Standing | M::Stopping, M::Starting) => wanted,
            (M::Starting, M::Walking) => true,
            (M::Starting, M::Standing) => asked(&[Request::Stop, Request::Stand]),
            (M::Walking, M::Stopping) => asked(&[Request::Stop, Request::Stand]),
            // At a switch, where a gait came that cannot be taken while walking.
            (M::Walking, M::Standing) => true,
            (M::Stopping, M::Standing) => true,
            (M::Stopping, M::Walking) => asked(&[Request::Walk]),
            (M::SittingDown, M::Disarmed) => true,
            (M::SittingDown, M::StandingUp) => asked(&[Request::Stand]),
            _ => false,
        }
}

/// What one cycle of a random day brings.
struct Cycle<'a> {
    state: JointState,
    /// Whether the state is received.
    present: bool,
    request: Option<Request>,
    gait: Option<&'a PreparedGait>,
    inertial: Option<InertialState>,
    is_event: bool,
}

/// The next cycle: an event now and then, seldom on a calm day.
fn next_cycle<'a>(b: &mut Bench, random: &mut Random, calm: bool, gaits: &'a [PreparedGait; 3]) -> Cycle<'a> {
    b.now += PERIOD;
    let is_event = random.one_in(if calm { 400 } else { 40 });
    let mut cycle = Cycle { state: b.state(), present: true, request: None, gait: None, inertial: None, is_event };
    if !is_event {
        if !calm && b.emergency_stop && random.one_in(50) {
            b.emergency_stop = false;
        }
        return cycle;
    }
    let state = &mut cycle.state;
    match random.next() % if calm { 9 } else { 20 } {
        0 | 1 => cycle.request = Some(Request::Arm),
        2 | 3 => cycle.request = Some(Request::Stand),
        4 | 5 => cycle.request = Some(Request::Walk),
        6 => cycle.request = Some(Request::Stop),
        7 => cycle.request = Some(Request::Sit),
        8 => cycle.gait = Some(&gaits[(random.next() % 3) as usize]),
        9 => cycle.request = Some(Request::Disarm),
        10 | 11 => {
            let fault = Fault::ALL[(random.next() % Fault::ALL.len() as u64) as usize];
            cycle.request = Some(Request::ClearFault(fault));
        }
        12 => state.position_rad[(random.next() % 12) as usize] = f64::NAN,
        13 => state.velocity_rad_s[(random.next() % 12) as usize] = 200.0 * (random.share() - 0.5),
        14 => state.position_rad[(random.next() % 12) as usize] += random.share() - 0.5,
        15 => cycle.inertial = Some(rolled(2.0 * random.share())),
        16 => b.now += Duration::from_millis(random.next() % 100),
        17 => state.drive_error[3] = random.next() as u8,
        18 => b.emergency_stop = !b.emergency_stop,
        _ => cycle.present = false,
    }
    cycle
}

/// The modes follow one another as they may. `wanted`: to walk, by the operator's requests so far.
fn check_order(last: &Output, output: &Output, request: Option<Request>, wanted: &mut bool) {
    if let Some(Ok(_)) = output.replies[0] {
        *wanted = match request {
            Some(Request::Walk) => true,
            Some(Request::Stop | Request::Stand | Request::Sit | Request::Disarm) => false,
            _ => *wanted,
        };
    }
    assert!(
        may_follow(last.mode, output.mode, request, *wanted),
        "{:?} → {:?} after {request:?}, walking {}",
        last.mode,
        output.mode,
        if *wanted { "wanted" } else { "not wanted" }
    );
    *wanted &= !matches!(output.mode, Mode::Disarmed | Mode::Damping | Mode::Fault);
}

/// The command is what its mode allows, within every limit.
fn check_command(c: &Config, cycle: &Cycle, last: Option<&Output>, output: &Output) {
    assert!(output.command.is_finite());
    match output.mode {
        Mode::Disarmed => return assert_eq!(output.command, JointCommand::LIMP),
        Mode::Damping | Mode::Fault => {
            assert_eq!(output.command.kp, [0.0; JOINTS]);
            return assert_eq!(output.command.torque_nm, [0.0; JOINTS]);
        }
        _ => assert!(output.faults.iter().all(|f| f.severity() == Severity::ControlledStop)),
    }
    let (q, v) = (cycle.state.position_rad, cycle.state.velocity_rad_s);
    for j in 0..JOINTS {
        let position = output.command.position_rad[j];
        assert!((c.position_min_rad[j]..=c.position_max_rad[j]).contains(&position));
        assert!(output.command.velocity_rad_s[j].abs() <= c.velocity_limit_rad_s[j]);
        assert!(output.torque_nm[j].abs() <= c.torque_limit_nm[j]);
        if let Some(last) = last.filter(|last| last.mode.is_moving()) {
            let step = (position - last.command.position_rad[j]).abs();
            let limit = c.velocity_limit_rad_s[j] * c.control_period_s;
            assert!(step <= limit + 1e-12, "joint {j} stepped {step} rad of {limit}");
        }
        assert!(output.command.torque_nm[j].abs() <= c.torque_limit_nm[j] + 1e-9);
        if cycle.present && q[j].is_finite() {
            let torque = output.command.joint_torque(j, q[j], v[j]);
            assert!(torque.abs() <= c.torque_limit_nm[j] + 1e-6, "joint {j}: {torque} N m");
        }
    }
}

/// A robot that follows with some noise, and stays where it is when nothing holds it.
fn follow(b: &mut Bench, output: &Output, random: &mut Random) {
    for j in 0..JOINTS {
        if output.mode.is_moving() {
            b.position_rad[j] = output.command.position_rad[j] + 0.01 * (random.share() - 0.5);
            b.velocity_rad_s[j] = output.command.velocity_rad_s[j].clamp(-0.9, 0.9);
        } else {
            b.velocity_rad_s[j] = 0.0;
        }
    }
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
        let mut b = Bench::new(Config { posture_speed_rad_s: 3.0, ..c.clone() });
        // Half of the robots are left alone most of the time, so that they get far.
        let calm = random.one_in(2);
        let mut last: Option<Output> = None;
        let mut wanted = false;
        for _ in 0..20_000 {
            let cycle = next_cycle(&mut b, &mut random, calm, &gaits);
            events += u64::from(cycle.is_event);
            let input = Input {
                joints: cycle.present.then_some(&cycle.state),
                inertial: cycle.inertial,
                requests: cycle.request.as_slice(),
                gait: cycle.gait,
                emergency_stop: b.emergency_stop,
                ..Input::default()
            };
            let before = realtime::allocations_of_this_thread();
            let output = b.controller.step(&input, b.now);
            assert_eq!(realtime::allocations_of_this_thread(), before, "a step allocated");

            seen[Mode::ALL.iter().position(|m| *m == output.mode).unwrap()] += 1;
            if let Some(last) = &last {
                check_order(last, &output, cycle.request, &mut wanted);
            }
            check_command(&c, &cycle, last.as_ref(), &output);
            follow(&mut b, &output, &mut random);
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
