//! Which gaits and configurations are taken, and how one gait follows another.

mod common;
use common::*;
use control::resolution;
use control::*;
use gait::StepSide;

#[test]
fn a_gait_that_starts_near_is_taken_at_a_switch_without_a_jump() {
    let mut b = Bench::walking(config());
    let other = PreparedGait::new(&gait_at("other", [0.12, 1.0, 2.03], 0.37), &config()).unwrap();
    b.run(100);
    b.cycle(&[], Some(&other));
    let mut last = b.last.unwrap();
    let mut changed = None;
    for n in 0..1500 {
        let output = b.cycle(&[], None);
        assert_eq!(output.mode, Mode::Walking);
        assert!(output.step_index >= last.step_index, "steps go on counting");
        for j in 0..JOINTS {
            let step = output.command.position_rad[j] - last.command.position_rad[j];
            assert!(step.abs() < 0.006, "cycle {n} joint {j} stepped {step}");
            let speed = output.command.velocity_rad_s[j] - last.command.velocity_rad_s[j];
            assert!(speed.abs() < 0.3, "cycle {n} joint {j}: velocity stepped {speed}");
        }
        if changed.is_none()
            && b.controller.gait().unwrap().name().as_str() == "other"
            && output.step_phase < last.step_phase
        {
            changed = Some(n);
        }
        last = output;
    }
    assert!(changed.unwrap() < 404);
    let at = other.at(StepSide::of_step(last.step_index), last.step_phase);
    for j in 0..JOINTS {
        assert!((last.command.position_rad[j] - at.position_rad[j]).abs() < 3e-6);
    }
}

#[test]
fn a_gait_that_starts_far_is_taken_through_standing() {
    let mut b = Bench::walking(config());
    let far = PreparedGait::new(&gait_at("far", [0.15, 1.1, 2.2], 0.37), &config()).unwrap();
    b.cycle(&[], Some(&far));
    b.until(Mode::Standing, 1.0);
    b.until(Mode::Starting, 1.0);
    b.until(Mode::Walking, 1.0);
    let output = b.run(2500);
    assert_eq!(output.mode, Mode::Walking);
    let at = far.at(StepSide::of_step(output.step_index), output.step_phase);
    assert_eq!(output.command.position_rad, at.position_rad.map(resolution::position_rad));
}

#[test]
fn starting_on_the_gait_is_refused_unless_the_configuration_says_simulated() {
    let mut b = Bench::new(config());
    b.load(&prepared());
    assert_eq!(b.ask(Request::StartOnGait), Err(Refusal::NotSimulated));
}

#[test]
fn a_gait_whose_last_gains_stalled_is_walked_as_the_planner_decided() {
    let mut g = gait();
    g.solver.status = "acceptable".into();
    assert!(PreparedGait::new(&g, &config()).is_ok());
    for status in ["interpolated", "infeasible", "cancelled", "numerical trouble: x", ""] {
        g.solver.status = status.into();
        assert!(PreparedGait::new(&g, &config()).is_err(), "{status:?}");
    }
}

#[test]
fn bad_gaits_are_refused_by_what_is_wrong() {
    type Case = (&'static str, fn(&mut gait::Gait));
    let cases: [Case; 8] = [
        ("robot \"solo12\"", |g| g.robot = "solo12".into()),
        ("gains.kp[4]", |g| g.gains.kp[4] = 5000.0),
        ("gains.kd[0]", |g| g.gains.kd[0] = 0.0),
        ("planned position of front_left_knee", |g| {
            g.coefficients_rad[2][2] = -4.0;
            g.reference_coefficients_rad[2][2] = -4.0;
        }),
        ("planned torque of rear_left_knee", |g| g.reference_coefficients_rad[5] = [2.7; 6]),
        ("solver.status", |g| g.solver.status = "iteration limit".into()),
        ("request.slope_rad is 0.4, expected -0.35 to 0.35", |g| g.request["slope_rad"] = 0.4.into()),
        ("request.sideways_slope_rad is \"steep\"", |g| g.request["sideways_slope_rad"] = "steep".into()),
    ];
    for (expected, spoil) in cases {
        let mut g = gait();
        spoil(&mut g);
        let e = PreparedGait::new(&g, &config()).unwrap_err().to_string();
        assert!(e.contains(expected), "expected {expected:?} in {e:?}");
    }
}

#[test]
fn a_bad_configuration_is_refused_by_its_key() {
    type Case = (&'static str, fn(&mut Config));
    let cases: [Case; 5] = [
        ("state_timeout_s is NaN", |c| c.state_timeout_s = f64::NAN),
        ("torque_limit_nm of rear_left_knee", |c| c.torque_limit_nm[5] = -1.0),
        ("stand puts front_right_hip_pitch", |c| c.stand.position_rad[7] = 9.0),
        ("position limits of front_left_hip_roll", |c| c.position_max_rad[0] = -0.43),
        ("over_temperature_c is 70", |c| c.over_temperature_c = 70.0),
    ];
    for (expected, spoil) in cases {
        let mut c = config();
        spoil(&mut c);
        let e = Controller::new(c).unwrap_err().to_string();
        assert!(e.contains(expected), "expected {expected:?} in {e:?}");
    }
}
