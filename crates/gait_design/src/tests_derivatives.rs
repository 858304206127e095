//! Derivatives of programs against central differences.

use crate::tests::{as_steps, noise, vision60};
use crate::{ProgramSettings, guess, program_of};
use nlp::{Evaluation, Problem};

#[test]
fn the_jacobian_agrees_with_central_differences_everywhere() {
    let robot = vision60();
    let request = as_steps("amble", &robot);
    let mut program = program_of(&robot, &request, ProgramSettings::default()).unwrap();
    let mut x = guess::nominal(&robot, &mut program, &request).unwrap();
    let mut random = noise(7);
    for v in &mut x {
        *v += 0.05 * random() * v.abs().max(1.0);
    }
    agrees_with_central_differences(&mut program, x);
}

/// Of central differences of eighth order: exact for polynomials of that degree, so that steps may be long and rounding
/// stays below 1e-11.
const WEIGHTS: [f64; 4] = [4.0 / 5.0, -1.0 / 5.0, 4.0 / 105.0, -1.0 / 280.0];
const STEP: f64 = 0.014;

pub(crate) fn agrees_with_central_differences(program: &mut impl Problem, mut x: Vec<f64>) {
    let mut evaluation = Evaluation::new(program);
    program.evaluate(&x, &mut evaluation);
    let (n, m) = (x.len(), evaluation.constraints.len());
    let mut analytic = vec![vec![0.0; n]; m];
    for (&(row, column), value) in program.jacobian_pattern().0.iter().zip(&evaluation.jacobian) {
        assert_eq!(analytic[row][column], 0.0, "row {row} column {column} is given twice");
        analytic[row][column] = *value;
    }
    let (mut above, mut below) = (vec![0.0; m], vec![0.0; m]);
    let mut worst = 0.0_f64;
    for column in 0..n {
        let h = STEP * x[column].abs().max(1.0);
        let kept = x[column];
        let (mut differences, mut slope, mut largest) = (vec![0.0; m], 0.0, vec![1.0_f64; m]);
        for (k, weight) in (1..).zip(WEIGHTS) {
            x[column] = kept + f64::from(k) * h;
            let objective_above = program.values(&x, &mut above);
            x[column] = kept - f64::from(k) * h;
            slope += weight * (objective_above - program.values(&x, &mut below)) / h;
            for row in 0..m {
                differences[row] += weight * (above[row] - below[row]) / h;
                largest[row] = largest[row].max(above[row].abs()).max(below[row].abs());
            }
        }
        x[column] = kept;
        for (row, difference) in differences.iter().enumerate() {
            let error = (difference - analytic[row][column]).abs() / difference.abs().max(largest[row]);
            worst = worst.max(error);
            assert!(
                error < 1e-11,
                "{} by {}: analytic {}, difference {difference}, off by {error:.1e}",
                program.constraint_name(row),
                program.variable_name(column),
                analytic[row][column],
            );
        }
        assert!((slope - evaluation.gradient[column]).abs() < 1e-9 * (1.0 + slope.abs()));
    }
    println!("largest relative error {worst:.1e}");
}
