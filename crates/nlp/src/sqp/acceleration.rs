//! Extrapolation of the last steps.

use super::bilinear;
use crate::problem::{Evaluation, Problem};

/// Anderson acceleration (Walker & Ni, SIAM J. Numer. Anal. 49, 2011) of the last iterations. With a Gauss–Newton
/// Hessian the steps p shrink by a constant factor there: x ↦ x + p(x) is nearly linear, and the last few points and
/// steps give its fixed point. Steps are measured by the subproblem's Hessian, the unit in which the objective does.
#[derive(Default)]
pub(super) struct Acceleration {
    /// The last point and its step.
    last: Option<(Vec<f64>, Vec<f64>)>,
    /// Differences of consecutive points and of their steps, the newest last.
    differences: Vec<(Vec<f64>, Vec<f64>)>,
}

/// Differences that are kept. A third one gains nothing on the gaits.
const DEPTH: usize = 2;

impl Acceleration {
    pub(super) fn forget(&mut self) {
        self.last = None;
        self.differences.clear();
    }

    /// Where the points so far and the step from `x` lead to, if they tell.
    pub(super) fn extrapolate<P: Problem>(
        &mut self,
        problem: &P,
        at: &Evaluation,
        x: &[f64],
        step: &[f64],
    ) -> Option<Vec<f64>> {
        if let Some((x_before, step_before)) = self.last.replace((x.to_vec(), step.to_vec())) {
            if self.differences.len() == DEPTH {
                self.differences.remove(0);
            }
            let minus = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a - b).collect::<Vec<f64>>();
            self.differences.push((minus(x, &x_before), minus(step, &step_before)));
        }
        // Least squares |p − Σ γ Δp| by Gram–Schmidt from the newest difference on.
        let mut residual = step.to_vec();
        let mut target: Vec<f64> = x.iter().zip(step).map(|(x, p)| x + p).collect();
        let mut basis: Vec<(Vec<f64>, Vec<f64>, f64)> = Vec::new();
        for (dx, dp) in self.differences.iter().rev() {
            let size = bilinear(problem, at, dp, dp);
            let (mut dx, mut dp) = (dx.clone(), dp.clone());
            for (ex, ep, square) in &basis {
                let share = bilinear(problem, at, &dp, ep) / square;
                subtract(&mut dp, share, ep);
                subtract(&mut dx, share, ex);
            }
            let square = bilinear(problem, at, &dp, &dp);
            // A difference that repeats the newer ones tells nothing.
            if square <= 1e-6 * size {
                break;
            }
            let share = bilinear(problem, at, &residual, &dp) / square;
            subtract(&mut residual, share, &dp);
            subtract(&mut target, share, &dx);
            subtract(&mut target, share, &dp);
            basis.push((dx, dp, square));
        }
        (!basis.is_empty()).then_some(target)
    }
}

fn subtract(from: &mut [f64], scale: f64, what: &[f64]) {
    for (f, w) in from.iter_mut().zip(what) {
        *f -= scale * w;
    }
}
