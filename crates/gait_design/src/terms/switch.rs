//! Where a domain ends, the next begins with the same q and q̇. The last one's next is the first one's beginning: its
//! mirror image a step ahead, or itself moved by the planar motion g over the whole schedule,
//!
//! > p_xy(end) = R(ω t) p_xy(0) + d(t),   yaw(end) = yaw(0) + ω t,   ṗ_xy(end) = R(ω t) ṗ_xy(0).
//!
//! Everything else repeats, for rates of Euler angles do not feel yaw.

use super::{At, EQUAL, Names, Place, Rows, Term};
use crate::planar::PlanarMotion;
use robot::Mirror;

const YAW: usize = 5;

/// How a domain's end meets the next one's beginning.
pub(crate) enum Link {
    /// They are one.
    Joined,
    /// The next is the mirror image, by so many durations of T ahead.
    Mirrored { mirror: Mirror, motion: PlanarMotion, duration: f64 },
    /// The next is moved for so many durations of T.
    Moved { motion: PlanarMotion, duration: f64 },
}

/// Rows are q and then q̇.
pub(crate) struct Switch {
    end: Place,
    next: Place,
    link: Link,
}

impl Switch {
    pub fn new(end: Place, next: Place, link: Link) -> Self {
        Self { end, next, link }
    }

    fn coordinates(&self) -> usize {
        self.end.layout.coordinates
    }

    /// Which coordinate of the next point coordinate `i` of the end is, and with which sign.
    fn source(&self, i: usize) -> (usize, f64) {
        match &self.link {
            Link::Mirrored { mirror, .. } => (self.end.layout.mirrored)(mirror, i),
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
    fn bounds(&self, bounds: &mut Vec<[f64; 2]>) {
        bounds.resize(bounds.len() + 2 * self.coordinates(), EQUAL);
    }

    fn values(&self, at: &At, rows: &mut [f64]) {
        let (n, end, next) = (self.coordinates(), &self.end, &self.next);
        for i in 0..n {
            let (from, sign) = self.source(i);
            rows[i] = at.x[end.q(i)] - sign * at.x[next.q(from)];
            rows[n + i] = sign * at.x[next.v(from)] - at.x[end.v(i)];
        }
        let Some((motion, t, _)) = self.moved(at) else { return };
        if motion.yaw_rate_rad_s != 0.0 {
            let turned = motion.rotation(t);
            let (q, v) = (turned * planar(at.x, next.q(0)), turned * planar(at.x, next.v(0)));
            for i in 0..2 {
                rows[i] = at.x[end.q(i)] - q[i];
                rows[n + i] = v[i] - at.x[end.v(i)];
            }
        }
        let ahead = motion.displacement_m(t);
        rows[0] -= ahead.x;
        rows[1] -= ahead.y;
        rows[YAW] -= motion.yaw_rad(t);
    }

    fn derivatives(&self, at: &At, rows: &mut Rows) {
        let (n, end, next) = (self.coordinates(), &self.end, &self.next);
        let moved = self.moved(at);
        let turned = moved.filter(|(motion, ..)| motion.yaw_rate_rad_s != 0.0).map(|(motion, t, _)| motion.rotation(t));
        for i in 0..n {
            rows.put(i, end.q(i), 1.0);
            rows.put(n + i, end.v(i), -1.0);
            if let Some(turned) = turned.filter(|_| i < 2) {
                for k in 0..2 {
                    rows.put(i, next.q(k), -turned[(i, k)]);
                    rows.put(n + i, next.v(k), turned[(i, k)]);
                }
                continue;
            }
            let (from, sign) = self.source(i);
            rows.put(i, next.q(from), -sign);
            rows.put(n + i, next.v(from), sign);
        }
        let Some((motion, t, duration)) = moved else { return };
        let ahead = motion.velocity_m_s(t) * duration;
        if motion.is_straight() {
            rows.put(0, at.t_column, -ahead.x);
            return;
        }
        let rate = motion.rotation_rate(t) * duration;
        let (q, v) = (rate * planar(at.x, next.q(0)), rate * planar(at.x, next.v(0)));
        for i in 0..2 {
            rows.put(i, at.t_column, -q[i] - ahead[i]);
            rows.put(n + i, at.t_column, v[i]);
        }
        rows.put(YAW, at.t_column, -motion.yaw_rad(duration));
    }

    fn is_tie(&self) -> bool {
        !matches!(self.link, Link::Joined)
    }

    fn name(&self, row: usize, names: &Names) -> String {
        let what = if row < self.coordinates() { "" } else { "the velocity of " };
        format!("periodicity of {what}{}{}", names.coordinate(row % self.coordinates()), self.end.step)
    }
}
