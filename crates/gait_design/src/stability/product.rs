//! The product of two dense matrices, summed in one order.

use nalgebra::DMatrix;

/// A B, each entry summed from the first column of A to the last. nalgebra's own product of matrices this large takes
/// fused multiplications where the processor has them, and so its last bits are the processor's.
pub(super) fn product(a: &DMatrix<f64>, b: &DMatrix<f64>) -> DMatrix<f64> {
    #[cfg(target_arch = "x86_64")]
    if std::arch::is_x86_feature_detected!("avx2") {
        // SAFETY: this processor has the instructions that the function is compiled for.
        return unsafe { product_with_avx2(a, b) };
    }
    product_as_compiled(a, b)
}

/// [`product_as_compiled`] for processors with registers twice as wide: the same sums to the bit, for none is fused.
#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
fn product_with_avx2(a: &DMatrix<f64>, b: &DMatrix<f64>) -> DMatrix<f64> {
    product_as_compiled(a, b)
}

#[inline(always)]
fn product_as_compiled(a: &DMatrix<f64>, b: &DMatrix<f64>) -> DMatrix<f64> {
    assert_eq!(a.ncols(), b.nrows(), "columns of the first and rows of the second");
    let rows = a.nrows();
    let mut product = DMatrix::zeros(rows, b.ncols());
    let columns = product.as_mut_slice().chunks_exact_mut(rows).zip(b.as_slice().chunks_exact(b.nrows()));
    for (to, shares) in columns {
        for (from, &share) in a.as_slice().chunks_exact(rows).zip(shares) {
            // Mirrors, turns and changes of coordinates are mostly zeros.
            if share != 0.0 {
                for (to, from) in to.iter_mut().zip(from) {
                    *to += share * from;
                }
            }
        }
    }
    product
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Entries whose products round, where a fused multiplication gives another sum.
    #[test]
    fn sums_are_rounded_after_every_multiplication_and_addition() {
        let entry = |r: usize, c: usize| 1.0 / (3 * r + 7 * c + 1) as f64 - 0.1;
        let (a, b) = (DMatrix::from_fn(9, 7, entry), DMatrix::from_fn(7, 8, |r, c| entry(c, r)));
        let [found, narrow] = [product(&a, &b), product_as_compiled(&a, &b)];
        assert_eq!(found, narrow);
        let mut differ = 0;
        for r in 0..9 {
            for c in 0..8 {
                let (mut sum, mut fused) = (0.0_f64, 0.0_f64);
                for k in 0..7 {
                    sum += a[(r, k)] * b[(k, c)];
                    fused = a[(r, k)].mul_add(b[(k, c)], fused);
                }
                assert_eq!(found[(r, c)].to_bits(), sum.to_bits(), "{r}, {c}");
                differ += usize::from(fused != sum);
            }
        }
        assert!(differ > 10, "only {differ} entries would tell a fused multiplication");
    }
}
