//! How much a disturbance grows within a step at most, whatever becomes of it over many.

use super::{PLACES, RATES, STATE};
use nalgebra::{DMatrix, DVector};
use robot::Robot;

/// Positions of the body, m, which come first in the manifold's coordinates; angles follow.
const LENGTHS: usize = 3;
/// Of the power iteration: it gains a digit in each where the largest growth is three times the next.
const ITERATIONS: usize = 16;

/// The largest singular value of a step's map in the robot's own measure: lengths in nominal heights h, angles in rad,
/// rates in √(g/h).
pub(super) fn step_growth(robot: &Robot, map: &DMatrix<f64>) -> f64 {
    let height_m = robot.nominal.height_m;
    let rate_s = (robot.model.gravity.norm() / height_m).sqrt();
    let unit: [f64; STATE] = std::array::from_fn(|k| {
        let place = if k % RATES < LENGTHS || k >= PLACES { height_m } else { 1.0 };
        if (RATES..PLACES).contains(&k) { place * rate_s } else { place }
    });
    let scaled = DMatrix::from_fn(STATE, STATE, |row, column| map[(row, column)] * unit[column] / unit[row]);
    largest_singular_value(&scaled)
}

/// By the power iteration, from the image of the column that is largest.
fn largest_singular_value(matrix: &DMatrix<f64>) -> f64 {
    let Some(column) = matrix.column_iter().max_by(|a, b| a.norm_squared().total_cmp(&b.norm_squared())) else {
        return 0.0;
    };
    let mut direction: DVector<f64> = matrix.tr_mul(&column);
    for _ in 0..ITERATIONS {
        direction = matrix.tr_mul(&(matrix * direction.normalize()));
    }
    direction.norm().sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_largest_singular_value_is_that_of_the_decomposition() {
        let matrix = DMatrix::from_fn(7, 7, |i, j| ((3 * i + 5 * j * j) as f64).sin() + if i == j { 2.0 } else { 0.0 });
        let expected = matrix.clone().svd(false, false).singular_values.max();
        assert!((largest_singular_value(&matrix) / expected - 1.0).abs() < 1e-3, "{expected}");
    }
}
