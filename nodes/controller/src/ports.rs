//! Messages to and from the controller's own types: the one place where the two meet. (Gaits: [`tandem_msgs::Gait::to_gait`].)

use crate::dds_bus::{CommandMessage, StateMessage};
use control::{JOINTS, Output, Tilt};
use std::time::Duration;
use tandem_msgs::builtin_interfaces::Time;
use tandem_msgs::std_msgs::Header;
use tandem_msgs::{ControllerState, JointCommand, sensor_msgs};

/// Where each of our joints is in a message's list of names; a message in our order costs twelve comparisons.
fn order(found: &[String], names: &[String; JOINTS]) -> [Option<usize>; JOINTS] {
    let mut from = [None; JOINTS];
    for (j, name) in names.iter().enumerate() {
        from[j] = if found.get(j) == Some(name) { Some(j) } else { found.iter().position(|n| n == name) };
    }
    from
}

/// The joints of a message that came in at `wall`, in our order. A joint that it lacks is marked so: another message may have it.
/// Values that are not finite go through: the controller has a fault for them.
///
/// # Errors
/// What is wrong with the message, where it cannot be taken.
pub fn joint_state(
    message: &sensor_msgs::JointState,
    names: &[String; JOINTS],
    wall: Duration,
) -> Result<StateMessage, String> {
    for (list, length) in [("position", message.position.len()), ("velocity", message.velocity.len())] {
        if length != message.name.len() {
            return Err(format!(
                "refused: {list} has {length} entries, name has {}: expected as many",
                message.name.len()
            ));
        }
    }
    let stamp = stamp(message.header.stamp).map_err(|problem| format!("refused: {problem}"))?;
    let from = order(&message.name, names);
    if from.iter().all(Option::is_none) {
        return Err(format!(
            "refused: joint {:?} is missing, and so are all others; the message has {:?}",
            names[0], message.name
        ));
    }
    let pick = |values: &[f64]| from.map(|i| i.and_then(|i| values.get(i)).copied().unwrap_or_default());
    Ok(StateMessage {
        stamp,
        wall,
        named: from.map(|i| i.is_some()),
        position_rad: pick(&message.position),
        velocity_rad_s: pick(&message.velocity),
        // None where they are not told or are no numbers.
        torque_nm: (message.effort.len() == message.name.len())
            .then(|| pick(&message.effort))
            .filter(|torque| torque.iter().all(|value| value.is_finite())),
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

/// How far a quaternion's length may be from 1 for the rounding of whoever sends it.
const QUATERNION_TOLERANCE: f64 = 0.02;

/// An attitude that cannot be: the controller has a fault for it.
pub const NO_TILT: Tilt = Tilt { roll_rad: f64::NAN, pitch_rad: f64::NAN };

/// Roll and pitch of the base, R = Rz(yaw) Ry(pitch) Rx(roll). An inertial unit without orientation (covariance −1) gives none.
///
/// # Errors
/// The orientation is no rotation: its quaternion's length is not 1 (0 0 0 0 included), or not a number.
pub fn tilt(message: &sensor_msgs::Imu) -> Result<Option<Tilt>, String> {
    if message.orientation_covariance[0] < 0.0 {
        return Ok(None);
    }
    let mut q = message.orientation;
    let length = (q.x * q.x + q.y * q.y + q.z * q.z + q.w * q.w).sqrt();
    if !length.is_finite() || (length - 1.0).abs() > QUATERNION_TOLERANCE {
        return Err(format!(
            "the orientation (x {}, y {}, z {}, w {}) has the length {length}: expected 1; an inertial unit without orientation \
             says so by orientation_covariance[0] = -1",
            q.x, q.y, q.z, q.w
        ));
    }
    for component in [&mut q.x, &mut q.y, &mut q.z, &mut q.w] {
        *component /= length;
    }
    Ok(Some(Tilt {
        roll_rad: (2.0 * (q.w * q.x + q.y * q.z)).atan2(1.0 - 2.0 * (q.x * q.x + q.y * q.y)),
        pitch_rad: (2.0 * (q.w * q.y - q.z * q.x)).clamp(-1.0, 1.0).asin(),
    }))
}

/// The command that answers the joint state of its stamp.
pub fn joint_command(message: &CommandMessage, names: &[String; JOINTS]) -> JointCommand {
    let c = &message.command;
    JointCommand {
        header: Header { stamp: time(message.stamp), frame_id: String::new() },
        name: names.to_vec(),
        position: c.position_rad.to_vec(),
        velocity: c.velocity_rad_s.to_vec(),
        kp: c.kp.to_vec(),
        kd: c.kd.to_vec(),
        torque: c.torque_nm.to_vec(),
    }
}

/// What was read from the drives. Joints that were never heard are left out.
pub fn joint_states(
    readings: &joint_bus::Readings,
    names: &[String; JOINTS],
    answered: Duration,
) -> sensor_msgs::JointState {
    let heard = || (0..JOINTS).filter(|j| readings.arrived[*j].is_some());
    sensor_msgs::JointState {
        header: Header { stamp: time(answered), frame_id: String::new() },
        name: heard().map(|j| names[j].clone()).collect(),
        position: heard().map(|j| readings.position_rad[j]).collect(),
        velocity: heard().map(|j| readings.velocity_rad_s[j]).collect(),
        effort: heard().map(|j| readings.torque_nm[j]).collect(),
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
        let wall = Duration::from_secs(9);
        let state = joint_state(&message, &names(), wall).unwrap();
        assert_eq!(state.position_rad, std::array::from_fn(|j| j as f64));
        assert_eq!((state.stamp, state.wall), (Duration::from_millis(1500), wall));

        // A joint that is missing is marked, and the others are heard.
        message.name[4] = "joint_99".into();
        assert_eq!(joint_state(&message, &names(), wall).unwrap().named, std::array::from_fn(|j| j != 3));

        message.velocity.pop();
        let problem = joint_state(&message, &names(), wall).unwrap_err();
        assert!(problem.contains("velocity has 12 entries, name has 13"));
        let stranger =
            sensor_msgs::JointState { name: vec!["pan".into()], position: vec![0.0], velocity: vec![0.0], ..message };
        assert!(joint_state(&stranger, &names(), wall).unwrap_err().contains("\"joint_0\" is missing"));
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
        // Rounded to single precision and a little more: taken as the rotation that it nearly is.
        for scale in [1.0, 1.0 - 1e-3] {
            let q = &mut imu.orientation;
            (q.x, q.y, q.z, q.w) = (scale * q.x, scale * q.y, scale * q.z, scale * q.w);
            let found = tilt(&imu).unwrap().unwrap();
            assert!((found.roll_rad - roll).abs() < 1e-12 && (found.pitch_rad - pitch).abs() < 1e-12);
        }
        imu.orientation_covariance[0] = -1.0;
        assert_eq!(tilt(&imu), Ok(None));
    }

    #[test]
    fn an_orientation_that_is_no_unit_quaternion_is_refused_and_not_read_as_level() {
        let of = |x, w| sensor_msgs::Imu { orientation: Quaternion { x, y: 0.0, z: 0.0, w }, ..Default::default() };
        assert!(tilt(&of(0.0, 0.0)).unwrap_err().contains("has the length 0: expected 1"));
        // 1.2 rad of roll at length 0.6 would read 0.41 rad.
        assert!(tilt(&of(0.6 * 0.6_f64.sin(), 0.6 * 0.6_f64.cos())).unwrap_err().contains("has the length 0.6"));
        assert!(tilt(&of(f64::NAN, 1.0)).unwrap_err().contains("NaN"));
    }
}
