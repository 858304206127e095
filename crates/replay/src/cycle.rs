//! Recorded messages, also those of versions that had fewer fields.

use std::borrow::Cow;
use std::time::Duration;

use bag::{BagError, BagTopic, from_cdr};
use control::{BodyPose, InertialState, Tilt, Velocity, VelocityCommand};
use tandem_msgs::{ControlCycle, ControllerState};

/// Groups of fields that were added at the message's end, in order: by one of its fields' name, how many flags of a
/// byte it begins with, and how many lists follow.
const ADDED: [(&str, usize, usize); 3] = [("inertial_age_ns", 1, 4), ("velocity_age_ns", 1, 2), ("body_pose", 0, 1)];

/// A recorded cycle. What an older message does not say is empty.
pub(crate) fn control_cycle(topic: &BagTopic, data: &[u8]) -> Result<ControlCycle, BagError> {
    let mut whole = Cow::Borrowed(data);
    for (field, flags, lists) in ADDED {
        if topic.definition.as_deref().is_some_and(|definition| !definition.contains(field)) {
            // Flags, and lengths of 0, which are aligned to 4 after the 4 bytes of the encapsulation.
            let length = (whole.len() + flags).next_multiple_of(4) + 4 * lists;
            whole.to_mut().resize(length, 0);
        }
    }
    from_cdr(&topic.type_name, &whole)
}

/// What the controller reported of itself. An older message has no numbers beside its names: 0.
pub(crate) fn controller_state(topic: &BagTopic, data: &[u8]) -> Result<ControllerState, BagError> {
    from_cdr(&topic.type_name, &with_numbers(topic.definition.as_deref(), data))
}

/// A gait. An older message has neither a lead nor a cycle.
pub(crate) fn gait(topic: &BagTopic, data: &[u8]) -> Result<tandem_msgs::Gait, BagError> {
    from_cdr(&topic.type_name, &with_domains(topic.definition.as_deref(), data))
}

fn with_domains<'a>(definition: Option<&str>, data: &'a [u8]) -> Cow<'a, [u8]> {
    let mut whole = Cow::Borrowed(data);
    if definition.is_some_and(|definition| !definition.contains("GaitDomain")) {
        // Two lengths of 0, aligned to 4 after the 4 bytes of the encapsulation.
        let length = whole.len().next_multiple_of(4) + 8;
        whole.to_mut().resize(length, 0);
    }
    whole
}

fn with_numbers<'a>(definition: Option<&str>, data: &'a [u8]) -> Cow<'a, [u8]> {
    let mut whole = Cow::Borrowed(data);
    if definition.is_some_and(|definition| !definition.contains("fault_bits")) {
        // One of four bytes, where the lists before it have ended aligned, and two of one.
        let length = whole.len() + 6;
        whole.to_mut().resize(length, 0);
    }
    whole
}

/// The time on the controller's clock that was so long before the cycle.
pub(crate) fn before(cycle: &ControlCycle, age_ns: i64) -> Result<Duration, &'static str> {
    let stamp = &cycle.header.stamp;
    let now_ns = i128::from(stamp.sec) * 1_000_000_000 + i128::from(stamp.nanosec);
    u64::try_from(now_ns - i128::from(age_ns)).map(Duration::from_nanos).map_err(|_| "a time before zero")
}

/// What the cycle saw of the inertial unit; `last` is what the cycle before saw.
pub(crate) fn inertial_state(
    cycle: &ControlCycle,
    last: Option<InertialState>,
) -> Result<Option<InertialState>, String> {
    if cycle.inertial_held {
        return last.map(Some).ok_or_else(|| "inertial_held without a state in the cycle before".into());
    }
    let (stamp, arrived) = match (cycle.inertial_age_ns.as_slice(), cycle.tilt_rad.as_slice()) {
        ([], []) => return Ok(None),
        ([], [roll_rad, pitch_rad]) => {
            let tilt = Tilt { roll_rad: *roll_rad, pitch_rad: *pitch_rad };
            return Ok(Some(InertialState::tilted(tilt, before(cycle, 0)?)));
        }
        ([], other) => return Err(format!("tilt_rad has {} entries; expected 0 or 2", other.len())),
        ([stamp, arrived], _) => (before(cycle, *stamp)?, before(cycle, *arrived)?),
        (other, _) => return Err(format!("inertial_age_ns has {} entries; expected 0 or 2", other.len())),
    };
    Ok(Some(InertialState {
        stamp,
        arrived,
        attitude_xyzw: some_array("inertial_attitude", &cycle.inertial_attitude)?,
        angular_velocity_rad_s: some_array("inertial_angular_velocity", &cycle.inertial_angular_velocity)?,
        acceleration_m_s2: some_array("inertial_acceleration", &cycle.inertial_acceleration)?,
    }))
}

/// The velocity that the cycle was asked for; `last` is what the cycle before was.
pub(crate) fn velocity_command(
    cycle: &ControlCycle,
    last: Option<VelocityCommand>,
) -> Result<Option<VelocityCommand>, String> {
    if cycle.velocity_held {
        return last.map(Some).ok_or_else(|| "velocity_held without a command in the cycle before".into());
    }
    match (cycle.velocity_age_ns.as_slice(), some_array("velocity", &cycle.velocity)?) {
        ([], None) => Ok(None),
        ([age_ns], Some([forward_m_s, left_m_s, yaw_rad_s])) => {
            let velocity = Velocity { forward_m_s, left_m_s, yaw_rad_s };
            Ok(Some(VelocityCommand { velocity, arrived: before(cycle, *age_ns)? }))
        }
        (ages, _) => Err(format!("velocity_age_ns has {} entries; expected as many commands as there are", ages.len())),
    }
}

/// The pose of the body that the cycle was asked for.
pub(crate) fn body_pose(cycle: &ControlCycle) -> Result<Option<BodyPose>, String> {
    Ok(some_array("body_pose", &cycle.body_pose)?.map(BodyPose::of))
}

fn some_array<const N: usize>(name: &str, values: &[f64]) -> Result<Option<[f64; N]>, String> {
    if values.is_empty() {
        return Ok(None);
    }
    values.try_into().map(Some).map_err(|_| format!("{name} has {} entries; expected 0 or {N}", values.len()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use bag::to_cdr;

    #[test]
    fn a_state_of_a_version_without_numbers_is_read_with_none() {
        let names = ControllerState {
            mode: "walking".into(),
            tracking_error_rad: vec![0.5; 12],
            commanded_torque_nm: vec![3.0; 12],
            ..ControllerState::default()
        };
        let now = ControllerState { fault_bits: 128, mode_id: 5, damped_id: 2, ..names.clone() };
        let data = to_cdr("ControllerState", &now).unwrap();
        let older = &data[..data.len() - 6];
        let read = |definition, data| {
            from_cdr::<ControllerState>("ControllerState", &with_numbers(Some(definition), data)).unwrap()
        };
        assert_eq!(read("uint32 fault_bits", &data), now);
        assert_eq!(read("float64[] commanded_torque_nm", older), names);
        // Lists that are empty end at other places.
        let empty = ControllerState { mode: "fault".into(), ..ControllerState::default() };
        let data = to_cdr("ControllerState", &empty).unwrap();
        assert_eq!(read("float64[] commanded_torque_nm", &data[..data.len() - 6]), empty);
    }

    #[test]
    fn a_gait_of_a_version_without_domains_is_read_with_none() {
        let amble = gait::Gait::from_json(include_str!("../../../tests/gaits/amble.json")).unwrap();
        let now = tandem_msgs::Gait::from_gait(&amble);
        let data = to_cdr("Gait", &now).unwrap();
        // The message ended with a flag of one byte.
        let ends = data.len() - 8;
        let older = &data[..(ends - 3..=ends).find(|end| end.next_multiple_of(4) == ends).unwrap()];
        let read =
            |definition, data| from_cdr::<tandem_msgs::Gait>("Gait", &with_domains(Some(definition), data)).unwrap();
        assert_eq!(read("GaitDomain[] cycle", &data), now);
        assert_eq!(read("bool stable", older), now);
    }
}
