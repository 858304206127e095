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
    /// ẅ where the flow has come to, as the last step's end has it; none at the start.
    acceleration: Option<[Row; ROWS]>,
}

/// The generator at share `s` of an interval, by the parabola through its ends and middle.
#[inline(always)]
fn within(three: [&[Row; ROWS]; 3], s: f64) -> [Row; ROWS] {
    let mut rows = [[0.0; STATE]; ROWS];
    let weights = [(1.0 - s) * (1.0 - 2.0 * s), 4.0 * s * (1.0 - s), s * (2.0 * s - 1.0)];
    for (r, row) in rows.iter_mut().enumerate() {
        for (weight, of) in weights.iter().zip(three) {
            add(row, *weight, &of[r]);
        }
    }
    rows
}

/// terms · (x, v, a).
#[inline(always)]
fn combined(terms: [f64; 3], x: &[Row; ROWS], v: &[Row; ROWS], a: &[Row; ROWS]) -> [Row; ROWS] {
    let mut rows = [[0.0; STATE]; ROWS];
    for (i, row) in rows.iter_mut().enumerate() {
        add(row, terms[0], &x[i]);
        add(row, terms[1], &v[i]);
        add(row, terms[2], &a[i]);
    }
    rows
}

/// G (w, ẇ, p) for these w and ẇ; p stays as at the start.
#[inline(always)]
fn accelerations(g: &[Row; ROWS], w: &[Row; ROWS], rate: Option<&[Row; ROWS]>) -> [Row; ROWS] {
    let mut sums = [[0.0; STATE]; ROWS];
    for (row, sum) in g.iter().zip(&mut sums) {
        sum[PLACES..].copy_from_slice(&row[PLACES..]);
        for k in 0..ROWS {
            add(sum, row[k], &w[k]);
        }
        if let Some(rate) = rate {
            for k in 0..ROWS {
                add(sum, row[RATES + k], &rate[k]);
            }
        }
    }
    sums
}

impl Flow {
    pub fn identity() -> Self {
        let unit = |at: usize| std::array::from_fn(|r| std::array::from_fn(|c| f64::from(c == at + r)));
        Self { position: unit(0), rate: unit(RATES), acceleration: None }
    }

    /// Over an interval of length `h` whose generators at its ends and middle are given, in `parts`.
    #[inline(always)]
    pub fn advance(&mut self, three: [&[Row; ROWS]; 3], h: f64, parts: usize) -> Result<(), DynamicsError> {
        let mut start = *three[0];
        for part in 0..parts {
            let share = |of_part: f64| (part as f64 + of_part) / parts as f64;
            let end = within(three, share(1.0));
            self.step(&start, &within(three, share(0.5)), &end, h / parts as f64)?;
            start = end;
        }
        Ok(())
    }

    /// One step. With x₁ = x₀ + h/2 (v₀ + v₁) + h²/12 (a₀ − a₁), the middle's
    ///
    /// > v_m = (v₀ + v₁)/2 + h/8 (a₀ − a₁),   x_m = x₀ + 3h/8 v₀ + h/8 v₁ + h²/24 (a₀ − a₁)
    ///
    /// and v₁ = v₀ + h/6 (a₀ + 4 a_m + a₁), a = G (x, v, p) is linear in v₁ and a₁.
    #[inline(always)]
    fn step(&mut self, g0: &[Row; ROWS], gm: &[Row; ROWS], g1: &[Row; ROWS], h: f64) -> Result<(), DynamicsError> {
        let Self { position, rate, acceleration } = self;
        let a0 = match acceleration {
            Some(a0) => *a0,
            None => accelerations(g0, position, Some(rate)),
        };
        let x1 = combined([1.0, h / 2.0, h * h / 12.0], position, rate, &a0);
        let xm = combined([1.0, 3.0 * h / 8.0, h * h / 24.0], position, rate, &a0);
        let vm = combined([0.0, 0.5, h / 8.0], position, rate, &a0);
        let of_x1 = accelerations(g1, &x1, None);
        let of_middle = accelerations(gm, &xm, Some(&vm));
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
            right[i] = rate[i];
            add(&mut right[i], h / 6.0, &a0[i]);
            add(&mut right[i], 2.0 * h / 3.0, &of_middle[i]);
            right[ROWS + i] = of_x1[i];
        }
        let size = 2 * ROWS;
        solve(&mut matrix, &mut right).map_err(|rank| DynamicsError::Singular { what: WHAT, rank, size })?;
        let mut a1 = a0;
        for i in 0..ROWS {
            (rate[i], a1[i]) = (right[i], right[ROWS + i]);
            position[i] = x1[i];
            add(&mut position[i], h / 2.0, &rate[i]);
            add(&mut position[i], -h * h / 12.0, &a1[i]);
        }
        *acceleration = Some(a1);
        Ok(())
    }
}

/// Gauss' elimination with row exchanges, in place. The column at which no pivot is left, if there is one.
#[inline(always)]
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
        // Whole vector registers: what they touch on the left is not looked at again.
        let first = c & !3;
        for r in c + 1..2 * ROWS {
            let factor = matrix[r][c] * inverse;
            if factor != 0.0 {
                for (to, from) in matrix[r][first..].iter_mut().zip(&row[first..]) {
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
