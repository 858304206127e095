//! How finely measurements are taken and commands are sent.
//!
//! Numbers are kept to binary fractions ten to a hundred times finer than a drive's own frame resolves (16 bits of position are
//! about 4e-4 rad, 12 bits of velocity 0.02 rad/s, 12 bits of torque 0.04 N m). What lies below is the noise of computing; a recording
//! that had to keep it would be almost three times as long. Rounding the values themselves, not their record, keeps a recording
//! whole: what is in it is what was measured and sent, to the bit.

use crate::{JointCommand, JointState, Tilt};

/// Steps of position in 1 rad: 2^18, 3.8e-6 rad each.
const PER_RAD: f64 = 262_144.0;
/// Steps of velocity in 1 rad/s: 2^12, 2.4e-4 rad/s each.
const PER_RAD_S: f64 = 4096.0;
/// Steps of torque in 1 N m: 2^9, 2e-3 N m each.
const PER_NM: f64 = 512.0;

/// The nearest position, rad. Not a number stays none.
pub fn position_rad(value: f64) -> f64 {
    (value * PER_RAD).round() / PER_RAD
}

/// The nearest velocity, rad/s.
pub fn velocity_rad_s(value: f64) -> f64 {
    (value * PER_RAD_S).round() / PER_RAD_S
}

/// The nearest torque, N m.
pub fn torque_nm(value: f64) -> f64 {
    (value * PER_NM).round() / PER_NM
}

/// The nearest measured torque in steps of 2^-6, 0.016 N m: it is looked at, nothing is computed with it.
pub fn measured_torque_nm(value: f64) -> f64 {
    (value * 64.0).round() / 64.0
}

impl JointState {
    /// The state as the controller takes it.
    pub fn to_resolution(self) -> Self {
        Self {
            position_rad: self.position_rad.map(position_rad),
            velocity_rad_s: self.velocity_rad_s.map(velocity_rad_s),
            ..self
        }
    }
}

impl Tilt {
    /// The attitude as the controller takes it.
    pub fn to_resolution(self) -> Self {
        Self { roll_rad: position_rad(self.roll_rad), pitch_rad: position_rad(self.pitch_rad) }
    }
}

impl JointCommand {
    /// The command as it is asked for; the limits come after it and change what breaks them, exactly. Gains are left as they are.
    pub(crate) fn to_resolution(self) -> Self {
        Self {
            position_rad: self.position_rad.map(position_rad),
            velocity_rad_s: self.velocity_rad_s.map(velocity_rad_s),
            torque_nm: self.torque_nm.map(torque_nm),
            ..self
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rounding_is_small_and_happens_once() {
        for n in -10_000..10_000 {
            let x = f64::from(n) * 1.234_567_890_123e-3;
            assert!((position_rad(x) - x).abs() <= 0.5 / PER_RAD);
            assert!((velocity_rad_s(x) - x).abs() <= 0.5 / PER_RAD_S);
            assert!((torque_nm(x) - x).abs() <= 0.5 / PER_NM);
            for round in [position_rad, velocity_rad_s, torque_nm] {
                assert_eq!(round(round(x)).to_bits(), round(x).to_bits());
            }
        }
        assert!(position_rad(f64::NAN).is_nan() && torque_nm(f64::INFINITY).is_infinite());
    }
}
