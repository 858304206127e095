//! The estimator on motions that are known: a base that sways, turns and walks over toes that stand.

use estimator::{Config, Estimator, Health, Inertial, Input, Toe};
use joints::InertialState;
use nalgebra::{Rotation3, UnitQuaternion, Vector3};
use std::time::Duration;

const STEP_S: f64 = 1e-3;
const G: f64 = 9.81;

fn config() -> Config {
    Config::new(0.0)
}

/// A base that goes ahead at 0.3 m/s, sways 2 cm to the sides, rolls 0.05 rad and turns at 0.1 rad/s.
fn attitude(t: f64) -> UnitQuaternion<f64> {
    UnitQuaternion::from_euler_angles(0.05 * (9.0 * t).sin(), 0.02 * (7.0 * t).cos() - 0.02, 0.1 * t)
}

fn velocity(t: f64) -> Vector3<f64> {
    Vector3::new(0.3, 0.02 * 9.0 * (9.0 * t).cos(), 0.0)
}

/// What the sensors say of it at `t`; the first two toes stand.
fn input(t: f64) -> Input {
    let h = 1e-5;
    let (now, next) = (attitude(t), attitude(t + h));
    let turning = (now.inverse() * next).scaled_axis() / h;
    let acceleration = (velocity(t + h) - velocity(t - h)) / (2.0 * h);
    let force = now.inverse() * (acceleration + Vector3::new(0.0, 0.0, G));
    let toe = |x: f64, y: f64| {
        let position = Vector3::new(x, y, -0.55);
        // At rest in the world: J θ̇ = −Rᵀ v − ω × p.
        let velocity = -(now.inverse() * velocity(t)) - turning.cross(&position);
        Toe { position_m: position.into(), velocity_m_s: velocity.into(), shank_rad_s: [0.0; 3], stands: true }
    };
    Input {
        dt_s: STEP_S,
        inertial: Some(Inertial {
            angular_velocity_rad_s: turning.into(),
            specific_force_m_s2: force.into(),
            age_s: 0.0,
            attitude_xyzw: None,
        }),
        toes: [toe(0.3, 0.2), toe(-0.3, -0.2), Toe::default(), Toe::default()],
        phase: Some(0.5),
    }
}

/// Runs from rest at `t` = 0 for `seconds`, each input changed by `change`.
fn run(seconds: f64, mut change: impl FnMut(f64, &mut Input)) -> Estimator {
    let mut estimator = Estimator::default();
    let config = config();
    for n in 0..(seconds / STEP_S).round() as u32 {
        let t = f64::from(n) * STEP_S;
        let mut input = input(t);
        if n == 0 {
            let q = attitude(0.0);
            input.inertial.as_mut().unwrap().attitude_xyzw = Some([q.i, q.j, q.k, q.w]);
        }
        change(t, &mut input);
        estimator.step(&config, &input);
    }
    estimator
}

fn velocity_error(estimator: &Estimator, t: f64) -> f64 {
    (Vector3::from(estimator.velocity_m_s()) - velocity(t)).norm()
}

/// Angle between the estimated and the true vertical.
fn tilt_error(estimator: &Estimator, t: f64) -> f64 {
    let found = estimator.rotation().row(2).transpose();
    let truth = attitude(t).to_rotation_matrix().matrix().row(2).transpose();
    found.cross(&truth).norm()
}

#[test]
fn a_known_motion_is_found() {
    let estimator = run(10.0, |_, _| {});
    assert_eq!(estimator.health(), Health::Good);
    assert!(velocity_error(&estimator, 10.0) < 0.01, "{}", velocity_error(&estimator, 10.0));
    assert!(tilt_error(&estimator, 10.0) < 0.003, "{}", tilt_error(&estimator, 10.0));
    assert!((estimator.yaw_rad() - 1.0).abs() < 0.01, "{}", estimator.yaw_rad());
    // 3 m along the world's x: within 1 % of the distance walked.
    assert!((estimator.position_m()[0] - 3.0).abs() < 0.03, "{:?}", estimator.position_m());
    let variances = estimator.variances(&config());
    assert!(variances.position_m2.sqrt() > 0.02 && variances.velocity_m2_s2.sqrt() < 0.03, "{variances:?}");
}

#[test]
fn a_start_without_an_attitude_finds_the_vertical_it_stands_in() {
    let tilted = Rotation3::from_euler_angles(0.1, -0.2, 0.0);
    let mut estimator = Estimator::default();
    let toes = [Toe { stands: true, ..Toe::default() }; 4];
    for n in 0..500 {
        // Noise that a first sample alone would take for the vertical.
        let noise = 0.6 * f64::from(n * 7919 % 101 - 50) / 50.0;
        let force = tilted.inverse() * Vector3::new(noise, -noise, G);
        let inertial = Inertial {
            angular_velocity_rad_s: [0.0; 3],
            specific_force_m_s2: force.into(),
            age_s: 0.0,
            attitude_xyzw: None,
        };
        estimator.step(&config(), &Input { dt_s: STEP_S, inertial: Some(inertial), toes, phase: None });
    }
    let [roll, pitch] = estimator.roll_pitch_rad();
    assert!((roll - 0.1).abs() < 0.01 && (pitch + 0.2).abs() < 0.01, "{roll} {pitch}");
}

#[test]
fn a_constant_offset_of_the_gyroscope_is_found() {
    let estimator = run(60.0, |_, input| input.inertial.as_mut().unwrap().angular_velocity_rad_s[0] += 0.01);
    assert!(tilt_error(&estimator, 60.0) < 0.02, "{}", tilt_error(&estimator, 60.0));
}

/// One toe slides at 2 m/s for half a second: the estimate follows the other leg and the accelerometer.
#[test]
fn a_leg_that_slips_is_not_followed() {
    let slips = |t: f64, input: &mut Input| {
        if (3.0..3.5).contains(&t) {
            input.toes[0].velocity_m_s[0] += 2.0;
        }
    };
    let estimator = run(3.5, slips);
    assert!(velocity_error(&estimator, 3.5) < 0.15, "{}", velocity_error(&estimator, 3.5));
    assert!(estimator.variances(&config()).velocity_m2_s2 > 0.1);
    assert!(velocity_error(&run(4.0, slips), 4.0) < 0.02);
}

/// An encoder that is no number leaves its leg out, not the other.
#[test]
fn a_leg_without_numbers_is_left_out() {
    let estimator = run(5.0, |t, input| {
        if t > 2.0 {
            input.toes[1].velocity_m_s = [f64::NAN; 3];
        }
    });
    assert_eq!(estimator.health(), Health::Good);
    assert!(velocity_error(&estimator, 5.0) < 0.02, "{}", velocity_error(&estimator, 5.0));
}

#[test]
fn data_that_are_missing_old_or_no_numbers_have_a_name() {
    let mut estimator = Estimator::default();
    estimator.step(&config(), &Input { dt_s: STEP_S, ..Input::default() });
    assert_eq!(estimator.health(), Health::Waiting);
    let mut estimator = run(1.0, |_, _| {});
    let good = input(1.0);
    let with = |change: fn(&mut Inertial)| {
        let mut changed = good;
        change(changed.inertial.as_mut().unwrap());
        changed
    };
    for (input, expected) in [
        (with(|data| data.age_s = 0.03), Health::Stale),
        (with(|data| data.age_s = f64::NAN), Health::Stale),
        (with(|data| data.specific_force_m_s2[1] = f64::NAN), Health::Invalid),
        (with(|data| data.angular_velocity_rad_s[2] = f64::INFINITY), Health::Invalid),
        (with(|data| data.angular_velocity_rad_s[2] = 100.0), Health::Invalid),
        (with(|data| data.attitude_xyzw = Some([0.0; 4])), Health::Invalid),
        (Input { inertial: None, ..good }, Health::Stale),
        (good, Health::Good),
    ] {
        estimator.step(&config(), &input);
        assert_eq!(estimator.health(), expected, "{input:?}");
        assert!(estimator.velocity_m_s().iter().all(|v| v.is_finite()));
    }
    assert!(velocity_error(&estimator, 1.0) < 0.05);
}

/// A base that falls freely past the largest speed.
#[test]
fn a_speed_that_no_robot_has_is_out_of_bounds() {
    let estimator = run(3.0, |t, input| {
        if t > 1.0 {
            input.toes = [Toe::default(); 4];
            input.inertial.as_mut().unwrap().specific_force_m_s2[0] = 20.0;
        }
    });
    assert_eq!(estimator.health(), Health::OutOfBounds);
}

/// After numbers that are none it finds the vertical again, and does not go on as if the base were level.
#[test]
fn an_estimate_that_was_lost_begins_anew_where_the_base_is_tilted() {
    let tilted = Rotation3::from_euler_angles(0.3, -0.2, 0.0);
    let inertial = Inertial {
        angular_velocity_rad_s: [0.0; 3],
        specific_force_m_s2: (tilted.inverse() * Vector3::new(0.0, 0.0, G)).into(),
        age_s: 0.0,
        attitude_xyzw: None,
    };
    let toes = [Toe { stands: true, ..Toe::default() }; 4];
    let good = Input { dt_s: STEP_S, inertial: Some(inertial), toes, phase: None };
    let mut estimator = Estimator::default();
    estimator.step(&config(), &good);
    estimator.step(&config(), &Input { dt_s: f64::NAN, ..good });
    assert_eq!(estimator.health(), Health::OutOfBounds);
    estimator.step(&config(), &good);
    assert_eq!(estimator.health(), Health::Good);
    let [roll, pitch] = estimator.roll_pitch_rad();
    assert!((roll - 0.3).abs() < 0.01 && (pitch + 0.2).abs() < 0.01, "{roll} {pitch}");
}

/// Written down and read again half way, it goes on to the bit.
#[test]
fn it_goes_on_from_its_record_to_the_bit() {
    let mut first = run(2.0, |_, _| {});
    let mut second: Estimator = serde_json::from_str(&serde_json::to_string(&first).unwrap()).unwrap();
    for n in 0..1000 {
        let input = input(2.0 + f64::from(n) * STEP_S);
        first.step(&config(), &input);
        second.step(&config(), &input);
    }
    assert_eq!(first, second);
}

#[test]
fn constants_that_cannot_be_are_named() {
    assert_eq!(config().problem(), None);
    let bad = Config { velocity_s: f64::NAN, ..config() };
    assert!(bad.problem().unwrap().starts_with("velocity_s is NaN"));
}

#[test]
fn the_estimator_gets_a_unit_that_measures_both_with_its_age() {
    let whole = InertialState {
        stamp: Duration::from_secs(90),
        arrived: Duration::from_millis(20),
        attitude_xyzw: None,
        angular_velocity_rad_s: Some([0.1, 0.2, 0.3]),
        acceleration_m_s2: Some([0.0, 1.0, 9.0]),
    };
    let given = Inertial::of(&whole, Duration::from_millis(25)).unwrap();
    assert_eq!((given.angular_velocity_rad_s, given.specific_force_m_s2), ([0.1, 0.2, 0.3], [0.0, 1.0, 9.0]));
    assert!((given.age_s - 5e-3).abs() < 1e-12 && given.attitude_xyzw.is_none(), "{given:?}");
    let part =
        [InertialState { angular_velocity_rad_s: None, ..whole }, InertialState { acceleration_m_s2: None, ..whole }];
    assert!(part.iter().all(|unit| Inertial::of(unit, Duration::from_millis(25)).is_none()));
}
