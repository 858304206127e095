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
//!
//! Everything is inlined, so that a caller compiled for wider registers has the solve compiled for them, too.

mod sums;
use sums::{at, axpy, dot, solve_gram};

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
    #[inline(always)]
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
    /// Shared unknowns that some row holds: the others may be there only to fill the width.
    shared_held: usize,
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
            shared_held: 0,
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
    #[inline(always)]
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
        self.shared_held = (0..W).filter(|&k| qp.rows.iter().any(|row| row.normal[k] != 0.0)).count();
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
                // As many active rows as unknowns that they hold leave no direction; what seems to be left of the
                // normal then is rounding.
                let complete = self.active.len() >= self.unknowns_held(qp, &normal);
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

    /// How many unknowns the active rows and one more hold between them: the most of them that can be independent.
    #[inline(always)]
    fn unknowns_held(&self, qp: &ArrowQp<W>, more: &Whitened<W>) -> usize {
        if self.active.len() < self.shared_held {
            return W + qp.own.len();
        }
        let own = |k: usize| if k < self.active.len() { self.active[k].normal.own } else { more.own };
        let is_new =
            |&k: &usize| own(k).1 != 0.0 && (0..k).all(|before| own(before).1 == 0.0 || own(before).0 != own(k).0);
        self.shared_held + (0..=self.active.len()).filter(is_new).count()
    }

    /// Rows that nearly repeat each other make R singular but for rounding, and the point then breaks rows that count as active.
    #[inline(always)]
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

    #[inline(always)]
    fn value(&self, row: &ArrowRow<W>) -> f64 {
        let own = if row.own.1 == 0.0 { 0.0 } else { row.own.1 * self.own[row.own.0] };
        row.offset + dot(&row.normal, &self.shared) + own
    }

    /// Distance from the bound on `side`, negative when broken.
    #[inline(always)]
    fn slack(&self, qp: &ArrowQp<W>, row: usize, side: f64) -> f64 {
        let row = &qp.rows[row];
        if side > 0.0 { self.value(row) - row.lower } else { row.upper - self.value(row) }
    }

    /// The most broken of the rows to try first or, when none of them is, of all.
    #[inline(always)]
    fn most_broken(&self, qp: &ArrowQp<W>) -> Option<(usize, f64)> {
        // No `or_else`: a closure is compiled by itself, and not for wider registers.
        match self.most_broken_of(qp, self.first.iter().copied()) {
            None => self.most_broken_of(qp, 0..qp.rows.len()),
            broken => broken,
        }
    }

    #[inline(always)]
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
    #[inline(always)]
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
    #[inline(always)]
    fn forward(&self, mut v: [f64; W]) -> [f64; W] {
        for i in 0..W {
            let known: f64 = (0..i).map(|k| self.factor[i][k] * v[k]).sum();
            v[i] = (v[i] - known) * self.factor[i][i];
        }
        v
    }

    /// L⁻ᵀ v.
    #[inline(always)]
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
    #[inline(always)]
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

    #[inline(always)]
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
    #[inline(always)]
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
    #[inline(always)]
    fn walk(&mut self, qp: &ArrowQp<W>, t: f64, z: &[f64; W]) {
        let shared = self.backward(*z);
        axpy(t, &shared, &mut self.shared);
        for ((value, own), z) in self.own.iter_mut().zip(&qp.own).zip(&self.z_own) {
            *value += t * (z / own.hessian.sqrt() - dot(&own.coupling, &shared) / own.hessian);
        }
    }

    /// Makes the row active whose normal has just been projected; `length` is that of what was left.
    #[inline(always)]
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
    #[inline(always)]
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

#[cfg(test)]
mod tests;
