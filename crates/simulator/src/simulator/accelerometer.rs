//! The accelerometer, and the inertial unit that it is part of.

use super::Simulator;
use control::InertialState;
use std::time::Duration;

/// Sum of the accelerometer's readings since it was asked last, m/s², and how many there were.
#[derive(Default)]
pub(super) struct Accumulated {
    sum: [f64; 3],
    count: u32,
}

impl Simulator {
    /// What an accelerometer at the base's origin reads, in the base's axes, m/s².
    pub fn specific_force_body(&self) -> [f64; 3] {
        let sensors = self.data.sensordata();
        [sensors[0], sensors[1], sensors[2]]
    }

    /// Its mean since this was asked last, as a unit gives that filters before it samples.
    pub fn mean_specific_force_body(&mut self) -> [f64; 3] {
        let Accumulated { sum, count } = std::mem::take(&mut self.accumulated);
        if count == 0 { self.specific_force_body() } else { sum.map(|sum| sum / f64::from(count)) }
    }

    /// What an inertial unit on the base measures at `now`.
    pub fn inertial_state(&mut self, now: Duration) -> InertialState {
        InertialState {
            stamp: now,
            arrived: now,
            attitude_xyzw: Some(self.imu_quaternion_xyzw()),
            angular_velocity_rad_s: Some(self.state().base_angular_velocity_body),
            acceleration_m_s2: Some(self.mean_specific_force_body()),
        }
    }

    /// After every physics step.
    pub(super) fn accumulate_specific_force(&mut self) {
        let force = self.specific_force_body();
        self.accumulated.sum = std::array::from_fn(|axis| self.accumulated.sum[axis] + force[axis]);
        self.accumulated.count += 1;
    }
}
