use super::{Drive, Velocity};
use crate::balanced::BalanceConfig;
use estimator::Estimator;
use robot::Robot;
use std::path::Path;

const DT_S: f64 = 1e-3;

fn config() -> BalanceConfig {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config/robots/vision60");
    BalanceConfig::for_robot(&Robot::load(&folder).unwrap()).unwrap()
}

/// Level, its heading along x.
fn estimate(velocity_m_s: [f64; 3], position_m: [f64; 3]) -> Estimator {
    let mut record = serde_json::to_value(Estimator::WAITING).unwrap();
    record["velocity_m_s"] = serde_json::json!(velocity_m_s);
    record["position_m"] = serde_json::json!(position_m);
    serde_json::from_value(record).unwrap()
}

const AHEAD: Velocity = Velocity { forward_m_s: 0.35, left_m_s: 0.0, yaw_rad_s: 0.0 };

/// Stance legs that run after a push take away what the body stands on: 60 N s are caught by placing and hurrying.
#[test]
fn an_error_of_speed_is_answered_by_the_stance_while_it_is_small_and_not_in_a_push() {
    let config = BalanceConfig { path_gain_s: 0.0, speed_integral_rate_s: 0.0, ..config() };
    let answer = |speed_m_s: f64| {
        let mut drive = Drive::new(&AHEAD, &estimate([0.35, 0.0, 0.0], [0.0; 3]));
        let estimate = estimate([speed_m_s, 0.0, 0.0], [0.0; 3]);
        (0..3000).for_each(|_| drive.step(&config, &AHEAD, &estimate, DT_S));
        drive.driven(&config).velocity.x - 0.35
    };
    let (small, large) = (answer(0.40), answer(1.85));
    assert!((-0.025..-0.018).contains(&small), "{small}");
    assert!((-0.005..0.0).contains(&large), "{large}");
    assert!((answer(0.30) + small).abs() < 1e-12, "to both sides alike");
}

/// Told 0.35 m/s and going 0.33 it would be 0.8 m short after 40 s.
#[test]
fn a_driven_robot_makes_up_for_where_its_commands_have_led_to_but_not_for_where_it_was_carried() {
    let config = BalanceConfig { speed_gain: 0.0, speed_integral_rate_s: 0.0, ..config() };
    let wanted = |left_m: f64| {
        let at = |t: f64, left_m: f64| estimate([0.35, 0.0, 0.0], [0.35 * t, left_m, 0.0]);
        let mut drive = Drive::new(&AHEAD, &at(0.0, 0.0));
        let mut left = |from: usize, to: usize, left_m: f64| {
            (from..to).for_each(|n| drive.step(&config, &AHEAD, &at(DT_S * n as f64, left_m), DT_S));
            drive.driven(&config).velocity.y
        };
        assert_eq!(left(0, 100, 0.0), 0.0, "where it was led");
        (left(100, 1000, left_m), left(1000, 2000, 0.0))
    };
    let (beside, back) = wanted(0.1);
    assert!((beside + 0.1 * config.path_gain_s).abs() < 1e-6, "{beside}");
    assert!(back.abs() < 1e-6, "{back}");
    let (carried, back) = wanted(3.0);
    assert!((carried + 0.2 * config.path_gain_s).abs() < 1e-6, "{carried}");
    assert!((back - 0.2 * config.path_gain_s).abs() < 1e-6, "where it was carried to is where it goes on from: {back}");
}

/// Told 0.1 m/s more than its gait goes, it goes 0.1 m/s once a lead has brought it to a gait that steps in place.
#[test]
fn what_is_walked_beyond_the_gaits_own_velocity_stays_where_a_lead_changes_that() {
    let config = BalanceConfig { speed_gain: 0.0, path_gain_s: 0.0, speed_integral_rate_s: 0.0, ..config() };
    let level = estimate([0.0; 3], [0.0; 3]);
    let walked = Velocity { forward_m_s: 0.45, left_m_s: -0.05, yaw_rad_s: 0.3 };
    let turning = Velocity { left_m_s: 0.02, yaw_rad_s: 0.2, ..AHEAD };
    let mut drive = Drive::new(&walked, &level);
    drive.go_over(&turning, &Velocity::default());
    let driven = drive.driven(&config);
    assert!((driven.velocity.x - 0.1).abs() < 1e-12 && (driven.velocity.y + 0.07).abs() < 1e-12, "{driven:?}");
    assert!((driven.yaw_rad_s - 0.1).abs() < 1e-12, "{driven:?}");
}
