//! Gaits whose stride is a cycle of domains other than the trot's two steps.

mod common;
use common::*;
use control::balanced::BalanceConfig;
use control::*;
use gait::{Domain, Gait};

#[global_allocator]
static ALLOCATOR: realtime::CountingAllocator = realtime::CountingAllocator;

/// One leg lifts at a time: rear left, front left, rear right, front right, each for its own time.
const SWINGS: [usize; 4] = [1, 0, 3, 2];
const DURATIONS_S: [f64; 4] = [0.25, 0.3505, 0.2995, 0.3];

fn crawl_at(name: &str, posture: [f64; 3]) -> Gait {
    let at = both_sides(posture);
    let lift = both_sides([0.05, 0.0, -0.45]);
    let load = both_sides([-0.09, -0.04, 0.13]);
    let shape = [0.0, 0.0, 1.0, 1.0, 0.0, 0.0];
    let domain = |index: usize| {
        let swings = |j: usize| j / 3 == SWINGS[index];
        let planned_rad =
            std::array::from_fn(|j| shape.map(|share| at[j] + if swings(j) { share * lift[j] } else { 0.0 }));
        let reference_rad: [[f64; 6]; JOINTS] =
            std::array::from_fn(|j| planned_rad[j].map(|c: f64| if swings(j) { c + 0.01 } else { c + load[j] }));
        let stands = std::array::from_fn(|leg| leg != SWINGS[index]);
        Domain { stands, duration_s: DURATIONS_S[index], planned_rad, reference_rad }
    };
    let cycle: Vec<Domain> = (0..4).map(domain).collect();
    let gait = Gait {
        coefficients_rad: cycle[0].planned_rad,
        reference_coefficients_rad: cycle[0].reference_rad,
        cycle,
        ..gait_at(name, posture, 0.3)
    };
    gait.validate().unwrap();
    gait
}

fn crawl() -> PreparedGait {
    PreparedGait::new(&crawl_at("crawl", [0.0977, 0.985, 1.997]), &config()).unwrap()
}

/// Walking the whole crawl, in the first cycle of a stride.
fn crawling() -> Bench {
    let mut bench = Bench::begun(&crawl());
    bench.until_step(8);
    bench
}

#[test]
fn each_domain_is_walked_for_its_own_time_and_strides_do_not_drift() {
    let mut b = crawling();
    // The stride takes 1.2 s, though no domain but one is a whole number of cycles.
    for stride in 0..50 {
        let cycles: Vec<usize> = (1..=4).map(|step| b.until_step(8 + 4 * stride + step)).collect();
        assert_eq!(cycles.iter().sum::<usize>(), 1200, "{cycles:?} in stride {stride}");
        for (cycles, duration_s) in cycles.iter().zip(DURATIONS_S) {
            assert!((*cycles as f64 - 1000.0 * duration_s).abs() < 1.0, "{cycles} of {duration_s} s");
        }
    }
}

#[test]
fn the_command_is_each_domains_own_plan_and_only_its_leg_lifts() {
    let (mut b, gait) = (crawling(), crawl());
    let standing = b.last.unwrap().command.position_rad;
    for step in 0..8 {
        let index = step % 4;
        b.until_step(8 + step as u64);
        let output = b.run(130);
        let at = gait.at_step(Step::Cycle(index), output.step_phase);
        for j in 0..JOINTS {
            let away = output.command.position_rad[j] - at.position_rad[j];
            assert!(away.abs() < 3e-6, "step {step} joint {j}: {away}");
            let lifted = (output.command.position_rad[j] - standing[j]).abs() > 0.02;
            assert!(!lifted || j / 3 == SWINGS[index], "step {step} joint {j} moves");
        }
        let knee = 3 * SWINGS[index] + 2;
        assert!((output.command.position_rad[knee] - standing[knee]).abs() > 0.2, "step {step} lifts no leg");
    }
}

#[test]
fn no_joint_jumps_from_standing_into_the_cycle_and_at_its_switches() {
    assert_begins_without_a_jump(&crawl(), 10);
}

#[test]
fn a_stop_within_any_domain_stands_at_the_next_switch() {
    for (step, duration_s) in DURATIONS_S.into_iter().enumerate() {
        let mut b = crawling();
        b.until_step(8 + step as u64);
        let mut last = b.run(100);
        b.ask(Request::Stop).unwrap();
        let mut moving = 0;
        while last.mode == Mode::Stopping || last.mode == Mode::Walking {
            let output = b.cycle(&[], None);
            for j in 0..JOINTS {
                let jump = output.command.position_rad[j] - last.command.position_rad[j];
                assert!(jump.abs() < 0.015, "{:?}, joint {j} jumped {jump}", output.mode);
            }
            (last, moving) = (output, moving + 1);
        }
        assert_eq!(last.mode, Mode::Standing, "out of step {step}");
        assert!(moving as f64 <= 1000.0 * duration_s - 100.0, "{moving} cycles out of step {step}");
        b.run(500);
        b.ask(Request::Walk).unwrap();
        b.until(Mode::Walking, 2.0);
        assert_eq!(b.until_step(1), 250, "it begins with the first domain again");
    }
}

#[test]
fn the_emergency_stop_and_a_thrown_joint_damp_within_the_cycle() {
    let mut b = crawling();
    b.run(300);
    b.emergency_stop = true;
    assert!(is_damping(&b.cycle(&[], None)));
    let mut b = crawling();
    b.run(300);
    b.disturbance_rad[2] = 0.6;
    b.obeys = false;
    b.until(Mode::Fault, 0.2);
    assert!(is_damping(&b.run(1)));
}

#[test]
fn another_gait_of_the_same_legs_is_taken_at_the_next_switch_and_one_of_others_after_standing() {
    let mut b = crawling();
    b.run(50);
    let near = PreparedGait::new(&crawl_at("near", [0.1, 0.99, 2.0]), &config()).unwrap();
    assert!(control::may_follow(&crawl(), &near, &config()));
    b.cycle(&[], Some(&near));
    b.until_step(9);
    assert_eq!(b.controller.gait().unwrap().name().as_str(), "near");
    assert_eq!(b.last.unwrap().mode, Mode::Walking);
    let output = b.run(300);
    // The second domain lifts the front left leg.
    let at = near.at_step(Step::Cycle(1), output.step_phase);
    assert!((output.command.position_rad[2] - at.position_rad[2]).abs() < 3e-6);
    assert!((output.command.position_rad[2] - 2.0).abs() > 0.05);
    // The trot's posture is the same, its legs are not.
    let trot = prepared();
    assert!(!control::may_follow(&near, &trot, &config()) && !control::may_follow(&trot, &near, &config()));
    b.cycle(&[], Some(&trot));
    b.until(Mode::Standing, 0.5);
    b.until(Mode::Walking, 3.0);
    assert_eq!(b.controller.gait().unwrap().name().as_str(), "stepping");
}

#[test]
fn a_snapshot_within_the_cycle_goes_on_to_the_bit() {
    for after in [10, 249, 250, 251, 700] {
        let mut b = crawling();
        b.run(after);
        let mut again = b.resumed();
        for cycle in 0..2000 {
            let (there, here) = (b.cycle(&[], None), again.cycle(&[], None));
            assert_eq!(there, here, "cycle {cycle} after {after}");
        }
    }
}

#[test]
fn a_stride_of_a_cycle_allocates_nothing() {
    let mut b = crawling();
    let before = realtime::allocations_of_this_thread();
    b.run(2500);
    assert_eq!(realtime::allocations_of_this_thread(), before);
}

#[test]
fn a_lead_into_a_cycle_is_walked_once() {
    let mut gait = crawl_at("led", [0.0977, 0.985, 1.997]);
    gait.lead = vec![Domain { stands: [true; 4], duration_s: 0.2, ..gait.cycle[1].clone() }, gait.cycle[3].clone()];
    let mut b = Bench::begun(&PreparedGait::new(&gait, &config()).unwrap());
    let cycles: Vec<_> = [1, 2, 3, 4, 5, 6, 7].map(|step| b.until_step(step)).into();
    assert_eq!(cycles, [200, 300, 250, 351, 299, 300, 250]);
}

/// The trot's two steps as a cycle of domains: the same walk, under both laws.
#[test]
fn a_trot_written_as_a_cycle_is_walked_as_the_trot() {
    let trot = Gait::from_json(include_str!("../../../tests/gaits/amble.json")).unwrap();
    let as_cycle = Gait { cycle: trot.schedule(), ..trot.clone() };
    for balanced in [false, true] {
        let config = common::balanced::config(balanced);
        let [mut a, mut b] = [&trot, &as_cycle].map(|gait| {
            let mut bench = common::balanced::Bench::new(config.clone());
            bench.gait = PreparedGait::new(gait, &config).unwrap();
            bench
        });
        for bench in [&mut a, &mut b] {
            bench.run(5);
            bench.cycle(&[Request::StartOnGait]);
        }
        for cycle in 0..3000 {
            let [there, here] = [&mut a, &mut b].map(|bench| bench.cycle(&[]));
            assert_eq!((there.mode, here.mode), (Mode::Walking, Mode::Walking), "cycle {cycle}: {:?}", here.report);
            assert_eq!((there.step_index, there.balance.is_some()), (here.step_index, balanced));
            for j in 0..JOINTS {
                let [a, b] = [&there, &here].map(|output| output.command.position_rad[j]);
                assert!((a - b).abs() < 1e-9, "balanced {balanced}, cycle {cycle}, joint {j}: {a} and {b}");
            }
        }
    }
}

/// The body rolls and pitches as planned over two legs of a side or an end, which the balanced law does not know.
#[test]
fn the_balanced_law_refuses_steps_over_two_legs_of_a_side_or_an_end_by_name() {
    let config = common::balanced::config(true);
    let trot = Gait::from_json(include_str!("../../../tests/gaits/amble.json")).unwrap();
    for (legs, named) in [
        ([0, 1], "cycle[0].stance_legs are front_left and rear_left"),
        ([1, 3], "cycle[0].stance_legs are rear_left and rear_right"),
    ] {
        let mut gait = Gait { cycle: trot.schedule(), ..trot.clone() };
        gait.cycle[0].stands = std::array::from_fn(|leg| legs.contains(&leg));
        gait.cycle[1].stands = gait.cycle[0].stands.map(|stands| !stands);
        let e = PreparedGait::new(&gait, &config).unwrap_err().to_string();
        assert!(e.contains(named) && e.contains("walk it under the bare law"), "{e}");
        PreparedGait::new(&gait, &Config { balance: None::<BalanceConfig>, ..config.clone() }).unwrap();
    }
}
