//! The problem trait and the shapes that go with it.

/// Where the nonzeros of a sparse matrix are: `(row, column)` pairs, in the order in which values are given.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Pattern(pub Vec<(usize, usize)>);

impl Pattern {
    /// Number of nonzeros.
    pub fn len(&self) -> usize {
        self.0.len()
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }
}

/// Lower and upper bounds of the variables and of the constraints; infinite where there is none, equal for an equality.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Bounds {
    /// x_L.
    pub variable_lower: Vec<f64>,
    /// x_U.
    pub variable_upper: Vec<f64>,
    /// g_L.
    pub constraint_lower: Vec<f64>,
    /// g_U.
    pub constraint_upper: Vec<f64>,
}

/// Values and derivatives at one point.
#[derive(Clone, Debug, Default)]
pub struct Evaluation {
    /// Whether the Jacobian's values are asked for; where they are not, a problem may leave them as they are.
    pub jacobian_wanted: bool,
    /// f(x).
    pub objective: f64,
    /// ∇f(x), one entry a variable.
    pub gradient: Vec<f64>,
    /// g(x), one entry a constraint.
    pub constraints: Vec<f64>,
    /// Values of ∂g/∂x on the problem's Jacobian pattern.
    pub jacobian: Vec<f64>,
    /// Values of the Hessian's upper triangle on the problem's Hessian pattern.
    pub hessian: Vec<f64>,
}

/// A nonlinear program. Patterns and bounds stay the same from one call to the next.
pub trait Problem {
    /// Bounds; their lengths give the numbers of variables and constraints.
    fn bounds(&self) -> &Bounds;

    /// Nonzeros of ∂g/∂x, each once. Asked for only where the Jacobian is.
    fn jacobian_pattern(&self) -> &Pattern;

    /// Nonzeros of the upper triangle (row ≤ column) of the Hessian approximation, each once.
    fn hessian_pattern(&self) -> &Pattern;

    /// Values and derivatives at `x`.
    fn evaluate(&mut self, x: &[f64], evaluation: &mut Evaluation);

    /// The size of the largest entry of ∂g/∂x in each row, at the point `x` where the problem has just been evaluated
    /// to `at`. A solve asks once. A problem that writes its Jacobian only where it is asked to may find them without.
    fn steepest(&mut self, x: &[f64], at: &mut Evaluation) -> Vec<f64> {
        if !at.jacobian_wanted {
            at.want_jacobian(self);
            self.evaluate(x, at);
        }
        let mut steepest = vec![0.0_f64; at.constraints.len()];
        for (&(row, _), value) in self.jacobian_pattern().0.iter().zip(&at.jacobian) {
            // A comparison, for `f64::max` minds values that are not numbers and takes three times as long.
            if value.abs() > steepest[row] {
                steepest[row] = value.abs();
            }
        }
        steepest
    }

    /// Values alone, for the line search: writes g(x) and returns f(x).
    fn values(&mut self, x: &[f64], constraints: &mut [f64]) -> f64;

    /// What constraint `row` is, for a person.
    fn constraint_name(&self, row: usize) -> String;

    /// What variable `column` is, for a person.
    fn variable_name(&self, column: usize) -> String;
}

/// A step of sequential quadratic programming.
#[derive(Clone, Debug, PartialEq)]
pub struct Step {
    /// p, one entry a variable.
    pub step: Vec<f64>,
    /// Multipliers, where the subproblem's solver computes them.
    pub multipliers: Option<Multipliers>,
    /// Iterations of the subproblem's solver.
    pub iterations: u32,
}

/// Multipliers of a subproblem: positive at an upper bound, negative at a lower one.
#[derive(Clone, Debug, PartialEq)]
pub struct Multipliers {
    /// One a constraint.
    pub constraints: Vec<f64>,
    /// One a variable.
    pub variables: Vec<f64>,
}

/// Why a subproblem gave no step.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum SubproblemError {
    /// The linearised constraints contradict each other.
    #[error("its linearised constraints contradict each other")]
    Infeasible,
    /// Its solver stopped short.
    #[error("its solver stopped: {0}")]
    Stopped(String),
}

/// Solves the convex subproblems of [`crate::SqpSolver`]:
/// minimise ½ pᵀ H p + ∇fᵀ p subject to g_L ≤ c + J p ≤ g_U, x_L ≤ x + p ≤ x_U.
pub trait Subproblem<P: Problem> {
    /// The step at `x`, where `problem` has just been evaluated to `at`. `constraints` is c: g(x), or what a
    /// second-order correction puts in its place.
    fn solve(&mut self, problem: &P, x: &[f64], at: &Evaluation, constraints: &[f64]) -> Result<Step, SubproblemError>;

    /// Whether it reads the Jacobian's values, rather than the problem's own derivatives.
    fn needs_jacobian(&self) -> bool {
        true
    }
}

/// A problem that contradicts itself before the first iteration.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum ProblemError {
    /// A lower bound above its upper bound, or a bound that is not a number.
    #[error("{name}: the lower bound {lower} and the upper bound {upper} leave nothing")]
    Bounds {
        /// The variable's or constraint's name.
        name: String,
        /// Lower bound.
        lower: f64,
        /// Upper bound.
        upper: f64,
    },
    /// Lengths that do not fit, or an index out of range.
    #[error("the problem's {what} has length or index {found}, expected {expected}")]
    Shape {
        /// Which array.
        what: &'static str,
        /// What was found.
        found: usize,
        /// What was expected.
        expected: usize,
    },
    /// A nonzero that is given twice.
    #[error("the problem's hessian_pattern has ({row}, {column}) twice, expected each nonzero once")]
    Repeated {
        /// Its row.
        row: usize,
        /// Its column.
        column: usize,
    },
    /// The start is not a number somewhere.
    #[error("the start of {name} is {value}, expected a finite number")]
    Start {
        /// The variable's name.
        name: String,
        /// Its value.
        value: f64,
    },
}

impl Evaluation {
    /// Room for a problem's values.
    pub fn new(problem: &impl Problem) -> Self {
        let mut evaluation = Self::default();
        evaluation.fit(problem);
        evaluation.want_jacobian(problem);
        evaluation
    }

    /// Asks for the Jacobian's values from the next evaluation on.
    pub(crate) fn want_jacobian(&mut self, problem: &(impl Problem + ?Sized)) {
        self.jacobian_wanted = true;
        self.jacobian.resize(problem.jacobian_pattern().len(), 0.0);
    }

    /// Makes room for a problem's values but the Jacobian's.
    pub(crate) fn fit(&mut self, problem: &impl Problem) {
        let bounds = problem.bounds();
        self.gradient.resize(bounds.variable_lower.len(), 0.0);
        self.constraints.resize(bounds.constraint_lower.len(), 0.0);
        self.hessian.resize(problem.hessian_pattern().len(), 0.0);
    }
}

/// By how much `value` is outside [lower, upper].
pub(crate) fn outside(value: f64, lower: f64, upper: f64) -> f64 {
    // A value that is not a number is as far outside as can be; the comparisons below would call it inside.
    let (below, above) = (lower - value, value - upper);
    let out = if below > above { below } else { above };
    if value.is_nan() {
        f64::INFINITY
    } else if out > 0.0 {
        out
    } else {
        0.0
    }
}

/// That the Jacobian's nonzeros are in the matrix.
pub(crate) fn check_jacobian(problem: &impl Problem) -> Result<(), ProblemError> {
    let (n, m) = (problem.bounds().variable_lower.len(), problem.bounds().constraint_lower.len());
    let largest = |a: (usize, usize), b: &(usize, usize)| (a.0.max(b.0), a.1.max(b.1));
    let (row, column) = problem.jacobian_pattern().0.iter().fold((0, 0), largest);
    if !problem.jacobian_pattern().is_empty() && (row >= m || column >= n) {
        return Err(ProblemError::Shape { what: "jacobian_pattern", found: row.max(column), expected: m.max(n) });
    }
    Ok(())
}

pub(crate) fn check(problem: &impl Problem, start: &[f64]) -> Result<(), ProblemError> {
    let b = problem.bounds();
    let (n, m) = (b.variable_lower.len(), b.constraint_lower.len());
    for (what, found, expected) in [
        ("variable_upper", b.variable_upper.len(), n),
        ("constraint_upper", b.constraint_upper.len(), m),
        ("start", start.len(), n),
    ] {
        if found != expected {
            return Err(ProblemError::Shape { what, found, expected });
        }
    }
    for &(row, column) in &problem.hessian_pattern().0 {
        if row > column || column >= n {
            return Err(ProblemError::Shape { what: "hessian_pattern", found: row, expected: column });
        }
    }
    // A pattern in order, as most are, has no repetition to look for.
    let pattern = &problem.hessian_pattern().0;
    if !pattern.is_sorted_by(|a, b| a < b) {
        let mut sorted = pattern.clone();
        sorted.sort_unstable();
        if let Some(pair) = sorted.windows(2).find(|pair| pair[0] == pair[1]) {
            return Err(ProblemError::Repeated { row: pair[0].0, column: pair[0].1 });
        }
    }
    let bad = |lower: f64, upper: f64| lower.is_nan() || upper.is_nan() || lower > upper;
    for i in 0..n {
        let (lower, upper) = (b.variable_lower[i], b.variable_upper[i]);
        if bad(lower, upper) {
            return Err(ProblemError::Bounds { name: problem.variable_name(i), lower, upper });
        }
        if !start[i].is_finite() {
            return Err(ProblemError::Start { name: problem.variable_name(i), value: start[i] });
        }
    }
    for i in 0..m {
        let (lower, upper) = (b.constraint_lower[i], b.constraint_upper[i]);
        if bad(lower, upper) {
            return Err(ProblemError::Bounds { name: problem.constraint_name(i), lower, upper });
        }
    }
    Ok(())
}
