//! Sensors as a robot has them: an inertial unit with noise and an offset, encoders that are differenced for
//! velocities.

use crate::simulator::{Random, Simulator};
use control::{InertialState, JointState};
use std::time::Duration;

/// How bad the sensors are. The default is a small MEMS unit and 18-bit encoders.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Noise {
    /// Deviation of a sample of angular velocity, rad/s.
    pub angular_velocity_rad_s: f64,
    /// Deviation of a sample of acceleration, m/s².
    pub acceleration_m_s2: f64,
    /// Constant offset of each axis' acceleration, of random sign, m/s².
    pub acceleration_offset_m_s2: f64,
    /// Step of the encoders, rad.
    pub encoder_rad: f64,
}

impl Default for Noise {
    fn default() -> Self {
        // Densities of 0.002 rad/s/√Hz and 0.02 m/s²/√Hz at 1 kHz.
        let per_sample = 1000.0_f64.sqrt();
        Self {
            angular_velocity_rad_s: 0.002 * per_sample,
            acceleration_m_s2: 0.02 * per_sample,
            acceleration_offset_m_s2: 0.05,
            encoder_rad: std::f64::consts::TAU / 262_144.0,
        }
    }
}

impl Noise {
    /// The inertial unit's noise and offset times `factor`.
    pub fn times(self, factor: f64) -> Self {
        Self {
            angular_velocity_rad_s: factor * self.angular_velocity_rad_s,
            acceleration_m_s2: factor * self.acceleration_m_s2,
            acceleration_offset_m_s2: factor * self.acceleration_offset_m_s2,
            ..self
        }
    }
}

/// The sensors and what they remember.
pub(super) struct Sensors {
    noise: Noise,
    random: Random,
    offset_m_s2: [f64; 3],
    /// The accelerometer's mean over the physics steps since the last reading, as a unit that filters before it
    /// samples.
    force_sum: [f64; 3],
    samples: f64,
    last_rad: Option<[f64; 12]>,
}

impl Sensors {
    pub fn new(seed: u64, noise: Noise, simulator: &Simulator) -> Self {
        let mut random = Random::new(seed ^ 0x5eed_0000_0000_0002);
        let sign = |random: &mut Random| if random.uniform() < 0.5 { -1.0 } else { 1.0 };
        let offset_m_s2 = std::array::from_fn(|_| sign(&mut random) * noise.acceleration_offset_m_s2);
        let mut sensors = Self { noise, random, offset_m_s2, force_sum: [0.0; 3], samples: 0.0, last_rad: None };
        sensors.accumulate(simulator);
        sensors
    }

    /// After every physics step.
    pub fn accumulate(&mut self, simulator: &Simulator) {
        let force = simulator.specific_force_body();
        for axis in 0..3 {
            self.force_sum[axis] += force[axis];
        }
        self.samples += 1.0;
    }

    /// What the controller receives at `now`.
    pub fn read(&mut self, simulator: &Simulator, now: Duration) -> (JointState, InertialState) {
        let state = simulator.state();
        let (noise, random) = (self.noise, &mut self.random);
        let position_rad = state.joint_position_rad.map(|q| (q / noise.encoder_rad).round() * noise.encoder_rad);
        let velocity_rad_s = match self.last_rad {
            Some(last) => std::array::from_fn(|j| (position_rad[j] - last[j]) / super::PERIOD_S),
            None => state.joint_velocity_rad_s,
        };
        let first = self.last_rad.replace(position_rad).is_none();
        let gyro = state.base_angular_velocity_body.map(|w| w + noise.angular_velocity_rad_s * random.normal());
        let force = std::array::from_fn(|axis| {
            self.force_sum[axis] / self.samples.max(1.0)
                + self.offset_m_s2[axis]
                + noise.acceleration_m_s2 * random.normal()
        });
        (self.force_sum, self.samples) = ([0.0; 3], 0.0);
        let joints = JointState::measured(now, position_rad, velocity_rad_s);
        let inertial = InertialState {
            stamp: now,
            arrived: now,
            angular_velocity_rad_s: Some(gyro),
            acceleration_m_s2: Some(force),
            // The trial begins in motion, where one sample of an accelerometer is no vertical.
            attitude_xyzw: first.then(|| simulator.imu_quaternion_xyzw()),
        };
        (joints.to_resolution(), inertial.to_resolution())
    }
}
