//! Strictly convex quadratic programs with a few shared unknowns, any number of unknowns that meet only the shared ones, and
//! many two-sided rows that each hold the shared unknowns and at most one of the others:
//!
//! ```text
//!     minimise   ½ yᵀ A y + aᵀ y + Σ_p (½ d_p μ_p² + μ_p b_pᵀ y + c_p μ_p)
//!     subject to lower ≤ offset + nᵀ y + e μ_p ≤ upper        for each row
//! ```
//!
//! The Hessian is an arrow: dense where the shared unknowns y meet, diagonal where the others do. The method is the dual
//! active set of Goldfarb & Idnani (Math. Prog. 27, 1983): it starts at the unconstrained minimum and adds the most broken
//! row until none is broken, so its work grows with the rows that end up active, not with the rows there are. Normals are kept as
//! sparse as they come: in the metric of the Hessian's factor a normal has the shared entries and one more, and the active
//! ones are held by the triangular factor R of their Gram matrix alone (with one step of refinement, which makes projections as
//! exact as an orthogonal basis would: Björck, BIT 7, 1967), so a change of the active set costs nothing that grows with the
//! unknowns.

/// One two-sided row.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ArrowRow<const W: usize> {
    /// n: the shared unknowns' coefficients.
    pub normal: [f64; W],
    /// Which of the other unknowns it holds, and e; e = 0 where it holds none.
    pub own: (usize, f64),
    /// Its value at zero.
    pub offset: f64,
    /// Lower bound; may be −∞.
    pub lower: f64,
    /// Upper bound; may be ∞.
    pub upper: f64,
}

/// One of the unknowns beside the shared ones.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Own<const W: usize> {
    /// b: how it meets the shared unknowns in the Hessian.
    pub coupling: [f64; W],
    /// d: its diagonal entry of the Hessian.
    pub hessian: f64,
    /// c: its entry of the gradient.
    pub gradient: f64,
}

/// The program, with W shared unknowns.
#[derive(Clone, Debug, PartialEq)]
pub struct ArrowQp<const W: usize> {
    /// A, symmetric.
    pub hessian: [[f64; W]; W],
    /// a.
    pub gradient: [f64; W],
    /// The other unknowns.
    pub own: Vec<Own<W>>,
    /// The rows.
    pub rows: Vec<ArrowRow<W>>,
}

impl<const W: usize> Default for ArrowQp<W> {
    fn default() -> Self {
        Self { hessian: [[0.0; W]; W], gradient: [0.0; W], own: Vec::new(), rows: Vec::new() }
    }
}

/// Why there is no solution.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ArrowQpError {
    /// The Hessian is not positive definite.
    #[error("its Hessian is not positive definite")]
    NotConvex,
    /// Nothing satisfies every row.
    #[error("row {row} cannot be satisfied together with the rows before it")]
    Infeasible {
        /// The row that found no place.
        row: usize,
    },
    /// Rounding spoilt the point: a row that should hold with equality does not.
    #[error("rows nearly repeat each other: row {row} is broken by rounding")]
    Inaccurate {
        /// The row.
        row: usize,
    },
    /// Rounding kept it from ending.
    #[error("it does not end")]
    IterationLimit,
}

/// A normal in the metric of the Hessian's factor: the shared part and the entry of one other unknown.
#[derive(Clone, Copy, Debug)]
struct Whitened<const W: usize> {
    shared: [f64; W],
    own: (usize, f64),
}

impl<const W: usize> Whitened<W> {
    fn dot(&self, other: &Self) -> f64 {
        let own = if self.own.0 == other.own.0 { self.own.1 * other.own.1 } else { 0.0 };
        dot(&self.shared, &other.shared) + own
    }
}

/// An active row.
#[derive(Clone, Copy, Debug)]
struct Active<const W: usize> {
    row: usize,
    /// +1 at its lower bound, −1 at its upper.
    side: f64,
    multiplier: f64,
    /// `side` times its normal.
    normal: Whitened<W>,
}

/// The solver and its memory. Rows that were active in the last solve are tried first in the next.
#[derive(Clone, Debug)]
pub struct DualActiveSet<const W: usize> {
    /// y of the solution.
    pub shared: [f64; W],
    /// μ of the solution.
    pub own: Vec<f64>,
    /// Changes of the active set that the last solve took.
    pub iterations: u32,
    /// Cholesky factor of A − Σ b_p b_pᵀ / d_p, lower, with its diagonal inverted.
    factor: [[f64; W]; W],
    active: Vec<Active<W>>,
    /// Upper triangular, one column after the other, packed: column k starts at k (k + 1) / 2.
    r: Vec<f64>,
    scale: Vec<f64>,
    /// Rows to try first: those active in the last solve.
    first: Vec<usize>,
    /// The other unknowns' part of the projected normal.
    z_own: Vec<f64>,
    products: Vec<f64>,
    dual_step: Vec<f64>,
}

impl<const W: usize> Default for DualActiveSet<W> {
    fn default() -> Self {
        Self {
            shared: [0.0; W],
            own: Vec::new(),
            iterations: 0,
            factor: [[0.0; W]; W],
            active: Vec::new(),
            r: Vec::new(),
            scale: Vec::new(),
            first: Vec::new(),
            z_own: Vec::new(),
            products: Vec::new(),
            dual_step: Vec::new(),
        }
    }
}

/// A row counts as broken when it is by more than this, relative to its normal's length.
const TOLERANCE: f64 = 1e-10;
/// An active row that is off its bound by more than this, relative to its normal and bound, is a sign of rounding gone wrong.
const ACTIVE_TOLERANCE: f64 = 1e-7;
/// A normal is a combination of the active ones when the square of what is left of it is below this, relative to it.
const REPEATED: f64 = 1e-20;

impl<const W: usize> DualActiveSet<W> {
    /// Solves; the solution is in `shared` and `own`, which rows are active in [`Self::active`].
    pub fn solve(&mut self, qp: &ArrowQp<W>) -> Result<(), ArrowQpError> {
        self.factorise(qp)?;
        self.first.clear();
        self.first.extend(self.active.iter().map(|a| a.row).filter(|&row| row < qp.rows.len()));
        self.active.clear();
        self.r.clear();
        self.iterations = 0;
        self.minimum(qp);
        self.scale.clear();
        self.scale.extend(
            qp.rows.iter().map(|row| (dot(&row.normal, &row.normal) + row.own.1 * row.own.1).sqrt().max(1e-12)),
        );
        let limit = 50 * (W + qp.own.len() + 10) as u32;
        'rows: while let Some((row, side)) = self.most_broken(qp) {
            let normal = self.whiten(qp, row, side);
            let mut multiplier = 0.0;
            loop {
                self.iterations += 1;
                if self.iterations > limit {
                    return Err(ArrowQpError::IterationLimit);
                }
                let (z, gained) = self.project(&normal);
                // The longest step that keeps every multiplier nonnegative, and the row that stops it.
                let mut blocking = None;
                let mut length = f64::INFINITY;
                for (k, (active, step)) in self.active.iter().zip(&self.dual_step).enumerate() {
                    if *step > 0.0 && active.multiplier / step < length {
                        (length, blocking) = (active.multiplier / step, Some(k));
                    }
                }
                // As many active rows as unknowns leave no direction; what seems to be left of the normal then is rounding.
                let complete = self.active.len() >= W + qp.own.len();
                let reachable = !complete && gained > REPEATED * normal.dot(&normal);
                let full = if reachable { -self.slack(qp, row, side) / gained } else { f64::INFINITY };
                if !length.is_finite() && !full.is_finite() {
                    return Err(ArrowQpError::Infeasible { row });
                }
                let t = length.min(full);
                for (active, step) in self.active.iter_mut().zip(&self.dual_step) {
                    active.multiplier -= t * step;
                }
                multiplier += t;
                if full.is_finite() {
                    self.walk(qp, t, &z);
                }
                if full <= length {
                    self.add(Active { row, side, multiplier, normal }, gained.sqrt());
                    continue 'rows;
                }
                self.drop(blocking.expect("a finite length has a row that stops it"));
            }
        }
        self.check_active(qp)
    }

    /// Rows that nearly repeat each other make R singular but for rounding, and the point then breaks rows that count as active.
    fn check_active(&self, qp: &ArrowQp<W>) -> Result<(), ArrowQpError> {
        let holds = |a: &Active<W>| {
            let row = &qp.rows[a.row];
            let bound = if a.side > 0.0 { row.lower } else { row.upper };
            self.slack(qp, a.row, a.side).abs() <= ACTIVE_TOLERANCE * (self.scale[a.row] + bound.abs())
        };
        match self.active.iter().find(|a| !holds(a)) {
            None => Ok(()),
            Some(broken) => Err(ArrowQpError::Inaccurate { row: broken.row }),
        }
    }

    /// Forgets which rows were active in the last solve.
    pub fn forget(&mut self) {
        self.active.clear();
    }

    /// Rows active at the solution, with +1 at the lower bound and −1 at the upper, and their multipliers (≥ 0).
    pub fn active(&self) -> impl Iterator<Item = (usize, f64, f64)> + '_ {
        self.active.iter().map(|a| (a.row, a.side, a.multiplier))
    }

    fn value(&self, row: &ArrowRow<W>) -> f64 {
        let own = if row.own.1 == 0.0 { 0.0 } else { row.own.1 * self.own[row.own.0] };
        row.offset + dot(&row.normal, &self.shared) + own
    }

    /// Distance from the bound on `side`, negative when broken.
    fn slack(&self, qp: &ArrowQp<W>, row: usize, side: f64) -> f64 {
        let row = &qp.rows[row];
        if side > 0.0 { self.value(row) - row.lower } else { row.upper - self.value(row) }
    }

    /// The most broken of the rows to try first or, when none of them is, of all.
    fn most_broken(&self, qp: &ArrowQp<W>) -> Option<(usize, f64)> {
        self.most_broken_of(qp, self.first.iter().copied()).or_else(|| self.most_broken_of(qp, 0..qp.rows.len()))
    }

    fn most_broken_of(&self, qp: &ArrowQp<W>, rows: impl Iterator<Item = usize>) -> Option<(usize, f64)> {
        let mut worst = None;
        let mut worst_amount = -TOLERANCE;
        for i in rows {
            let row = &qp.rows[i];
            let value = self.value(row);
            let (low, high) = (value - row.lower, row.upper - value);
            let (slack, side) = if low < high { (low, 1.0) } else { (high, -1.0) };
            if slack < worst_amount * self.scale[i] && !self.active.iter().any(|a| a.row == i && a.side == side) {
                (worst, worst_amount) = (Some((i, side)), slack / self.scale[i]);
            }
        }
        worst
    }

    /// The Hessian's factor, the other unknowns first: √d, then b / √d, then the shared block's.
    fn factorise(&mut self, qp: &ArrowQp<W>) -> Result<(), ArrowQpError> {
        let l = &mut self.factor;
        *l = qp.hessian;
        for own in &qp.own {
            // Written so that NaN is refused as well.
            if !(own.hessian > 0.0 && own.hessian.is_finite()) {
                return Err(ArrowQpError::NotConvex);
            }
            for (row, b) in l.iter_mut().zip(&own.coupling) {
                axpy(-b / own.hessian, &own.coupling, row);
            }
        }
        for c in 0..W {
            for row in c..W {
                let s: f64 = (0..c).map(|k| l[row][k] * l[c][k]).sum();
                l[row][c] -= s;
            }
            let pivot = l[c][c];
            if !(pivot > 1e-14 * qp.hessian[c][c].abs() && pivot > 0.0) {
                return Err(ArrowQpError::NotConvex);
            }
            let inverse = 1.0 / pivot.sqrt();
            l[c][c] = inverse;
            for row in &mut l[c + 1..] {
                row[c] *= inverse;
            }
        }
        Ok(())
    }

    /// L⁻¹ v.
    fn forward(&self, mut v: [f64; W]) -> [f64; W] {
        for i in 0..W {
            let known: f64 = (0..i).map(|k| self.factor[i][k] * v[k]).sum();
            v[i] = (v[i] - known) * self.factor[i][i];
        }
        v
    }

    /// L⁻ᵀ v.
    fn backward(&self, mut v: [f64; W]) -> [f64; W] {
        for i in (0..W).rev() {
            v[i] *= self.factor[i][i];
            let known = v[i];
            for k in 0..i {
                v[k] -= self.factor[i][k] * known;
            }
        }
        v
    }

    /// The unconstrained minimum.
    fn minimum(&mut self, qp: &ArrowQp<W>) {
        let mut right = qp.gradient.map(|g| -g);
        for own in &qp.own {
            axpy(own.gradient / own.hessian, &own.coupling, &mut right);
        }
        self.shared = self.backward(self.forward(right));
        self.own.clear();
        let shared = &self.shared;
        self.own.extend(qp.own.iter().map(|own| -(own.gradient + dot(&own.coupling, shared)) / own.hessian));
    }

    fn whiten(&self, qp: &ArrowQp<W>, row: usize, side: f64) -> Whitened<W> {
        let row = &qp.rows[row];
        let (place, entry) = row.own;
        let mut shared = row.normal;
        let mut own = 0.0;
        if entry != 0.0 {
            let unknown = &qp.own[place];
            axpy(-entry / unknown.hessian, &unknown.coupling, &mut shared);
            own = side * entry / unknown.hessian.sqrt();
        }
        Whitened { shared: self.forward(shared).map(|v| side * v), own: (place, own) }
    }

    /// What is left of a normal without its part along the active ones, and the square of its length. The part's
    /// coefficients are in `dual_step`, the other unknowns' entries of what is left in `z_own`.
    fn project(&mut self, normal: &Whitened<W>) -> ([f64; W], f64) {
        let mut z = normal.shared;
        self.z_own.clear();
        self.z_own.resize(self.own.len(), 0.0);
        if let Some(entry) = self.z_own.get_mut(normal.own.0) {
            *entry = normal.own.1;
        }
        self.dual_step.clear();
        self.dual_step.resize(self.active.len(), 0.0);
        // Twice: what rounding leaves along the active normals the first time, the second takes out.
        for _ in 0..2 {
            self.products.clear();
            for active in &self.active {
                let n = &active.normal;
                let own = if n.own.1 == 0.0 { 0.0 } else { n.own.1 * self.z_own[n.own.0] };
                self.products.push(dot(&n.shared, &z) + own);
            }
            solve_gram(&self.r, &mut self.products);
            for ((active, share), sum) in self.active.iter().zip(&self.products).zip(&mut self.dual_step) {
                *sum += share;
                axpy(-share, &active.normal.shared, &mut z);
                if active.normal.own.1 != 0.0 {
                    self.z_own[active.normal.own.0] -= share * active.normal.own.1;
                }
            }
        }
        (z, dot(&z, &z) + self.z_own.iter().map(|v| v * v).sum::<f64>())
    }

    /// Moves by `t` along the projected normal.
    fn walk(&mut self, qp: &ArrowQp<W>, t: f64, z: &[f64; W]) {
        let shared = self.backward(*z);
        axpy(t, &shared, &mut self.shared);
        for ((value, own), z) in self.own.iter_mut().zip(&qp.own).zip(&self.z_own) {
            *value += t * (z / own.hessian.sqrt() - dot(&own.coupling, &shared) / own.hessian);
        }
    }

    /// Makes the row active whose normal has just been projected; `length` is that of what was left.
    fn add(&mut self, active: Active<W>, length: f64) {
        // R's new column is R times the coefficients, then the length.
        let k = self.active.len();
        for row in 0..k {
            let entry: f64 = (row..k).map(|c| self.r[at(row, c)] * self.dual_step[c]).sum();
            self.r.push(entry);
        }
        self.r.push(length);
        self.active.push(active);
    }

    /// Takes active row `k` out and makes R triangular again.
    fn drop(&mut self, k: usize) {
        self.active.remove(k);
        let active = self.active.len();
        // Column c + 1 becomes column c, with one entry below the diagonal, which a rotation of rows c and c + 1 removes.
        for c in k..active {
            let mut column: Vec<f64> = (0..=c + 1).map(|row| self.r[at(row, c + 1)]).collect();
            // Rotations found so far apply to this column, too; they are redone from the left.
            for (row, (cosine, sine)) in (k..c).zip(self.products.chunks_exact(2).map(|p| (p[0], p[1]))) {
                let (a, b) = (column[row], column[row + 1]);
                (column[row], column[row + 1]) = (cosine * a + sine * b, cosine * b - sine * a);
            }
            if c == k {
                self.products.clear();
            }
            let (a, b) = (column[c], column[c + 1]);
            let norm = a.hypot(b);
            let (cosine, sine) = if norm == 0.0 { (1.0, 0.0) } else { (a / norm, b / norm) };
            self.products.extend([cosine, sine]);
            column[c] = norm;
            for (row, value) in column[..=c].iter().enumerate() {
                self.r[at(row, c)] = *value;
            }
        }
        self.r.truncate(active * (active + 1) / 2);
    }
}

/// Place of R's entry in row `row` ≤ `column`.
fn at(row: usize, column: usize) -> usize {
    column * (column + 1) / 2 + row
}

/// (RᵀR)⁻¹ v in place.
fn solve_gram(r: &[f64], v: &mut [f64]) {
    for c in 0..v.len() {
        let known: f64 = (0..c).map(|row| r[at(row, c)] * v[row]).sum();
        v[c] = (v[c] - known) / r[at(c, c)];
    }
    for c in (0..v.len()).rev() {
        v[c] /= r[at(c, c)];
        let known = v[c];
        for row in 0..c {
            v[row] -= r[at(row, c)] * known;
        }
    }
}

/// Four sums side by side: one alone waits for each addition before the next.
fn dot<const W: usize>(a: &[f64; W], b: &[f64; W]) -> f64 {
    let (a_fours, a_rest) = a.as_chunks::<4>();
    let (b_fours, b_rest) = b.as_chunks::<4>();
    let mut sums = [0.0; 4];
    for (a, b) in a_fours.iter().zip(b_fours) {
        for k in 0..4 {
            sums[k] += a[k] * b[k];
        }
    }
    let rest: f64 = a_rest.iter().zip(b_rest).map(|(a, b)| a * b).sum();
    (sums[0] + sums[1]) + (sums[2] + sums[3]) + rest
}

fn axpy<const W: usize>(scale: f64, x: &[f64; W], y: &mut [f64; W]) {
    for (y, x) in y.iter_mut().zip(x) {
        *y += scale * x;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use clarabel::algebra::CscMatrix;
    use clarabel::solver::{DefaultSettingsBuilder, DefaultSolver, IPSolver, NonnegativeConeT, SolverStatus};

    const W: usize = 6;

    fn noise(seed: u64) -> impl FnMut() -> f64 {
        let mut state = seed.wrapping_mul(2).wrapping_add(1);
        move || {
            state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            (state >> 11) as f64 / (1u64 << 52) as f64 - 1.0
        }
    }

    /// A convex arrow and random rows around 0 so that some are active and, at times, none can be satisfied.
    fn random(seed: u64, own: usize, rows: usize, width: f64) -> ArrowQp<W> {
        let mut r = noise(seed);
        let mut qp = ArrowQp::default();
        for _ in 0..own {
            let coupling = std::array::from_fn(|_| r());
            qp.own.push(Own { coupling, hessian: 0.2 + r().abs(), gradient: r() });
            // What the coupling takes from the shared block, so that the whole stays convex.
            let d = qp.own.last().unwrap().hessian;
            for i in 0..W {
                axpy(coupling[i] / d, &coupling, &mut qp.hessian[i]);
            }
        }
        let b: [[f64; W]; W] = std::array::from_fn(|_| std::array::from_fn(|_| r()));
        for i in 0..W {
            for k in 0..W {
                qp.hessian[i][k] += dot(&b[i], &b[k]) + if i == k { 0.01 } else { 0.0 };
            }
            qp.gradient[i] = r();
        }
        for i in 0..rows {
            let lower = r() * 0.5 - width;
            qp.rows.push(ArrowRow {
                normal: std::array::from_fn(|_| r()),
                own: if own > 0 && i % 3 > 0 { (i % own, r()) } else { (0, 0.0) },
                offset: 0.1 * r(),
                lower,
                upper: lower + width * (1.5 + r()),
            });
        }
        qp
    }

    /// All unknowns of a row's normal, the shared ones first.
    fn dense_normal(qp: &ArrowQp<W>, row: &ArrowRow<W>) -> Vec<f64> {
        let mut n = row.normal.to_vec();
        n.resize(W + qp.own.len(), 0.0);
        if row.own.1 != 0.0 {
            n[W + row.own.0] = row.own.1;
        }
        n
    }

    fn dense_hessian(qp: &ArrowQp<W>) -> Vec<Vec<f64>> {
        let n = W + qp.own.len();
        let mut h = vec![vec![0.0; n]; n];
        for i in 0..W {
            h[i][..W].copy_from_slice(&qp.hessian[i]);
        }
        for (p, own) in qp.own.iter().enumerate() {
            h[W + p][W + p] = own.hessian;
            for i in 0..W {
                (h[i][W + p], h[W + p][i]) = (own.coupling[i], own.coupling[i]);
            }
        }
        h
    }

    fn dense_gradient(qp: &ArrowQp<W>) -> Vec<f64> {
        qp.gradient.iter().copied().chain(qp.own.iter().map(|o| o.gradient)).collect()
    }

    /// The same program by Clarabel: `None` where it proves that there is no solution.
    fn by_clarabel(qp: &ArrowQp<W>) -> Option<Vec<f64>> {
        let m = qp.rows.len();
        let normals: Vec<Vec<f64>> = qp.rows.iter().map(|row| dense_normal(qp, row)).collect();
        let negative = normals.iter().map(|n| n.iter().map(|v| -v).collect());
        let a: Vec<Vec<f64>> = normals.iter().cloned().chain(negative).collect();
        let b: Vec<f64> =
            qp.rows.iter().map(|r| r.upper - r.offset).chain(qp.rows.iter().map(|r| r.offset - r.lower)).collect();
        let mut h = dense_hessian(qp);
        for (i, row) in h.iter_mut().enumerate() {
            row[..i].fill(0.0);
        }
        let settings = DefaultSettingsBuilder::default().verbose(false).build().unwrap();
        let mut solver = DefaultSolver::new(
            &CscMatrix::from(&h),
            &dense_gradient(qp),
            &CscMatrix::from(&a),
            &b,
            &[NonnegativeConeT(2 * m)],
            settings,
        )
        .unwrap();
        solver.solve();
        match solver.solution.status {
            SolverStatus::Solved => Some(solver.solution.x.clone()),
            SolverStatus::PrimalInfeasible => None,
            other => panic!("Clarabel: {other:?}"),
        }
    }

    fn objective(qp: &ArrowQp<W>, x: &[f64]) -> f64 {
        let product = |row: &Vec<f64>| row.iter().zip(x).map(|(h, x)| h * x).sum::<f64>();
        let curvature: f64 = dense_hessian(qp).iter().zip(x).map(|(row, x)| x * product(row)).sum();
        0.5 * curvature + product(&dense_gradient(qp))
    }

    fn solution(solver: &DualActiveSet<W>) -> Vec<f64> {
        solver.shared.iter().chain(&solver.own).copied().collect()
    }

    /// Programs of changing size, one solver for all: rows active before are tried first, whether or not they fit.
    #[test]
    fn random_programs_have_the_solution_that_clarabel_finds() {
        let mut solver = DualActiveSet::default();
        let (mut solved, mut infeasible) = (0, 0);
        for seed in 0..400 {
            let own = (seed as usize * 7) % 24;
            let qp = random(seed, own, 2 * W + own, if seed % 3 == 0 { 0.3 } else { 3.0 });
            match (solver.solve(&qp), by_clarabel(&qp)) {
                (Ok(()), Some(expected)) => {
                    solved += 1;
                    let x = solution(&solver);
                    for row in &qp.rows {
                        let value: f64 =
                            row.offset + dense_normal(&qp, row).iter().zip(&x).map(|(n, x)| n * x).sum::<f64>();
                        assert!(value > row.lower - 1e-8 && value < row.upper + 1e-8, "seed {seed}: {row:?}: {value}");
                    }
                    // Clarabel's own tolerance is 1e-8 in the objective; in a flat direction that is more in an unknown.
                    let (mine, theirs) = (objective(&qp, &x), objective(&qp, &expected));
                    assert!(
                        (mine - theirs).abs() < 1e-6 * (1.0 + theirs.abs()),
                        "seed {seed}: {mine} against {theirs}"
                    );
                }
                (Err(ArrowQpError::Infeasible { .. }), None) => infeasible += 1,
                (mine, other) => panic!("seed {seed}: {mine:?}, Clarabel finds a solution: {}", other.is_some()),
            }
        }
        assert!(solved > 50 && infeasible > 10, "{solved} solved, {infeasible} infeasible");
    }

    /// Rows that repeat each other but for rounding, between bounds that contradict each other or hardly do not.
    #[test]
    fn rows_that_nearly_repeat_each_other_never_end_in_an_optimum_that_breaks_them() {
        let mut solver = DualActiveSet::default();
        let (mut solved, mut refused) = (0, 0);
        for seed in 0..20000 {
            let own = seed as usize % 5;
            let mut qp = random(seed, own, 2 * W, [0.02, 0.3, 3.0][seed as usize % 3]);
            let apart = 10f64.powi(-8 - (seed % 6) as i32);
            let mut r = noise(seed + 7);
            // Nearly flat in one direction: there the rows' normals are long in the Hessian's metric.
            for i in 0..W {
                for k in 0..W {
                    qp.hessian[i][k] *= if i == 0 || k == 0 { 1e-5 } else { 1.0 };
                }
            }
            qp.hessian[0][0] += 1e-9;
            for own in &mut qp.own {
                own.coupling[0] *= 1e-5;
            }
            for row in qp.rows.clone().iter().cycle().take(4 * W) {
                let normal = row.normal.map(|n| n + apart * r());
                let offset = row.offset + [0.1 * apart, 100.0 * apart, 1e-3, 0.5][seed as usize % 4] * r();
                qp.rows.push(ArrowRow { normal, offset, ..*row });
            }
            if solver.solve(&qp).is_err() {
                refused += 1;
                continue;
            }
            solved += 1;
            assert!(solver.active().count() <= W + own, "seed {seed}: more active rows than unknowns");
            for (i, row) in qp.rows.iter().enumerate() {
                let value = solver.value(row);
                let allowed = 1e-6 * (1.0 + solver.scale[i]);
                assert!(
                    value > row.lower - allowed && value < row.upper + allowed,
                    "seed {seed}: row {i} is {value}, allowed {} to {}",
                    row.lower,
                    row.upper
                );
            }
        }
        assert!(solved > 100 && refused > 100, "{solved} solved, {refused} refused");
    }

    #[test]
    fn multipliers_balance_the_gradient() {
        let mut solver = DualActiveSet::default();
        let mut drops = 0;
        for seed in 0..100 {
            let qp = random(seed, 6, 30, 1.0);
            if solver.solve(&qp).is_err() {
                continue;
            }
            drops += (solver.iterations as usize).saturating_sub(solver.active().count());
            let x = solution(&solver);
            let mut residual = dense_gradient(&qp);
            for (r, row) in residual.iter_mut().zip(dense_hessian(&qp)) {
                *r += row.iter().zip(&x).map(|(h, x)| h * x).sum::<f64>();
            }
            for (row, side, multiplier) in solver.active() {
                assert!(multiplier >= 0.0);
                for (r, n) in residual.iter_mut().zip(dense_normal(&qp, &qp.rows[row])) {
                    *r -= side * multiplier * n;
                }
            }
            assert!(residual.iter().all(|r| r.abs() < 1e-9), "seed {seed}: {residual:?}");
        }
        assert!(drops > 20, "only {drops} rows left the active set: R's repair was hardly tried");
    }

    #[test]
    fn the_same_program_again_takes_only_its_active_rows() {
        let mut solver = DualActiveSet::default();
        let qp = random(4, 12, 40, 1.0);
        solver.solve(&qp).unwrap();
        let before = solution(&solver);
        solver.solve(&qp).unwrap();
        assert!(solver.iterations as usize <= 2 * solver.active().count());
        for (a, b) in solution(&solver).iter().zip(&before) {
            assert!((a - b).abs() < 1e-12 * (1.0 + b.abs()));
        }
    }

    #[test]
    fn a_hessian_with_a_flat_direction_is_refused() {
        let mut qp = random(1, 3, 2, 1.0);
        qp.hessian = [[0.0; W]; W];
        assert_eq!(DualActiveSet::default().solve(&qp), Err(ArrowQpError::NotConvex));
        let mut qp = random(1, 3, 2, 1.0);
        qp.own[1].hessian = f64::NAN;
        assert_eq!(DualActiveSet::default().solve(&qp), Err(ArrowQpError::NotConvex));
    }
}
