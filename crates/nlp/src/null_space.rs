//! Subproblems by elimination: the equalities are solved for as many variables as there are independent ones, and what remains,
//! a small dense program, is handed to [`DualActiveSet`].
//!
//! The elimination is Gauss's on sparse rows in Markowitz's order (Management Science 3, 1957): of the entries that are not small in
//! their row, the one that makes the least fill. The order is found once and kept from one iteration to the next; when a pivot has
//! become small, it is found anew.

use crate::arrow_qp::{ArrowQp, ArrowQpError, ArrowRow, DualActiveSet};
use crate::problem::{Evaluation, Problem, Step, Subproblem, SubproblemError};
use crate::qp::Qp;
use std::collections::BTreeSet;

/// A pivot's least share of its row's largest entry when the order is chosen: larger ones round less and fill more; …
const PIVOTS: [f64; 2] = [0.05, 0.5];
/// … and at least this share of it later.
const PIVOT_LATER: f64 = 1e-6;
/// An entry is no pivot when it is below this, relative to what it is the difference of.
const CANCELS: f64 = 1e-13;
/// What may be left of an equality that repeats others, relative to its largest entry.
const REPEATS: f64 = 1e-8;
/// Rows with the fewest entries among which a pivot is looked for.
const CANDIDATES: usize = 4;

/// Solves subproblems in which at most W variables stay free by elimination, and by Clarabel those with more.
pub struct NullSpace<const W: usize> {
    elimination: Option<Elimination>,
    numbers: Numbers<W>,
    qp: ArrowQp<W>,
    solver: DualActiveSet<W>,
    /// For problems that elimination does not suit.
    sparse: Option<Qp>,
    scale: f64,
}

/// An equality: a constraint's row, or a variable whose bounds leave it one value.
#[derive(Clone, Copy)]
enum Equality {
    Constraint(usize),
    Variable(usize),
}

/// Place among the Jacobian's values that stands for 1.
const ONE: usize = usize::MAX;

/// Columns of a row's nonzeros and their places among the Jacobian's values.
type Row = Vec<(usize, usize)>;

/// An order of elimination and the patterns that it gives.
struct Elimination {
    steps: Vec<Pivot>,
    /// Variables that stay free.
    free: Vec<usize>,
    /// The constraints that are no equalities.
    inequalities: Vec<(usize, Row)>,
}

/// One step of the elimination: an equality and the variable that it is solved for.
struct Pivot {
    equality: Equality,
    row: Row,
    /// None where the equality repeats others.
    column: Option<usize>,
    /// Earlier steps whose variables are taken out of the equality, in their order.
    before: Vec<usize>,
    /// Variables that remain in it.
    after: Vec<usize>,
}

/// The numbers of an elimination.
struct Numbers<const W: usize> {
    work: Vec<f64>,
    /// Of each step, the entries of its `after` and its constant, divided by the pivot.
    rows: Vec<(Vec<f64>, f64)>,
    /// Every variable's step as a function of the free ones.
    variables: Vec<Affine<W>>,
}

/// A function of the free variables.
#[derive(Clone, Copy)]
struct Affine<const W: usize> {
    slopes: [f64; W],
    constant: f64,
}

impl<const W: usize> Affine<W> {
    const ZERO: Self = Self { slopes: [0.0; W], constant: 0.0 };

    #[inline(always)]
    fn add(&mut self, scale: f64, other: &Self) {
        for (to, from) in self.slopes.iter_mut().zip(&other.slopes) {
            *to += scale * from;
        }
        self.constant += scale * other.constant;
    }
}

/// Why the equalities are not solved.
enum Unsolved {
    /// The order of elimination does not fit the numbers.
    Outdated,
    /// An equality that repeats others wants something else.
    Contradiction,
}

impl<const W: usize> NullSpace<W> {
    /// `scale` multiplies the objective where Clarabel has to help, so that its absolute tolerances fit it.
    pub fn new(scale: f64) -> Self {
        Self {
            elimination: None,
            numbers: Numbers { work: Vec::new(), rows: Vec::new(), variables: Vec::new() },
            qp: ArrowQp::default(),
            solver: DualActiveSet::default(),
            sparse: None,
            scale,
        }
    }
}

impl<P: Problem, const W: usize> Subproblem<P> for NullSpace<W> {
    fn solve(&mut self, problem: &P, x: &[f64], at: &Evaluation, constraints: &[f64]) -> Result<Step, SubproblemError> {
        if self.sparse.is_none() {
            let known = self.elimination.take();
            let new = PIVOTS.into_iter().filter_map(|share| Elimination::new(problem, at, W, share));
            for order in known.into_iter().chain(new) {
                match self.numbers.eliminate(&order, problem, x, at, constraints) {
                    Ok(()) => {
                        self.elimination = Some(order);
                        break;
                    }
                    Err(Unsolved::Outdated) => {}
                    Err(Unsolved::Contradiction) => return Err(SubproblemError::Infeasible),
                }
            }
            if let Some(elimination) = &self.elimination {
                self.numbers.assemble(elimination, problem, x, at, constraints, &mut self.qp);
                match self.solver.solve(&self.qp) {
                    Ok(()) => return self.numbers.expand(&self.solver),
                    Err(ArrowQpError::Infeasible { .. }) => return Err(SubproblemError::Infeasible),
                    // Clarabel tells what is the matter.
                    Err(ArrowQpError::NotConvex | ArrowQpError::Inaccurate { .. } | ArrowQpError::IterationLimit) => {}
                }
            }
        }
        let scale = self.scale;
        self.sparse.get_or_insert_with(|| Qp::new(problem, false, scale)).solve(problem, x, at, constraints)
    }
}

fn entry(at: &Evaluation, place: usize) -> f64 {
    if place == ONE { 1.0 } else { at.jacobian[place] }
}

/// An entry of a row that is to be eliminated.
#[derive(Clone, Copy)]
struct RowEntry {
    column: usize,
    value: f64,
    /// The largest number that went into the value: what it is rounded by.
    size: f64,
}

impl RowEntry {
    /// The product, in the other's column.
    fn times(&self, other: &Self) -> Self {
        let size = (self.value.abs() * other.size).max(self.size * other.value.abs());
        Self { column: other.column, value: self.value * other.value, size }
    }

    fn cancels(&self) -> bool {
        self.value.abs() <= CANCELS * self.size
    }
}

/// The rows that are still to be eliminated.
struct Remaining {
    rows: Vec<Vec<RowEntry>>,
    /// Rows still to come that hold each column.
    columns: Vec<Vec<usize>>,
    /// Rows still to come by their length.
    by_length: BTreeSet<(usize, usize)>,
    /// Steps whose variables have been taken out of each row.
    before: Vec<Vec<usize>>,
    /// The pivot's entries by column, while its variable is taken out.
    places: Vec<Option<RowEntry>>,
    /// The row in which each of the pivot's columns was met last.
    met: Vec<usize>,
}

impl Remaining {
    /// The row and the place in it of the best pivot among the shortest rows that have one.
    fn best(&self, least_share: f64) -> Option<(usize, usize)> {
        let mut best: Option<(usize, f64, (usize, usize))> = None;
        let mut candidates = 0;
        for &(length, row) in &self.by_length {
            let entries = &self.rows[row];
            let largest = entries.iter().filter(|e| !e.cancels()).fold(0.0_f64, |a, e| a.max(e.value.abs()));
            if largest == 0.0 {
                continue;
            }
            for (place, e) in entries.iter().enumerate() {
                let share = e.value.abs() / largest;
                if share < least_share || e.cancels() {
                    continue;
                }
                let fill = (length - 1) * (self.columns[e.column].len() - 1);
                if best.is_none_or(|(least, size, _)| fill < least || (fill == least && share > size)) {
                    best = Some((fill, share, (row, place)));
                }
            }
            candidates += 1;
            if candidates == CANDIDATES {
                break;
            }
        }
        best.map(|b| b.2)
    }

    /// Takes a row out of those to come.
    fn take(&mut self, row: usize) -> Vec<RowEntry> {
        let entries = std::mem::take(&mut self.rows[row]);
        self.by_length.remove(&(entries.len(), row));
        for e in &entries {
            let rows = &mut self.columns[e.column];
            let place = rows.iter().position(|&r| r == row).expect("the row is in its columns");
            rows.swap_remove(place);
        }
        entries
    }

    /// Takes the variable `column` of step `step`, whose row is `pivot`, divided by its entry, out of the rows that hold it.
    fn eliminate(&mut self, step: usize, column: usize, pivot: &[RowEntry]) {
        for e in pivot {
            self.places[e.column] = Some(*e);
        }
        for row in std::mem::take(&mut self.columns[column]) {
            let entries = &mut self.rows[row];
            self.by_length.remove(&(entries.len(), row));
            let place = entries.iter().position(|e| e.column == column).expect("the column holds the row");
            let factor = entries.swap_remove(place);
            for e in entries.iter_mut() {
                if let Some(other) = &self.places[e.column] {
                    let product = factor.times(other);
                    e.value -= product.value;
                    e.size = e.size.max(product.size);
                    self.met[e.column] = row;
                }
            }
            for e in pivot {
                if self.met[e.column] != row {
                    let product = factor.times(e);
                    entries.push(RowEntry { value: -product.value, ..product });
                    self.columns[e.column].push(row);
                }
            }
            for e in pivot {
                self.met[e.column] = usize::MAX;
            }
            self.by_length.insert((entries.len(), row));
            self.before[row].push(step);
        }
        for e in pivot {
            self.places[e.column] = None;
        }
    }
}

impl Elimination {
    /// The order for a problem's numbers; none where more than `most_free` variables stay free.
    fn new(problem: &impl Problem, at: &Evaluation, most_free: usize, pivot_share: f64) -> Option<Self> {
        let b = problem.bounds();
        let (n, m) = (b.variable_lower.len(), b.constraint_lower.len());
        let mut of_constraint: Vec<Row> = vec![Vec::new(); m];
        for (place, &(row, column)) in problem.jacobian_pattern().0.iter().enumerate() {
            of_constraint[row].push((column, place));
        }
        let (mut equalities, mut inequalities) = (Vec::new(), Vec::new());
        for (i, row) in of_constraint.into_iter().enumerate() {
            let (lower, upper) = (b.constraint_lower[i], b.constraint_upper[i]);
            if lower == upper {
                equalities.push((Equality::Constraint(i), row));
            } else if lower.is_finite() || upper.is_finite() {
                inequalities.push((i, row));
            }
        }
        let fixed = (0..n).filter(|&i| b.variable_lower[i] == b.variable_upper[i]);
        equalities.extend(fixed.map(|i| (Equality::Variable(i), vec![(i, ONE)])));
        if equalities.len() + most_free < n {
            return None;
        }

        let numbers = |row: &Row| {
            let entry = |&(column, place): &(usize, usize)| {
                let value = entry(at, place);
                RowEntry { column, value, size: value.abs() }
            };
            row.iter().map(entry).collect::<Vec<_>>()
        };
        let rows: Vec<Vec<RowEntry>> = equalities.iter().map(|(_, row)| numbers(row)).collect();
        let mut columns = vec![Vec::new(); n];
        for (r, row) in rows.iter().enumerate() {
            for e in row {
                columns[e.column].push(r);
            }
        }
        let by_length = rows.iter().enumerate().map(|(r, row)| (row.len(), r)).collect();
        let before = vec![Vec::new(); rows.len()];
        let mut remaining =
            Remaining { rows, columns, by_length, before, places: vec![None; n], met: vec![usize::MAX; n] };
        let mut steps = Vec::with_capacity(equalities.len());
        let mut is_free = vec![true; n];
        let mut step = |remaining: &mut Remaining, row: usize, column: Option<usize>, rest: &[RowEntry]| {
            let (equality, entries) = &mut equalities[row];
            steps.push(Pivot {
                equality: *equality,
                row: std::mem::take(entries),
                column,
                before: std::mem::take(&mut remaining.before[row]),
                after: rest.iter().map(|e| e.column).collect(),
            });
        };
        let mut count = 0;
        while let Some((row, place)) = remaining.best(pivot_share) {
            let mut pivot = remaining.take(row);
            let RowEntry { column, value, .. } = pivot.swap_remove(place);
            for e in &mut pivot {
                e.value /= value;
                e.size /= value.abs();
            }
            remaining.eliminate(count, column, &pivot);
            is_free[column] = false;
            step(&mut remaining, row, Some(column), &pivot);
            count += 1;
        }
        // Rows without a pivot repeat others.
        for (_, row) in std::mem::take(&mut remaining.by_length) {
            let rest = std::mem::take(&mut remaining.rows[row]);
            step(&mut remaining, row, None, &rest);
        }
        let free: Vec<usize> = (0..n).filter(|&i| is_free[i]).collect();
        (free.len() <= most_free).then_some(Self { steps, free, inequalities })
    }
}

impl<const W: usize> Numbers<W> {
    /// Solves the equalities in a known order.
    fn eliminate(
        &mut self,
        e: &Elimination,
        problem: &impl Problem,
        x: &[f64],
        at: &Evaluation,
        constraints: &[f64],
    ) -> Result<(), Unsolved> {
        let b = problem.bounds();
        self.work.clear();
        self.work.resize(x.len(), 0.0);
        self.rows.resize_with(e.steps.len(), Default::default);
        let work = &mut self.work;
        for (step, pivot) in e.steps.iter().enumerate() {
            let mut constant = match pivot.equality {
                Equality::Constraint(i) => b.constraint_lower[i] - constraints[i],
                Equality::Variable(i) => b.variable_lower[i] - x[i],
            };
            let mut before = 0.0_f64;
            for &(column, place) in &pivot.row {
                work[column] = entry(at, place);
                before = before.max(work[column].abs());
            }
            let (known, rest) = self.rows.split_at_mut(step);
            for &earlier in &pivot.before {
                let taken = e.steps[earlier].column.expect("only steps with a variable come before others");
                let factor = std::mem::take(&mut work[taken]);
                if factor != 0.0 {
                    let (values, known_constant) = &known[earlier];
                    for (column, value) in e.steps[earlier].after.iter().zip(values) {
                        work[*column] -= factor * value;
                    }
                    constant -= factor * known_constant;
                }
            }
            let divisor = pivot.column.map_or(1.0, |column| std::mem::take(&mut work[column]));
            let (values, to) = &mut rest[0];
            values.clear();
            let mut largest = 0.0_f64;
            for &column in &pivot.after {
                let value = std::mem::take(&mut work[column]);
                largest = largest.max(value.abs());
                values.push(value / divisor);
            }
            if pivot.column.is_none() {
                if largest > REPEATS * before {
                    return Err(Unsolved::Outdated);
                }
                if constant.abs() > REPEATS * before {
                    return Err(Unsolved::Contradiction);
                }
                continue;
            }
            // Written so that NaN is refused as well.
            if !(divisor.abs() >= PIVOT_LATER * largest && divisor != 0.0) {
                return Err(Unsolved::Outdated);
            }
            *to = constant / divisor;
        }

        self.variables.clear();
        self.variables.resize(x.len(), Affine::ZERO);
        for (k, &i) in e.free.iter().enumerate() {
            self.variables[i].slopes[k] = 1.0;
        }
        for (pivot, (values, constant)) in e.steps.iter().zip(&self.rows).rev() {
            let Some(column) = pivot.column else { continue };
            let mut variable = Affine { constant: *constant, ..Affine::ZERO };
            for (&other, value) in pivot.after.iter().zip(values) {
                variable.add(-value, &self.variables[other]);
            }
            self.variables[column] = variable;
        }
        Ok(())
    }

    /// The program in the free variables.
    fn assemble(
        &self,
        e: &Elimination,
        problem: &impl Problem,
        x: &[f64],
        at: &Evaluation,
        constraints: &[f64],
        qp: &mut ArrowQp<W>,
    ) {
        let b = problem.bounds();
        qp.rows.clear();
        let mut push = |row: &Affine<W>, value: f64, lower: f64, upper: f64| {
            let offset = value + row.constant;
            qp.rows.push(ArrowRow { normal: row.slopes, own: (0, 0.0), offset, lower, upper });
        };
        for (i, variable) in self.variables.iter().enumerate() {
            let (lower, upper) = (b.variable_lower[i], b.variable_upper[i]);
            if lower < upper && (lower.is_finite() || upper.is_finite()) {
                push(variable, x[i], lower, upper);
            }
        }
        for (i, row) in &e.inequalities {
            let mut sum = Affine::ZERO;
            for &(column, place) in row {
                sum.add(entry(at, place), &self.variables[column]);
            }
            push(&sum, constraints[*i], b.constraint_lower[*i], b.constraint_upper[*i]);
        }

        let mut slopes = at.gradient.clone();
        qp.hessian = [[0.0; W]; W];
        qp.gradient = [0.0; W];
        for (&(row, column), &value) in problem.hessian_pattern().0.iter().zip(&at.hessian) {
            let (a, c) = (&self.variables[row], &self.variables[column]);
            slopes[row] += value * c.constant;
            add_product(&mut qp.hessian, value, a, c);
            if row != column {
                slopes[column] += value * a.constant;
                add_product(&mut qp.hessian, value, c, a);
            }
        }
        for (variable, slope) in self.variables.iter().zip(&slopes) {
            for (to, from) in qp.gradient.iter_mut().zip(&variable.slopes) {
                *to += slope * from;
            }
        }
        for (k, row) in qp.hessian.iter_mut().enumerate().skip(e.free.len()) {
            // Places that stand for nothing stay at zero.
            row[k] = 1.0;
        }
    }

    /// The step of all variables.
    fn expand(&self, solution: &DualActiveSet<W>) -> Result<Step, SubproblemError> {
        let of = |variable: &Affine<W>| {
            variable.constant + variable.slopes.iter().zip(&solution.shared).map(|(a, b)| a * b).sum::<f64>()
        };
        let step: Vec<f64> = self.variables.iter().map(of).collect();
        if step.iter().any(|p| !p.is_finite()) {
            return Err(SubproblemError::Stopped("the step is not a number".into()));
        }
        Ok(Step { step, multipliers: None, iterations: solution.iterations })
    }
}

/// Adds value · a cᵀ.
fn add_product<const W: usize>(to: &mut [[f64; W]; W], value: f64, a: &Affine<W>, c: &Affine<W>) {
    for (row, share) in to.iter_mut().zip(&a.slopes) {
        for (to, from) in row.iter_mut().zip(&c.slopes) {
            *to += value * share * from;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::problem::{Bounds, Pattern};

    const VARIABLES: usize = 12;
    const CONSTRAINTS: usize = 10;

    /// A convex quadratic program around 0 whose last two equalities repeat others; some variables are fixed.
    struct Random {
        bounds: Bounds,
        jacobian: Pattern,
        hessian: Pattern,
        at: Evaluation,
    }

    fn noise(seed: u64) -> impl FnMut() -> f64 {
        let mut state = seed.wrapping_mul(2).wrapping_add(1);
        move || {
            state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            (state >> 11) as f64 / (1u64 << 52) as f64 - 1.0
        }
    }

    impl Random {
        fn new(seed: u64) -> Self {
            let mut r = noise(seed);
            let mut rows = [[0.0; VARIABLES]; CONSTRAINTS];
            for row in &mut rows[..8] {
                for value in row {
                    *value = if r() > 0.2 { r() } else { 0.0 };
                }
            }
            // Rows 6 and 7 are inequalities, the others equalities; the last two repeat some.
            for i in 0..VARIABLES {
                rows[8][i] = rows[0][i] - 2.0 * rows[1][i];
                rows[9][i] = rows[8][i] + rows[2][i];
            }
            let mut constraints: Vec<f64> = (0..8).map(|_| 0.1 * r()).collect();
            constraints.push(constraints[0] - 2.0 * constraints[1]);
            constraints.push(constraints[8] + constraints[2]);
            let mut bounds = Bounds {
                variable_lower: vec![-1.0; VARIABLES],
                variable_upper: vec![0.3; VARIABLES],
                constraint_lower: vec![0.0; CONSTRAINTS],
                constraint_upper: vec![0.0; CONSTRAINTS],
            };
            (bounds.variable_lower[3], bounds.variable_upper[3]) = (0.05, 0.05);
            (bounds.variable_lower[4], bounds.variable_upper[4]) = (f64::NEG_INFINITY, f64::INFINITY);
            (bounds.constraint_lower[6], bounds.constraint_upper[6]) = (-0.05, 0.2);
            (bounds.constraint_lower[7], bounds.constraint_upper[7]) = (0.01, f64::INFINITY);
            let mut jacobian = (Vec::new(), Vec::new());
            for (i, row) in rows.iter().enumerate() {
                for (k, value) in row.iter().enumerate() {
                    jacobian.0.push((i, k));
                    jacobian.1.push(*value);
                }
            }
            let mut hessian = (Vec::new(), Vec::new());
            for i in 0..VARIABLES {
                for k in i..VARIABLES {
                    hessian.0.push((i, k));
                    hessian.1.push(if i == k { 4.0 + r() } else { 0.3 * r() });
                }
            }
            let at = Evaluation {
                jacobian_wanted: true,
                objective: 0.0,
                gradient: (0..VARIABLES).map(|_| r()).collect(),
                constraints,
                jacobian: jacobian.1,
                hessian: hessian.1,
            };
            Self { bounds, jacobian: Pattern(jacobian.0), hessian: Pattern(hessian.0), at }
        }
    }

    impl Problem for Random {
        fn bounds(&self) -> &Bounds {
            &self.bounds
        }
        fn jacobian_pattern(&self) -> &Pattern {
            &self.jacobian
        }
        fn hessian_pattern(&self) -> &Pattern {
            &self.hessian
        }
        fn evaluate(&mut self, _: &[f64], evaluation: &mut Evaluation) {
            evaluation.clone_from(&self.at);
        }
        fn values(&mut self, _: &[f64], _: &mut [f64]) -> f64 {
            unreachable!("a subproblem asks for no values")
        }
        fn constraint_name(&self, row: usize) -> String {
            format!("constraint {row}")
        }
        fn variable_name(&self, column: usize) -> String {
            format!("variable {column}")
        }
    }

    fn step<const W: usize>(eliminated: &mut NullSpace<W>, problem: &Random) -> Result<Vec<f64>, SubproblemError> {
        let x = [0.0; VARIABLES];
        eliminated.solve(problem, &x, &problem.at, &problem.at.constraints).map(|s| s.step)
    }

    #[test]
    fn gives_clarabel_s_step_with_repeated_rows_and_fixed_variables() {
        let (mut solved, mut refused) = (0, 0);
        // One solver for all: the order of one program is tried on the next.
        let mut eliminated = NullSpace::<8>::new(1.0);
        for seed in 0..300 {
            let problem = Random::new(seed);
            let x = [0.0; VARIABLES];
            let reference = Qp::new(&problem, false, 1.0).solve(&problem, &x, &problem.at, &problem.at.constraints);
            match (step(&mut eliminated, &problem), reference) {
                (Ok(ours), Ok(theirs)) => {
                    solved += 1;
                    for (a, b) in ours.iter().zip(&theirs.step) {
                        assert!((a - b).abs() < 1e-5, "seed {seed}: {ours:?}, {:?}", theirs.step);
                    }
                }
                (Err(SubproblemError::Infeasible), Err(_)) => refused += 1,
                (ours, theirs) => panic!("seed {seed}: {ours:?}, {theirs:?}"),
            }
            assert!(eliminated.sparse.is_none(), "seed {seed}: solved by Clarabel");
        }
        println!("{solved} solved, {refused} infeasible");
        assert!(solved > 100 && refused > 0, "{solved} solved, {refused} infeasible");
    }

    #[test]
    fn what_has_too_many_free_variables_is_clarabel_s() {
        let problem = (0..).map(Random::new).find(|p| step(&mut NullSpace::<8>::new(1.0), p).is_ok()).unwrap();
        let mut narrow = NullSpace::<4>::new(1.0);
        let ours = step(&mut NullSpace::<8>::new(1.0), &problem).unwrap();
        let theirs = step(&mut narrow, &problem).unwrap();
        assert!(narrow.sparse.is_some());
        assert!(ours.iter().zip(&theirs).all(|(a, b)| (a - b).abs() < 1e-5), "{ours:?}, {theirs:?}");
    }
}
