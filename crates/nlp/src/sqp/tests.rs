//! Problems with known solutions, and every status.

use super::*;
use crate::problem::{Bounds, Pattern};

type Values = fn(&[f64], &mut [f64]) -> f64;
type Derivatives = fn(&[f64], &mut Evaluation);

/// A dense problem written as two functions.
struct Dense {
    bounds: Bounds,
    jacobian: Pattern,
    hessian: Pattern,
    values: Values,
    derivatives: Derivatives,
}

impl Dense {
    fn new(variables: [Vec<f64>; 2], constraints: [Vec<f64>; 2], values: Values, derivatives: Derivatives) -> Self {
        let (n, m) = (variables[0].len(), constraints[0].len());
        let [variable_lower, variable_upper] = variables;
        let [constraint_lower, constraint_upper] = constraints;
        Self {
            bounds: Bounds { variable_lower, variable_upper, constraint_lower, constraint_upper },
            jacobian: Pattern((0..m).flat_map(|r| (0..n).map(move |c| (r, c))).collect()),
            hessian: Pattern((0..n).flat_map(|c| (0..=c).map(move |r| (r, c))).collect()),
            values,
            derivatives,
        }
    }
}

impl Problem for Dense {
    fn bounds(&self) -> &Bounds {
        &self.bounds
    }
    fn jacobian_pattern(&self) -> &Pattern {
        &self.jacobian
    }
    fn hessian_pattern(&self) -> &Pattern {
        &self.hessian
    }
    fn evaluate(&mut self, x: &[f64], evaluation: &mut Evaluation) {
        evaluation.objective = (self.values)(x, &mut evaluation.constraints);
        (self.derivatives)(x, evaluation);
    }
    fn values(&mut self, x: &[f64], constraints: &mut [f64]) -> f64 {
        (self.values)(x, constraints)
    }
    fn constraint_name(&self, row: usize) -> String {
        format!("row {row}")
    }
    fn variable_name(&self, column: usize) -> String {
        format!("x{column}")
    }
}

const FREE: f64 = f64::INFINITY;

fn solve(mut problem: Dense, start: &[f64]) -> Solution {
    SqpSolver::default().solve(&mut problem, start, |_| ControlFlow::Continue(())).unwrap()
}

/// Hock & Schittkowski's problem 71: minimum 17.0140173 at (1, 4.742994, 3.8211503, 1.3794082).
fn hock_schittkowski_71() -> Dense {
    Dense::new(
        [vec![1.0; 4], vec![5.0; 4]],
        [vec![25.0, 40.0], vec![FREE, 40.0]],
        |x, g| {
            g[0] = x[0] * x[1] * x[2] * x[3];
            g[1] = x.iter().map(|v| v * v).sum();
            x[0] * x[3] * (x[0] + x[1] + x[2]) + x[2]
        },
        |x, e| {
            e.gradient.copy_from_slice(&[
                x[3] * (2.0 * x[0] + x[1] + x[2]),
                x[0] * x[3],
                x[0] * x[3] + 1.0,
                x[0] * (x[0] + x[1] + x[2]),
            ]);
            for c in 0..4 {
                e.jacobian[c] = (0..4).filter(|&k| k != c).map(|k| x[k]).product();
                e.jacobian[4 + c] = 2.0 * x[c];
            }
            // The objective is not convex; any positive definite matrix will do for a first-order method.
            e.hessian.fill(0.0);
            for c in 0..4 {
                e.hessian[c * (c + 3) / 2] = 1.0;
            }
        },
    )
}

#[test]
fn hock_schittkowski_71_reaches_the_published_minimum() {
    let solution = solve(hock_schittkowski_71(), &[1.0, 5.0, 5.0, 1.0]);
    assert_eq!(solution.status, Status::Converged);
    assert!((solution.objective - 17.0140173).abs() < 1e-5, "{}", solution.objective);
    for (found, published) in solution.x.iter().zip([1.0, 4.742994, 3.8211503, 1.3794082]) {
        assert!((found - published).abs() < 1e-3, "{:?}", solution.x);
    }
    // The published multipliers: -0.55229366 of the product (at its lower bound), 0.16146857 of the sum of squares.
    let multipliers = solution.multipliers.unwrap().constraints;
    assert!((multipliers[0] + 0.5522937).abs() < 1e-3, "{multipliers:?}");
    assert!((multipliers[1] - 0.1614686).abs() < 1e-3, "{multipliers:?}");
}

/// A bowl whose curvature the Hessian states twice and 1.5 times too large, so that plain steps halve the error at
/// best.
fn bowl_with_a_cautious_hessian() -> Dense {
    Dense::new(
        [vec![-FREE; 2], vec![FREE; 2]],
        [vec![0.0], vec![FREE]],
        |x, g| {
            g[0] = x[0] + x[1] + 10.0;
            0.5 * (x[0] - 1.0).powi(2) + 2.0 * (x[1] + 2.0).powi(2)
        },
        |x, e| {
            e.gradient.copy_from_slice(&[x[0] - 1.0, 4.0 * (x[1] + 2.0)]);
            e.jacobian.fill(1.0);
            e.hessian.copy_from_slice(&[2.0, 0.0, 6.0]);
        },
    )
}

#[test]
fn a_linear_tail_is_extrapolated() {
    let solution = solve(bowl_with_a_cautious_hessian(), &[1.1, -1.9]);
    assert_eq!(solution.status, Status::Converged);
    assert!(solution.log.iter().any(|i| i.accelerated));
    // The error falls by 1/2 and 1/3 an iteration: from 0.1 to the promise of 1e-8 it takes plain steps ten of them.
    assert!(solution.iterations() <= 7, "{}", solution.iterations());
    assert!((solution.x[0] - 1.0).abs() < 1e-4 && (solution.x[1] + 2.0).abs() < 1e-4, "{:?}", solution.x);
}

#[test]
fn a_solve_that_ends_with_a_step_has_what_was_foreseen_of_it() {
    let mut foreseen = 0;
    // A fifth of the error is left by a plain step: the promises shrink by 25.
    for away in [5e-4, 1e-3, 1.3e-3, 1.6e-3, 3e-3, 1e-2] {
        let from = |start: &[f64]| {
            let mut bowl = bowl_with_a_cautious_hessian();
            bowl.derivatives = |x, e| {
                e.gradient.copy_from_slice(&[x[0] - 1.0, 4.0 * (x[1] + 2.0)]);
                e.jacobian.fill(1.0);
                e.hessian.copy_from_slice(&[1.25, 0.0, 5.0]);
            };
            solve(bowl, start)
        };
        let solution = from(&[1.0 + away, -2.0 + 0.1 * away]);
        assert_eq!(solution.status, Status::Converged);
        foreseen += usize::from(solution.log.last().unwrap().step_length == 1.0);
        // The subproblem that was saved promises no more than is tolerated.
        let again = from(&solution.x);
        assert_eq!(again.iterations(), 1, "{away}: {:?}", again.log);
    }
    assert!(foreseen > 0, "no solve ended with a step");
}

#[test]
fn a_tail_that_gains_next_to_nothing_ends_acceptable_and_says_so_and_a_broken_constraint_never_does() {
    let settings = Settings {
        acceptable_tolerance: 1e-3,
        acceptable_iterations: 3,
        objective_tolerance: 1e-14,
        ..Settings::default()
    };
    let go_on = |_: &Iteration| ControlFlow::Continue(());
    let solver = SqpSolver::new(settings.clone()).unwrap();
    let solution = solver.solve(&mut bowl_with_a_cautious_hessian(), &[1.01, -1.99], go_on).unwrap();
    assert_eq!((solution.status.clone(), solution.iterations()), (Status::Acceptable, 3));
    assert!(solution.status.is_solution() && solution.status.to_string() == "acceptable");
    assert!(solution.log.iter().all(|i| i.predicted_decrease <= 1e-3), "{:?}", solution.log);
    // However little is asked of the objective, the constraints are held as ever.
    let lax = Settings { acceptable_tolerance: 1e9, acceptable_iterations: 1, ..settings };
    let solver = SqpSolver::new(lax).unwrap();
    let solution = solver.solve(&mut hock_schittkowski_71(), &[1.0, 5.0, 5.0, 1.0], go_on).unwrap();
    assert!(solution.iterations() > 1 && solution.worst.amount <= 1e-6, "{:?}", solution.worst);
    assert!(SqpSolver::new(Settings { acceptable_iterations: 0, ..Settings::default() }).is_err());
}

/// Rosenbrock's residuals (10 (y − x²), 1 − x) by Gauss–Newton, kept on the unit circle's inside.
fn rosenbrock_in_disc() -> Dense {
    Dense::new(
        [vec![-FREE; 2], vec![FREE; 2]],
        [vec![-FREE], vec![1.0]],
        |x, g| {
            g[0] = x[0] * x[0] + x[1] * x[1];
            let (a, b) = (10.0 * (x[1] - x[0] * x[0]), 1.0 - x[0]);
            0.5 * (a * a + b * b)
        },
        |x, e| {
            let (a, b) = (10.0 * (x[1] - x[0] * x[0]), 1.0 - x[0]);
            let rows = [[-20.0 * x[0], 10.0], [-1.0, 0.0]];
            for c in 0..2 {
                e.gradient[c] = rows[0][c] * a + rows[1][c] * b;
            }
            e.hessian[0] = rows[0][0] * rows[0][0] + 1.0;
            e.hessian[1] = rows[0][0] * rows[0][1];
            e.hessian[2] = rows[0][1] * rows[0][1];
            e.jacobian.copy_from_slice(&[2.0 * x[0], 2.0 * x[1]]);
        },
    )
}

#[test]
fn rosenbrock_in_the_unit_disc_ends_on_the_circle() {
    let solution = solve(rosenbrock_in_disc(), &[-0.5, 0.5]);
    assert_eq!(solution.status, Status::Converged);
    assert!((solution.x[0] - 0.78641).abs() < 1e-4 && (solution.x[1] - 0.61770).abs() < 1e-4, "{:?}", solution.x);
}

#[test]
fn constraints_that_contradict_each_other_are_named() {
    let problem = Dense::new(
        [vec![-10.0], vec![10.0]],
        [vec![2.0, -FREE], vec![FREE, 1.0]],
        |x, g| {
            g.copy_from_slice(&[x[0], x[0]]);
            x[0] * x[0]
        },
        |x, e| {
            e.gradient[0] = 2.0 * x[0];
            e.hessian[0] = 2.0;
            e.jacobian.copy_from_slice(&[1.0, 1.0]);
        },
    );
    let solution = solve(problem, &[0.0]);
    let Status::Infeasible { fighting } = solution.status else { panic!("{:?}", solution.status) };
    assert!(fighting.iter().any(|v| v.name.starts_with("row")), "{fighting:?}");
}

#[test]
fn a_nan_ends_the_solve_and_says_so() {
    let problem = Dense::new(
        [vec![-1.0], vec![1.0]],
        [vec![], vec![]],
        |_, _| f64::NAN,
        |_, e| {
            e.gradient[0] = f64::NAN;
            e.hessian[0] = 1.0;
        },
    );
    assert!(matches!(solve(problem, &[0.0]).status, Status::NumericalTrouble { .. }));
}

#[test]
fn the_iteration_limit_and_a_cancellation_are_distinguished() {
    let solver = SqpSolver::new(Settings { max_iterations: 2, ..Settings::default() }).unwrap();
    let cut = solver.solve(&mut hock_schittkowski_71(), &[1.0, 5.0, 5.0, 1.0], |_| ControlFlow::Continue(())).unwrap();
    assert_eq!(cut.status, Status::IterationLimit);
    assert_eq!(cut.iterations(), 2);
    let stopped = SqpSolver::default()
        .solve(&mut hock_schittkowski_71(), &[1.0, 5.0, 5.0, 1.0], |i| {
            if i.number == 3 { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
        })
        .unwrap();
    assert_eq!(stopped.status, Status::Cancelled);
    assert_eq!(stopped.iterations(), 3);
}

#[test]
fn a_problem_that_contradicts_itself_is_refused_by_name() {
    let mut problem = hock_schittkowski_71();
    problem.bounds.variable_lower[2] = 9.0;
    let e = SqpSolver::default().solve(&mut problem, &[1.0; 4], |_| ControlFlow::Continue(())).unwrap_err();
    assert!(e.to_string().contains("x2"), "{e}");
    let e = SqpSolver::default().solve(&mut hock_schittkowski_71(), &[f64::NAN; 4], |_| ControlFlow::Continue(()));
    assert!(matches!(e, Err(ProblemError::Start { .. })));
    let mut problem = hock_schittkowski_71();
    let first = problem.hessian.0[0];
    problem.hessian.0.push(first);
    let e = SqpSolver::default().solve(&mut problem, &[1.0; 4], |_| ControlFlow::Continue(())).unwrap_err();
    assert_eq!(e, ProblemError::Repeated { row: first.0, column: first.1 });
    assert!(SqpSolver::new(Settings { objective_tolerance: 0.0, ..Settings::default() }).is_err());
}

#[test]
fn the_same_problem_gives_the_same_bits() {
    let a = solve(rosenbrock_in_disc(), &[-0.5, 0.5]);
    let b = solve(rosenbrock_in_disc(), &[-0.5, 0.5]);
    assert_eq!(a.x, b.x);
    assert_eq!(a.log, b.log);
}

/// A derivative that is none of the function's: the line search lets steps of 1e-4 pass by its forgiveness of rounding,
/// and the solve crawled to its iteration limit, a subproblem each. A request that could not be planned took minutes.
#[test]
fn steps_that_lead_nowhere_end_the_solve() {
    let flat = Dense::new(
        [vec![-FREE], vec![FREE]],
        [vec![], vec![]],
        |_, _| 0.0,
        |_, e| {
            e.gradient[0] = 1e-5;
            e.hessian[0] = 1e-6;
        },
    );
    let solution = solve(flat, &[0.0]);
    assert!(matches!(solution.status, Status::NumericalTrouble { .. }), "{:?}", solution.status);
    assert!(solution.iterations() < 10, "{}", solution.iterations());
    assert!(solution.log.iter().all(|iteration| iteration.step_length > 0.0), "each was accepted");
}
