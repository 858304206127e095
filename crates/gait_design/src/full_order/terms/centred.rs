//! Where a stride is and where it heads, which its closure leaves open: in axes that have moved along for half of it,
//! the body's x, y and yaw are opposite to what they were at its start, as the mirror makes y and yaw. With p₂, ψ₂ at
//! its middle switch, at time t,
//!
//! > R(ω t)ᵀ (p₂ − d(t)) + p₁ = 0,   ψ₂ − ω t + ψ₁ = 0.
//!
//! So the mirror image of a stride is the stride of the mirrored request.

use crate::full_order::schedule::{Place, Schedule};
use crate::planar::PlanarMotion;
use crate::terms::{At, EQUAL, Names, Rows, Sink, Term};

const YAW: usize = 5;

/// Rows are x and y, m, and yaw, rad.
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
        let p = self.middle.q(0);
        nalgebra::Vector2::new(at.x[p], at.x[p + 1]) - self.motion.displacement_m(self.half_s(at))
    }
}

impl Term for Centred {
    fn bounds(&self, bounds: &mut Vec<[f64; 2]>) {
        bounds.extend([EQUAL; 3]);
    }

    fn values(&self, at: &At, rows: &mut [f64]) {
        let [first, middle] = [self.first, self.middle].map(|place| &at.x[place.q(0)..]);
        let away = self.motion.rotation(self.half_s(at)).tr_mul(&self.away(at));
        rows[0] = first[0] + away.x;
        rows[1] = first[1] + away.y;
        rows[2] = first[YAW] + (middle[YAW] - self.motion.yaw_rad(self.half_s(at)));
    }

    fn derivatives(&self, at: &At, rows: &mut Rows<impl Sink>) {
        let [first, middle] = [self.first, self.middle].map(|place| place.q(0));
        let half_s = self.half_s(at);
        let turned = self.motion.rotation(half_s);
        let turning = self.motion.rotation_rate(half_s);
        let by_t = turning.tr_mul(&self.away(at)) - turned.tr_mul(&self.motion.velocity_m_s(half_s));
        for row in 0..2 {
            rows.put(row, first + row, 1.0);
            for i in 0..2 {
                rows.put(row, middle + i, turned[(i, row)]);
            }
            rows.put(row, at.t_column, by_t[row] * self.middle.time);
        }
        rows.put(2, first + YAW, 1.0);
        rows.put(2, middle + YAW, 1.0);
        rows.put(2, at.t_column, -self.motion.yaw_rad(self.middle.time));
    }

    fn is_tie(&self) -> bool {
        true
    }

    fn name(&self, row: usize, names: &Names) -> String {
        format!("{} opposite at the two switches", names.coordinate([0, 1, YAW][row]))
    }
}
