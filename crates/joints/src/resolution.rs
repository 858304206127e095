//! How finely measurements are taken and commands are sent.
//!
//! Numbers are kept to binary fractions ten to a hundred times finer than a drive's own frame resolves (16 bits of
//! position are about 4e-4 rad, 12 bits of velocity 0.02 rad/s, 12 bits of torque 0.04 N m), and finer than an encoder
//! of 18 bits (2.4e-5 rad). What lies below is the noise of computing; a recording that had to keep it would be almost
//! three times as long. Rounding the values themselves, not their record, keeps a recording whole: what is in it is
//! what was measured and sent, to the bit.
//!
//! It is safe because it comes before everything that protects: a measurement is checked after it (not a number stays
//! none, infinite stays infinite), and the limits are applied to commands after it, exactly. What it can move a torque
//! by, at the stiffest gains of the Vision 60, is half a step of each: 1.9e-6 · 300 + 1.2e-4 · 5 + 1e-3 = 2.2e-3 N m, a
//! tenth of what a frame rounds by.

/// Steps of position in 1 rad: 2^18.
const PER_RAD: f64 = 262_144.0;
/// Steps of velocity in 1 rad/s: 2^12.
const PER_RAD_S: f64 = 4096.0;
/// Steps of torque in 1 N m: 2^9.
const PER_NM: f64 = 512.0;
/// A step of position, 3.8e-6 rad.
pub const STEP_RAD: f64 = 1.0 / PER_RAD;
/// A step of velocity, 2.4e-4 rad/s.
pub const STEP_RAD_S: f64 = 1.0 / PER_RAD_S;
/// A step of torque, 2e-3 N m.
pub const STEP_NM: f64 = 1.0 / PER_NM;

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

/// The nearest measured torque in steps of 2^-5, 0.03 N m: it is looked at, nothing is computed with it.
pub fn measured_torque_nm(value: f64) -> f64 {
    (value * 32.0).round() / 32.0
}

/// The nearest length in steps of 2^-20, 1e-6 m: what a simulation reports of itself.
pub fn length_m(value: f64) -> f64 {
    (value * 1_048_576.0).round() / 1_048_576.0
}

/// The nearest component of a unit quaternion in steps of 2^-20: an angle to 2e-6 rad.
pub fn quaternion(value: f64) -> f64 {
    length_m(value)
}

/// The nearest velocity in steps of 2^-14, 6e-5 m/s.
pub fn velocity_m_s(value: f64) -> f64 {
    (value * 16_384.0).round() / 16_384.0
}

/// The nearest acceleration in steps of 2^-10, 1e-3 m/s².
pub fn acceleration_m_s2(value: f64) -> f64 {
    (value * 1024.0).round() / 1024.0
}

/// The nearest force in steps of 2^-6, 0.016 N.
pub fn force_n(value: f64) -> f64 {
    (value * 64.0).round() / 64.0
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
