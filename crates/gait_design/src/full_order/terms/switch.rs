//! Where a domain ends, the next begins with the same q and q̇. The last one's next is the first one's beginning: its
//! mirror image a step ahead, or itself moved by the planar motion g over the whole schedule,
//!
//! > p_xy(end) = R(ω t) p_xy(0) + d(t),   yaw(end) = yaw(0) + ω t,   ṗ_xy(end) = R(ω t) ṗ_xy(0).
//!
//! Everything else repeats, for rates of Euler angles do not feel yaw.

use super::{Asked, At, EQUAL, Names, Place, Rows, Term};
use crate::full_order::schedule::{Closure, DOF, Step, at};
use crate::planar::PlanarMotion;
use robot::Mirror;

const YAW: usize = 5;

enum Link {
    /// To the next domain.
    Joined,
    /// To the mirror image of the beginning, by so many durations of T ahead.
    Mirrored { mirror: Mirror, motion: PlanarMotion, duration: f64 },
    /// To the beginning, moved for so many durations of T.
    Moved { motion: PlanarMotion, duration: f64 },
}

/// Rows are q and then q̇.
pub(super) struct Switch {
    end: Place,
    next: Place,
    link: Link,
    step: Step,
}

impl Switch {
    pub fn new(asked: &Asked, end: Place) -> Self {
        let schedule = asked.schedule;
        let (motion, duration) = (asked.motion, schedule.duration());
        let (next, link) = if end.domain + 1 < schedule.domains.len() {
            (end.domain + 1, Link::Joined)
        } else {
            let link = match &schedule.closure {
                Closure::Mirrored => Link::Mirrored { mirror: asked.robot.mirror, motion, duration },
                Closure::Moved => Link::Moved { motion, duration },
                Closure::Between(_) => unreachable!("where a state is to be reached, Arrival stands in its place"),
            };
            (0, link)
        };
        Self { end, next: schedule.places_of(next)[0], link, step: schedule.step_of(end.domain) }
    }

    /// Which coordinate of the next point coordinate `i` of the end is, and with which sign.
    fn source(&self, i: usize) -> (usize, f64) {
        match &self.link {
            Link::Mirrored { mirror, .. } => mirror.coordinate_source(i),
            Link::Joined | Link::Moved { .. } => (i, 1.0),
        }
    }

    /// The planar motion and the time that it has, where there is one.
    fn moved(&self, at: &At) -> Option<(PlanarMotion, f64, f64)> {
        match &self.link {
            Link::Joined => None,
            Link::Mirrored { motion, duration, .. } | Link::Moved { motion, duration } => {
                Some((*motion, at.t() * duration, *duration))
            }
        }
    }
}

/// x and y of the vector that begins at `start`.
fn planar(x: &[f64], start: usize) -> nalgebra::Vector2<f64> {
    nalgebra::Vector2::new(x[start], x[start + 1])
}

impl Term for Switch {
    fn bounds(&self) -> Vec<[f64; 2]> {
        vec![EQUAL; 2 * DOF]
    }

    fn values(&self, at: &At, rows: &mut [f64]) {
        let (end, next) = (&at.x[self.end.column..], &at.x[self.next.column..]);
        for i in 0..DOF {
            let (from, sign) = self.source(i);
            rows[i] = end[at::Q + i] - sign * next[at::Q + from];
            rows[DOF + i] = sign * next[at::V + from] - end[at::V + i];
        }
        let Some((motion, t, _)) = self.moved(at) else { return };
        if motion.yaw_rate_rad_s != 0.0 {
            let turned = motion.rotation(t);
            let (q, v) = (turned * planar(next, at::Q), turned * planar(next, at::V));
            for i in 0..2 {
                rows[i] = end[at::Q + i] - q[i];
                rows[DOF + i] = v[i] - end[at::V + i];
            }
        }
        let ahead = motion.displacement_m(t);
        rows[0] -= ahead.x;
        rows[1] -= ahead.y;
        rows[YAW] -= motion.yaw_rad(t);
    }

    fn derivatives(&self, at: &At, rows: &mut Rows) {
        let (end, next) = (self.end.column, self.next.column);
        let moved = self.moved(at);
        let turned = moved.filter(|(motion, ..)| motion.yaw_rate_rad_s != 0.0).map(|(motion, t, _)| motion.rotation(t));
        for i in 0..DOF {
            rows.put(i, end + at::Q + i, 1.0);
            rows.put(DOF + i, end + at::V + i, -1.0);
            if let Some(turned) = turned.filter(|_| i < 2) {
                for k in 0..2 {
                    rows.put(i, next + at::Q + k, -turned[(i, k)]);
                    rows.put(DOF + i, next + at::V + k, turned[(i, k)]);
                }
                continue;
            }
            let (from, sign) = self.source(i);
            rows.put(i, next + at::Q + from, -sign);
            rows.put(DOF + i, next + at::V + from, sign);
        }
        let Some((motion, t, duration)) = moved else { return };
        let ahead = motion.velocity_m_s(t) * duration;
        if motion.is_straight() {
            rows.put(0, at.t_column, -ahead.x);
            return;
        }
        let rate = motion.rotation_rate(t) * duration;
        let (q, v) = (rate * planar(at.x, next + at::Q), rate * planar(at.x, next + at::V));
        for i in 0..2 {
            rows.put(i, at.t_column, -q[i] - ahead[i]);
            rows.put(DOF + i, at.t_column, v[i]);
        }
        rows.put(YAW, at.t_column, -motion.yaw_rad(duration));
    }

    fn is_tie(&self) -> bool {
        !matches!(self.link, Link::Joined)
    }

    fn name(&self, row: usize, names: &Names) -> String {
        let what = if row < DOF { "" } else { "the velocity of " };
        format!("periodicity of {what}{}{}", names.coordinate(row % DOF), self.step)
    }
}
