//! Bézier polynomials of degree 5 in the step phase s = t / T ∈ [0, 1] (Ma & Ames 2020, II-C: B(t), α ∈ R⁶ an output).

/// Degree of every output's polynomial.
pub const DEGREE: usize = 5;
/// Coefficients of one output.
pub type Coefficients = [f64; DEGREE + 1];

/// The six Bernstein polynomials at `s`: B(s) = Σ α_i basis(s)_i.
pub fn basis(s: f64) -> Coefficients {
    let r = 1.0 - s;
    let (s2, r2) = (s * s, r * r);
    let (s3, r3) = (s2 * s, r2 * r);
    [r2 * r3, 5.0 * s * r2 * r2, 10.0 * s2 * r3, 10.0 * s3 * r2, 5.0 * s2 * s2 * r, s2 * s3]
}

/// dB/ds = Σ α_i basis_first_derivative(s)_i. Divide by T for the time derivative.
pub fn basis_first_derivative(s: f64) -> Coefficients {
    let r = 1.0 - s;
    let (s2, r2) = (s * s, r * r);
    // Bernstein polynomials of degree 4; the derivative's coefficients are 5 (α_{i+1} − α_i).
    let b = [r2 * r2, 4.0 * s * r2 * r, 6.0 * s2 * r2, 4.0 * s2 * s * r, s2 * s2];
    let mut d = [0.0; DEGREE + 1];
    for (i, b) in b.into_iter().enumerate() {
        d[i] -= 5.0 * b;
        d[i + 1] += 5.0 * b;
    }
    d
}

/// d²B/ds² = Σ α_i basis_second_derivative(s)_i. Divide by T² for the time derivative.
pub fn basis_second_derivative(s: f64) -> Coefficients {
    let r = 1.0 - s;
    // Degree 3; the coefficients are 20 (α_{i+2} − 2 α_{i+1} + α_i).
    let b = [r * r * r, 3.0 * s * r * r, 3.0 * s * s * r, s * s * s];
    let mut d = [0.0; DEGREE + 1];
    for (i, b) in b.into_iter().enumerate() {
        d[i] += 20.0 * b;
        d[i + 1] -= 40.0 * b;
        d[i + 2] += 20.0 * b;
    }
    d
}

/// Σ a_i b_i: a polynomial's value from its coefficients and a basis.
pub fn combine(coefficients: &Coefficients, basis: &Coefficients) -> f64 {
    coefficients.iter().zip(basis).map(|(a, b)| a * b).sum()
}

/// The polynomial's value at `s`.
pub fn value(coefficients: &Coefficients, s: f64) -> f64 {
    combine(coefficients, &basis(s))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// De Casteljau's algorithm, an independent way to the value.
    fn de_casteljau(mut c: Vec<f64>, s: f64) -> f64 {
        while c.len() > 1 {
            c = c.windows(2).map(|w| (1.0 - s) * w[0] + s * w[1]).collect();
        }
        c[0]
    }

    proptest! {
        #[test]
        fn value_agrees_with_de_casteljau(c in prop::array::uniform6(-3.0..3.0f64), s in 0.0..1.0f64) {
            prop_assert!((value(&c, s) - de_casteljau(c.to_vec(), s)).abs() < 1e-13);
        }

        #[test]
        fn derivatives_agree_with_differences(c in prop::array::uniform6(-3.0..3.0f64), s in 0.01..0.99f64) {
            let h = 1e-5;
            let first = combine(&c, &basis_first_derivative(s));
            let by_difference = (value(&c, s + h) - value(&c, s - h)) / (2.0 * h);
            prop_assert!((first - by_difference).abs() < 1e-7);
            let second = combine(&c, &basis_second_derivative(s));
            let by_difference = (combine(&c, &basis_first_derivative(s + h))
                - combine(&c, &basis_first_derivative(s - h))) / (2.0 * h);
            prop_assert!((second - by_difference).abs() < 1e-6);
        }
    }

    #[test]
    fn the_ends_are_the_end_coefficients() {
        let c = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0];
        assert_eq!(value(&c, 0.0), 1.0);
        assert_eq!(value(&c, 1.0), 6.0);
    }
}
