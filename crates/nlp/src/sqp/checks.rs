//! What a solve looks at before it goes on.

use super::Iteration;
use crate::problem::{Bounds, Evaluation, outside};

/// So many steps in a row of at most this share of what their subproblems ask for lead nowhere: what lets them pass is
/// rounding, and each costs a subproblem.
const CRAWLS: (usize, f64) = (6, 1e-3);

/// Energies ½ pᵀ H p of the steps. Where the constraints held before, it is what a step gains; else it is more, for
/// the way to the constraints is a part of it. The next step's is foreseen as its share of this one's, and that ends
/// a solve without another subproblem to say so.
#[derive(Default)]
pub(super) struct Energies {
    before: Option<f64>,
    share: f64,
}

/// Steps shrink to this share at least as foreseen, and to half of the last share: one that fell further fell by luck.
/// Measured on the gaits, from memory of others: to 0.03 at most, 0.003 mostly; in slow tails to nearly all.
const SHRINKS: f64 = 0.25;

impl Energies {
    /// What the step after one of this energy is foreseen to have.
    pub(super) fn foreseen(&mut self, energy: f64, relaxed: bool) -> f64 {
        if relaxed {
            *self = Self::default();
            return f64::INFINITY;
        }
        let shrunk = self.before.map_or(0.0, |before| energy / before);
        self.share = shrunk.max(0.5 * self.share).max(SHRINKS);
        self.before = Some(energy);
        self.share * energy
    }
}

/// Whether the last steps have led nowhere.
pub(super) fn crawls(log: &[Iteration]) -> bool {
    let (steps, share) = CRAWLS;
    log.len() >= steps && log[log.len() - steps..].iter().all(|iteration| iteration.step_length <= share)
}

/// Whether every value and derivative that was asked for is a number.
pub(super) fn is_finite(at: &Evaluation) -> bool {
    finite(&at.gradient) && finite(&at.constraints) && (!at.jacobian_wanted || finite(&at.jacobian))
}

/// Whether every value is a number, eight at a time: a number times 0 is 0, anything else is not.
fn finite(values: &[f64]) -> bool {
    let (eights, rest) = values.as_chunks::<8>();
    let mut sums = [0.0; 8];
    for eight in eights {
        for (sum, value) in sums.iter_mut().zip(eight) {
            *sum += value * 0.0;
        }
    }
    sums.iter().sum::<f64>() == 0.0 && rest.iter().all(|v| v.is_finite())
}

/// Moves a point inside the variables' bounds.
pub(super) fn stay_within(bounds: &Bounds, x: &mut [f64]) {
    for (x, (lower, upper)) in x.iter_mut().zip(bounds.variable_lower.iter().zip(&bounds.variable_upper)) {
        *x = x.clamp(*lower, *upper);
    }
}

/// The amount of the most broken constraint.
pub(super) fn largest_violation(bounds: &Bounds, g: &[f64]) -> f64 {
    let ends = bounds.constraint_lower.iter().zip(&bounds.constraint_upper);
    let larger = |a: f64, b: f64| if b > a { b } else { a };
    g.iter().zip(ends).map(|(g, (lower, upper))| outside(*g, *lower, *upper)).fold(0.0, larger)
}

/// Σ weights · violations: four sums side by side, for one alone would wait for each addition before the next.
pub(super) fn weighted_violation(bounds: &Bounds, weights: &[f64], g: &[f64]) -> f64 {
    let (g_fours, g_rest) = g.as_chunks::<4>();
    let (weights_fours, weights_rest) = weights.as_chunks::<4>();
    let (lower_fours, lower_rest) = bounds.constraint_lower.as_chunks::<4>();
    let (upper_fours, upper_rest) = bounds.constraint_upper.as_chunks::<4>();
    let mut sums = [0.0; 4];
    for (((g, weight), lower), upper) in g_fours.iter().zip(weights_fours).zip(lower_fours).zip(upper_fours) {
        for k in 0..4 {
            sums[k] += weight[k] * outside(g[k], lower[k], upper[k]);
        }
    }
    let rest = g_rest.iter().zip(weights_rest).zip(lower_rest.iter().zip(upper_rest));
    let rest: f64 = rest.map(|((g, weight), (lower, upper))| weight * outside(*g, *lower, *upper)).sum();
    (sums[0] + sums[1]) + (sums[2] + sums[3]) + rest
}
