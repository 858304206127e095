//! A gait's lead: walked once, out of standing, before the gait's own steps.

mod common;
use common::*;
use control::*;
use gait::{Domain, Gait, StepSide};

/// Steps of the stepping gait as a lead, shorter and lower, and by less than is refused off where the gait begins.
fn with_lead() -> Gait {
    const OFF_RAD: f64 = 0.008;
    let mut gait = gait();
    let step = |side: StepSide, duration_s: f64| {
        let rows = gait.planned_coefficients(side);
        let lowered = rows.map(|row| row.map(|c| row[0] + 0.5 * (c - row[0]) + OFF_RAD));
        Domain { stands: side.stands(), duration_s, planned_rad: lowered, reference_rad: lowered }
    };
    gait.lead = vec![step(StepSide::First, 0.3), step(StepSide::Mirrored, 0.35)];
    gait.validate().unwrap();
    gait
}

fn with_lead_prepared() -> PreparedGait {
    PreparedGait::new(&with_lead(), &config()).unwrap()
}

/// Walking in its first cycle, out of standing.
fn leading() -> Bench {
    Bench::begun(&with_lead_prepared())
}

#[test]
fn no_joint_jumps_from_standing_through_the_lead_into_the_gait() {
    assert_begins_without_a_jump(&with_lead_prepared(), 6);
}

#[test]
fn the_lead_is_walked_once_with_its_own_durations_and_then_the_whole_gait() {
    let mut b = leading();
    let mut cycles = [0; 6];
    while let output = b.last.unwrap()
        && output.step_index < 6
    {
        cycles[output.step_index as usize] += 1;
        b.cycle(&[], None);
    }
    assert_eq!(cycles, [300, 350, 404, 404, 404, 404]);
    // Past what the lead's end left, the gait itself, from its first step on.
    let (output, prepared) = (b.run(300), prepared());
    let at = prepared.at(StepSide::of_step(output.step_index), output.step_phase);
    for j in 0..JOINTS {
        assert!((output.command.position_rad[j] - at.position_rad[j]).abs() < 3e-6, "joint {j}");
    }
}

#[test]
fn a_stop_within_the_lead_stands_at_its_next_switch() {
    for (after, at_most) in [(50, 250), (400, 250)] {
        let mut b = leading();
        let mut last = b.run(after);
        assert!(last.step_index < 2);
        b.ask(Request::Stop).unwrap();
        for _ in 0..at_most + 400 {
            let output = b.cycle(&[], None);
            for j in 0..JOINTS {
                let step = output.command.position_rad[j] - last.command.position_rad[j];
                assert!(step.abs() < 0.015, "{:?}, joint {j} jumped {step}", output.mode);
            }
            last = output;
        }
        assert_eq!(last.mode, Mode::Standing, "asked after {after} cycles");
        // And begins with the lead again.
        b.ask(Request::Walk).unwrap();
        b.until(Mode::Walking, 2.0);
        assert_eq!((b.until_step(1), b.until_step(2)), (300, 350));
    }
}

#[test]
fn a_fault_within_the_lead_damps_the_robot() {
    let mut b = leading();
    b.run(100);
    b.disturbance_rad[2] = 0.6;
    b.obeys = false;
    b.until(Mode::Fault, 0.2);
    assert!(is_damping(&b.run(1)));
}

#[test]
fn another_gait_that_comes_within_the_lead_waits_for_its_end() {
    let mut b = leading();
    let other = PreparedGait::new(&gait_at("other", [0.1, 0.99, 2.0], 0.37), &config()).unwrap();
    b.run(50);
    b.cycle(&[], Some(&other));
    assert_eq!((b.until_step(1), b.until_step(2)), (249, 350));
    // The step after what the lead left is still the gait's that led, then the other walks.
    assert_eq!((b.until_step(3), b.until_step(4)), (404, 370));
}

#[test]
fn a_snapshot_within_the_lead_goes_on_to_the_bit() {
    for after in [10, 299, 300, 301, 500, 700] {
        let mut b = leading();
        b.run(after);
        let mut again = b.resumed();
        for cycle in 0..1000 {
            let (there, here) = (b.cycle(&[], None), again.cycle(&[], None));
            assert_eq!(there, here, "cycle {cycle} after {after}");
        }
    }
}

#[test]
fn a_lead_that_is_no_two_steps_of_a_trot_or_breaks_a_limit_is_refused() {
    type Case = (&'static str, fn(&mut Gait));
    let cases: [Case; 4] = [
        ("lead is none that is walked: expected two domains", |g| {
            g.lead.remove(0);
        }),
        ("lead is none that is walked", |g| g.lead[0].stands = [true; 4]),
        ("lead is none that is walked", |g| g.lead.swap(0, 1)),
        ("the lead's planned position of front_left_knee", |g| {
            g.lead[0].planned_rad[2][2] = -4.0;
            g.lead[0].reference_rad[2][2] = -4.0;
        }),
    ];
    for (expected, spoil) in cases {
        let mut gait = with_lead();
        spoil(&mut gait);
        let e = PreparedGait::new(&gait, &config()).unwrap_err().to_string();
        assert!(e.contains(expected), "expected {expected:?} in {e:?}");
    }
}

/// The amble of the tests' file, which moves at its switches.
fn amble() -> Gait {
    Gait::from_json(include_str!("../../../tests/gaits/amble.json")).unwrap()
}

/// A gait that steps in place with its feet elsewhere, and two steps to it from where the amble's first begins.
fn with_lead_from_the_amble() -> Gait {
    const STEP_S: f64 = 0.3;
    let mut gait = gait_at("stepping", [0.05, 0.94, 1.9], 0.404);
    let ((begins_rad, rates_rad_s), (ends_rad, _)) =
        (amble().planned(StepSide::First, 0.0), gait.planned(StepSide::First, 0.0));
    let step = |side: StepSide, rows: [gait::Coefficients; JOINTS]| Domain {
        stands: side.stands(),
        duration_s: STEP_S,
        planned_rad: rows,
        reference_rad: rows,
    };
    let onto_the_feet = std::array::from_fn(|j| {
        let [begin, end] = [begins_rad[j], ends_rad[j]];
        [begin, begin + rates_rad_s[j] * STEP_S / 5.0, end, end, end, end]
    });
    let in_place = std::array::from_fn(|j| [ends_rad[j]; 6]);
    gait.lead = vec![step(StepSide::First, onto_the_feet), step(StepSide::Mirrored, in_place)];
    gait.validate().unwrap();
    gait
}

/// Walking the amble, grown up, in step `step`.
fn ambling(step: u64) -> Bench {
    let mut bench = Bench::begun(&PreparedGait::new(&amble(), &config()).unwrap());
    bench.until_step(step);
    bench
}

#[test]
fn a_far_gait_is_gone_over_to_by_its_lead_without_a_stop_or_a_jump() {
    let [amble, far] = [amble(), with_lead_from_the_amble()].map(|gait| PreparedGait::new(&gait, &config()).unwrap());
    let without = PreparedGait::new(&Gait { lead: Vec::new(), ..with_lead_from_the_amble() }, &config()).unwrap();
    assert!(may_follow(&amble, &far, &config()) && !may_follow(&amble, &without, &config()));
    // Asked for in either step, it waits for the beginning of a stride, whose step's index is even.
    for (asked_in, led_from) in [(20, 22), (21, 22)] {
        let mut b = ambling(asked_in);
        let mut last = b.cycle(&[], Some(&far));
        while last.step_index < led_from + 4 {
            let output = b.cycle(&[], None);
            assert_eq!(output.mode, Mode::Walking);
            for j in 0..JOINTS {
                let moved = output.command.position_rad[j] - last.command.position_rad[j];
                assert!(moved.abs() < 0.02, "step {} joint {j} jumped {moved}", output.step_index);
            }
            last = output;
        }
        let gaits_own = PreparedGait::at(&far, StepSide::First, last.step_phase);
        for j in 0..JOINTS {
            assert!((last.command.position_rad[j] - gaits_own.position_rad[j]).abs() < 3e-6, "joint {j}");
        }
        let times = [led_from, led_from + 1].map(|step| step_cycles(asked_in, &far, step));
        assert_eq!(times, [300, 300], "the lead's own durations");
    }
}

/// How many cycles step `step` takes where `far` was asked for in step `asked_in`.
fn step_cycles(asked_in: u64, far: &PreparedGait, step: u64) -> usize {
    let mut b = ambling(asked_in);
    b.cycle(&[], Some(far));
    b.until_step(step);
    b.until_step(step + 1)
}

#[test]
fn a_gait_whose_lead_comes_out_of_another_gait_grows_out_of_standing() {
    let mut b = Bench::new(config());
    b.load(&PreparedGait::new(&with_lead_from_the_amble(), &config()).unwrap());
    for request in [Request::Arm, Request::Stand, Request::Walk] {
        b.ask(request).unwrap();
    }
    b.until(Mode::Walking, 6.0);
    assert_eq!((b.until_step(1), b.until_step(2)), (404, 404), "the gait's own steps");
}

#[test]
fn a_snapshot_within_a_lead_out_of_another_gait_goes_on_to_the_bit() {
    let far = PreparedGait::new(&with_lead_from_the_amble(), &config()).unwrap();
    for step in [22, 23, 24] {
        let mut b = ambling(20);
        b.cycle(&[], Some(&far));
        b.until_step(step);
        b.run(50);
        let mut again = b.resumed();
        for cycle in 0..1000 {
            let (there, here) = (b.cycle(&[], None), again.cycle(&[], None));
            assert_eq!(there, here, "cycle {cycle} in step {step}");
        }
    }
}
