//! The ground's plane through the toes, and the frames that it gives.

use super::BalanceConfig;
use estimator::Estimator;
use nalgebra::{Matrix3, Vector3};

/// The body is lowered by at most this share of its height.
const LOWERED_MOST: f64 = 0.25;
/// … and this share of it a second.
const LOWERED_RATE_S: f64 = 0.05;
/// Ground is steep where it has been for about so long, s: over a kerb or where it rolls the body keeps its height.
const STEEP_FILTER_S: f64 = 3.0;

/// The ground's rise over run, ahead and to the left, the shift that keeps the body above the toes on it, and how much
/// lower the body is, m.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Ground {
    pub rise: [f64; 2],
    pub shift_m: [f64; 2],
    /// Recordings that are older know of none.
    #[serde(default)]
    pub lowered_m: f64,
    /// The rise of the last seconds, less what the gait is planned for.
    #[serde(default)]
    lasting_rise: [f64; 2],
}

/// Rotations of one cycle.
#[derive(Clone, Copy, Debug)]
pub(super) struct Frames {
    /// From the body's axes to the heading's: yaw removed, z against gravity.
    pub heading: Matrix3<f64>,
    /// From the body's axes to the ground's.
    pub ground: Matrix3<f64>,
    /// Up, in the ground's axes.
    pub up: Vector3<f64>,
}

impl Ground {
    /// The frames in which the base's attitude is `estimate`'s.
    pub fn frames(&self, estimate: &Estimator) -> Frames {
        let rotation = estimate.rotation();
        let (sine, cosine) = rotation.m21.atan2(rotation.m11).sin_cos();
        let unyaw = Matrix3::new(cosine, sine, 0.0, -sine, cosine, 0.0, 0.0, 0.0, 1.0);
        let heading = unyaw * rotation;
        let to_heading = ground_to_heading(self.rise);
        Frames { heading, ground: to_heading.transpose() * heading, up: to_heading.row(2).transpose() }
    }

    /// The plane through the four toes (body axes) that differs least from them, believed by `gain`.
    pub fn fit(&mut self, config: &BalanceConfig, toes: &[Vector3<f64>; 4], frames: &Frames, gain: f64) {
        let toes = toes.map(|toe| frames.heading * toe);
        let mean = toes.iter().sum::<Vector3<f64>>() / 4.0;
        let [mut xx, mut xy, mut yy, mut xz, mut yz] = [0.0; 5];
        for toe in toes {
            let d = toe - mean;
            xx += d.x * d.x;
            xy += d.x * d.y;
            yy += d.y * d.y;
            xz += d.x * d.z;
            yz += d.y * d.z;
        }
        let determinant = xx * yy - xy * xy;
        // Toes on one line have no plane.
        if determinant < 1e-6 * (xx + yy) * (xx + yy) {
            return;
        }
        let rise = [(yy * xz - xy * yz) / determinant, (xx * yz - xy * xz) / determinant];
        for axis in 0..2 {
            let believed = rise[axis].clamp(-config.ground_limit, config.ground_limit);
            self.rise[axis] += gain * (believed - self.rise[axis]);
        }
    }

    /// The shift that the ground asks for beyond what a gait that is planned for such ground has by itself.
    fn wanted_shift_m(&self, config: &BalanceConfig, height_m: f64, planned_rise: [f64; 2]) -> [f64; 2] {
        let by_rise_m = config.slope_shift_share * height_m;
        std::array::from_fn(|axis| -by_rise_m * (self.rise[axis] - planned_rise[axis]))
    }

    /// The shift that the ground asks for, at once; it has been as steep for long.
    pub fn shift_at_once(&mut self, config: &BalanceConfig, height_m: f64, planned_rise: [f64; 2]) {
        self.shift_m = self.wanted_shift_m(config, height_m, planned_rise);
        self.lasting_rise = std::array::from_fn(|axis| self.rise[axis] - planned_rise[axis]);
    }

    /// Shift and height follow the ground.
    pub fn follow(&mut self, config: &BalanceConfig, height_m: f64, planned_rise: [f64; 2], dt_s: f64) {
        let most = config.shift_rate_share * height_m * dt_s;
        let wanted = self.wanted_shift_m(config, height_m, planned_rise);
        for axis in 0..2 {
            self.shift_m[axis] += (wanted[axis] - self.shift_m[axis]).clamp(-most, most);
            let rise = self.rise[axis] - planned_rise[axis];
            self.lasting_rise[axis] += dt_s / STEEP_FILTER_S * (rise - self.lasting_rise[axis]);
        }
        // Steep ground asks for legs that reach further, up and down the hill.
        let steep = self.lasting_rise[0].hypot(self.lasting_rise[1]) - config.slope_lowering_from;
        let lowered = height_m * (config.slope_lowering_share * steep).clamp(0.0, LOWERED_MOST);
        let most = LOWERED_RATE_S * height_m * dt_s;
        self.lowered_m += (lowered - self.lowered_m).clamp(-most, most);
    }
}

/// Up, in the axes of ground that rises so.
pub(super) fn up_on(rise: [f64; 2]) -> Vector3<f64> {
    ground_to_heading(rise).row(2).transpose()
}

fn ground_to_heading([rise_x, rise_y]: [f64; 2]) -> Matrix3<f64> {
    let normal = Vector3::new(-rise_x, -rise_y, 1.0).normalize();
    let ahead = Vector3::new(1.0, 0.0, rise_x).normalize();
    Matrix3::from_columns(&[ahead, normal.cross(&ahead), normal])
}

#[cfg(test)]
mod tests {
    use super::Ground;
    use crate::balanced::BalanceConfig;
    use robot::Robot;
    use std::path::Path;

    const HEIGHT_M: f64 = 0.55;

    /// How much lower the body is after `seconds` over ground of this rise at each time, m.
    fn lowered_m(seconds: f64, rise_at: impl Fn(f64) -> f64) -> f64 {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config/robots/vision60");
        let config = BalanceConfig::for_robot(&Robot::load(&folder).unwrap()).unwrap();
        let mut ground = Ground::default();
        for cycle in 0..(1000.0 * seconds) as u32 {
            ground.rise = [rise_at(1e-3 * f64::from(cycle)), 0.0];
            ground.follow(&config, HEIGHT_M, [0.0; 2], 1e-3);
        }
        ground.lowered_m
    }

    /// At its own height it slid down 15°: legs that reach down the hill were straight.
    #[test]
    fn on_a_steep_slope_the_body_goes_lower_and_over_a_kerb_or_rolling_ground_it_does_not() {
        let steep = 15_f64.to_radians().tan();
        let low = lowered_m(20.0, |_| steep);
        assert!((low / HEIGHT_M - (steep - 0.05)).abs() < 2e-3, "{low} m");
        assert_eq!(lowered_m(20.0, |_| 0.04), 0.0, "hardly a slope");
        assert_eq!(lowered_m(1.0, |t| if t < 0.4 { 0.13 } else { 0.0 }), 0.0, "a kerb of 8 cm under half the legs");
        let rolling = lowered_m(20.0, |t| 0.17 * (2.0 * t).sin());
        assert!(rolling < 0.01, "{rolling} m");
        assert!(lowered_m(40.0, |t| if t < 20.0 { steep } else { 0.0 }) < 1e-9, "level again, as high again");
    }
}
