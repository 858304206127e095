//! Small dense strictly convex quadratic programs with many two-sided rows, by the dual active-set method of Goldfarb &
//! Idnani (Math. Prog. 27, 1983): it starts at the unconstrained minimum and adds the most broken row until none is broken,
//! so its work grows with the rows that end up active, not with the rows there are.

/// min ½ xᵀ H x + gᵀ x subject to lower ≤ offset + Rᵀ x ≤ upper.
#[derive(Clone, Debug, Default)]
pub struct DenseQp {
    /// Unknowns.
    pub variables: usize,
    /// H, variables × variables, symmetric, one row after the other.
    pub hessian: Vec<f64>,
    /// g.
    pub gradient: Vec<f64>,
    /// R's columns one after the other: the normal of each row, `variables` long.
    pub normals: Vec<f64>,
    /// Each row's value at x = 0.
    pub offset: Vec<f64>,
    /// Each row's lower bound; may be −∞.
    pub lower: Vec<f64>,
    /// Each row's upper bound; may be ∞.
    pub upper: Vec<f64>,
}

/// Why there is no solution.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum DenseQpError {
    /// H is not positive definite.
    #[error("its Hessian is not positive definite")]
    NotConvex,
    /// No x satisfies every row.
    #[error("row {row} cannot be satisfied together with the rows before it")]
    Infeasible {
        /// The row that found no place.
        row: usize,
    },
    /// Rounding kept it from ending.
    #[error("it does not end")]
    IterationLimit,
}

/// The solver and its memory.
#[derive(Clone, Debug, Default)]
pub struct DualActiveSet {
    /// The solution.
    pub x: Vec<f64>,
    /// Changes of the active set that the last solve took.
    pub iterations: u32,
    /// J = L⁻ᵀ Q, one column after the other; the first `active.len()` span the active normals.
    j: Vec<f64>,
    /// Upper triangular R, one column after the other, `variables` apart.
    r: Vec<f64>,
    factor: Vec<f64>,
    /// Active rows: which row, and +1 at its lower bound, −1 at its upper.
    active: Vec<(usize, f64)>,
    multipliers: Vec<f64>,
    d: Vec<f64>,
    z: Vec<f64>,
    dual_step: Vec<f64>,
    values: Vec<f64>,
    scale: Vec<f64>,
}

/// A row counts as broken when it is by more than this, relative to its normal's length.
const TOLERANCE: f64 = 1e-10;

impl DualActiveSet {
    /// Solves; the solution is in `x`, which rows are active in [`Self::active`].
    pub fn solve(&mut self, qp: &DenseQp) -> Result<(), DenseQpError> {
        let n = qp.variables;
        let m = qp.offset.len();
        self.factorise(qp)?;
        self.active.clear();
        self.multipliers.clear();
        self.iterations = 0;
        for buffer in [&mut self.d, &mut self.z, &mut self.dual_step] {
            buffer.clear();
            buffer.resize(n, 0.0);
        }
        self.r.clear();
        self.r.resize(n * n, 0.0);
        // x = −H⁻¹ g = −J Jᵀ g while J = L⁻ᵀ.
        self.x.clear();
        self.x.resize(n, 0.0);
        for k in 0..n {
            let column = &self.j[k * n..(k + 1) * n];
            let along = -dot(column, &qp.gradient);
            axpy(along, column, &mut self.x);
        }
        self.values.clear();
        self.scale.clear();
        for i in 0..m {
            let normal = &qp.normals[i * n..(i + 1) * n];
            self.values.push(qp.offset[i] + dot(normal, &self.x));
            self.scale.push(dot(normal, normal).sqrt().max(1e-12));
        }

        let limit = 50 * (n as u32 + 10);
        'rows: while let Some((row, side)) = self.most_broken(qp) {
            let mut multiplier = 0.0;
            loop {
                self.iterations += 1;
                if self.iterations > limit {
                    return Err(DenseQpError::IterationLimit);
                }
                let normal = &qp.normals[row * n..(row + 1) * n];
                let active = self.active.len();
                for k in 0..n {
                    self.d[k] = side * dot(&self.j[k * n..(k + 1) * n], normal);
                }
                self.z.fill(0.0);
                for k in active..n {
                    axpy(self.d[k], &self.j[k * n..(k + 1) * n], &mut self.z);
                }
                for k in (0..active).rev() {
                    let mut sum = self.d[k];
                    for l in k + 1..active {
                        sum -= self.r[l * n + k] * self.dual_step[l];
                    }
                    self.dual_step[k] = sum / self.r[k * n + k];
                }
                // The longest step that keeps every multiplier nonnegative, and the row that stops it.
                let mut blocking = None;
                let mut length = f64::INFINITY;
                for k in 0..active {
                    if self.dual_step[k] > 0.0 {
                        let t = self.multipliers[k] / self.dual_step[k];
                        if t < length {
                            (length, blocking) = (t, Some(k));
                        }
                    }
                }
                let gained: f64 = self.d[active..].iter().map(|d| d * d).sum();
                // No progress where the normal is a combination of the active ones, up to rounding.
                let reachable = gained > 1e-20 * dot(&self.d, &self.d);
                let broken = self.slack(qp, row, side);
                let full = if reachable { -broken / gained } else { f64::INFINITY };
                if !length.is_finite() && !full.is_finite() {
                    return Err(DenseQpError::Infeasible { row });
                }
                let t = length.min(full);
                for k in 0..active {
                    self.multipliers[k] -= t * self.dual_step[k];
                }
                multiplier += t;
                if full.is_finite() {
                    axpy(t, &self.z, &mut self.x);
                    for (i, value) in self.values.iter_mut().enumerate() {
                        *value += t * dot(&qp.normals[i * n..(i + 1) * n], &self.z);
                    }
                }
                if full <= length {
                    self.add(n, row, side, multiplier);
                    continue 'rows;
                }
                self.drop(n, blocking.expect("a finite length has a row that stops it"));
            }
        }
        Ok(())
    }

    /// Rows active at the solution, with +1 at the lower bound and −1 at the upper, and their multipliers (≥ 0).
    pub fn active(&self) -> impl Iterator<Item = (usize, f64, f64)> + '_ {
        self.active.iter().zip(&self.multipliers).map(|(&(row, side), &u)| (row, side, u))
    }

    /// Distance from the bound on `side`, negative when broken.
    fn slack(&self, qp: &DenseQp, row: usize, side: f64) -> f64 {
        if side > 0.0 { self.values[row] - qp.lower[row] } else { qp.upper[row] - self.values[row] }
    }

    fn most_broken(&self, qp: &DenseQp) -> Option<(usize, f64)> {
        let mut worst = None;
        let mut worst_amount = -TOLERANCE;
        for (i, (value, scale)) in self.values.iter().zip(&self.scale).enumerate() {
            let (low, high) = (value - qp.lower[i], qp.upper[i] - value);
            let (amount, side) = if low < high { (low / scale, 1.0) } else { (high / scale, -1.0) };
            if amount < worst_amount && !self.active.contains(&(i, side)) {
                (worst, worst_amount) = (Some((i, side)), amount);
            }
        }
        worst
    }

    /// H = L Lᵀ and J = L⁻ᵀ.
    fn factorise(&mut self, qp: &DenseQp) -> Result<(), DenseQpError> {
        let n = qp.variables;
        let l = &mut self.factor;
        l.clear();
        l.extend_from_slice(&qp.hessian);
        for c in 0..n {
            let mut pivot = l[c * n + c];
            for k in 0..c {
                pivot -= l[c * n + k] * l[c * n + k];
            }
            // Written so that NaN is refused as well.
            if !(pivot > 1e-14 * qp.hessian[c * n + c].abs() && pivot > 0.0) {
                return Err(DenseQpError::NotConvex);
            }
            let pivot = pivot.sqrt();
            l[c * n + c] = pivot;
            for row in c + 1..n {
                let (above, below) = l.split_at(row * n);
                let s = dot(&above[c * n..c * n + c], &below[..c]);
                l[row * n + c] = (l[row * n + c] - s) / pivot;
            }
        }
        // Column k of J = L⁻ᵀ is row k of L⁻¹.
        self.j.clear();
        self.j.resize(n * n, 0.0);
        for k in 0..n {
            // Row k of L⁻¹ from the rows above it: (e_k − Σ_{i<k} L_ki row_i) / L_kk.
            let (done, rest) = self.j.split_at_mut(k * n);
            let row = &mut rest[..n];
            row[k] = 1.0;
            for i in 0..k {
                axpy(-l[k * n + i], &done[i * n..i * n + n], row);
            }
            let scale = 1.0 / l[k * n + k];
            row.iter_mut().for_each(|v| *v *= scale);
        }
        Ok(())
    }

    /// Makes the row with d = Jᵀ n active: rotations that bring d₂ onto its first entry.
    fn add(&mut self, n: usize, row: usize, side: f64, multiplier: f64) {
        let active = self.active.len();
        for k in (active + 1..n).rev() {
            let (c, s, norm) = rotation(self.d[k - 1], self.d[k]);
            self.d[k - 1] = norm;
            self.d[k] = 0.0;
            rotate(&mut self.j, n, k - 1, k, c, s);
        }
        self.r[active * n..active * n + active + 1].copy_from_slice(&self.d[..=active]);
        self.active.push((row, side));
        self.multipliers.push(multiplier);
    }

    /// Takes active row `k` out and makes R triangular again.
    fn drop(&mut self, n: usize, k: usize) {
        self.active.remove(k);
        self.multipliers.remove(k);
        let active = self.active.len();
        for column in k..active {
            let (left, right) = self.r.split_at_mut((column + 1) * n);
            left[column * n..column * n + column + 2].copy_from_slice(&right[..column + 2]);
        }
        for column in k..active {
            let (c, s, norm) = rotation(self.r[column * n + column], self.r[column * n + column + 1]);
            self.r[column * n + column] = norm;
            self.r[column * n + column + 1] = 0.0;
            for other in column + 1..active {
                let (a, b) = (self.r[other * n + column], self.r[other * n + column + 1]);
                self.r[other * n + column] = c * a + s * b;
                self.r[other * n + column + 1] = c * b - s * a;
            }
            rotate(&mut self.j, n, column, column + 1, c, s);
        }
    }
}

/// (c, s, norm) with c a + s b = norm and c b − s a = 0.
fn rotation(a: f64, b: f64) -> (f64, f64, f64) {
    let norm = a.hypot(b);
    if norm == 0.0 { (1.0, 0.0, 0.0) } else { (a / norm, b / norm, norm) }
}

fn rotate(j: &mut [f64], n: usize, first: usize, second: usize, c: f64, s: f64) {
    let (left, right) = j.split_at_mut(second * n);
    for (a, b) in left[first * n..(first + 1) * n].iter_mut().zip(&mut right[..n]) {
        (*a, *b) = (c * *a + s * *b, c * *b - s * *a);
    }
}

/// Four sums side by side: one alone waits for each addition before the next.
fn dot(a: &[f64], b: &[f64]) -> f64 {
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

fn axpy(scale: f64, x: &[f64], y: &mut [f64]) {
    for (y, x) in y.iter_mut().zip(x) {
        *y += scale * x;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use clarabel::algebra::CscMatrix;
    use clarabel::solver::{DefaultSettingsBuilder, DefaultSolver, IPSolver, NonnegativeConeT, SolverStatus};

    fn noise(seed: u64) -> impl FnMut() -> f64 {
        let mut state = seed.wrapping_mul(2).wrapping_add(1);
        move || {
            state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            (state >> 11) as f64 / (1u64 << 52) as f64 - 1.0
        }
    }

    /// H = B Bᵀ + 0.01 I, random rows around 0 so that some are active and, at times, none can be satisfied.
    fn random(seed: u64, n: usize, m: usize, width: f64) -> DenseQp {
        let mut r = noise(seed);
        let b: Vec<f64> = (0..n * n).map(|_| r()).collect();
        let mut hessian = vec![0.0; n * n];
        for i in 0..n {
            for k in 0..n {
                hessian[i * n + k] =
                    dot(&b[i * n..(i + 1) * n], &b[k * n..(k + 1) * n]) + if i == k { 0.01 } else { 0.0 };
            }
        }
        let lower: Vec<f64> = (0..m).map(|_| r() * 0.5 - width).collect();
        let upper = lower.iter().map(|l| l + width * (1.5 + r())).collect();
        DenseQp {
            variables: n,
            hessian,
            gradient: (0..n).map(|_| r()).collect(),
            normals: (0..n * m).map(|_| r()).collect(),
            offset: (0..m).map(|_| 0.1 * r()).collect(),
            lower,
            upper,
        }
    }

    /// The same program by Clarabel: `None` where it proves that there is no solution.
    fn by_clarabel(qp: &DenseQp) -> Option<Vec<f64>> {
        let (n, m) = (qp.variables, qp.offset.len());
        let rows =
            |sign: f64, i: usize| -> Vec<f64> { qp.normals[i * n..(i + 1) * n].iter().map(|v| sign * v).collect() };
        let a: Vec<Vec<f64>> = (0..m).map(|i| rows(1.0, i)).chain((0..m).map(|i| rows(-1.0, i))).collect();
        let b: Vec<f64> =
            (0..m).map(|i| qp.upper[i] - qp.offset[i]).chain((0..m).map(|i| qp.offset[i] - qp.lower[i])).collect();
        let h: Vec<Vec<f64>> =
            (0..n).map(|i| (0..n).map(|k| if k >= i { qp.hessian[i * n + k] } else { 0.0 }).collect()).collect();
        let settings = DefaultSettingsBuilder::default().verbose(false).build().unwrap();
        let mut solver = DefaultSolver::new(
            &CscMatrix::from(&h),
            &qp.gradient,
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

    #[test]
    fn random_programs_have_the_solution_that_clarabel_finds() {
        let mut solver = DualActiveSet::default();
        let (mut solved, mut infeasible) = (0, 0);
        for seed in 0..300 {
            let n = 2 + (seed as usize * 7) % 24;
            let qp = random(seed, n, 3 * n, if seed % 3 == 0 { 0.2 } else { 1.0 });
            match (solver.solve(&qp), by_clarabel(&qp)) {
                (Ok(()), Some(expected)) => {
                    solved += 1;
                    for (a, b) in solver.x.iter().zip(&expected) {
                        assert!((a - b).abs() < 1e-5 * (1.0 + b.abs()), "seed {seed}: {a} against {b}");
                    }
                }
                (Err(DenseQpError::Infeasible { .. }), None) => infeasible += 1,
                (mine, other) => panic!("seed {seed}: {mine:?}, Clarabel finds a solution: {}", other.is_some()),
            }
        }
        assert!(solved > 50 && infeasible > 10, "{solved} solved, {infeasible} infeasible");
    }

    #[test]
    fn multipliers_balance_the_gradient() {
        let mut solver = DualActiveSet::default();
        let qp = random(4, 12, 30, 1.0);
        solver.solve(&qp).unwrap();
        let n = qp.variables;
        let mut residual: Vec<f64> =
            (0..n).map(|i| qp.gradient[i] + dot(&qp.hessian[i * n..(i + 1) * n], &solver.x)).collect();
        for (row, side, multiplier) in solver.active() {
            assert!(multiplier >= 0.0);
            axpy(-side * multiplier, &qp.normals[row * n..(row + 1) * n], &mut residual);
        }
        assert!(residual.iter().all(|r| r.abs() < 1e-9), "{residual:?}");
    }

    #[test]
    fn a_hessian_with_a_flat_direction_is_refused() {
        let mut qp = random(1, 3, 2, 1.0);
        qp.hessian = vec![1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0];
        assert_eq!(DualActiveSet::default().solve(&qp), Err(DenseQpError::NotConvex));
        qp.hessian[4] = f64::NAN;
        assert_eq!(DualActiveSet::default().solve(&qp), Err(DenseQpError::NotConvex));
    }
}
