//! Messages to and from the project's own types: the one place where the two meet.

use control::{JOINTS, JointState, Output, Tilt};
use gait::{Gait, InitialState, Mirror, SolverSummary};
use std::time::Duration;
use tandem_msgs::builtin_interfaces::Time;
use tandem_msgs::std_msgs::Header;
use tandem_msgs::{ControllerState, JointCommand, sensor_msgs};

/// Where each of our joints is in a message's list of names; a message in our order costs twelve comparisons.
fn order(found: &[String], names: &[String; JOINTS]) -> Result<[usize; JOINTS], String> {
    let mut from = [0; JOINTS];
    for (j, name) in names.iter().enumerate() {
        from[j] = if found.get(j) == Some(name) {
            j
        } else {
            found
                .iter()
                .position(|n| n == name)
                .ok_or_else(|| format!("joint \"{name}\" is missing; the message has {found:?}"))?
        };
    }
    Ok(from)
}

/// The joints of a message, in our order. `arrived` is left at zero: the cycle knows the time. Values that are not finite
/// go through: the controller has a fault for them.
pub fn joint_state(message: &sensor_msgs::JointState, names: &[String; JOINTS]) -> Result<JointState, String> {
    for (list, length) in [("position", message.position.len()), ("velocity", message.velocity.len())] {
        if length != message.name.len() {
            return Err(format!("{list} has {length} entries, name has {}: expected as many", message.name.len()));
        }
    }
    let from = order(&message.name, names)?;
    Ok(JointState {
        stamp: stamp(message.header.stamp)?,
        arrived: [Duration::ZERO; JOINTS],
        position_rad: from.map(|i| message.position[i]),
        velocity_rad_s: from.map(|i| message.velocity[i]),
        temperature_c: None,
        drive_error: [0; JOINTS],
    })
}

fn stamp(time: Time) -> Result<Duration, String> {
    u64::try_from(time.nanoseconds())
        .map(Duration::from_nanos)
        .map_err(|_| format!("the stamp is {} s, expected 0 or more", time.seconds()))
}

fn time(stamp: Duration) -> Time {
    Time::from_nanoseconds(i64::try_from(stamp.as_nanos()).unwrap_or(i64::MAX))
}

/// Roll and pitch of the base, R = Rz(yaw) Ry(pitch) Rx(roll). An inertial unit without orientation (covariance −1) gives none.
pub fn tilt(message: &sensor_msgs::Imu) -> Option<Tilt> {
    if message.orientation_covariance[0] < 0.0 {
        return None;
    }
    let q = &message.orientation;
    Some(Tilt {
        roll_rad: (2.0 * (q.w * q.x + q.y * q.z)).atan2(1.0 - 2.0 * (q.x * q.x + q.y * q.y)),
        pitch_rad: (2.0 * (q.w * q.y - q.z * q.x)).clamp(-1.0, 1.0).asin(),
    })
}

/// The command that answers the joint state of that stamp.
pub fn joint_command(output: &Output, names: &[String; JOINTS]) -> JointCommand {
    let c = &output.command;
    JointCommand {
        header: Header { stamp: time(output.answered.unwrap_or_default()), frame_id: String::new() },
        name: names.to_vec(),
        position: c.position_rad.to_vec(),
        velocity: c.velocity_rad_s.to_vec(),
        kp: c.kp.to_vec(),
        kd: c.kd.to_vec(),
        torque: c.torque_nm.to_vec(),
    }
}

/// What the controller does, for people and programs.
pub fn controller_state(output: &Output, gait: Option<&str>, missed_cycles: u64) -> ControllerState {
    let faults: Vec<&str> = output.faults.iter().map(control::Fault::name).collect();
    let fault = match (faults.is_empty(), output.damping_reason) {
        (true, Some(reason)) => reason.name().to_owned(),
        _ => faults.join(","),
    };
    ControllerState {
        header: Header { stamp: time(output.answered.unwrap_or_default()), frame_id: String::new() },
        mode: output.mode.name().to_owned(),
        fault,
        gait: gait.unwrap_or_default().to_owned(),
        step_index: output.step_index,
        step_phase: output.step_phase,
        cycles: output.cycles,
        missed_cycles,
        stale_inputs: output.stale_inputs,
        tracking_error_rad: output.tracking_error_rad.to_vec(),
        commanded_torque_nm: output.torque_nm.to_vec(),
    }
}

fn array<T: Copy, const N: usize>(field: &str, list: &[T]) -> Result<[T; N], String> {
    list.try_into().map_err(|_| format!("{field} has {} entries, expected {N}", list.len()))
}

fn rows(field: &str, list: &[f64]) -> Result<[gait::Coefficients; JOINTS], String> {
    let columns = gait::bezier::DEGREE + 1;
    if list.len() != JOINTS * columns {
        return Err(format!("{field} has {} entries, expected {}", list.len(), JOINTS * columns));
    }
    Ok(std::array::from_fn(|j| std::array::from_fn(|i| list[j * columns + i])))
}

/// A gait from its message, with every value checked as a gait file's values are.
pub fn gait(message: &tandem_msgs::Gait) -> Result<Gait, String> {
    let m = message;
    if u64::from(m.version) != gait::FILE_VERSION {
        return Err(format!("version is {}, expected {}", m.version, gait::FILE_VERSION));
    }
    if usize::from(m.bezier_degree) != gait::bezier::DEGREE {
        return Err(format!("bezier_degree is {}, expected {}", m.bezier_degree, gait::bezier::DEGREE));
    }
    let names: [String; JOINTS] = m
        .joint_names
        .clone()
        .try_into()
        .map_err(|names: Vec<_>| format!("joint_names has {} entries, expected {JOINTS}", names.len()))?;
    let (pose, twist) = (&m.initial_base_pose, &m.initial_base_twist);
    let gait = Gait {
        robot: m.robot.clone(),
        name: m.name.clone(),
        joint_names: names,
        step_duration_s: m.step_duration_s,
        step_length_m: m.step_length_m,
        coefficients_rad: rows("coefficients_rad", &m.coefficients_rad)?,
        mirror: Mirror {
            leg: array::<u8, 4>("mirror_leg", &m.mirror_leg)?.map(usize::from),
            sign: array("mirror_sign", &m.mirror_sign)?,
        },
        initial: InitialState {
            base_position_m: [pose.position.x, pose.position.y, pose.position.z],
            base_quaternion_xyzw: [pose.orientation.x, pose.orientation.y, pose.orientation.z, pose.orientation.w],
            base_linear_velocity_world: [twist.linear.x, twist.linear.y, twist.linear.z],
            base_angular_velocity_body: [twist.angular.x, twist.angular.y, twist.angular.z],
            joint_position_rad: array("initial_joint_position_rad", &m.initial_joint_position_rad)?,
            joint_velocity_rad_s: array("initial_joint_velocity_rad_s", &m.initial_joint_velocity_rad_s)?,
        },
        reference_coefficients_rad: rows("reference_coefficients_rad", &m.reference_coefficients_rad)?,
        kp: array("kp", &m.kp)?,
        kd: array("kd", &m.kd)?,
        torque_limit_nm: array("torque_limit_nm", &m.torque_limit_nm)?,
        // What was asked for is for people; the walk does not depend on it.
        request: serde_json::from_str(&m.request_json).unwrap_or(serde_json::Value::Null),
        solver: SolverSummary {
            status: m.solver.status.clone(),
            iterations: m.solver.iterations,
            solve_time_s: m.solver.solve_time_s,
            max_violation: m.solver.max_violation,
            objective: m.solver.objective,
        },
    };
    gait.validate().map_err(|e| e.to_string())?;
    Ok(gait)
}

#[cfg(test)]
mod tests {
    use super::*;
    use tandem_msgs::geometry_msgs::Quaternion;

    fn names() -> [String; JOINTS] {
        std::array::from_fn(|j| format!("joint_{j}"))
    }

    #[test]
    fn joints_are_taken_by_name_and_more_joints_are_no_harm() {
        let mut message = sensor_msgs::JointState {
            name: names().to_vec(),
            position: (0..12).map(f64::from).collect(),
            velocity: (0..12).map(|j| 0.1 * f64::from(j)).collect(),
            ..Default::default()
        };
        message.header.stamp = Time::from_nanoseconds(1_500_000_000);
        message.name.insert(0, "camera_pan".into());
        message.position.insert(0, 9.0);
        message.velocity.insert(0, 9.0);
        let state = joint_state(&message, &names()).unwrap();
        assert_eq!(state.position_rad, std::array::from_fn(|j| j as f64));
        assert_eq!(state.stamp, Duration::from_millis(1500));

        message.name[4] = "joint_99".into();
        assert!(joint_state(&message, &names()).unwrap_err().contains("\"joint_3\" is missing"));
        message.velocity.pop();
        assert!(joint_state(&message, &names()).unwrap_err().contains("velocity has 12 entries, name has 13"));
    }

    #[test]
    fn tilt_is_roll_and_pitch() {
        let (roll, pitch, yaw) = (0.3_f64, -0.2_f64, 1.1_f64);
        let [(sr, cr), (sp, cp), (sy, cy)] = [roll, pitch, yaw].map(|a| (a / 2.0).sin_cos());
        let mut imu = sensor_msgs::Imu {
            orientation: Quaternion {
                w: cr * cp * cy + sr * sp * sy,
                x: sr * cp * cy - cr * sp * sy,
                y: cr * sp * cy + sr * cp * sy,
                z: cr * cp * sy - sr * sp * cy,
            },
            ..Default::default()
        };
        let tilt_found = tilt(&imu).unwrap();
        assert!((tilt_found.roll_rad - roll).abs() < 1e-12 && (tilt_found.pitch_rad - pitch).abs() < 1e-12);
        imu.orientation_covariance[0] = -1.0;
        assert_eq!(tilt(&imu), None);
    }

    #[test]
    fn gait_messages_are_refused_by_what_is_wrong() {
        let bare = tandem_msgs::Gait { version: 1, bezier_degree: 5, ..Default::default() };
        assert!(gait(&bare).unwrap_err().contains("joint_names has 0 entries"));
        let wrong = tandem_msgs::Gait { version: 2, ..bare.clone() };
        assert!(gait(&wrong).unwrap_err().contains("version is 2, expected 1"));
        let short = tandem_msgs::Gait { joint_names: names().to_vec(), coefficients_rad: vec![0.0; 71], ..bare };
        assert!(gait(&short).unwrap_err().contains("coefficients_rad has 71 entries, expected 72"));
    }
}
