//! What the drives say of themselves, where the cycle reads them itself: `joint_diagnostics`, and `battery_state` where
//! their frames carry the voltage that they are fed with.

use control::JOINTS;
use joint_bus::{BusHealth, Readings};
use ros::{Node, PublishError, Publisher, Qos, RosError};
use std::time::Duration;
use tandem_msgs::JointDiagnostics;
use tandem_msgs::builtin_interfaces::Time;
use tandem_msgs::sensor_msgs::BatteryState;
use tandem_msgs::std_msgs::Header;

/// The publishers.
pub struct DriveReports {
    diagnostics: Publisher<JointDiagnostics>,
    battery: Publisher<BatteryState>,
}

impl DriveReports {
    /// Opens the topics.
    ///
    /// # Errors
    /// What the middleware refuses.
    pub fn new(node: &Node, offered: Qos) -> Result<Self, RosError> {
        Ok(Self {
            diagnostics: node.publisher("joint_diagnostics", offered)?,
            battery: node.publisher("battery_state", offered)?,
        })
    }

    /// Publishes what was read by the state that was answered.
    pub fn publish(
        &self,
        readings: &Readings,
        bus: &BusHealth,
        names: &[String; JOINTS],
        answered: Duration,
    ) -> [Result<(), PublishError>; 2] {
        let battery = battery_state(readings, answered).map_or(Ok(()), |message| self.battery.publish(message));
        [self.diagnostics.publish(joint_diagnostics(readings, bus, names, answered)), battery]
    }
}

fn header(answered: Duration) -> Header {
    let stamp = Time::from_nanoseconds(i64::try_from(answered.as_nanos()).unwrap_or(i64::MAX));
    Header { stamp, frame_id: String::new() }
}

fn joint_diagnostics(
    readings: &Readings,
    bus: &BusHealth,
    names: &[String; JOINTS],
    answered: Duration,
) -> JointDiagnostics {
    let or_nan = |values: Option<[f64; JOINTS]>| values.unwrap_or([f64::NAN; JOINTS]).to_vec();
    let age_s = |arrived: Option<Duration>| arrived.map_or(f64::NAN, |at| answered.saturating_sub(at).as_secs_f64());
    JointDiagnostics {
        header: header(answered),
        name: names.to_vec(),
        temperature_c: or_nan(readings.temperature_c),
        supply_v: or_nan(readings.supply_v),
        current_a: or_nan(readings.current_a),
        drive_error: readings.drive_error.to_vec(),
        requests: bus.requests.to_vec(),
        lost: bus.requests.iter().zip(bus.replies).map(|(sent, taken)| sent.saturating_sub(taken)).collect(),
        age_s: readings.arrived.map(age_s).to_vec(),
    }
}

/// None where no drive says its voltage. The battery's is the median of the drives': one that measures wrongly moves
/// nothing. What nobody measures is NaN or unknown, as the message's definition asks.
fn battery_state(readings: &Readings, answered: Duration) -> Option<BatteryState> {
    let mut supply_v: Vec<f64> = readings.supply_v?.into_iter().filter(|volts| volts.is_finite()).collect();
    supply_v.sort_by(f64::total_cmp);
    let median = supply_v.get(supply_v.len() / 2)?;
    Some(BatteryState {
        header: header(answered),
        voltage: *median as f32,
        temperature: f32::NAN,
        current: f32::NAN,
        charge: f32::NAN,
        capacity: f32::NAN,
        design_capacity: f32::NAN,
        percentage: f32::NAN,
        present: true,
        location: "drives".to_owned(),
        ..BatteryState::default()
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn readings() -> Readings {
        let mut supply_v = [48.0; JOINTS];
        (supply_v[3], supply_v[5]) = (f64::NAN, 3.0);
        let mut arrived = [Some(Duration::from_millis(990)); JOINTS];
        arrived[7] = None;
        Readings { supply_v: Some(supply_v), temperature_c: Some([41.0; JOINTS]), arrived, ..Readings::default() }
    }

    #[test]
    fn the_battery_is_the_median_of_what_the_drives_are_fed_with() {
        let message = battery_state(&readings(), Duration::from_secs(1)).unwrap();
        assert_eq!((message.voltage, message.present, message.header.stamp.sec), (48.0, true, 1));
        assert!(message.percentage.is_nan() && message.current.is_nan(), "nobody measures them");
        assert!(battery_state(&Readings::default(), Duration::ZERO).is_none(), "no drive says it");
    }

    #[test]
    fn a_drives_lost_frames_are_what_it_was_asked_and_has_not_answered() {
        let mut bus = BusHealth { requests: [1000; JOINTS], replies: [1000; JOINTS], ..BusHealth::default() };
        bus.replies[2] = 990;
        let names = std::array::from_fn(|j| format!("joint_{j}"));
        let message = joint_diagnostics(&readings(), &bus, &names, Duration::from_secs(1));
        assert_eq!((message.lost[1], message.lost[2], message.requests[2]), (0, 10, 1000));
        assert_eq!((message.temperature_c[0], message.supply_v[0]), (41.0, 48.0));
        assert!(message.current_a.iter().all(|amperes| amperes.is_nan()), "mit frames carry none");
        assert!((message.age_s[0] - 0.010).abs() < 1e-12 && message.age_s[7].is_nan());
    }
}
