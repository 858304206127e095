//! Where a stride is and where it heads, which its closure leaves open: in axes that have moved along for half of it,
//! the body's y and yaw are opposite to what they were at its start, as the mirror makes them. With x₂, y₂, ψ₂ at its
//! middle switch, at time t,
//!
//! > −sin(ω t) (x₂ − d_x) + cos(ω t) (y₂ − d_y) + y₁ = 0,   ψ₂ − ω t + ψ₁ = 0.

use super::{At, EQUAL, Names, Place, Rows, Schedule, Term};
use crate::full_order::schedule::at;
use crate::planar::PlanarMotion;

const Y: usize = 1;
const YAW: usize = 5;

/// Rows are y, m, and yaw, rad.
pub(super) struct Centred {
    first: Place,
    middle: Place,
    motion: PlanarMotion,
}

impl Centred {
    pub fn new(schedule: &Schedule, motion: PlanarMotion) -> Self {
        let half = schedule.domains.len() / 2;
        Self { first: schedule.places_of(0)[0], middle: schedule.places_of(half)[0], motion }
    }

    /// Time at the middle switch, s.
    fn half_s(&self, at: &At) -> f64 {
        at.t() * self.middle.time
    }

    /// How far the middle is from where the motion leads, m.
    fn away(&self, at: &At) -> nalgebra::Vector2<f64> {
        let p = self.middle.column + at::Q;
        nalgebra::Vector2::new(at.x[p], at.x[p + 1]) - self.motion.displacement_m(self.half_s(at))
    }
}

impl Term for Centred {
    fn bounds(&self) -> Vec<[f64; 2]> {
        vec![EQUAL; 2]
    }

    fn values(&self, at: &At, rows: &mut [f64]) {
        let [first, middle] = [self.first, self.middle].map(|place| &at.x[place.column + at::Q..]);
        let left = self.motion.rotation(self.half_s(at)).column(1).into_owned();
        rows[0] = first[Y] + left.dot(&self.away(at));
        rows[1] = first[YAW] + (middle[YAW] - self.motion.yaw_rad(self.half_s(at)));
    }

    fn derivatives(&self, at: &At, rows: &mut Rows) {
        let [first, middle] = [self.first, self.middle].map(|place| place.column + at::Q);
        let half_s = self.half_s(at);
        let left = self.motion.rotation(half_s).column(1).into_owned();
        rows.put(0, first + Y, 1.0);
        rows.put(0, middle + Y, left.y);
        rows.put(1, first + YAW, 1.0);
        rows.put(1, middle + YAW, 1.0);
        if self.motion.is_straight() {
            return;
        }
        let turning = self.motion.rotation_rate(half_s).column(1).into_owned();
        let by_t = turning.dot(&self.away(at)) - left.dot(&self.motion.velocity_m_s(half_s));
        rows.put(0, middle, left.x);
        rows.put(0, at.t_column, by_t * self.middle.time);
        rows.put(1, at.t_column, -self.motion.yaw_rad(self.middle.time));
    }

    fn is_tie(&self) -> bool {
        true
    }

    fn name(&self, row: usize, names: &Names) -> String {
        format!("{} opposite at the two switches", names.coordinate([Y, YAW][row]))
    }
}
