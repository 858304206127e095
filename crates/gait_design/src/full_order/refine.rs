//! The same unknowns on a finer grid: between the points by the interpolants that Hermite–Simpson collocation stands
//! for.

use super::schedule::{DOF, Schedule, at};
use crate::refine::integral;

/// Unknowns over `fine`, whose intervals are those of `coarse` halved.
pub(super) fn finer(coarse: &Schedule, x: &[f64], fine: &Schedule) -> Vec<f64> {
    let mut out = vec![0.0; fine.unknowns];
    out[..=fine.t()].copy_from_slice(&x[..=coarse.t()]);
    for domain in 0..coarse.domains.len() {
        let places = coarse.places_of(domain);
        let h = 2.0 * x[coarse.t()] * places[0].share / (places.len() - 1) as f64;
        for place in fine.places_of(domain) {
            let interval = (place.point / 4).min(places.len() / 2 - 1);
            let three = [0, 1, 2].map(|k| &x[coarse.columns(&places[2 * interval + k])]);
            within(three, 0.25 * (place.point - 4 * interval) as f64, h, &mut out[fine.columns(place)]);
        }
    }
    out
}

/// A point's unknowns at share `s` of an interval of length `h`: forces and accelerations by the quadratic through the
/// three points, velocities and positions by the integral of what they change with.
fn within([p0, p1, p2]: [&[f64]; 3], s: f64, h: f64, point: &mut [f64]) {
    let (value, integral) = ([(1.0 - s) * (1.0 - 2.0 * s), 4.0 * s * (1.0 - s), s * (2.0 * s - 1.0)], integral(s));
    for (i, unknown) in point.iter_mut().enumerate() {
        let of = |weights: [f64; 3], i: usize| weights[0] * p0[i] + weights[1] * p1[i] + weights[2] * p2[i];
        *unknown = if i < at::A { p0[i] + h * of(integral, i + DOF) } else { of(value, i) };
    }
}
