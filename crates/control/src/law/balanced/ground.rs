//! The ground's plane through the toes, and the frames that it gives.

use super::BalanceConfig;
use estimator::Estimator;
use nalgebra::{Matrix3, Vector3};

/// The ground's rise over run, ahead and to the left, and the shift that keeps the body above the toes on it.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Ground {
    pub rise: [f64; 2],
    pub shift_m: [f64; 2],
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

    /// The shift that the ground asks for, at once.
    pub fn shift_at_once(&mut self, config: &BalanceConfig, height_m: f64, planned_rise: [f64; 2]) {
        self.shift_m = self.wanted_shift_m(config, height_m, planned_rise);
    }

    /// The shift follows the ground.
    pub fn follow(&mut self, config: &BalanceConfig, height_m: f64, planned_rise: [f64; 2], dt_s: f64) {
        let most = config.shift_rate_share * height_m * dt_s;
        let wanted = self.wanted_shift_m(config, height_m, planned_rise);
        for axis in 0..2 {
            self.shift_m[axis] += (wanted[axis] - self.shift_m[axis]).clamp(-most, most);
        }
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
