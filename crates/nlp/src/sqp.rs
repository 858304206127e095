//! Sequential quadratic programming with an ℓ₁ merit function, a second-order correction and an elastic mode
//! (Nocedal & Wright, Numerical Optimization, 2nd ed., sections 18.3–18.5 and algorithm 18.3).

use crate::problem::{
    Evaluation, Multipliers, Problem, ProblemError, Step, Subproblem, SubproblemError, check, check_jacobian, outside,
};
use crate::qp::Qp;
use std::ops::ControlFlow;

mod acceleration;
mod checks;
mod ending;
use acceleration::Acceleration;
use checks::{Energies, crawls, is_finite, largest_violation, stay_within, weighted_violation};
pub use ending::{Settings, SettingsError, Status};

/// The most broken constraint.
#[derive(Clone, Debug, PartialEq)]
pub struct Violation {
    /// What the problem calls it.
    pub name: String,
    /// By how much it is broken, in its own unit.
    pub amount: f64,
}

/// One iteration, for the log and for progress.
#[derive(Clone, Debug, PartialEq)]
pub struct Iteration {
    /// Counted from 1.
    pub number: u32,
    /// f at the point that the iteration started from.
    pub objective: f64,
    /// Largest violation there.
    pub max_violation: f64,
    /// What the subproblem promises to gain of the objective, were its constraints already satisfied.
    pub predicted_decrease: f64,
    /// Largest entry of the Lagrangian's gradient there, where the subproblem's solver computes multipliers.
    pub stationarity: Option<f64>,
    /// Fraction of the subproblem's step that was taken.
    pub step_length: f64,
    /// Largest entry of the step.
    pub step_norm: f64,
    /// Interior-point iterations of the subproblem.
    pub qp_iterations: u32,
    /// Whether constraints had to be relaxed for the subproblem to have a solution.
    pub elastic: bool,
    /// Whether the step taken was extrapolated from those before it.
    pub accelerated: bool,
}

/// What a solve came to.
#[derive(Clone, Debug)]
pub struct Solution {
    /// How it ended.
    pub status: Status,
    /// The last point.
    pub x: Vec<f64>,
    /// f there.
    pub objective: f64,
    /// The most broken constraint there.
    pub worst: Violation,
    /// Multipliers of the last subproblem, where its solver computes them.
    pub multipliers: Option<Multipliers>,
    /// Every iteration.
    pub log: Vec<Iteration>,
}

impl Solution {
    /// Iterations taken.
    pub fn iterations(&self) -> u32 {
        self.log.len() as u32
    }
}

/// The solver.
#[derive(Clone, Debug, Default)]
pub struct SqpSolver {
    settings: Settings,
}

/// Memory of a solve, for the next one: its arrays are large enough that giving them back and asking for them anew shows.
#[derive(Clone, Debug, Default)]
pub struct Workspace {
    at: Evaluation,
    next: Evaluation,
}

/// Constraints named when a solve ends infeasible.
const NAMED: usize = 5;
/// Steps are extrapolated where the subproblem promises at most the first, relative to max(1, |f|): further out they are
/// not yet those of one linear map. A solve that has taken so many is no easy one, and extrapolates below the second.
const TAIL: [f64; 2] = [3e-3, 1e-5];
const EASY: usize = 10;
/// The last step holds the constraints to this share of what is tolerated: the objective would gain by what is left.
const HELD_SHARE: f64 = 0.2;
/// A step shorter than this is no progress.
const SHORTEST_STEP: f64 = 1e-8;

impl SqpSolver {
    /// Checks the settings.
    pub fn new(settings: Settings) -> Result<Self, SettingsError> {
        settings.check()?;
        Ok(Self { settings })
    }

    /// Solves from `start` (moved inside the variables' bounds first), the subproblems by Clarabel. `progress` sees every
    /// iteration and may stop it.
    pub fn solve<P: Problem>(
        &self,
        problem: &mut P,
        start: &[f64],
        progress: impl FnMut(&Iteration) -> ControlFlow<()>,
    ) -> Result<Solution, ProblemError> {
        check(problem, start)?;
        check_jacobian(problem)?;
        let mut subproblem = Qp::new(problem, false, self.settings.objective_scale);
        self.solve_with(problem, &mut subproblem, start, &mut Workspace::default(), progress)
    }

    /// [`Self::solve`] with a solver of the subproblems that knows the problem's structure. Where it finds no step, Clarabel
    /// solves the subproblem with the constraints relaxed.
    pub fn solve_with<P: Problem>(
        &self,
        problem: &mut P,
        subproblem: &mut impl Subproblem<P>,
        start: &[f64],
        workspace: &mut Workspace,
        mut progress: impl FnMut(&Iteration) -> ControlFlow<()>,
    ) -> Result<Solution, ProblemError> {
        check(problem, start)?;
        let Workspace { at, next } = workspace;
        at.fit(problem);
        next.fit(problem);
        let bounds = problem.bounds().clone();
        let (n, m) = (bounds.variable_lower.len(), bounds.constraint_lower.len());
        let mut x = start.to_vec();
        stay_within(&bounds, &mut x);
        (at.jacobian_wanted, next.jacobian_wanted) = (false, false);
        if subproblem.needs_jacobian() {
            check_jacobian(problem)?;
            at.want_jacobian(problem);
            next.want_jacobian(problem);
        }
        problem.evaluate(&x, at);
        let mut elastic: Option<Qp> = None;
        let mut elastic_price = 10.0_f64;
        // Without multipliers one price serves all constraints, each measured by the change of an unknown that mends it:
        // newtons and metres as they come would let the rounding of a force outweigh a toe's height.
        let unit = units(&problem.steepest(&x, at));
        let mut common_price = 0.0_f64;
        let mut prices = vec![0.0; m];
        let mut multipliers: Option<Multipliers> = None;
        let mut log: Vec<Iteration> = Vec::new();
        let mut trial = vec![0.0; n];
        let mut trial_constraints = vec![0.0; m];
        let (mut past, mut energies) = (Acceleration::default(), Energies::default());
        let mut acceptable = 0;
        // Σ weights · violations.
        let broken = |weights: &[f64], g: &[f64]| weighted_violation(&bounds, weights, g);

        let status = loop {
            if !is_finite(at) {
                break Status::NumericalTrouble { reason: "a value or derivative is not a number".into() };
            }
            let max_violation = largest_violation(&bounds, &at.constraints);
            let (step, relaxed) = match subproblem.solve(problem, &x, at, &at.constraints) {
                Ok(step) => (step, false),
                // Clarabel proves infeasibility of a nearly infeasible subproblem only slowly; the elastic variant,
                // which always has a solution, decides in both cases.
                Err(SubproblemError::Infeasible | SubproblemError::Stopped(_)) => {
                    if !at.jacobian_wanted {
                        at.want_jacobian(problem);
                        problem.evaluate(&x, at);
                        if !is_finite(at) {
                            break Status::NumericalTrouble { reason: "a derivative is not a number".into() };
                        }
                    }
                    let qp = elastic.get_or_insert_with(|| Qp::new(problem, true, 1.0));
                    qp.price = elastic_price;
                    match qp.solve(problem, &x, at, &at.constraints) {
                        Ok(step) => (step, true),
                        Err(e) => {
                            break Status::NumericalTrouble { reason: format!("the subproblem found no step: {e}") };
                        }
                    }
                }
            };
            let stationarity = step.multipliers.as_ref().map(|m| stationarity(problem, at, m));
            if let (Some(m), false) = (&step.multipliers, relaxed) {
                // Well above the multipliers, so that nothing is broken that need not be. (Those of a relaxed subproblem
                // are the price itself.)
                elastic_price = m.constraints.iter().fold(elastic_price, |a, l| a.max(10.0 * l.abs()));
            }
            multipliers.clone_from(&step.multipliers);
            let slope: f64 = at.gradient.iter().zip(&step.step).map(|(g, p)| g * p).sum();
            let curvature = bilinear(problem, at, &step.step, &step.step);
            let mut iteration = Iteration {
                number: log.len() as u32 + 1,
                objective: at.objective,
                max_violation,
                predicted_decrease: -(slope + 0.5 * curvature),
                stationarity,
                step_length: 0.0,
                step_norm: step.step.iter().fold(0.0, |a: f64, p| a.max(p.abs())),
                qp_iterations: step.iterations,
                elastic: relaxed,
                accelerated: false,
            };
            let scale = at.objective.abs().max(1.0);
            let feasible = max_violation <= self.settings.constraint_tolerance;
            if let Some(status) = self.ended(&iteration, feasible, scale, &mut acceptable) {
                if status.is_solution() {
                    log.push(iteration);
                }
                break status;
            }

            if let Some(multipliers) = &step.multipliers {
                // Powell's rule: each price at least its multiplier, falling slowly where it was larger.
                for (price, multiplier) in prices.iter_mut().zip(&multipliers.constraints) {
                    *price = multiplier.abs().max(0.5 * (*price + multiplier.abs()));
                }
            } else {
                // So high that the step descends (Nocedal & Wright, 18.36, with ρ = ½).
                let units_broken = broken(&unit, &at.constraints);
                let needed = if units_broken > 0.0 { 2.0 * (slope + 0.5 * curvature) / units_broken } else { 0.0 };
                if needed > common_price {
                    common_price = 2.0 * needed;
                }
                for (price, unit) in prices.iter_mut().zip(&unit) {
                    *price = common_price * unit;
                }
            }
            let merit = |objective: f64, g: &[f64]| objective + broken(&prices, g);
            let broken_here = broken(&prices, &at.constraints);
            let merit_here = at.objective + broken_here;
            // A subproblem that was not relaxed has satisfied the linear model.
            let broken_there = if relaxed { broken(&prices, &linearised(problem, at, &step.step)) } else { 0.0 };
            // Directional derivative of the merit function along the step, from the linear model.
            let descent = (slope + broken_there - broken_here).min(0.0);

            // Foreseen to be the last, and so looked at without derivatives.
            let is_last = energies.foreseen(0.5 * curvature, relaxed) <= self.settings.objective_tolerance * scale;
            let extrapolated = if relaxed {
                past.forget();
                false
            } else {
                let tail = iteration.predicted_decrease.abs() <= TAIL[usize::from(log.len() >= EASY)] * scale;
                past.extrapolate(problem, at, &x, &step.step, &mut trial) && tail && !is_last
            };
            // The extrapolated point and the full step, one of which is nearly always taken, with their derivatives.
            let go = |trial: &mut [f64], length: f64, step: &[f64]| {
                (0..n).for_each(|i| trial[i] = x[i] + length * step[i]);
                stay_within(&bounds, trial);
            };
            if extrapolated {
                stay_within(&bounds, &mut trial);
                problem.evaluate(&trial, next);
                iteration.accelerated = merit(next.objective, &next.constraints) <= merit_here + 1e-4 * descent;
            }
            // The last term forgives rounding where the merit function cannot resolve the step any more.
            let enough = |length: f64, merit_there: f64| {
                merit_there <= merit_here + 1e-4 * length * descent + 1e-12 * merit_here.abs().max(1.0)
            };
            let mut length = 1.0;
            let mut accepted = iteration.accelerated;
            if !accepted {
                go(&mut trial, 1.0, &step.step);
                if is_last {
                    next.objective = problem.values(&trial, &mut next.constraints);
                } else {
                    problem.evaluate(&trial, next);
                }
                accepted = enough(1.0, merit(next.objective, &next.constraints));
            }
            if !accepted {
                let there = next.constraints.clone();
                at.want_jacobian(problem);
                problem.evaluate(&x, at);
                let corrected = if relaxed {
                    None
                } else {
                    self.second_order_correction(problem, subproblem, &x, at, &step, &there)
                };
                if let Some(p) = corrected {
                    go(&mut trial, 1.0, &p);
                    let objective = problem.values(&trial, &mut trial_constraints);
                    accepted = merit(objective, &trial_constraints) <= merit_here + 1e-4 * descent;
                }
                while !accepted && length >= 2.0 * SHORTEST_STEP {
                    length *= 0.5;
                    go(&mut trial, length, &step.step);
                    let objective = problem.values(&trial, &mut trial_constraints);
                    accepted = enough(length, merit(objective, &trial_constraints));
                }
                if accepted {
                    problem.evaluate(&trial, next);
                }
            }
            iteration.step_length = if accepted { length } else { 0.0 };
            log.push(iteration);
            // As where a subproblem finds the solve at its end, the iteration that ends it is not asked about.
            let ends = is_last && accepted && length == 1.0 && self.holds(problem, next);
            if is_last && accepted && !ends {
                problem.evaluate(&trial, next);
            }
            if !ends && progress(log.last().expect("pushed above")).is_break() {
                break Status::Cancelled;
            }
            // Relaxed, and the linear model sees no way to break the constraints less: a stationary point of violation.
            let stuck = relaxed && broken_here - broken_there <= 1e-6 * broken_here;
            if !accepted || (stuck && !feasible) || crawls(&log) {
                break self.without_step(problem, at, feasible, relaxed);
            }
            x.copy_from_slice(&trial);
            std::mem::swap(at, next);
            next.jacobian_wanted = subproblem.needs_jacobian();
            if ends {
                break Status::Converged;
            }
        };
        let worst = worst(problem, at);
        Ok(Solution { status, x, objective: at.objective, worst, multipliers, log })
    }

    /// Whether the solve ends where an iteration started, after so many acceptable ones in a row.
    fn ended(&self, iteration: &Iteration, feasible: bool, scale: f64, acceptable: &mut u32) -> Option<Status> {
        let held = feasible && !iteration.elastic;
        let gains_at_most = |tolerance: f64| iteration.predicted_decrease.abs() <= tolerance * scale;
        if held && gains_at_most(self.settings.objective_tolerance) {
            return Some(Status::Converged);
        }
        *acceptable = if held && gains_at_most(self.settings.acceptable_tolerance) { *acceptable + 1 } else { 0 };
        if *acceptable == self.settings.acceptable_iterations {
            return Some(Status::Acceptable);
        }
        (iteration.number > self.settings.max_iterations).then_some(Status::IterationLimit)
    }

    /// Whether the constraints hold where a solve may end that nobody looks at again.
    fn holds<P: Problem>(&self, problem: &P, at: &Evaluation) -> bool {
        let allowed = HELD_SHARE * self.settings.constraint_tolerance;
        is_finite(at) && largest_violation(problem.bounds(), &at.constraints) <= allowed
    }

    /// How a solve ends where no step leads on.
    fn without_step<P: Problem>(&self, problem: &P, at: &Evaluation, feasible: bool, relaxed: bool) -> Status {
        let trouble = |reason: &str| Status::NumericalTrouble { reason: reason.into() };
        if feasible {
            trouble("no step improves the point")
        } else if relaxed {
            Status::Infeasible { fighting: self.broken(problem, at) }
        } else {
            trouble("the line search found no step that brings the constraints nearer")
        }
    }

    /// The step whose linearised constraints are corrected by what the full step left over (Nocedal & Wright, 18.36).
    fn second_order_correction<P: Problem>(
        &self,
        problem: &P,
        subproblem: &mut impl Subproblem<P>,
        x: &[f64],
        at: &Evaluation,
        step: &Step,
        constraints_there: &[f64],
    ) -> Option<Vec<f64>> {
        if constraints_there.iter().any(|v| !v.is_finite()) {
            return None;
        }
        let mut shifted = constraints_there.to_vec();
        for (&(row, column), value) in problem.jacobian_pattern().0.iter().zip(&at.jacobian) {
            shifted[row] -= value * step.step[column];
        }
        // A correction that cannot be had is no failure: the line search goes on without it.
        subproblem.solve(problem, x, at, &shifted).ok().map(|s| s.step)
    }

    fn broken<P: Problem>(&self, problem: &P, at: &Evaluation) -> Vec<Violation> {
        let b = problem.bounds();
        let mut all: Vec<(f64, usize)> = at
            .constraints
            .iter()
            .enumerate()
            .map(|(i, g)| (outside(*g, b.constraint_lower[i], b.constraint_upper[i]), i))
            .filter(|(amount, _)| *amount > self.settings.constraint_tolerance)
            .collect();
        all.sort_by(|a, b| b.0.total_cmp(&a.0));
        all.truncate(NAMED);
        all.into_iter().map(|(amount, i)| Violation { name: problem.constraint_name(i), amount }).collect()
    }
}

fn worst<P: Problem>(problem: &P, at: &Evaluation) -> Violation {
    let b = problem.bounds();
    let (row, amount) = at
        .constraints
        .iter()
        .enumerate()
        .map(|(i, g)| (i, outside(*g, b.constraint_lower[i], b.constraint_upper[i])))
        .max_by(|a, b| a.1.total_cmp(&b.1))
        .unwrap_or((0, 0.0));
    let name = if at.constraints.is_empty() { "none".into() } else { problem.constraint_name(row) };
    Violation { name, amount }
}

/// The most broken constraint or variable's bound at a point, given the constraints' values there. (A solve keeps the variables'
/// bounds itself.)
pub fn most_broken<P: Problem>(problem: &P, x: &[f64], constraints: &[f64]) -> Violation {
    let b = problem.bounds();
    let of = |values: &[f64], lower: &[f64], upper: &[f64]| {
        let amounts = values.iter().zip(lower.iter().zip(upper)).map(|(v, (l, u))| outside(*v, *l, *u));
        amounts.enumerate().max_by(|a, b| a.1.total_cmp(&b.1))
    };
    let variable = of(x, &b.variable_lower, &b.variable_upper);
    let constraint = of(constraints, &b.constraint_lower, &b.constraint_upper);
    match (variable, constraint) {
        (Some((i, amount)), c) if c.is_none_or(|c| c.1 < amount) => {
            Violation { name: problem.variable_name(i), amount }
        }
        (_, Some((i, amount))) => Violation { name: problem.constraint_name(i), amount },
        _ => Violation { name: "none".into(), amount: 0.0 },
    }
}

/// For each constraint, how far the unknown that moves it most must change to change it by one, from how steeply it does.
fn units(steepest: &[f64]) -> Vec<f64> {
    steepest.iter().map(|slope| if *slope > 0.0 { 1.0 / slope } else { 1.0 }).collect()
}

/// g + J p.
fn linearised<P: Problem>(problem: &P, at: &Evaluation, p: &[f64]) -> Vec<f64> {
    let mut g = at.constraints.clone();
    for (&(row, column), value) in problem.jacobian_pattern().0.iter().zip(&at.jacobian) {
        g[row] += value * p[column];
    }
    g
}

/// aᵀ H b.
fn bilinear<P: Problem>(problem: &P, at: &Evaluation, a: &[f64], b: &[f64]) -> f64 {
    let pattern = &problem.hessian_pattern().0;
    pattern
        .iter()
        .zip(&at.hessian)
        .map(
            |(&(row, column), h)| {
                if row == column { h * a[row] * b[row] } else { h * (a[row] * b[column] + a[column] * b[row]) }
            },
        )
        .sum()
}

/// Largest entry of ∇f + Jᵀ λ + bound multipliers.
fn stationarity<P: Problem>(problem: &P, at: &Evaluation, multipliers: &Multipliers) -> f64 {
    let mut r = at.gradient.clone();
    for (&(row, column), value) in problem.jacobian_pattern().0.iter().zip(&at.jacobian) {
        r[column] += value * multipliers.constraints[row];
    }
    r.iter().zip(&multipliers.variables).fold(0.0, |a: f64, (r, z)| a.max((r + z).abs()))
}

#[cfg(test)]
mod tests;
