//! Messages to and from the controller's own types: the one place where the two meet. (Gaits:
//! [`tandem_msgs::Gait::to_gait`].)

use crate::messages::{CommandMessage, StateMessage};
use control::{InertialState, JOINTS, Output};
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

/// The joints of a message that came in at `wall`, in our order. A joint that it lacks is marked so: another message
/// may have it. Values that are not finite go through: the controller has a fault for them.
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
        // None where they are not given or are no numbers.
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

/// All that an inertial unit says; `arrived` is for the cycle to say. What it does not measure (covariance −1) is none.
/// What cannot be goes through: the controller has a fault for it. Besides, what is wrong with the message, if
/// something is.
pub fn inertial_state(message: &sensor_msgs::Imu) -> (InertialState, Option<String>) {
    let (q, v, a) = (message.orientation, &message.angular_velocity, &message.linear_acceleration);
    // A covariance that is no number says nothing, the measurement least of all that there is none.
    let measured = |covariance: &[f64; 9]| covariance[0] >= 0.0 || covariance[0].is_nan();
    let stamp = stamp(message.header.stamp);
    let state = InertialState {
        stamp: stamp.clone().unwrap_or_default(),
        arrived: Duration::ZERO,
        attitude_xyzw: measured(&message.orientation_covariance).then_some([q.x, q.y, q.z, q.w]),
        angular_velocity_rad_s: measured(&message.angular_velocity_covariance).then_some([v.x, v.y, v.z]),
        acceleration_m_s2: measured(&message.linear_acceleration_covariance).then_some([a.x, a.y, a.z]),
    };
    let problem = inertial_problem(&state).or(stamp.err());
    (state, problem)
}

fn inertial_problem(state: &InertialState) -> Option<String> {
    if let Some([x, y, z, w]) = state.attitude_xyzw {
        let length = (x * x + y * y + z * z + w * w).sqrt();
        if !control::is_unit_length(length) {
            return Some(format!(
                "the orientation (x {x}, y {y}, z {z}, w {w}) has the length {length}: expected 1; an inertial unit \
                 without orientation says so by orientation_covariance[0] = -1"
            ));
        }
    }
    let rates = [("angular_velocity", state.angular_velocity_rad_s), ("linear_acceleration", state.acceleration_m_s2)];
    rates.into_iter().find_map(|(field, value)| {
        let [x, y, z] = value.filter(|value| value.iter().any(|value| !value.is_finite()))?;
        Some(format!(
            "{field} (x {x}, y {y}, z {z}) is no number: an inertial unit that does not measure it says so by \
             {field}_covariance[0] = -1"
        ))
    })
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

/// What was read from the drives. Joints that were never received are left out.
pub fn joint_states(
    readings: &joint_bus::Readings,
    names: &[String; JOINTS],
    answered: Duration,
) -> sensor_msgs::JointState {
    let received = || (0..JOINTS).filter(|j| readings.arrived[*j].is_some());
    sensor_msgs::JointState {
        header: Header { stamp: time(answered), frame_id: String::new() },
        name: received().map(|j| names[j].clone()).collect(),
        position: received().map(|j| readings.position_rad[j]).collect(),
        velocity: received().map(|j| readings.velocity_rad_s[j]).collect(),
        effort: received().map(|j| readings.torque_nm[j]).collect(),
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
        fault_bits: output.faults.bits(),
        mode_id: output.mode.number(),
        damped_id: output.damped_number(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use control::{DampingReason, Fault, FaultSet, Mode};
    use tandem_msgs::geometry_msgs::{Quaternion, Vector3};

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

        // A joint that is missing is marked, and the others are received.
        message.name[4] = "joint_99".into();
        assert_eq!(joint_state(&message, &names(), wall).unwrap().named, std::array::from_fn(|j| j != 3));

        message.velocity.pop();
        let problem = joint_state(&message, &names(), wall).unwrap_err();
        assert!(problem.contains("velocity has 12 entries, name has 13"));
        let foreign =
            sensor_msgs::JointState { name: vec!["pan".into()], position: vec![0.0], velocity: vec![0.0], ..message };
        assert!(joint_state(&foreign, &names(), wall).unwrap_err().contains("\"joint_0\" is missing"));
    }

    #[test]
    fn an_inertial_unit_is_taken_whole_and_what_it_does_not_measure_is_none() {
        let mut imu = sensor_msgs::Imu {
            orientation: Quaternion { x: 0.0, y: 0.6, z: 0.0, w: 0.8 },
            angular_velocity: Vector3 { x: 0.1, y: -0.2, z: 0.3 },
            linear_acceleration: Vector3 { x: 1.0, y: 2.0, z: 9.0 },
            ..Default::default()
        };
        imu.header.stamp = Time::from_nanoseconds(3_000_000_005);
        let (state, problem) = inertial_state(&imu);
        assert_eq!(problem, None);
        assert_eq!(state.stamp, Duration::new(3, 5));
        assert_eq!(state.attitude_xyzw, Some([0.0, 0.6, 0.0, 0.8]));
        assert_eq!(state.angular_velocity_rad_s, Some([0.1, -0.2, 0.3]));
        assert_eq!(state.acceleration_m_s2, Some([1.0, 2.0, 9.0]));
        for covariance in [
            &mut imu.orientation_covariance,
            &mut imu.angular_velocity_covariance,
            &mut imu.linear_acceleration_covariance,
        ] {
            covariance[0] = -1.0;
        }
        imu.orientation.w = f64::NAN;
        let (state, problem) = inertial_state(&imu);
        let nothing = (state.attitude_xyzw, state.angular_velocity_rad_s, state.acceleration_m_s2);
        assert_eq!((nothing, problem), ((None, None, None), None));
    }

    #[test]
    fn an_orientation_that_is_no_unit_quaternion_and_a_rate_that_is_no_number_are_refused_by_what_they_are() {
        let of = |x, w, rate| {
            inertial_state(&sensor_msgs::Imu {
                orientation: Quaternion { x, y: 0.0, z: 0.0, w },
                angular_velocity: Vector3 { x: 0.0, y: rate, z: 0.0 },
                ..Default::default()
            })
        };
        let problem = |x, w, rate| of(x, w, rate).1.unwrap();
        assert!(problem(0.0, 0.0, 0.0).contains("has the length 0: expected 1"));
        // 1.2 rad of roll at length 0.6 would read 0.41 rad.
        assert!(problem(0.6 * 0.6_f64.sin(), 0.6 * 0.6_f64.cos(), 0.0).contains("has the length 0.6"));
        assert!(problem(f64::NAN, 1.0, 0.0).contains("NaN"));
        assert!(problem(0.0, 1.0, f64::NAN).contains("angular_velocity (x 0, y NaN, z 0) is no number"));
        // The controller gets them all the same, and has a fault for them.
        assert!(of(0.0, 0.0, 0.0).0.tilt().unwrap().roll_rad.is_nan());
    }

    #[test]
    fn the_message_names_every_mode_every_fault_and_every_reason_of_damping() {
        let file = include_str!("../../../msgs/msg/ControllerState.msg");
        let numbers = |kind: &str| -> Vec<(String, u32)> {
            let lines =
                file.lines().filter_map(|line| line.strip_prefix("uint")?.split_once(' ')?.1.strip_prefix(kind));
            let lines = lines.filter_map(|line| line.split_once('='));
            lines.map(|(name, value)| (name.to_lowercase(), value.parse().unwrap())).collect()
        };
        let constants = |kind: &str| -> Vec<(String, String)> {
            let lines =
                file.lines().filter_map(|line| line.strip_prefix("string ")?.strip_prefix(kind)?.split_once('='));
            lines.map(|(name, value)| (name.to_lowercase(), value.trim_matches('"').to_owned())).collect()
        };
        let named = |names: &[&str]| names.iter().map(|name| ((*name).into(), (*name).into())).collect::<Vec<_>>();
        assert_eq!(constants("MODE_"), named(&Mode::ALL.map(Mode::name)));
        assert_eq!(constants("FAULT_"), named(&Fault::ALL.map(Fault::name)));
        let reasons = [DampingReason::Armed, DampingReason::EmergencyStop, DampingReason::StaleJointState];
        assert_eq!(constants("DAMPED_"), named(&reasons.map(DampingReason::name)));
        assert_eq!(numbers("MODE_ID_"), Mode::ALL.map(|mode| (mode.name().to_owned(), u32::from(mode.number()))));
        let bit = |fault: Fault| {
            let mut alone = FaultSet::NONE;
            alone.insert(fault);
            (fault.name().to_owned(), alone.bits())
        };
        assert_eq!(numbers("FAULT_BIT_"), Fault::ALL.map(bit));
        let mut damped = vec![("none".to_owned(), 0)];
        damped.extend(reasons.map(|reason| (reason.name().to_owned(), u32::from(reason.number()))));
        assert_eq!(numbers("DAMPED_ID_"), damped);
    }
}
