//! What a solve looks at before it goes on.

use super::Iteration;
use crate::problem::Evaluation;

/// So many steps in a row of at most this share of what their subproblems ask for lead nowhere: what lets them pass is
/// rounding, and each costs a subproblem.
const CRAWLS: (usize, f64) = (6, 1e-3);

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
