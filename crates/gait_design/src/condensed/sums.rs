//! Sums of rows of coefficients, whole vector registers at a time.

use super::{FREE_MAX, Reduced, WIDTH};

#[inline(always)]
pub(super) fn add<const N: usize>(to: &mut [f64; N], scale: f64, from: &[f64; N]) {
    for (t, f) in to.iter_mut().zip(from) {
        *t += scale * f;
    }
}

#[inline(always)]
pub(super) fn scaled<const N: usize>(row: &[f64; N], scale: f64) -> [f64; N] {
    row.map(|v| scale * v)
}

/// Four sums side by side: one alone waits for each addition before the next.
#[inline(always)]
pub(super) fn dot(a: &Reduced, b: &Reduced) -> f64 {
    let mut sums = [0.0; 4];
    for (a, b) in a.as_chunks::<4>().0.iter().zip(b.as_chunks::<4>().0) {
        for k in 0..4 {
            sums[k] += a[k] * b[k];
        }
    }
    (sums[0] + sums[1]) + (sums[2] + sums[3])
}

/// Adds Σ w t tᵀ to rows FIRST to FIRST + 3, from column FIRST on: with whole vector registers, what of a symmetric
/// matrix is on and above the diagonal.
#[inline(always)]
pub(super) fn add_squares<const FIRST: usize>(to: &mut [[f64; WIDTH]; WIDTH], terms: &[(f64, Reduced)]) {
    for a in FIRST..FREE_MAX.min(FIRST + 4) {
        let mut row = to[a];
        for (weight, term) in terms {
            let scale = weight * term[a];
            for k in FIRST..WIDTH {
                row[k] += scale * term[k];
            }
        }
        to[a] = row;
    }
}
