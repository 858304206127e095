//! What robot.toml says against what the URDF says: limits, places of the legs, the standing posture.

use joints::LEG_NAMES;
use rigid_body::{Data, Description, forward_kinematics, frame_position};
use urdf_rs::JointType;

use crate::{Leg, Limits, Nominal, Robot, RobotError};

/// Largest angle that a posture may have, rad: one turn. Beyond it degrees are meant.
const POSTURE_MOST_RAD: f64 = 6.3;
/// Largest angle that a limit may have, rad: two turns.
const LIMIT_MOST_RAD: f64 = 12.6;
/// How far limits may differ by rounding in a file.
const ROUNDING: f64 = 1e-4;
/// How far a toe may stand from the nominal posture, as a fraction of the nominal height.
const POSTURE_TOLERANCE: f64 = 0.05;
/// How far a toe may be on the wrong side, m: a leg may stand below the middle plane.
const MIDDLE_M: f64 = 1e-3;

/// The leg's angles must be radians.
pub(crate) fn check_radians(leg: &Leg, number: usize) -> Result<(), RobotError> {
    for (name, values, most) in [
        ("position_min_rad", &leg.position_min_rad, LIMIT_MOST_RAD),
        ("position_max_rad", &leg.position_max_rad, LIMIT_MOST_RAD),
        ("stand_rad", &leg.stand_rad, POSTURE_MOST_RAD),
        ("sit_rad", &leg.sit_rad, POSTURE_MOST_RAD),
    ] {
        if let Some(k) = (0..3).find(|&k| values[k].abs() > most) {
            let degrees = values[k];
            let field = format!("legs[{number}].{name}[{k}]");
            return Err(RobotError::Degrees { field, degrees, radians: degrees.to_radians() });
        }
    }
    Ok(())
}

/// Narrows the leg's position limits to the URDF's, with a line for what was wider.
pub(crate) fn narrow_positions(
    leg: &mut Leg,
    number: usize,
    description: &Description,
    notes: &mut Vec<String>,
) -> Result<(), RobotError> {
    for k in 0..3 {
        let name = &leg.joints[k];
        let Some(joint) = description.joint(name).filter(|joint| joint.joint_type == JointType::Revolute) else {
            continue;
        };
        let (lower, upper) = (joint.limit.lower, joint.limit.upper);
        if lower > upper {
            return Err(RobotError::SwappedLimits { joint: name.clone(), lower, upper });
        }
        if let Some(limit) = [lower, upper].into_iter().find(|limit| limit.abs() > LIMIT_MOST_RAD) {
            notes.push(format!(
                "the URDF's joint '{name}' has a limit of {limit}: more than two turns, or degrees ({:.3} rad)?",
                limit.to_radians()
            ));
        }
        if lower == upper {
            notes.push(format!("the URDF's joint '{name}' has the limits {lower} to {upper}: taken as none"));
            continue;
        }
        if lower > leg.position_min_rad[k] + ROUNDING {
            let found = leg.position_min_rad[k];
            notes.push(wider(&format!("legs[{number}].position_min_rad[{k}]"), found, name, "lower limit", lower));
            leg.position_min_rad[k] = lower;
        }
        if upper < leg.position_max_rad[k] - ROUNDING {
            let found = leg.position_max_rad[k];
            notes.push(wider(&format!("legs[{number}].position_max_rad[{k}]"), found, name, "upper limit", upper));
            leg.position_max_rad[k] = upper;
        }
        if leg.position_min_rad[k] >= leg.position_max_rad[k] {
            return Err(RobotError::AgainstUrdf {
                field: format!("legs[{number}].position_min_rad[{k}]"),
                found: leg.position_min_rad[k],
                joint: name.clone(),
                what: "range",
                allowed: format!("{lower} to {upper}"),
                cure: "they have nothing in common",
            });
        }
        if !(lower - ROUNDING..=upper + ROUNDING).contains(&leg.sit_rad[k]) {
            notes.push(format!(
                "legs[{number}].sit_rad[{k}] is {}, outside the range {lower} to {upper} of the URDF's joint '{name}'",
                leg.sit_rad[k]
            ));
        }
    }
    Ok(())
}

fn wider(field: &str, found: f64, joint: &str, what: &str, used: f64) -> String {
    format!(
        "robot.toml's {field}, {found}, is wider than the {what} {used} of the URDF's joint '{joint}': {used} is used"
    )
}

/// Narrows torque and velocity limits to the URDF's, with a line; a plan may not use more than the URDF's effort.
pub(crate) fn narrow_limits(
    limits: &mut Limits,
    legs: &[Leg; 4],
    description: &Description,
    notes: &mut Vec<String>,
) -> Result<(), RobotError> {
    for (k, name) in legs.iter().flat_map(|leg| leg.joints.iter().enumerate()) {
        let Some(joint) = description.joint(name) else { continue };
        // None given reads as 0.
        let (effort, velocity) = (joint.limit.effort, joint.limit.velocity);
        if effort > 0.0 && limits.plan_torque_nm[k] > effort * (1.0 + ROUNDING) {
            return Err(RobotError::AgainstUrdf {
                field: format!("limits.plan_torque_nm[{k}]"),
                found: limits.plan_torque_nm[k],
                joint: name.clone(),
                what: "effort",
                allowed: effort.to_string(),
                cure: "plan with less, or correct the URDF",
            });
        }
        if effort > 0.0 && limits.drive_torque_nm[k] > effort * (1.0 + ROUNDING) {
            let field = format!("limits.drive_torque_nm[{k}]");
            notes.push(wider(&field, limits.drive_torque_nm[k], name, "effort", effort));
            limits.drive_torque_nm[k] = effort;
        }
        if velocity > 0.0 && limits.velocity_rad_s[k] > velocity * (1.0 + ROUNDING) {
            let field = format!("limits.velocity_rad_s[{k}]");
            notes.push(wider(&field, limits.velocity_rad_s[k], name, "velocity", velocity));
            limits.velocity_rad_s[k] = velocity;
        }
    }
    for k in 0..3 {
        let (plan, drive) = (limits.plan_torque_nm[k], limits.drive_torque_nm[k]);
        if plan > drive * (1.0 + ROUNDING) {
            return Err(RobotError::Field {
                field: format!("limits.plan_torque_nm[{k}]"),
                found: plan.to_string(),
                expected: format!("at most limits.drive_torque_nm[{k}], {drive}"),
            });
        }
    }
    Ok(())
}

/// Where the toes are in the torso's axes in the standing posture, m.
fn standing_toes(robot: &Robot) -> [[f64; 3]; 4] {
    let mut data = Data::new(&robot.model);
    let mut q = [0.0; 18];
    q[6..].copy_from_slice(&robot.stand_rad());
    let zero = [0.0; 18];
    forward_kinematics(&robot.model, &mut data, &q, &zero, &zero);
    std::array::from_fn(|i| frame_position(&robot.model, &data, robot.legs[i].toe).into())
}

/// Each leg stands where its number says.
pub(crate) fn check_places(robot: &Robot) -> Result<(), RobotError> {
    let toes = standing_toes(robot);
    for (number, [x_m, y_m, _]) in toes.into_iter().enumerate() {
        let (left, front) = (number < 2, number % 2 == 0);
        let ahead = x_m - toes[number ^ 1][0];
        let found = match (left, front) {
            (true, _) if y_m < -MIDDLE_M => "on the right",
            (false, _) if y_m > MIDDLE_M => "on the left",
            (_, true) if ahead < 0.0 => "behind the rear leg",
            (_, false) if ahead > 0.0 => "before the front leg",
            _ => continue,
        };
        let (leg, toe) = (&robot.legs[number], robot.model.frame_name(robot.legs[number].toe));
        let (leg, toe) = (leg.name.clone(), toe.to_owned());
        return Err(RobotError::WrongPlace { place: LEG_NAMES[number], found, number, leg, toe, x_m, y_m });
    }
    Ok(())
}

/// The standing posture is the nominal one.
pub(crate) fn check_posture(robot: &Robot) -> Result<(), RobotError> {
    let Nominal { height_m, half_width_m } = robot.nominal;
    let tolerance_m = POSTURE_TOLERANCE * height_m;
    for (leg, toe) in robot.legs.iter().zip(standing_toes(robot)) {
        let hip = robot.hip_height_m(leg);
        for (what, field, found_m, nominal_m) in [
            ("below the hip axes", "height_m", hip - toe[2], height_m),
            ("from the middle plane", "half_width_m", toe[1].abs(), half_width_m),
        ] {
            if (found_m - nominal_m).abs() > tolerance_m {
                let leg = leg.name.clone();
                return Err(RobotError::Posture { leg, what, field, found_m, nominal_m, tolerance_m });
            }
        }
    }
    Ok(())
}
