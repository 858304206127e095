//! A velocity begins a walk where the configuration wants it, and only where nothing forbids it.

mod common;
use common::balanced::{Bench, config, drive};
use control::{Config, Controller, Mode, Output, Refusal, Request, Snapshot, VelocityCommand};

/// Without a velocity for this long it stands, s.
const STAND_AFTER_S: f64 = 1.0;
const CYCLES: usize = 1000;

fn heeding() -> Config {
    let mut config = config(true);
    config.balance.as_mut().unwrap().stand_after_s = Some(STAND_AFTER_S);
    config
}

/// Standing, and nobody asked for anything for longer than it takes.
fn rested(config: Config) -> Bench {
    let mut bench = Bench::standing(config);
    bench.run(2 * CYCLES);
    assert_eq!(bench.controller.mode(), Mode::Standing);
    bench
}

/// Somebody asks for a velocity in each of so many cycles.
fn asked(bench: &mut Bench, forward_m_s: f64, cycles: usize) -> Vec<Output> {
    let one = |bench: &mut Bench| {
        bench.velocity = Some(VelocityCommand { velocity: drive(forward_m_s, 0.0, 0.0), arrived: bench.now });
        bench.cycle(&[])
    };
    (0..cycles).map(|_| one(bench)).collect()
}

fn modes(outputs: &[Output]) -> Vec<Mode> {
    let mut modes: Vec<_> = outputs.iter().map(|output| output.mode).collect();
    modes.dedup();
    modes
}

#[test]
fn a_velocity_begins_a_walk_its_silence_ends_it_and_so_again() {
    let mut bench = rested(heeding());
    for _ in 0..3 {
        let outputs = asked(&mut bench, 0.3, 5 * CYCLES);
        assert_eq!(modes(&outputs), [Mode::Starting, Mode::Walking]);
        assert!(outputs.last().unwrap().estimate.unwrap().velocity_m_s()[0] > 0.2);
        // Silent: old after the timeout, walked in place, then it stands.
        let outputs = bench.run(3 * CYCLES);
        assert_eq!(modes(&outputs), [Mode::Walking, Mode::Stopping, Mode::Standing]);
        let stopping = outputs.iter().position(|output| output.mode == Mode::Stopping).unwrap();
        let timeout_s = bench.controller.config().balance.unwrap().command_timeout_s;
        let expected = ((timeout_s + STAND_AFTER_S) * 1e3) as usize;
        assert!(stopping.abs_diff(expected) <= 2, "{stopping} instead of {expected} cycles");
    }
}

#[test]
fn a_velocity_of_zero_ends_a_walk_as_silence_does_and_begins_none() {
    let mut bench = rested(heeding());
    assert_eq!(modes(&asked(&mut bench, 0.0, 2 * CYCLES)), [Mode::Standing]);
    asked(&mut bench, 0.3, 3 * CYCLES);
    let outputs = asked(&mut bench, 0.0, 3 * CYCLES);
    assert_eq!(modes(&outputs), [Mode::Walking, Mode::Stopping, Mode::Standing]);
    // While it still starts, likewise.
    asked(&mut bench, 0.3, CYCLES / 10);
    assert_eq!(bench.controller.mode(), Mode::Starting);
    bench.velocity = None;
    let mut config = bench.controller.config().clone();
    config.start_blend_s = 10.0;
    let mut bench = rested(config);
    asked(&mut bench, 0.3, CYCLES / 10);
    assert_eq!(modes(&asked(&mut bench, 0.0, 2 * CYCLES)), [Mode::Starting, Mode::Standing]);
}

#[test]
fn a_velocity_that_comes_while_its_walk_ends_goes_on_walking() {
    let mut bench = rested(heeding());
    asked(&mut bench, 0.3, 4 * CYCLES);
    while bench.cycle(&[]).mode != Mode::Stopping {}
    assert_eq!(modes(&asked(&mut bench, 0.3, CYCLES)), [Mode::Walking]);
}

/// Not asked for by the configuration, without the balanced law, without data of an inertial unit, without a gait.
#[test]
fn a_velocity_begins_no_walk_where_it_is_not_to() {
    let mut silent = heeding();
    silent.balance = None;
    for config in [config(true), silent] {
        assert_eq!(modes(&asked(&mut rested(config), 0.3, 2 * CYCLES)), [Mode::Standing]);
    }
    let mut bench = rested(heeding());
    bench.unit_sends = false;
    bench.run(CYCLES);
    assert_eq!(modes(&asked(&mut bench, 0.3, CYCLES)), [Mode::Standing], "the estimate is not good");
    bench.unit_sends = true;
    assert_eq!(modes(&asked(&mut bench, 0.3, CYCLES)), [Mode::Standing], "what was refused does not begin later");
    bench.run(2 * CYCLES);
    assert_eq!(modes(&asked(&mut bench, 0.3, CYCLES / 2)), [Mode::Starting], "and now it is good");
}

#[test]
fn a_velocity_arms_nobody_and_lets_nobody_stand_up() {
    let mut bench = Bench::new(heeding());
    bench.joints.position_rad = bench.controller.config().stand.position_rad;
    assert_eq!(modes(&asked(&mut bench, 0.3, CYCLES)), [Mode::Disarmed]);
    bench.cycle(&[Request::Arm]);
    assert_eq!(modes(&asked(&mut bench, 0.3, CYCLES)), [Mode::Damping]);
    bench.velocity = None;
    bench.run(2 * CYCLES);
    assert_eq!(modes(&asked(&mut bench, 0.3, CYCLES)), [Mode::Damping]);
}

/// A key that is still held, a planner that still sends: what an operator asked for holds.
#[test]
fn what_an_operator_asks_for_holds_until_the_velocity_was_at_rest() {
    let mut bench = rested(heeding());
    asked(&mut bench, 0.3, 4 * CYCLES);
    let stopped = bench.cycle(&[Request::Stop]);
    assert_eq!(stopped.reply(0), Some(Ok(Mode::Stopping)));
    assert_eq!(modes(&asked(&mut bench, 0.3, 3 * CYCLES)), [Mode::Stopping, Mode::Standing]);
    // A short gap is none.
    asked(&mut bench, 0.0, CYCLES / 2);
    assert_eq!(modes(&asked(&mut bench, 0.3, CYCLES)), [Mode::Standing]);
    asked(&mut bench, 0.0, CYCLES + 2);
    assert_eq!(modes(&asked(&mut bench, 0.3, 2 * CYCLES)), [Mode::Starting, Mode::Walking]);
    // Sitting down likewise.
    bench.cycle(&[Request::Stop]);
    asked(&mut bench, 0.3, CYCLES);
    assert_eq!(bench.cycle(&[Request::Sit]).reply(0), Some(Ok(Mode::SittingDown)));
    assert!(!modes(&asked(&mut bench, 0.3, 5 * CYCLES)).contains(&Mode::Starting));
}

#[test]
fn the_emergency_stop_damps_and_no_velocity_leads_out_of_it() {
    let mut bench = rested(heeding());
    asked(&mut bench, 0.3, 4 * CYCLES);
    bench.emergency_stop = true;
    assert_eq!(modes(&asked(&mut bench, 0.3, CYCLES)), [Mode::Damping]);
    bench.emergency_stop = false;
    assert_eq!(modes(&asked(&mut bench, 0.3, CYCLES)), [Mode::Damping]);
    assert_eq!(bench.cycle(&[Request::Walk]).reply(0).map(|reply| reply.is_err()), Some(true));
    // Stood up again by a person while the key is held: it stands.
    bench.cycle(&[Request::Stand]);
    let outputs = asked(&mut bench, 0.3, 4 * CYCLES);
    assert_eq!(modes(&outputs), [Mode::StandingUp, Mode::Standing]);
}

/// A walk that an operator began goes on for as long as nobody has ever driven.
#[test]
fn a_walk_that_was_requested_is_not_ended_by_a_client_that_never_was() {
    let mut bench = Bench::walked_out_of_standing(heeding());
    assert_eq!(modes(&bench.run(5 * CYCLES)), [Mode::Walking]);
    asked(&mut bench, 0.3, CYCLES);
    assert_eq!(modes(&bench.run(3 * CYCLES)), [Mode::Walking, Mode::Stopping, Mode::Standing]);
}

#[test]
fn it_goes_on_from_its_record_to_the_bit_and_older_records_are_read() {
    let mut first = rested(heeding());
    asked(&mut first, 0.3, CYCLES / 2);
    let text = serde_json::to_value(first.controller.snapshot()).unwrap();
    let read: Snapshot = serde_json::from_value(text.clone()).unwrap();
    let mut second = first.clone();
    second.controller = Controller::resume(first.controller.config().clone(), &read).unwrap();
    assert_eq!(asked(&mut first, 0.3, 4 * CYCLES), asked(&mut second, 0.3, 4 * CYCLES));
    assert_eq!(first.run(4 * CYCLES), second.run(4 * CYCLES));
    let mut old = text;
    old["day"].as_object_mut().unwrap().remove("heed").expect("the day has it");
    serde_json::from_value::<Snapshot>(old).unwrap();
}

#[test]
fn without_a_gait_a_velocity_begins_nothing() {
    let mut bench = Bench::new(heeding());
    bench.joints.position_rad = bench.controller.config().stand.position_rad;
    bench.has_gait = false;
    bench.cycle(&[Request::Arm]);
    bench.cycle(&[Request::Stand]);
    bench.run(5 * CYCLES);
    assert_eq!(bench.cycle(&[Request::Walk]).reply(0), Some(Err(Refusal::NoGait)));
    bench.run(2 * CYCLES);
    assert_eq!(modes(&asked(&mut bench, 0.3, CYCLES)), [Mode::Standing]);
}
