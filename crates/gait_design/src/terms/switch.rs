//! Where a domain ends, the next begins with the same q and q̇. The last one's next is the first one's beginning: its
//! mirror image a step ahead, or itself moved by the planar motion g over the whole schedule,
//!
//! > p_xy(end) = R(ω t) p_xy(0) + d(t),   yaw(end) = yaw(0) + ω t,   ṗ_xy(end) = R(ω t) ṗ_xy(0).
//!
//! Everything else repeats, for rates of Euler angles do not feel yaw.

use super::{At, EQUAL, Layout, Names, Place, Rows, Sink, Term};
use crate::planar::PlanarMotion;
use robot::Mirror;

const YAW: usize = 5;

/// Rows are q and then q̇.
pub(crate) struct Switch<L> {
    pub end: Place<L>,
    pub next: Place<L>,
    /// Where the end is the mirror image of the next point.
    pub mirror: Option<Mirror>,
    /// Where the end is the next point moved: how, and for how many durations of T.
    pub moved: Option<(PlanarMotion, f64)>,
}

impl<L: Layout> Switch<L> {
    /// Which coordinate of the next point coordinate `i` of the end is, and with which sign.
    fn source(&self, i: usize) -> (usize, f64) {
        self.mirror.map_or((i, 1.0), |mirror| L::MIRRORED(&mirror, i))
    }
}

/// x and y of the vector that begins at `start`.
fn planar(x: &[f64], start: usize) -> nalgebra::Vector2<f64> {
    nalgebra::Vector2::new(x[start], x[start + 1])
}

impl<L: Layout> Term for Switch<L> {
    fn bounds(&self, bounds: &mut Vec<[f64; 2]>) {
        bounds.resize(bounds.len() + 2 * L::COORDINATES, EQUAL);
    }

    fn values(&self, at: &At, rows: &mut [f64]) {
        let (n, end, next) = (L::COORDINATES, &self.end, &self.next);
        for i in 0..n {
            let (from, sign) = self.source(i);
            rows[i] = at.x[end.q(i)] - sign * at.x[next.q(from)];
            rows[n + i] = sign * at.x[next.v(from)] - at.x[end.v(i)];
        }
        let Some((motion, duration)) = self.moved else { return };
        let t = at.t() * duration;
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

    fn derivatives(&self, at: &At, rows: &mut Rows<impl Sink>) {
        let (n, end, next) = (L::COORDINATES, &self.end, &self.next);
        let moved = self.moved.map(|(motion, duration)| (motion, at.t() * duration, duration));
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
        self.moved.is_some()
    }

    fn name(&self, row: usize, names: &Names) -> String {
        let what = if row < L::COORDINATES { "" } else { "the velocity of " };
        format!("periodicity of {what}{}{}", names.coordinate(row % L::COORDINATES), self.end.step)
    }
}
