//! The contract, for every backend and protocol that can run without hardware.

mod common;
use common::*;
use joint_bus::*;

#[test]
fn memory_with_mit_frames() {
    check_contract(&mut Bench::new(Mit::default(), bus_config("mit", 1.0), 0.002, 0.35));
}

#[test]
fn memory_with_register_frames() {
    check_contract(&mut Bench::new(Registers::default(), bus_config("registers", 1.0), 1e-5, 0.01));
}

#[test]
fn memory_with_gears_behind_the_drives() {
    check_contract(&mut Bench::new(Mit::default(), bus_config("mit", 2.0), 0.002, 0.7));
}

#[test]
fn the_shipped_bus_file_fits_the_shipped_robot() {
    let robot = robot::Robot::from_toml_str(
        include_str!("../../../config/robots/vision60/robot.toml"),
        include_str!("../../../config/robots/vision60/vision60.urdf"),
    )
    .unwrap();
    let text = include_str!("../../../config/hardware/vision60_can.toml");
    let bus = BusConfig::from_toml_str(text, &robot.name, &robot.joint_names()).unwrap();
    bus.check_ranges(&control::Config::for_robot(&robot).command_range()).unwrap();
    assert_eq!(bus.interfaces.len(), 4, "one bus for each leg");
}

/// The controller rounds what it measures and sends (joints::resolution); a drive's frame rounds at least ten times as
/// much.
#[test]
fn the_controller_s_rounding_is_lost_in_a_frame_s() {
    use joints::resolution::{STEP_NM, STEP_RAD, STEP_RAD_S};
    let text = include_str!("../../../config/hardware/vision60_can.toml");
    let bus = BusConfig::from_toml_str(text, "vision60", &joint_names()).unwrap();
    for joint in &bus.joints {
        let (ranges, gear) = (joint.ranges, joint.gear_ratio);
        let step = |range: f64, bits: u32| 2.0 * range / f64::from((1_u32 << bits) - 1);
        assert!(step(ranges.position_rad, 16) / gear >= 10.0 * STEP_RAD, "{}", joint.name);
        assert!(step(ranges.velocity_rad_s, 12) / gear >= 10.0 * STEP_RAD_S, "{}", joint.name);
        assert!(step(ranges.torque_nm, 12) * gear >= 10.0 * STEP_NM, "{}", joint.name);
    }
    // What all three together can move a torque by, at the gains that walk.
    let torque = 0.5 * (300.0 * STEP_RAD + 5.0 * STEP_RAD_S + STEP_NM);
    let frame = 0.5 * 2.0 * bus.joints[0].ranges.torque_nm / 4095.0;
    assert!(torque < 0.0025 && torque < 0.12 * frame, "{torque} N m beside {frame} N m");
}

#[test]
fn bad_bus_files_are_refused_by_what_is_wrong() {
    let text = bus_text("mit", 1.0);
    for (expected, from, to) in [
        ("robot is \"solo12\"", "robot = \"vision60\"", "robot = \"solo12\""),
        ("id of rear_left_hip_roll is 0", "interface = 1\nid = 1", "interface = 1\nid = 0"),
        ("sign of front_left_hip_roll is 0.5", "sign = 1.0", "sign = 0.5"),
        ("as that of front_left_hip_pitch on the same interface", "interface = 0\nid = 3", "interface = 0\nid = 2"),
        ("interface of front_right_hip_roll is 7", "interface = 2\nid = 1", "interface = 7\nid = 1"),
        ("unknown field `gearratio`", "gear_ratio", "gearratio"),
        ("format and version", "version = 1", "version = 2"),
        ("ranges.torque_nm of front_left_hip_roll is NaN", "torque_nm = 90.0", "torque_nm = nan"),
    ] {
        assert!(text.contains(from), "{from}");
        let error = BusConfig::from_toml_str(&text.replacen(from, to, 1), "vision60", &joint_names()).unwrap_err();
        assert!(error.to_string().contains(expected), "expected {expected:?} in {error}");
    }
}
