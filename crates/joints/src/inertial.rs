//! What an inertial unit reports.

use crate::resolution::{acceleration_m_s2, quaternion, velocity_rad_s};
use std::time::Duration;

/// How far a quaternion's length may be from 1 for the rounding of whoever sends it.
const QUATERNION_TOLERANCE: f64 = 0.02;

/// Whether a quaternion of this length may stand for a rotation; one whose length is not a number may not.
pub fn is_unit_length(length: f64) -> bool {
    (length - 1.0).abs() <= QUATERNION_TOLERANCE
}

/// One message of the inertial unit on the base, whole. What a unit does not measure is none.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub struct InertialState {
    /// The unit's own time stamp, on a clock of its own: only differences mean something.
    pub stamp: Duration,
    /// When it came in, on the clock of `now`.
    pub arrived: Duration,
    /// Rotation from the base's axes to level ones, (x, y, z, w).
    pub attitude_xyzw: Option<[f64; 4]>,
    /// Angular velocity about the base's axes, rad/s.
    pub angular_velocity_rad_s: Option<[f64; 3]>,
    /// Acceleration along the base's axes, m/s², gravity included: at rest, upright, (0, 0, 9.81).
    pub acceleration_m_s2: Option<[f64; 3]>,
}

/// The base's attitude without its heading.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tilt {
    /// Rotation about the forward axis, rad.
    pub roll_rad: f64,
    /// Rotation about the leftward axis, rad.
    pub pitch_rad: f64,
}

impl InertialState {
    /// The state as the controller takes it.
    pub fn to_resolution(self) -> Self {
        Self {
            attitude_xyzw: self.attitude_xyzw.map(|q| q.map(quaternion)),
            angular_velocity_rad_s: self.angular_velocity_rad_s.map(|v| v.map(velocity_rad_s)),
            acceleration_m_s2: self.acceleration_m_s2.map(|a| a.map(acceleration_m_s2)),
            ..self
        }
    }

    /// Roll and pitch, R = Rz(yaw) Ry(pitch) Rx(roll); not a number where the attitude is no rotation, none where it is
    /// not measured.
    pub fn tilt(&self) -> Option<Tilt> {
        let q = self.attitude_xyzw?;
        let length = q.iter().map(|component| component * component).sum::<f64>().sqrt();
        if !is_unit_length(length) {
            return Some(Tilt { roll_rad: f64::NAN, pitch_rad: f64::NAN });
        }
        let [x, y, z, w] = q.map(|component| component / length);
        Some(Tilt {
            roll_rad: (2.0 * (w * x + y * z)).atan2(1.0 - 2.0 * (x * x + y * y)),
            pitch_rad: (2.0 * (w * y - z * x)).clamp(-1.0, 1.0).asin(),
        })
    }

    /// An attitude alone, as bags of earlier versions and tests know it.
    pub fn tilted(tilt: Tilt, now: Duration) -> Self {
        let [(sr, cr), (sp, cp)] = [tilt.roll_rad, tilt.pitch_rad].map(|angle| (0.5 * angle).sin_cos());
        Self {
            stamp: now,
            arrived: now,
            attitude_xyzw: Some([sr * cp, cr * sp, -sr * sp, cr * cp]),
            angular_velocity_rad_s: None,
            acceleration_m_s2: None,
        }
    }

    /// The first of its numbers that is none.
    pub fn not_finite(&self) -> Option<f64> {
        let attitude = self.attitude_xyzw.iter().flatten();
        let rates = self.angular_velocity_rad_s.iter().chain(&self.acceleration_m_s2).flatten();
        attitude.chain(rates).copied().find(|value| !value.is_finite())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tilt_is_roll_and_pitch_whatever_the_heading() {
        let (roll, pitch, yaw) = (0.3_f64, -0.2_f64, 1.1_f64);
        let [(sr, cr), (sp, cp), (sy, cy)] = [roll, pitch, yaw].map(|a| (a / 2.0).sin_cos());
        let q = [
            sr * cp * cy - cr * sp * sy,
            cr * sp * cy + sr * cp * sy,
            cr * cp * sy - sr * sp * cy,
            cr * cp * cy + sr * sp * sy,
        ];
        let mut state = InertialState::tilted(Tilt { roll_rad: roll, pitch_rad: pitch }, Duration::ZERO);
        // Rounded to single precision and a little more: taken as the rotation that it nearly is.
        for attitude in [state.attitude_xyzw.unwrap(), q, q.map(|c| c * (1.0 - 1e-3))] {
            state.attitude_xyzw = Some(attitude);
            let found = state.tilt().unwrap();
            assert!((found.roll_rad - roll).abs() < 1e-12 && (found.pitch_rad - pitch).abs() < 1e-12, "{found:?}");
        }
        state.attitude_xyzw = None;
        assert_eq!(state.tilt(), None);
    }

    #[test]
    fn an_attitude_that_is_no_rotation_is_not_read_as_level() {
        let mut state = InertialState::tilted(Tilt { roll_rad: 0.0, pitch_rad: 0.0 }, Duration::ZERO);
        // 1.2 rad of roll at length 0.6 would read 0.41 rad.
        for q in [[0.0; 4], [0.6 * 0.6_f64.sin(), 0.0, 0.0, 0.6 * 0.6_f64.cos()], [f64::NAN, 0.0, 0.0, 1.0]] {
            state.attitude_xyzw = Some(q);
            assert!(state.tilt().unwrap().roll_rad.is_nan(), "{q:?}");
        }
    }
}
