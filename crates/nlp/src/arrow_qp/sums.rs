//! Sums of products over vectors of a fixed length, and the packed triangular factor.

/// Place of R's entry in row `row` ≤ `column`.
#[inline(always)]
pub(super) fn at(row: usize, column: usize) -> usize {
    column * (column + 1) / 2 + row
}

/// (RᵀR)⁻¹ v in place.
#[inline(always)]
pub(super) fn solve_gram(r: &[f64], v: &mut [f64]) {
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
#[inline(always)]
pub(super) fn dot<const W: usize>(a: &[f64; W], b: &[f64; W]) -> f64 {
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

#[inline(always)]
pub(super) fn axpy<const W: usize>(scale: f64, x: &[f64; W], y: &mut [f64; W]) {
    for (y, x) in y.iter_mut().zip(x) {
        *y += scale * x;
    }
}
