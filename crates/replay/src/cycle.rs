//! Recorded cycles, also those of versions whose message had fewer fields.

use std::borrow::Cow;
use std::time::Duration;

use bag::{BagError, BagTopic, from_cdr};
use control::{InertialState, Tilt};
use tandem_msgs::ControlCycle;

/// Fields that were added at the message's end: a flag, and four lists, of which every one empty is a length of 0.
const INERTIAL: (&str, usize, usize) = ("inertial_age_ns", 1, 4 * 4);

/// A recorded cycle. What an older message does not say is empty.
pub(crate) fn control_cycle(topic: &BagTopic, data: &[u8]) -> Result<ControlCycle, BagError> {
    let (field, flag, lists) = INERTIAL;
    let is_older = topic.definition.as_deref().is_some_and(|definition| !definition.contains(field));
    let whole = if is_older {
        // The lists' lengths are aligned to 4 after the 4 bytes of the encapsulation.
        let missing = (data.len() + flag).next_multiple_of(4) - data.len() + lists;
        Cow::Owned([data, &vec![0; missing]].concat())
    } else {
        Cow::Borrowed(data)
    };
    from_cdr(&topic.type_name, &whole)
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

fn some_array<const N: usize>(name: &str, values: &[f64]) -> Result<Option<[f64; N]>, String> {
    if values.is_empty() {
        return Ok(None);
    }
    values.try_into().map(Some).map_err(|_| format!("{name} has {} entries; expected 0 or {N}", values.len()))
}
