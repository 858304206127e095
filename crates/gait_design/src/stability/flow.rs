//! The flow of δẅ = G(t) (δw, δẇ, δp), δṗ = 0 over a step by Lobatto IIIA of order 4, which is the program's own
//! Hermite–Simpson rule. It is implicit: a swing leg's damping is fast beside the step.

use super::generator::{PLACES, RATES, Row, add};
use super::{ROWS, STATE};
use decomposition::DynamicsError;

const WHAT: &str = "an integration step of the linearised motion";

/// w and ẇ as functions of what they and p were at the start.
pub(super) struct Flow {
    pub position: [Row; ROWS],
    pub rate: [Row; ROWS],
}

impl Flow {
    pub fn identity() -> Self {
        let unit = |at: usize| std::array::from_fn(|r| std::array::from_fn(|c| f64::from(c == at + r)));
        Self { position: unit(0), rate: unit(RATES) }
    }

    /// Over an interval of length `h` whose generators at its ends and middle are given, in `parts`.
    pub fn advance(&mut self, three: [&[Row; ROWS]; 3], h: f64, parts: usize) -> Result<(), DynamicsError> {
        let at = |s: f64| -> [Row; ROWS] {
            let weights = [(1.0 - s) * (1.0 - 2.0 * s), 4.0 * s * (1.0 - s), s * (2.0 * s - 1.0)];
            std::array::from_fn(|r| std::array::from_fn(|c| (0..3).map(|k| weights[k] * three[k][r][c]).sum()))
        };
        for part in 0..parts {
            let s = |share: f64| (part as f64 + share) / parts as f64;
            self.step(&at(s(0.0)), &at(s(0.5)), &at(s(1.0)), h / parts as f64)?;
        }
        Ok(())
    }

    /// G (w, ẇ, p) for these w and ẇ; p stays as at the start.
    fn accelerations(g: &[Row; ROWS], w: &[Row; ROWS], rate: Option<&[Row; ROWS]>) -> [Row; ROWS] {
        let mut sums = [[0.0; STATE]; ROWS];
        for r in 0..ROWS {
            let mut sum = [0.0; STATE];
            sum[PLACES..].copy_from_slice(&g[r][PLACES..]);
            for (k, row) in w.iter().enumerate() {
                add(&mut sum, g[r][k], row);
            }
            for (k, row) in rate.into_iter().flatten().enumerate() {
                add(&mut sum, g[r][RATES + k], row);
            }
            sums[r] = sum;
        }
        sums
    }

    /// One step. With x₁ = x₀ + h/2 (v₀ + v₁) + h²/12 (a₀ − a₁), the middle's
    ///
    /// > v_m = (v₀ + v₁)/2 + h/8 (a₀ − a₁),   x_m = x₀ + 3h/8 v₀ + h/8 v₁ + h²/24 (a₀ − a₁)
    ///
    /// and v₁ = v₀ + h/6 (a₀ + 4 a_m + a₁), a = G (x, v, p) is linear in v₁ and a₁.
    fn step(&mut self, g0: &[Row; ROWS], gm: &[Row; ROWS], g1: &[Row; ROWS], h: f64) -> Result<(), DynamicsError> {
        let a0 = Self::accelerations(g0, &self.position, Some(&self.rate));
        let known = |terms: [f64; 3]| -> [Row; ROWS] {
            let mut rows = self.position;
            for (i, row) in rows.iter_mut().enumerate() {
                row.iter_mut().for_each(|x| *x *= terms[0]);
                add(row, terms[1], &self.rate[i]);
                add(row, terms[2], &a0[i]);
            }
            rows
        };
        let (x1, xm) = (known([1.0, h / 2.0, h * h / 12.0]), known([1.0, 3.0 * h / 8.0, h * h / 24.0]));
        let of_x1 = Self::accelerations(g1, &x1, None);
        let of_middle = Self::accelerations(gm, &xm, Some(&known([0.0, 0.5, h / 8.0])));
        let mut matrix = [[0.0; 2 * ROWS]; 2 * ROWS];
        let mut right = [[0.0; STATE]; 2 * ROWS];
        for i in 0..ROWS {
            for k in 0..ROWS {
                let (one, third) = (f64::from(i == k), 2.0 * h / 3.0);
                let (by_x, by_v) = (gm[i][k], gm[i][RATES + k]);
                matrix[i][k] = one - third * (by_x * h / 8.0 + by_v / 2.0);
                matrix[i][ROWS + k] = third * (by_x * h * h / 24.0 + by_v * h / 8.0) - one * h / 6.0;
                matrix[ROWS + i][k] = -(g1[i][k] * h / 2.0 + g1[i][RATES + k]);
                matrix[ROWS + i][ROWS + k] = one + g1[i][k] * h * h / 12.0;
            }
            right[i] = self.rate[i];
            add(&mut right[i], h / 6.0, &a0[i]);
            add(&mut right[i], 2.0 * h / 3.0, &of_middle[i]);
            right[ROWS + i] = of_x1[i];
        }
        let size = 2 * ROWS;
        solve(&mut matrix, &mut right).map_err(|rank| DynamicsError::Singular { what: WHAT, rank, size })?;
        for i in 0..ROWS {
            let (v1, a1) = (right[i], right[ROWS + i]);
            self.position[i] = x1[i];
            add(&mut self.position[i], h / 2.0, &v1);
            add(&mut self.position[i], -h * h / 12.0, &a1);
            self.rate[i] = v1;
        }
        Ok(())
    }
}

/// Gauss' elimination with row exchanges, in place. The column at which no pivot is left, if there is one.
fn solve(matrix: &mut [[f64; 2 * ROWS]; 2 * ROWS], right: &mut [Row; 2 * ROWS]) -> Result<(), usize> {
    for c in 0..2 * ROWS {
        let largest = |a: &usize, b: &usize| matrix[*a][c].abs().total_cmp(&matrix[*b][c].abs());
        let pivot = (c..2 * ROWS).max_by(largest).unwrap_or(c);
        if !matrix[pivot][c].is_normal() {
            return Err(c);
        }
        matrix.swap(c, pivot);
        right.swap(c, pivot);
        let (row, known, inverse) = (matrix[c], right[c], 1.0 / matrix[c][c]);
        for r in c + 1..2 * ROWS {
            let factor = matrix[r][c] * inverse;
            if factor != 0.0 {
                for (to, from) in matrix[r].iter_mut().zip(&row) {
                    *to -= factor * from;
                }
                add(&mut right[r], -factor, &known);
            }
        }
    }
    for c in (0..2 * ROWS).rev() {
        let inverse = 1.0 / matrix[c][c];
        right[c].iter_mut().for_each(|v| *v *= inverse);
        let known = right[c];
        for r in 0..c {
            add(&mut right[r], -matrix[r][c], &known);
        }
    }
    Ok(())
}
