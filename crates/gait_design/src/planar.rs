//! The planar motion that a stride repeats: g(t) = exp(t (v_x, v_y, ω)), a constant velocity in axes that turn along.

use crate::request::GaitRequest;
use nalgebra::{Matrix2, Vector2};

/// Velocity ahead and to the left, m/s, and yaw rate, rad/s.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct PlanarMotion {
    velocity_m_s: Vector2<f64>,
    pub yaw_rate_rad_s: f64,
}

impl PlanarMotion {
    /// What a request asks for.
    pub fn of(request: &GaitRequest) -> Self {
        Self {
            velocity_m_s: Vector2::new(request.speed_m_s, request.lateral_speed_m_s),
            yaw_rate_rad_s: request.yaw_rate_rad_s,
        }
    }

    /// Straight ahead.
    pub fn straight(speed_m_s: f64) -> Self {
        Self { velocity_m_s: Vector2::new(speed_m_s, 0.0), yaw_rate_rad_s: 0.0 }
    }

    /// Whether it is straight ahead, which is a step and its mirror image.
    pub fn is_straight(&self) -> bool {
        self.velocity_m_s.y == 0.0 && self.yaw_rate_rad_s == 0.0
    }

    /// Yaw after `t`, rad.
    pub fn yaw_rad(&self, t: f64) -> f64 {
        self.yaw_rate_rad_s * t
    }

    /// R(ω t).
    pub fn rotation(&self, t: f64) -> Matrix2<f64> {
        let (sin, cos) = self.yaw_rad(t).sin_cos();
        Matrix2::new(cos, -sin, sin, cos)
    }

    /// dR/dt = ω R′(ω t).
    pub fn rotation_rate(&self, t: f64) -> Matrix2<f64> {
        let (sin, cos) = self.yaw_rad(t).sin_cos();
        Matrix2::new(-sin, -cos, cos, -sin) * self.yaw_rate_rad_s
    }

    /// d(t) = V(ω t) (v_x, v_y) t, m, with V(a) = [sin a / a, −(1 − cos a) / a; (1 − cos a) / a, sin a / a].
    pub fn displacement_m(&self, t: f64) -> Vector2<f64> {
        let half = self.yaw_rad(t) / 2.0;
        // (1 − cos a) / a by the half angle does not cancel where a is small.
        let (along, across) = (t * sinc(2.0 * half), t * half.sin() * sinc(half));
        let v = &self.velocity_m_s;
        Vector2::new(along * v.x - across * v.y, across * v.x + along * v.y)
    }

    /// ḋ(t) = R(ω t) (v_x, v_y), m/s.
    pub fn velocity_m_s(&self, t: f64) -> Vector2<f64> {
        self.rotation(t) * self.velocity_m_s
    }
}

/// sin a / a.
fn sinc(a: f64) -> f64 {
    if a == 0.0 { 1.0 } else { a.sin() / a }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn motion(x: f64, y: f64, yaw_rate_rad_s: f64) -> PlanarMotion {
        PlanarMotion { velocity_m_s: Vector2::new(x, y), yaw_rate_rad_s }
    }

    #[test]
    fn motions_compose_and_a_full_turn_comes_back() {
        let m = motion(0.4, -0.2, 0.7);
        let (s, t) = (0.3, 1.1);
        let both = m.displacement_m(s) + m.rotation(s) * m.displacement_m(t);
        assert!((both - m.displacement_m(s + t)).norm() < 1e-15);
        assert!(m.displacement_m(std::f64::consts::TAU / 0.7).norm() < 1e-15);
    }

    /// Against the series of V, where the closed form would cancel, and differences.
    #[test]
    fn slow_turns_and_rates_are_exact() {
        for w in [0.0, 1e-12, 1e-7, 1e-3, 0.5] {
            let (m, t) = (motion(0.4, -0.2, w), 0.8);
            let a: f64 = w * t;
            if a < 1e-4 {
                let (along, across) = (1.0 - a * a / 6.0, a / 2.0 - a.powi(3) / 24.0);
                let series = Vector2::new(along * 0.4 + across * 0.2, across * 0.4 - along * 0.2) * t;
                assert!((series - m.displacement_m(t)).norm() < 1e-15, "{w}");
            }
            let h = 1e-5;
            let rate = (m.displacement_m(t + h) - m.displacement_m(t - h)) / (2.0 * h);
            assert!((rate - m.velocity_m_s(t)).norm() < 1e-10, "{w}");
            let rate = (m.rotation(t + h) - m.rotation(t - h)) / (2.0 * h);
            assert!((rate - m.rotation_rate(t)).norm() < 1e-10, "{w}");
        }
    }
}
