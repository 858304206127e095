use super::*;
use clarabel::algebra::CscMatrix;
use clarabel::solver::{DefaultSettingsBuilder, DefaultSolver, IPSolver, NonnegativeConeT, SolverStatus};

const W: usize = 6;

fn noise(seed: u64) -> impl FnMut() -> f64 {
    let mut state = seed.wrapping_mul(2).wrapping_add(1);
    move || {
        state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (state >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    }
}

/// A convex arrow and random rows around 0 so that some are active and, at times, none can be satisfied.
fn random(seed: u64, own: usize, rows: usize, width: f64) -> ArrowQp<W> {
    let mut r = noise(seed);
    let mut qp = ArrowQp::default();
    for _ in 0..own {
        let coupling = std::array::from_fn(|_| r());
        qp.own.push(Own { coupling, hessian: 0.2 + r().abs(), gradient: r() });
        // What the coupling takes from the shared block, so that the whole stays convex.
        let d = qp.own.last().unwrap().hessian;
        for i in 0..W {
            axpy(coupling[i] / d, &coupling, &mut qp.hessian[i]);
        }
    }
    let b: [[f64; W]; W] = std::array::from_fn(|_| std::array::from_fn(|_| r()));
    for i in 0..W {
        for k in 0..W {
            qp.hessian[i][k] += dot(&b[i], &b[k]) + if i == k { 0.01 } else { 0.0 };
        }
        qp.gradient[i] = r();
    }
    for i in 0..rows {
        let lower = r() * 0.5 - width;
        qp.rows.push(ArrowRow {
            normal: std::array::from_fn(|_| r()),
            own: if own > 0 && i % 3 > 0 { (i % own, r()) } else { (0, 0.0) },
            offset: 0.1 * r(),
            lower,
            upper: lower + width * (1.5 + r()),
        });
    }
    qp
}

/// All unknowns of a row's normal, the shared ones first.
fn dense_normal(qp: &ArrowQp<W>, row: &ArrowRow<W>) -> Vec<f64> {
    let mut n = row.normal.to_vec();
    n.resize(W + qp.own.len(), 0.0);
    if row.own.1 != 0.0 {
        n[W + row.own.0] = row.own.1;
    }
    n
}

fn dense_hessian(qp: &ArrowQp<W>) -> Vec<Vec<f64>> {
    let n = W + qp.own.len();
    let mut h = vec![vec![0.0; n]; n];
    for i in 0..W {
        h[i][..W].copy_from_slice(&qp.hessian[i]);
    }
    for (p, own) in qp.own.iter().enumerate() {
        h[W + p][W + p] = own.hessian;
        for i in 0..W {
            (h[i][W + p], h[W + p][i]) = (own.coupling[i], own.coupling[i]);
        }
    }
    h
}

fn dense_gradient(qp: &ArrowQp<W>) -> Vec<f64> {
    qp.gradient.iter().copied().chain(qp.own.iter().map(|o| o.gradient)).collect()
}

/// The same program by Clarabel: `None` where it proves that there is no solution.
fn by_clarabel(qp: &ArrowQp<W>) -> Option<Vec<f64>> {
    let m = qp.rows.len();
    let normals: Vec<Vec<f64>> = qp.rows.iter().map(|row| dense_normal(qp, row)).collect();
    let negative = normals.iter().map(|n| n.iter().map(|v| -v).collect());
    let a: Vec<Vec<f64>> = normals.iter().cloned().chain(negative).collect();
    let b: Vec<f64> =
        qp.rows.iter().map(|r| r.upper - r.offset).chain(qp.rows.iter().map(|r| r.offset - r.lower)).collect();
    let mut h = dense_hessian(qp);
    for (i, row) in h.iter_mut().enumerate() {
        row[..i].fill(0.0);
    }
    let settings = DefaultSettingsBuilder::default().verbose(false).build().unwrap();
    let mut solver = DefaultSolver::new(
        &CscMatrix::from(&h),
        &dense_gradient(qp),
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

fn objective(qp: &ArrowQp<W>, x: &[f64]) -> f64 {
    let product = |row: &Vec<f64>| row.iter().zip(x).map(|(h, x)| h * x).sum::<f64>();
    let curvature: f64 = dense_hessian(qp).iter().zip(x).map(|(row, x)| x * product(row)).sum();
    0.5 * curvature + product(&dense_gradient(qp))
}

fn solution(solver: &DualActiveSet<W>) -> Vec<f64> {
    solver.shared.iter().chain(&solver.own).copied().collect()
}

/// Programs of changing size, one solver for all: rows active before are tried first, whether or not they fit.
#[test]
fn random_programs_have_the_solution_that_clarabel_finds() {
    let mut solver = DualActiveSet::default();
    let (mut solved, mut infeasible) = (0, 0);
    for seed in 0..400 {
        let own = (seed as usize * 7) % 24;
        let qp = random(seed, own, 2 * W + own, if seed % 3 == 0 { 0.3 } else { 3.0 });
        match (solver.solve(&qp), by_clarabel(&qp)) {
            (Ok(()), Some(expected)) => {
                solved += 1;
                let x = solution(&solver);
                for row in &qp.rows {
                    let value: f64 =
                        row.offset + dense_normal(&qp, row).iter().zip(&x).map(|(n, x)| n * x).sum::<f64>();
                    assert!(value > row.lower - 1e-8 && value < row.upper + 1e-8, "seed {seed}: {row:?}: {value}");
                }
                // Clarabel's own tolerance is 1e-8 in the objective; in a flat direction that is more in an unknown.
                let (mine, theirs) = (objective(&qp, &x), objective(&qp, &expected));
                assert!((mine - theirs).abs() < 1e-6 * (1.0 + theirs.abs()), "seed {seed}: {mine} against {theirs}");
            }
            (Err(ArrowQpError::Infeasible { .. }), None) => infeasible += 1,
            (mine, other) => panic!("seed {seed}: {mine:?}, Clarabel finds a solution: {}", other.is_some()),
        }
    }
    assert!(solved > 50 && infeasible > 10, "{solved} solved, {infeasible} infeasible");
}

/// Nearly flat in one direction: there the rows' normals are long in the Hessian's metric.
fn flatten_one_direction(qp: &mut ArrowQp<W>) {
    for i in 0..W {
        for k in 0..W {
            qp.hessian[i][k] *= if i == 0 || k == 0 { 1e-5 } else { 1.0 };
        }
    }
    qp.hessian[0][0] += 1e-9;
    for own in &mut qp.own {
        own.coupling[0] *= 1e-5;
    }
}

/// Rows that repeat each other but for rounding, between bounds that contradict each other or hardly do not.
#[test]
fn rows_that_nearly_repeat_each_other_never_end_in_an_optimum_that_breaks_them() {
    let mut solver = DualActiveSet::default();
    let (mut solved, mut refused) = (0, 0);
    for seed in 0..20000 {
        let own = seed as usize % 5;
        let mut qp = random(seed, own, 2 * W, [0.02, 0.3, 3.0][seed as usize % 3]);
        let apart = 10f64.powi(-8 - (seed % 6) as i32);
        let mut r = noise(seed + 7);
        flatten_one_direction(&mut qp);
        for row in qp.rows.clone().iter().cycle().take(4 * W) {
            let normal = row.normal.map(|n| n + apart * r());
            let offset = row.offset + [0.1 * apart, 100.0 * apart, 1e-3, 0.5][seed as usize % 4] * r();
            qp.rows.push(ArrowRow { normal, offset, ..*row });
        }
        if solver.solve(&qp).is_err() {
            refused += 1;
            continue;
        }
        solved += 1;
        assert!(solver.active().count() <= W + own, "seed {seed}: more active rows than unknowns");
        for (i, row) in qp.rows.iter().enumerate() {
            let value = solver.value(row);
            let allowed = 1e-6 * (1.0 + solver.scale[i]);
            assert!(
                value > row.lower - allowed && value < row.upper + allowed,
                "seed {seed}: row {i} is {value}, allowed {} to {}",
                row.lower,
                row.upper
            );
        }
    }
    assert!(solved > 100 && refused > 100, "{solved} solved, {refused} refused");
}

/// Three of the six shared unknowns only fill the width, as where the caller has fewer than its type has room for,
/// and not every other unknown is in a row: rows that contradict each other but for rounding are infeasible, never an
/// optimum with more active rows than unknowns.
#[test]
fn there_are_never_more_active_rows_than_unknowns_that_they_hold() {
    const HELD: usize = 3;
    let (mut solved, mut infeasible) = (0, 0);
    for seed in 0..20000 {
        let own = seed as usize % 4;
        let mut qp = random(seed, own, 2 * W, [0.02, 0.3, 3.0][seed as usize % 3]);
        let apart = 10f64.powi(-6 - (seed % 8) as i32);
        let mut r = noise(seed + 7);
        flatten_one_direction(&mut qp);
        for row in &mut qp.rows {
            row.normal[HELD..].fill(0.0);
            row.own = if own > 1 && row.own.1 != 0.0 { (row.own.0 % (own - 1), row.own.1) } else { (0, 0.0) };
        }
        for row in qp.rows.clone().iter().cycle().take(4 * W) {
            let normal = std::array::from_fn(|k| row.normal[k] + if k < HELD { apart * r() } else { 0.0 });
            let offset = row.offset + [0.1 * apart, 100.0 * apart, 1e-3, 0.5][seed as usize % 4] * r();
            qp.rows.push(ArrowRow { normal, offset, ..*row });
        }
        let mut solver = DualActiveSet::default();
        let outcome = solver.solve(&qp);
        let held = HELD + own.saturating_sub(1);
        assert!(solver.active().count() <= held, "seed {seed}: {outcome:?} with {} rows", solver.active().count());
        match outcome {
            Ok(()) => {
                solved += 1;
                assert!(qp.rows.iter().enumerate().all(|(i, row)| {
                    let (value, allowed) = (solver.value(row), 1e-6 * (1.0 + solver.scale[i]));
                    value > row.lower - allowed && value < row.upper + allowed
                }));
            }
            Err(ArrowQpError::Infeasible { .. }) => infeasible += 1,
            Err(_) => {}
        }
    }
    assert!(solved > 100 && infeasible > 100, "{solved} solved, {infeasible} infeasible");
}

#[test]
fn multipliers_balance_the_gradient() {
    let mut solver = DualActiveSet::default();
    let mut drops = 0;
    for seed in 0..100 {
        let qp = random(seed, 6, 30, 1.0);
        if solver.solve(&qp).is_err() {
            continue;
        }
        drops += (solver.iterations as usize).saturating_sub(solver.active().count());
        let x = solution(&solver);
        let mut residual = dense_gradient(&qp);
        for (r, row) in residual.iter_mut().zip(dense_hessian(&qp)) {
            *r += row.iter().zip(&x).map(|(h, x)| h * x).sum::<f64>();
        }
        for (row, side, multiplier) in solver.active() {
            assert!(multiplier >= 0.0);
            for (r, n) in residual.iter_mut().zip(dense_normal(&qp, &qp.rows[row])) {
                *r -= side * multiplier * n;
            }
        }
        assert!(residual.iter().all(|r| r.abs() < 1e-9), "seed {seed}: {residual:?}");
    }
    assert!(drops > 20, "only {drops} rows left the active set: R's repair was hardly tried");
}

#[test]
fn the_same_program_again_takes_only_its_active_rows() {
    let mut solver = DualActiveSet::default();
    let qp = random(4, 12, 40, 1.0);
    solver.solve(&qp).unwrap();
    let before = solution(&solver);
    solver.solve(&qp).unwrap();
    assert!(solver.iterations as usize <= 2 * solver.active().count());
    for (a, b) in solution(&solver).iter().zip(&before) {
        assert!((a - b).abs() < 1e-12 * (1.0 + b.abs()));
    }
}

#[test]
fn a_hessian_with_a_flat_direction_is_refused() {
    let mut qp = random(1, 3, 2, 1.0);
    qp.hessian = [[0.0; W]; W];
    assert_eq!(DualActiveSet::default().solve(&qp), Err(ArrowQpError::NotConvex));
    let mut qp = random(1, 3, 2, 1.0);
    qp.own[1].hessian = f64::NAN;
    assert_eq!(DualActiveSet::default().solve(&qp), Err(ArrowQpError::NotConvex));
}
