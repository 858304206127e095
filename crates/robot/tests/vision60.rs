//! The robot that the project carries.

use nalgebra::Vector3;
use robot::{Robot, RobotError};

const TOML: &str = include_str!("../../../config/robots/vision60/robot.toml");
const URDF: &str = include_str!("../../../config/robots/vision60/vision60.urdf");

fn vision60() -> Robot {
    Robot::from_toml_str(TOML, URDF).expect("the project's own robot loads")
}

#[test]
fn has_the_published_numbers() {
    let robot = vision60();
    assert!((robot.model.total_mass() - 38.0).abs() < 1e-12);
    assert_eq!(robot.model.dof(), 18);
    assert_eq!(robot.joint_names()[4], "rear_left_hip_pitch");
    assert_eq!(robot.model.joint_names()[6..], robot.joint_names());
    assert_eq!(robot.stand_rad()[9..], [-0.21036, 1.02839, 2.05802]);
}

#[test]
fn stands_at_its_nominal_height_and_width() {
    let robot = vision60();
    for leg in 0..4 {
        let side = if leg < 2 { 1.0 } else { -1.0 };
        let toe = robot.toe_from_hip(leg, &robot.legs[leg].stand_rad);
        // The hip roll axes are 0.092865 m from the middle plane.
        let target = Vector3::new(0.0, side * (robot.nominal.half_width_m - 0.092865), -robot.nominal.height_m);
        assert!((toe - target).norm() < 1e-4, "{toe}");
    }
}

#[test]
fn inverse_kinematics_undoes_forward_kinematics() {
    let robot = vision60();
    for leg in 0..4 {
        for joints in [[0.2, 0.5, 1.2], [-0.3, 1.4, 2.4], [0.0, 0.94, 1.881], [0.4, -0.2, 0.7]] {
            let toe = robot.toe_from_hip(leg, &joints);
            let found = robot.joints_for_toe(leg, &toe).expect("the toe came from joint angles");
            for k in 0..3 {
                assert!((found[k] - joints[k]).abs() < 1e-8, "{found:?} for {joints:?}");
            }
        }
    }
    let far = robot.joints_for_toe(0, &Vector3::new(0.0, 0.1, -0.9));
    assert!(matches!(far, Err(RobotError::OutOfReach { .. })), "{far:?}");
}

#[test]
fn the_mirror_takes_the_left_side_to_the_right() {
    let robot = vision60();
    let joints: [f64; 12] = std::array::from_fn(|i| i as f64);
    assert_eq!(robot.mirror.apply(&joints), [-6.0, 7.0, 8.0, -9.0, 10.0, 11.0, -0.0, 1.0, 2.0, -3.0, 4.0, 5.0]);
    assert_eq!(robot.mirror.apply(&robot.mirror.apply(&joints)), joints);
}
