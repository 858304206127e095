//! The convex subproblem of an SQP iteration, in the form Clarabel takes:
//!
//! ```text
//!     minimise ½ pᵀ H p + ∇fᵀ p        subject to  g_L ≤ g + J p ≤ g_U,   x_L ≤ x + p ≤ x_U
//! ```
//!
//! and its elastic variant, in which each constraint may be broken at a price, for when the linearised constraints
//! contradict each other.

use crate::problem::{Evaluation, Multipliers, Problem, Step, Subproblem, SubproblemError};
use clarabel::algebra::CscMatrix;
use clarabel::solver::{
    DefaultSettings, DefaultSettingsBuilder, DefaultSolver, IPSolver, NonnegativeConeT, SolverStatus, ZeroConeT,
};

/// Where a nonzero of Clarabel's A comes from.
#[derive(Clone, Copy)]
enum Entry {
    Jacobian { nonzero: usize, sign: f64 },
    Constant(f64),
}

/// What a row of Clarabel's A stands for.
#[derive(Clone, Copy)]
enum Row {
    ConstraintEqual(usize),
    ConstraintUpper(usize),
    ConstraintLower(usize),
    VariableEqual(usize),
    VariableUpper(usize),
    VariableLower(usize),
    SlackNonnegative,
}

pub(crate) struct Qp {
    solver: Option<Box<DefaultSolver<f64>>>,
    hessian: CscMatrix<f64>,
    hessian_nonzeros: Vec<usize>,
    matrix: CscMatrix<f64>,
    entries: Vec<Entry>,
    rows: Vec<Row>,
    equalities: usize,
    linear: Vec<f64>,
    right: Vec<f64>,
    variables: usize,
    constraints: usize,
    /// Cost of one unit of violation in the elastic variant.
    pub price: f64,
    scale: f64,
}

impl Qp {
    /// `elastic`: constraints may be broken at `price`. `scale` multiplies the
    /// objective, so that Clarabel's absolute tolerances fit it.
    pub fn new(problem: &impl Problem, elastic: bool, scale: f64) -> Self {
        let b = problem.bounds();
        let (n, m) = (b.variable_lower.len(), b.constraint_lower.len());
        let (mut equal, mut unequal) = (Vec::new(), Vec::new());
        for i in 0..m {
            let (lower, upper) = (b.constraint_lower[i], b.constraint_upper[i]);
            if lower == upper {
                equal.push(Row::ConstraintEqual(i));
            } else {
                if upper.is_finite() {
                    unequal.push(Row::ConstraintUpper(i));
                }
                if lower.is_finite() {
                    unequal.push(Row::ConstraintLower(i));
                }
            }
        }
        for i in 0..n {
            let (lower, upper) = (b.variable_lower[i], b.variable_upper[i]);
            if lower == upper {
                equal.push(Row::VariableEqual(i));
            } else {
                if upper.is_finite() {
                    unequal.push(Row::VariableUpper(i));
                }
                if lower.is_finite() {
                    unequal.push(Row::VariableLower(i));
                }
            }
        }
        let slacks = if elastic { 2 * m } else { 0 };
        unequal.extend(std::iter::repeat_n(Row::SlackNonnegative, slacks));
        let equalities = equal.len();
        let rows: Vec<Row> = equal.into_iter().chain(unequal).collect();

        // Rows of A that constraint i appears in, with their sign.
        let mut rows_of: Vec<Vec<(usize, f64)>> = vec![Vec::new(); m];
        let mut nonzeros: Vec<(usize, usize, Entry)> = Vec::new();
        let mut slack = n;
        for (r, row) in rows.iter().enumerate() {
            match *row {
                Row::ConstraintEqual(i) | Row::ConstraintUpper(i) => rows_of[i].push((r, 1.0)),
                Row::ConstraintLower(i) => rows_of[i].push((r, -1.0)),
                Row::VariableEqual(i) | Row::VariableUpper(i) => nonzeros.push((i, r, Entry::Constant(1.0))),
                Row::VariableLower(i) => nonzeros.push((i, r, Entry::Constant(-1.0))),
                Row::SlackNonnegative => {
                    nonzeros.push((slack, r, Entry::Constant(-1.0)));
                    slack += 1;
                }
            }
        }
        for (nonzero, &(i, column)) in problem.jacobian_pattern().0.iter().enumerate() {
            nonzeros.extend(rows_of[i].iter().map(|&(r, sign)| (column, r, Entry::Jacobian { nonzero, sign })));
        }
        if elastic {
            // g + J p + up − down inside the bounds: slack 2 i adds to constraint i, slack 2 i + 1 takes away.
            for (i, rows) in rows_of.iter().enumerate() {
                for &(r, sign) in rows {
                    nonzeros.push((n + 2 * i, r, Entry::Constant(sign)));
                    nonzeros.push((n + 2 * i + 1, r, Entry::Constant(-sign)));
                }
            }
        }
        nonzeros.sort_by_key(|&(column, row, _)| (column, row));
        let columns = n + slacks;
        let matrix = compressed(rows.len(), columns, nonzeros.iter().map(|&(c, r, _)| (r, c)));
        let entries = nonzeros.into_iter().map(|(_, _, e)| e).collect();

        let pattern = &problem.hessian_pattern().0;
        let mut order: Vec<usize> = (0..pattern.len()).collect();
        order.sort_by_key(|&k| (pattern[k].1, pattern[k].0));
        let hessian = compressed(columns, columns, order.iter().map(|&k| pattern[k]));
        let right = vec![0.0; rows.len()];
        Self {
            solver: None,
            hessian,
            hessian_nonzeros: order,
            matrix,
            entries,
            rows,
            equalities,
            linear: vec![0.0; columns],
            right,
            variables: n,
            constraints: m,
            price: 1.0,
            scale,
        }
    }
}

impl<P: Problem> Subproblem<P> for Qp {
    fn solve(&mut self, problem: &P, x: &[f64], at: &Evaluation, constraints: &[f64]) -> Result<Step, SubproblemError> {
        for (value, &k) in self.hessian.nzval.iter_mut().zip(&self.hessian_nonzeros) {
            *value = self.scale * at.hessian[k];
        }
        for (value, entry) in self.matrix.nzval.iter_mut().zip(&self.entries) {
            *value = match *entry {
                Entry::Jacobian { nonzero, sign } => sign * at.jacobian[nonzero],
                Entry::Constant(v) => v,
            };
        }
        for (value, gradient) in self.linear.iter_mut().zip(&at.gradient) {
            *value = self.scale * gradient;
        }
        self.linear[self.variables..].fill(self.scale * self.price);
        let b = problem.bounds();
        for (value, row) in self.right.iter_mut().zip(&self.rows) {
            *value = match *row {
                Row::ConstraintEqual(i) | Row::ConstraintUpper(i) => b.constraint_upper[i] - constraints[i],
                Row::ConstraintLower(i) => constraints[i] - b.constraint_lower[i],
                Row::VariableEqual(i) | Row::VariableUpper(i) => b.variable_upper[i] - x[i],
                Row::VariableLower(i) => x[i] - b.variable_lower[i],
                Row::SlackNonnegative => 0.0,
            };
        }
        if let Some(solver) = &mut self.solver {
            solver
                .update_data(&self.hessian, &self.linear, &self.matrix, &self.right)
                .map_err(|e| SubproblemError::Stopped(e.to_string()))?;
        } else {
            let cones = [ZeroConeT(self.equalities), NonnegativeConeT(self.rows.len() - self.equalities)];
            let solver = DefaultSolver::new(&self.hessian, &self.linear, &self.matrix, &self.right, &cones, settings())
                .map_err(|e| SubproblemError::Stopped(e.to_string()))?;
            self.solver = Some(Box::new(solver));
        }
        let solver = self.solver.as_mut().expect("made above");
        solver.solve();
        let solution = &solver.solution;
        match solution.status {
            SolverStatus::Solved | SolverStatus::AlmostSolved => {}
            SolverStatus::PrimalInfeasible | SolverStatus::AlmostPrimalInfeasible => {
                return Err(SubproblemError::Infeasible);
            }
            status => return Err(SubproblemError::Stopped(format!("Clarabel says {status:?}"))),
        }
        if solution.x.iter().chain(&solution.z).any(|v| !v.is_finite()) {
            return Err(SubproblemError::Stopped("the solution is not a number".into()));
        }
        let mut multipliers =
            Multipliers { constraints: vec![0.0; self.constraints], variables: vec![0.0; self.variables] };
        for (row, z) in self.rows.iter().zip(&solution.z) {
            let z = z / self.scale;
            match *row {
                Row::ConstraintEqual(i) | Row::ConstraintUpper(i) => multipliers.constraints[i] += z,
                Row::ConstraintLower(i) => multipliers.constraints[i] -= z,
                Row::VariableEqual(i) | Row::VariableUpper(i) => multipliers.variables[i] += z,
                Row::VariableLower(i) => multipliers.variables[i] -= z,
                Row::SlackNonnegative => {}
            }
        }
        Ok(Step {
            step: solution.x[..self.variables].to_vec(),
            multipliers: Some(multipliers),
            iterations: solution.iterations,
        })
    }
}

/// A matrix with the given nonzeros, sorted by column then row, all values 1 so that Clarabel keeps each of them.
fn compressed(rows: usize, columns: usize, nonzeros: impl Iterator<Item = (usize, usize)>) -> CscMatrix<f64> {
    let mut column_start = vec![0; columns + 1];
    let mut row_of = Vec::new();
    for (r, c) in nonzeros {
        column_start[c + 1] += 1;
        row_of.push(r);
    }
    for c in 0..columns {
        column_start[c + 1] += column_start[c];
    }
    let values = vec![1.0; row_of.len()];
    CscMatrix::new(rows, columns, column_start, row_of, values)
}

fn settings() -> DefaultSettings<f64> {
    DefaultSettingsBuilder::default()
        .verbose(false)
        // Both change the problem's structure, which would forbid the updates from iteration to iteration.
        .presolve_enable(false)
        .input_sparse_dropzeros(false)
        .max_threads(1)
        .max_iter(100)
        .build()
        .expect("these settings are within Clarabel's ranges")
}
