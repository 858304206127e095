//! Moving from one posture to another without a jump: cubic Hermite in position, smooth in gains and torque.

use crate::{JOINTS, JointCommand};
use std::time::Duration;

/// A move between two commands. Position and velocity are continuous at both ends; gains and feed-forward torque go
/// over along 3x² − 2x³.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub(crate) struct Ramp {
    pub from: JointCommand,
    pub to: JointCommand,
    pub duration_s: f64,
    /// Gains reach their final value after this time, s; at most `duration_s`.
    pub gain_s: f64,
}

impl Ramp {
    pub fn is_over(&self, elapsed: Duration) -> bool {
        elapsed >= Duration::from_secs_f64(self.duration_s)
    }

    pub fn at(&self, elapsed_s: f64) -> JointCommand {
        if elapsed_s >= self.duration_s {
            return self.to;
        }
        let x = (elapsed_s / self.duration_s).clamp(0.0, 1.0);
        let smooth = smoothstep(x);
        let g = (elapsed_s / self.gain_s).clamp(0.0, 1.0);
        let gain = smoothstep(g);
        let (a, b) = (&self.from, &self.to);
        let mix = |from: &[f64; JOINTS], to: &[f64; JOINTS], share: f64| {
            std::array::from_fn(|j| from[j] + share * (to[j] - from[j]))
        };
        // Hermite's polynomials and their derivatives.
        let (h10, h11) = (x * (1.0 - x) * (1.0 - x), x * x * (x - 1.0));
        let (d00, d10, d11) = (6.0 * x * (x - 1.0), (1.0 - x) * (1.0 - 3.0 * x), x * (3.0 * x - 2.0));
        let t = self.duration_s;
        JointCommand {
            position_rad: std::array::from_fn(|j| {
                a.position_rad[j]
                    + smooth * (b.position_rad[j] - a.position_rad[j])
                    + t * (h10 * a.velocity_rad_s[j] + h11 * b.velocity_rad_s[j])
            }),
            velocity_rad_s: std::array::from_fn(|j| {
                d00 * (a.position_rad[j] - b.position_rad[j]) / t
                    + d10 * a.velocity_rad_s[j]
                    + d11 * b.velocity_rad_s[j]
            }),
            kp: mix(&a.kp, &b.kp, gain),
            kd: mix(&a.kd, &b.kd, gain),
            torque_nm: mix(&a.torque_nm, &b.torque_nm, gain),
        }
    }
}

/// 3 x² − 2 x³: from rest to rest for x from 0 to 1.
pub(crate) fn smoothstep(x: f64) -> f64 {
    x * x * (3.0 - 2.0 * x)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ramp() -> Ramp {
        let from = JointCommand {
            position_rad: std::array::from_fn(|j| 0.1 * j as f64),
            velocity_rad_s: std::array::from_fn(|j| 1.0 - 0.2 * j as f64),
            ..JointCommand::LIMP
        };
        let to = JointCommand {
            position_rad: std::array::from_fn(|j| 1.0 - 0.1 * j as f64),
            velocity_rad_s: std::array::from_fn(|j| 0.3 * j as f64),
            kp: [230.0; JOINTS],
            kd: [5.0; JOINTS],
            torque_nm: [20.0; JOINTS],
        };
        Ramp { from, to, duration_s: 0.8, gain_s: 0.2 }
    }

    #[test]
    fn both_ends_are_met_in_position_velocity_and_gains() {
        let r = ramp();
        assert_eq!(r.at(0.0), r.from);
        let end = r.at(0.8 - 1e-9);
        for j in 0..JOINTS {
            assert!((end.position_rad[j] - r.to.position_rad[j]).abs() < 1e-7);
            assert!((end.velocity_rad_s[j] - r.to.velocity_rad_s[j]).abs() < 1e-6);
        }
        assert_eq!(r.at(0.2).kp, r.to.kp);
        assert_eq!(r.at(0.8), r.to);
    }

    #[test]
    fn the_velocity_is_the_position_s_derivative() {
        let r = ramp();
        for n in 1..80 {
            let (t, h) = (0.01 * n as f64, 1e-6);
            if t + h >= 0.8 {
                continue;
            }
            let (before, at, after) = (r.at(t - h), r.at(t), r.at(t + h));
            for j in 0..JOINTS {
                let slope = (after.position_rad[j] - before.position_rad[j]) / (2.0 * h);
                assert!((slope - at.velocity_rad_s[j]).abs() < 1e-6);
            }
        }
    }
}
