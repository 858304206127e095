//! The program's derivatives, and the five gaits of the paper's Table I.

use super::*;
use nlp::{Evaluation, Problem};
use std::path::Path;

fn vision60() -> Robot {
    Robot::load(&Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config/robots/vision60")).unwrap()
}

fn go_on(_: &Iteration) -> ControlFlow<()> {
    ControlFlow::Continue(())
}

/// Small, repeatable numbers between −1 and 1.
fn noise(seed: u64) -> impl FnMut() -> f64 {
    let mut state = seed.wrapping_mul(2).wrapping_add(1);
    move || {
        state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (state >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    }
}

#[test]
fn the_jacobian_agrees_with_central_differences_everywhere() {
    let robot = vision60();
    let request = GaitRequest::named("amble", &robot).unwrap();
    let mut program =
        DecomposedProgram::new(&robot, Bipeds::new(&robot).unwrap(), &request, ProgramSettings::default());
    let mut x = guess::nominal(&robot, &mut program, &request).unwrap();
    let mut random = noise(7);
    for v in &mut x {
        *v += 0.05 * random() * v.abs().max(1.0);
    }
    let mut evaluation = Evaluation::new(&program);
    program.evaluate(&x, &mut evaluation);
    let (n, m) = (x.len(), evaluation.constraints.len());
    let mut analytic = vec![vec![0.0; n]; m];
    for (&(row, column), value) in program.jacobian_pattern().0.iter().zip(&evaluation.jacobian) {
        assert_eq!(analytic[row][column], 0.0, "row {row} column {column} is given twice");
        analytic[row][column] = *value;
    }
    let (mut above, mut below) = (vec![0.0; m], vec![0.0; m]);
    for column in 0..n {
        let h = 1e-6 * x[column].abs().max(1.0);
        let kept = x[column];
        x[column] = kept + h;
        let objective_above = program.values(&x, &mut above);
        x[column] = kept - h;
        let objective_below = program.values(&x, &mut below);
        x[column] = kept;
        for row in 0..m {
            let difference = (above[row] - below[row]) / (2.0 * h);
            let error = (difference - analytic[row][column]).abs();
            assert!(
                error < 1e-5 * (1.0 + difference.abs().max(above[row].abs() * 1e-2)),
                "{} by {}: analytic {}, difference {difference}",
                program.constraint_name(row),
                program.variable_name(column),
                analytic[row][column],
            );
        }
        let slope = (objective_above - objective_below) / (2.0 * h);
        assert!((slope - evaluation.gradient[column]).abs() < 1e-5 * (1.0 + slope.abs()));
    }
}

#[test]
fn the_five_gaits_of_table_i_converge() {
    let robot = vision60();
    for name in behaviours() {
        let request = GaitRequest::named(name, &robot).unwrap();
        let result = plan(&robot, &request, &PlanOptions::default(), |i| {
            println!(
                "{name} {:3} f {:.6e} viol {:.1e} stat {:.1e} a {:.3} |p| {:.1e} qp {} {}",
                i.number, i.objective, i.max_violation, i.stationarity, i.step_length, i.step_norm, i.qp_iterations,
                if i.elastic { "elastic" } else { "" }
            );
            go_on(i)
        });
        match result {
            Ok(p) => println!("{name}: {} it, cost {:.6}, viol {:.1e}", p.gait.solver.iterations, p.gait.solver.objective, p.gait.solver.max_violation),
            Err(e) => println!("{name}: {e}"),
        }
    }
}
