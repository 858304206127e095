//! The control cycle's leg kinematics against the rigid-body model, on robots whose legs differ.

use nalgebra::Vector3;
use rigid_body::{Data, frame_rotation, point_kinematics};
use robot::{LegKinematics, Robot, RobotError};
use std::path::PathBuf;

const TOML: &str = include_str!("../../../config/robots/vision60/robot.toml");
const URDF: &str = include_str!("../../../config/robots/vision60/vision60.urdf");

/// Numbers from −1 to 1, the same every time.
struct Numbers(u64);

impl Numbers {
    fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    }
}

fn vision60() -> Robot {
    Robot::from_toml_str(TOML, URDF).unwrap()
}

/// A Vision 60 whose elbows bend the other way, with pitch axes turned over, ahead of the roll axis and below it.
fn elbows_the_other_way() -> Robot {
    let urdf = URDF
        .replace("<axis xyz=\"0 1 0\"/>", "<axis xyz=\"0 KNEE 0\"/>")
        .replace("<axis xyz=\"0 -1 0\"/>", "<axis xyz=\"0 1 0\"/>")
        .replace("KNEE", "-1")
        .replace("xyz=\"-0.34 0 0\"", "xyz=\"0.34 0 0\"")
        .replace("xyz=\"0.3407 0 0\"", "xyz=\"-0.3407 0 0\"")
        .replace("<origin xyz=\"0 0.0975 0\"", "<origin xyz=\"0.05 0.0975 -0.02\"")
        .replace("<origin xyz=\"0 -0.0975 0\"", "<origin xyz=\"0.05 -0.0975 -0.02\"");
    Robot::from_toml_str(TOML, &urdf).unwrap()
}

/// A Vision 60 with axes a little off square, as URDFs with rounded angles have them.
fn askew() -> Robot {
    let urdf = URDF.replace("<axis xyz=\"0 -1 0\"/>", "<axis xyz=\"0.0002 -1 0\"/>");
    let toml = TOML.replace("[mirror]", "[mirror]\ntolerance = 0.01");
    Robot::from_toml_str(&toml, &urdf).unwrap()
}

/// Those, and the robots whose folders lie in the folder that TANDEM_ROBOTS names (tests/robots makes some).
fn robots() -> Vec<Robot> {
    let mut robots = vec![vision60(), elbows_the_other_way(), askew()];
    if let Some(folder) = std::env::var_os("TANDEM_ROBOTS") {
        let entries = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
        let mut folders: Vec<PathBuf> = entries.filter(|path| path.join("robot.toml").is_file()).collect();
        folders.sort();
        robots.extend(folders.iter().map(|folder| Robot::load(folder).unwrap()));
    }
    robots
}

fn within(robot: &Robot, leg: usize, numbers: &mut Numbers) -> [f64; 3] {
    let leg = &robot.legs[leg];
    std::array::from_fn(|k| {
        let (low, high) = (leg.position_min_rad[k], leg.position_max_rad[k]);
        (leg.stand_rad[k] + 0.5 * numbers.next()).clamp(low, high)
    })
}

#[test]
fn toe_jacobian_and_axes_are_the_model_s() {
    let mut numbers = Numbers(1);
    for robot in robots() {
        let mut data = Data::new(&robot.model);
        let legs = LegKinematics::all(&robot).unwrap();
        for n in 0..400 {
            let (leg, first) = (n % 4, 6 + 3 * (n % 4));
            let joints = within(&robot, leg, &mut numbers);
            let mut q = [0.0; 18];
            q[first..first + 3].copy_from_slice(&joints);
            let zero = [0.0; 18];
            let expected = point_kinematics(&robot.model, &mut data, &q, &zero, &zero, robot.legs[leg].toe);
            let (position, jacobian) = (expected.position, expected.jacobian.fixed_columns::<3>(first).into_owned());
            let found = legs[leg].toe(&joints);
            assert!((found.position_m - position).norm() < 1e-12, "{} leg {leg}", robot.name);
            assert!((legs[leg].toe_m(&joints) - position).norm() < 1e-12);
            assert!((found.jacobian - jacobian).norm() < 1e-12, "{} leg {leg}", robot.name);
            // The shank's angular velocity at unit joint velocities, by the change of its rotation.
            let rates = Vector3::new(0.3, -0.7, 0.9);
            let link = robot.model.frame_id(robot.model.link_name(first + 2)).unwrap();
            let before = frame_rotation(&robot.model, &data, link);
            let h = 1e-6;
            for k in 0..3 {
                q[first + k] += h * rates[k];
            }
            point_kinematics(&robot.model, &mut data, &q, &zero, &zero, robot.legs[leg].toe);
            let change = (frame_rotation(&robot.model, &data, link) * before.transpose()) / h;
            let turning = 0.5 * Vector3::new(change.m32 - change.m23, change.m13 - change.m31, change.m21 - change.m12);
            assert!((found.axes * rates - turning).norm() < 1e-5, "{} leg {leg}", robot.name);
        }
    }
}

#[test]
fn the_inverse_gives_the_joints_back() {
    let mut numbers = Numbers(2);
    for robot in robots() {
        let legs = LegKinematics::all(&robot).unwrap();
        let mut worst = 0.0_f64;
        let mut counted = 0;
        for n in 0..4000 {
            let leg = n % 4;
            let joints = within(&robot, leg, &mut numbers);
            let solution = legs[leg].joints(&legs[leg].toe_m(&joints));
            // Near a straight leg, or with the toe close to the roll axis, the inverse is bounded on purpose.
            let there = legs[leg].toe_m(&solution.joints_rad);
            if solution.limited {
                continue;
            }
            counted += 1;
            assert!((there - legs[leg].toe_m(&joints)).norm() < 1e-12, "{} leg {leg} {joints:?}", robot.name);
            for k in 0..3 {
                worst = worst.max((solution.joints_rad[k] - joints[k]).abs());
            }
        }
        assert!(counted > 2000, "{}: only {counted} within reach", robot.name);
        // An angle is known as well as the toe moves with it.
        assert!(worst < 1e-10, "{}: {worst:e} rad", robot.name);
    }
}

#[test]
fn what_is_out_of_reach_is_reported_and_stays_within_the_limits() {
    for robot in robots() {
        let legs = LegKinematics::all(&robot).unwrap();
        for leg in 0..4 {
            let about = &robot.legs[leg];
            let stand = legs[leg].toe_m(&about.stand_rad);
            assert!(!legs[leg].joints(&stand).limited, "{}", robot.name);
            for offset in [[0.0, 0.0, -1.0], [1.5, 0.0, 0.0], [0.0, 2.0, 0.0], [0.0, -2.0, 0.0], [f64::NAN, 0.0, 0.0]] {
                let target = stand + Vector3::from(offset) * legs[leg].length_m();
                let solution = legs[leg].joints(&target);
                assert!(solution.limited || offset[0].is_nan(), "{} {offset:?}", robot.name);
                for k in 0..3 {
                    let q = solution.joints_rad[k];
                    let inside = (about.position_min_rad[k]..=about.position_max_rad[k]).contains(&q);
                    assert!(inside || offset[0].is_nan(), "{} {offset:?} {q}", robot.name);
                }
            }
        }
    }
}

/// A toe asked for beyond the roll's stop is as high as it was asked to be.
#[test]
fn roll_at_its_stop_keeps_the_toe_s_height() {
    let robot = vision60();
    let leg = LegKinematics::of(&robot, 0).unwrap();
    let stand = leg.toe_m(&robot.legs[0].stand_rad);
    let target = stand + Vector3::new(0.0, 0.25, 0.05);
    let solution = leg.joints(&target);
    assert!(solution.limited);
    assert_eq!(solution.joints_rad[0].abs(), 0.43);
    let toe = leg.toe_m(&solution.joints_rad);
    assert!((toe.z - target.z).abs() < 1e-12 && (toe.x - target.x).abs() < 1e-12, "{toe:?} {target:?}");
    assert!(toe.y < target.y);
}

#[test]
fn a_leg_of_another_shape_is_refused_by_name() {
    let urdf = URDF.replace("<axis xyz=\"0 -1 0\"/>", "<axis xyz=\"0.03 -1 0\"/>");
    let toml = TOML.replace("[mirror]", "[mirror]\ntolerance = 0.5");
    let robot = Robot::from_toml_str(&toml, &urdf).unwrap();
    let error = LegKinematics::all(&robot).unwrap_err();
    assert!(matches!(error, RobotError::LegShape { .. }), "{error}");
    assert!(error.to_string().contains("front_left"), "{error}");
}
