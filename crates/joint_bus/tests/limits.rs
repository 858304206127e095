//! What a wiring file may say of the limits that travel with every command, and what it is refused for.

use joint_bus::BusConfig;

const WIRING: &str = include_str!("../../../config/hardware/vision60_can.toml");

fn vision60() -> robot::Robot {
    robot::Robot::load(&std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config/robots/vision60")).unwrap()
}

fn read(protocol: &str, limits: &str) -> Result<BusConfig, String> {
    let text = WIRING.replacen("protocol = \"mit\"", &format!("protocol = \"{protocol}\""), 1);
    // A table of its own, so before the first table of the file.
    let at = text.find("\n[").unwrap();
    let text = format!("{}\n{limits}\n{}", &text[..at], &text[at..]);
    BusConfig::from_toml_str(&text, "vision60", &vision60().joint_names()).map_err(|error| error.to_string())
}

#[test]
fn limits_that_cannot_be_meant_are_refused_by_name() {
    for (protocol, limits, expected) in [
        ("mit", "[limits]\nmax_torque_nm = 5.0", "limits are given, mit frames have no room for them"),
        ("registers", "[limits]\nmax_torque_nm = 0.0", "limits.max_torque_nm is 0, expected more than 0"),
        ("registers", "[limits]\nmax_torque_nm = -3.0", "limits.max_torque_nm is -3, expected more than 0"),
        ("registers", "[limits]\nmax_torque_nm = nan", "limits.max_torque_nm is NaN, expected more than 0"),
        ("registers", "[limits]\nmax_torque_nm = 1e6", "at most 1e5"),
        ("registers", "[limits]\nwatchdog_s = 0.0005", "limits.watchdog_s is 0.0005, expected 0.001 to 1"),
        ("registers", "[limits]\nwatchdog_s = 2.0", "limits.watchdog_s is 2, expected 0.001 to 1"),
        ("registers", "[limits]\nmax_torqe_nm = 5.0", "max_torqe_nm"),
    ] {
        let refused = read(protocol, limits).expect_err(limits);
        assert!(refused.contains(expected), "{limits}: {refused}");
    }
}

#[test]
fn every_drive_gets_the_limits_of_the_file_or_else_its_range_and_20_ms() {
    let given = read("registers", "[limits]\nmax_torque_nm = 12.5\nwatchdog_s = 0.01").unwrap();
    for joint in &given.joints {
        assert_eq!((joint.limits.max_torque_nm, joint.limits.watchdog_s), (Some(12.5), Some(0.01)), "{}", joint.name);
    }
    for joint in &read("registers", "").unwrap().joints {
        let expected = (Some(joint.ranges.torque_nm), Some(0.02));
        assert_eq!((joint.limits.max_torque_nm, joint.limits.watchdog_s), expected, "{}", joint.name);
    }
    for joint in &read("mit", "").unwrap().joints {
        assert_eq!((joint.limits.max_torque_nm, joint.limits.watchdog_s), (None, None), "{}", joint.name);
    }
}

#[test]
fn a_watchdog_that_one_late_cycle_would_end_is_refused() {
    let config = control::Config::for_robot(&vision60());
    let shortest_s = 3.0 * config.control_period_s;
    let of = |watchdog_s: f64| read("registers", &format!("[limits]\nwatchdog_s = {watchdog_s}")).unwrap();
    let refused = of(0.9 * shortest_s).check_ranges(&config.command_range()).unwrap_err().to_string();
    assert!(refused.contains("limits.watchdog_s of") && refused.contains("three control periods"), "{refused}");
    of(1.1 * shortest_s).check_ranges(&config.command_range()).unwrap();
}
