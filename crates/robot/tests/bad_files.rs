//! Every way in which a robot's folder can be wrong gives one clear error.

#[path = "../../rigid_body/tests/mutated/mod.rs"]
mod mutated;

use mutated::mutated;
use robot::{Robot, RobotError};

const TOML: &str = include_str!("../../../config/robots/vision60/robot.toml");
const URDF: &str = include_str!("../../../config/robots/vision60/vision60.urdf");

/// The error after replacing `from`, which must be there, by `to` in the robot file.
fn toml_error(from: &str, to: &str) -> RobotError {
    assert!(TOML.contains(from), "the test's text '{from}' is no longer in robot.toml");
    Robot::from_toml_str(&TOML.replacen(from, to, 1), URDF).expect_err("the file is wrong")
}

fn urdf_error(from: &str, to: &str) -> RobotError {
    assert!(URDF.contains(from), "the test's text '{from}' is no longer in the URDF");
    Robot::from_toml_str(TOML, &URDF.replacen(from, to, 1)).expect_err("the file is wrong")
}

fn assert_says(error: RobotError, words: &[&str]) {
    let message = error.to_string();
    for word in words {
        assert!(message.contains(word), "'{message}' does not say '{word}'");
    }
}

#[test]
fn not_toml() {
    let error = Robot::from_toml_str("format = ", URDF).expect_err("not TOML");
    assert!(matches!(error, RobotError::Toml(_)), "{error}");
}

#[test]
fn an_unknown_or_missing_field_is_named() {
    assert_says(toml_error("toe_radius_m", "toe_radius_mm"), &["toe_radius_mm"]);
    assert_says(toml_error("toe_radius_m = 0.0325\n", ""), &["toe_radius_m"]);
}

#[test]
fn another_version() {
    assert_says(toml_error("version = 1", "version = 2"), &["version 2", "version 1"]);
    assert_says(toml_error("tandem-robot", "tandem-gait"), &["tandem-gait", "tandem-robot"]);
}

#[test]
fn a_joint_or_toe_that_does_not_exist() {
    let error = toml_error("\"front_left_knee\"]", "\"front_left_ankle\"]");
    assert_says(error, &["front_left", "front_left_ankle", "rear_right_knee"]);
    assert_says(toml_error("\"rear_left_toe\"", "\"rear_left_tow\""), &["rear_left_tow"]);
}

#[test]
fn a_leg_with_the_wrong_number_of_joints() {
    let error = toml_error("\"rear_right_hip_pitch\", ", "");
    assert_says(error, &["rear_right", "2 joints", "three"]);
    let three_legs = TOML.rsplit_once("[[legs]]").expect("the file has legs").0;
    let error = Robot::from_toml_str(three_legs, URDF).expect_err("three legs");
    assert_says(error, &["legs", "a list of 3", "four"]);
}

#[test]
fn joints_in_the_wrong_order() {
    let order = "\"front_left_hip_roll\", \"front_left_hip_pitch\"";
    let wrong = "\"front_left_hip_pitch\", \"front_left_hip_roll\"";
    assert_says(toml_error(order, wrong), &["front_left_hip_pitch", "the torso"]);
}

#[test]
fn a_toe_of_another_leg() {
    let error = toml_error("toe_link = \"front_left_toe\"", "toe_link = \"front_right_toe\"");
    assert_says(error, &["front_right_toe", "front_left_knee"]);
}

#[test]
fn a_joint_of_no_leg() {
    let error = urdf_error("name=\"rear_left_toe_fixed\" type=\"fixed\"", "name=\"ankle\" type=\"continuous\"");
    assert_says(error, &["ankle", "belongs to no leg"]);
}

#[test]
fn numbers_out_of_range() {
    for (from, to, field) in [
        ("toe_radius_m = 0.0325", "toe_radius_m = nan", "toe_radius_m"),
        ("height_m = 0.55", "height_m = inf", "height_m"),
        ("kp_nm_per_rad = [230.0", "kp_nm_per_rad = [-230.0", "kp_nm_per_rad[0]"),
        ("plan_torque_nm = [50.0, 50.0, 50.0]", "plan_torque_nm = [50.0, 50.0]", "plan_torque_nm"),
        ("joint_sign = [-1.0, 1.0, 1.0]", "joint_sign = [-1.0, 0.5, 1.0]", "joint_sign[1]"),
        ("leg = [2, 3, 0, 1]", "leg = [2, 3, 1, 0]", "mirror.leg"),
        ("leg = [2, 3, 0, 1]", "leg = [2, 9, 0, 1]", "mirror.leg"),
        ("position_min_rad = [-0.43", "position_min_rad = [0.44", "position_max_rad[0]"),
        ("stand_rad = [0.21036, 1.02839", "stand_rad = [0.21036, 2.940", "stand_rad[1]"),
        ("name = \"vision60\"", "name = \"../vision60\"", "name"),
    ] {
        assert_says(toml_error(from, to), &[field, "expected"]);
    }
}

#[test]
fn a_mirror_that_does_not_fit_names_the_link() {
    let error = toml_error("joint_sign = [-1.0, 1.0, 1.0]", "joint_sign = [1.0, 1.0, 1.0]");
    assert_says(error, &["front_left", "front_right", "joint_sign"]);
    // The front-left hip, 5 g heavier than the front-right one.
    let error = urdf_error("<mass value=\"1.975\"/>", "<mass value=\"1.98\"/>");
    assert_says(error, &["front_left_hip", "front_right_hip", "1.98", "1.975"]);
    let error = urdf_error("xyz=\"0 0.0975 0\"", "xyz=\"0 0.0975 0.001\"");
    assert_says(error, &["front_left_upper", "centre of mass"]);
    let error = urdf_error("ixx=\"0.00891458\"", "ixx=\"0.00891459\"");
    assert_says(error, &["front_left_hip", "inertia"]);
}

#[test]
fn a_mirror_tolerance_lets_a_slightly_lopsided_robot_in() {
    let toml = TOML.replacen("leg = [2, 3, 0, 1]", "leg = [2, 3, 0, 1]\ntolerance = 0.01", 1);
    let urdf = URDF.replacen("<mass value=\"1.975\"/>", "<mass value=\"1.98\"/>", 1);
    Robot::from_toml_str(&toml, &urdf).expect("within the tolerance");
}

#[test]
fn a_bad_urdf_is_reported_as_such() {
    assert_says(urdf_error("<mass value=\"17.9\"/>", "<mass value=\"-1\"/>"), &["torso", "-1"]);
}

#[test]
fn folders_that_cannot_be_read() {
    let missing = Robot::load(std::path::Path::new("/nowhere/robot")).expect_err("no such folder");
    assert_says(missing, &["/nowhere/robot/robot.toml"]);
    let folder = tempfile::tempdir().expect("a temporary folder");
    let toml = TOML.replacen("\"vision60.urdf\"", "\"../vision60.urdf\"", 1);
    std::fs::write(folder.path().join("robot.toml"), toml).expect("writes");
    assert_says(Robot::load(folder.path()).expect_err("outside"), &["../vision60.urdf"]);
    let hundred_mb = vec![b' '; 100 << 20];
    std::fs::write(folder.path().join("robot.toml"), TOML).expect("writes");
    std::fs::write(folder.path().join("vision60.urdf"), hundred_mb).expect("writes");
    assert_says(Robot::load(folder.path()).expect_err("too large"), &["vision60.urdf", "larger"]);
    std::fs::write(folder.path().join("vision60.urdf"), URDF).expect("writes");
    Robot::load(folder.path()).expect("a copy of the project's own robot");
}

/// Mutated robot files load or are refused, and never panic; what loads is within the file's own rules.
/// TANDEM_FUZZ_CASES sets how many.
#[test]
fn mutated_files_never_panic() {
    let cases = std::env::var("TANDEM_FUZZ_CASES").map_or(1_000, |n| n.parse().expect("a number of cases"));
    let mut state = 2026_u64;
    let mut random = || {
        // Marsaglia's xorshift: any generator does, if it is the same on every run.
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        (state >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
    };
    let mut loaded = 0;
    for _ in 0..cases {
        let text = mutated(TOML, &mut random);
        if let Ok(robot) = Robot::from_toml_str(&text, URDF) {
            loaded += 1;
            assert!(robot.nominal.height_m > 0.0 && robot.toe_radius_m >= 0.0, "{text}");
            for leg in &robot.legs {
                for joint in 0..3 {
                    let range = leg.position_min_rad[joint]..=leg.position_max_rad[joint];
                    assert!(range.contains(&leg.stand_rad[joint]) && leg.sit_rad[joint].is_finite(), "{text}");
                }
            }
            assert!(robot.limits.drive_torque_nm.iter().all(|limit| limit.is_finite() && *limit > 0.0), "{text}");
        }
    }
    assert!(loaded > cases / 100 && loaded < cases, "{loaded} of {cases} loaded");
}
