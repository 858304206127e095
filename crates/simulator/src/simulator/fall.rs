//! Whether the robot has fallen.

use super::Simulator;
use crate::Fall;

/// A body lower than this fraction of its first height has fallen.
const FALLEN_HEIGHT_FRACTION: f64 = 0.6;
/// A body tilted by more than this has fallen, rad.
const FALLEN_TILT_RAD: f64 = 0.8;

impl Simulator {
    /// Whether the robot has fallen, judged on the present state.
    pub fn fallen(&self) -> Option<Fall> {
        let (qpos, qvel) = (self.data.qpos(), self.data.qvel());
        if qpos.iter().chain(qvel).any(|v| !v.is_finite()) {
            return Some(Fall::NotFinite);
        }
        let state = self.state();
        let [roll, pitch, _] = state.roll_pitch_yaw();
        if roll.abs().max(pitch.abs()) > FALLEN_TILT_RAD {
            return Some(Fall::Tilted);
        }
        let height = qpos[2] - self.options.terrain.ground_m(qpos[0], qpos[1]);
        (height < FALLEN_HEIGHT_FRACTION * self.first_height_m).then_some(Fall::Low)
    }

    /// From now on a fall is judged against this height of the base above the toe centres, m (after standing up, for
    /// example).
    pub fn expect_height(&mut self, height_m: f64) {
        self.first_height_m = height_m;
    }

    /// Height of the base above the toe centres of a robot that stands on the ground below it, m.
    pub fn height_m(&self) -> f64 {
        let qpos = self.data.qpos();
        qpos[2] - self.toe_radius_m - self.options.terrain.ground_m(qpos[0], qpos[1])
    }
}
