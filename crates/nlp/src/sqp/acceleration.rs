//! Extrapolation of the last two steps.

use super::bilinear;
use crate::problem::{Evaluation, Problem};

/// Anderson acceleration of depth one (Walker & Ni, SIAM J. Numer. Anal. 49, 2011). With a Gauss–Newton Hessian the
/// steps p shrink by a constant factor: x ↦ x + p(x) is nearly linear, and the last two points and steps give its fixed
/// point. Steps are measured by the subproblem's Hessian, the unit in which the objective does. A second difference
/// gains as much on some gaits as it loses on others.
#[derive(Default)]
pub(super) struct Acceleration {
    /// The last point and its step; empty where there is none.
    x: Vec<f64>,
    step: Vec<f64>,
    /// How the step has changed since.
    change: Vec<f64>,
}

impl Acceleration {
    pub(super) fn forget(&mut self) {
        self.x.clear();
        self.step.clear();
    }

    /// Writes to `target` where the last point and the step from `x` lead to; false where they do not tell.
    pub(super) fn extrapolate<P: Problem>(
        &mut self,
        problem: &P,
        at: &Evaluation,
        x: &[f64],
        step: &[f64],
        target: &mut [f64],
    ) -> bool {
        let Self { x: x_before, step: step_before, change } = self;
        let known = !x_before.is_empty();
        change.clear();
        change.extend(step.iter().zip(&*step_before).map(|(now, before)| now - before));
        let square = if known { bilinear(problem, at, change, change) } else { 0.0 };
        let tells = square > 0.0;
        if tells {
            let share = bilinear(problem, at, step, change) / square;
            for i in 0..x.len() {
                target[i] = x[i] + step[i] - share * (x[i] - x_before[i] + change[i]);
            }
        }
        x_before.clear();
        x_before.extend_from_slice(x);
        step_before.clear();
        step_before.extend_from_slice(step);
        tells
    }
}
