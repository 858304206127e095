//! Steps against Clarabel's.

use super::*;
use crate::problem::{Bounds, Pattern};

/// A chain of links, each a state of two numbers that a push moves on, and three loads (a, b, c) that balance the
/// push: a + b + c is determined twice and one of them not at all.
///
/// Unknowns: s₀, t₀ and p (the push's scale), then of each link s, t, push, a, b, c. Equalities of a link: s and t
/// from those before and the push; the loads' three, which leave push + (what s does) = 0.
struct Chain {
    links: usize,
    bounds: Bounds,
    jacobian: Pattern,
    hessian: Pattern,
    at: Evaluation,
}

const BEFORE: usize = 3;
const LINK: usize = 6;

fn noise(seed: u64) -> impl FnMut() -> f64 {
    let mut state = seed.wrapping_mul(2).wrapping_add(1);
    move || {
        state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (state >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    }
}

impl Chain {
    fn new(links: usize, seed: u64) -> Self {
        let mut r = noise(seed);
        let n = BEFORE + LINK * links;
        let (mut places, mut values, mut constraints) = (Vec::new(), Vec::new(), Vec::new());
        let mut bounds = Bounds {
            variable_lower: vec![-1.0; n],
            variable_upper: vec![1.0; n],
            constraint_lower: Vec::new(),
            constraint_upper: Vec::new(),
        };
        let mut put = |entries: &[(usize, f64)], value: f64, [lower, upper]: [f64; 2]| {
            for &(column, number) in entries {
                places.push((constraints.len(), column));
                values.push(number);
            }
            constraints.push(value);
            bounds.constraint_lower.push(lower);
            bounds.constraint_upper.push(upper);
        };
        for link in 0..links {
            let first = BEFORE + LINK * link;
            let before = if link == 0 { [0, 1] } else { [first - LINK, first - LINK + 1] };
            let [s, t, push, a, b, c] = std::array::from_fn(|k| first + k);
            put(&[(before[0], -0.9), (before[1], -0.3 - 0.1 * r()), (s, 1.0), (push, 0.2 * r())], 0.1 * r(), [0.0; 2]);
            put(&[(before[1], -1.0), (s, 0.1 * r()), (t, 1.0), (push, -0.5 + 0.2 * r())], 0.1 * r(), [0.0; 2]);
            // The third is the first and the second together, in a, b, c.
            let (x, y, z, w) = (1.0 + 0.3 * r(), 0.4 * r(), 0.5 * r(), 1.0 + 0.2 * r());
            put(&[(a, x), (b, y), (c, 0.0), (push, 0.2), (s, 0.3 * r())], 0.1 * r(), [0.0; 2]);
            put(&[(a, 0.0), (b, z), (c, w), (2, 0.3), (t, 0.2)], 0.1 * r(), [0.0; 2]);
            put(&[(a, x), (b, y + z), (c, w), (push, 1.0 + 0.2 * r()), (s, 0.5 * r())], 0.1 * r(), [0.0; 2]);
            // Inequalities on the loads, and one row that no bound holds.
            put(&[(a, 1.0), (c, -0.5)], 0.0, [-0.2, 0.3]);
            put(&[(b, 1.0), (s, 0.2)], 0.0, [-0.05, f64::INFINITY]);
            put(&[(b, 1.0)], 0.0, [f64::NEG_INFINITY, f64::INFINITY]);
        }
        // The end meets the beginning in one number, said twice.
        let last = BEFORE + LINK * (links - 1);
        let gap = 0.05 * r();
        put(&[(last, 1.0), (0, -0.5)], gap, [0.0; 2]);
        put(&[(last, 2.0), (0, -1.0)], 2.0 * gap, [0.0; 2]);
        let at = Evaluation {
            jacobian_wanted: true,
            objective: 0.0,
            gradient: (0..n).map(|_| r()).collect(),
            constraints,
            jacobian: values,
            hessian: (0..n).map(|_| 2.0 + r()).collect(),
        };
        Self { links, bounds, jacobian: Pattern(places), hessian: Pattern((0..n).map(|i| (i, i)).collect()), at }
    }

    fn order(&self) -> Order {
        let rows = self.bounds.constraint_lower.len();
        let link = |k: usize| BEFORE + LINK * k;
        Order {
            inputs: vec![0, 1, 2],
            loads: (0..self.links).map(|k| (link(k) + 3..link(k) + 6).collect()).collect(),
            stages: (0..self.links)
                .map(|k| Stage { chain: vec![link(k)], core: vec![link(k) + 1, link(k) + 2] })
                .collect(),
            ties: vec![rows - 2, rows - 1],
        }
    }
}

impl Problem for Chain {
    fn bounds(&self) -> &Bounds {
        &self.bounds
    }
    fn jacobian_pattern(&self) -> &Pattern {
        &self.jacobian
    }
    fn hessian_pattern(&self) -> &Pattern {
        &self.hessian
    }
    fn evaluate(&mut self, _: &[f64], evaluation: &mut Evaluation) {
        evaluation.clone_from(&self.at);
    }
    fn values(&mut self, _: &[f64], _: &mut [f64]) -> f64 {
        unreachable!("a subproblem asks for no values")
    }
    fn constraint_name(&self, row: usize) -> String {
        format!("constraint {row}")
    }
    fn variable_name(&self, column: usize) -> String {
        format!("variable {column}")
    }
}

#[test]
fn gives_clarabel_s_step_with_loads_and_repeated_ties() {
    let (mut solved, mut refused) = (0, 0);
    for seed in 0..200 {
        let problem = Chain::new(4, seed);
        let x = vec![0.0; problem.bounds.variable_lower.len()];
        let mut ordered = Ordered::<4, 4>::new(&problem, &problem.order(), 1.0).expect("the order fits");
        let ours = ordered.solve(&problem, &x, &problem.at, &problem.at.constraints);
        assert!(ordered.sparse.is_none(), "seed {seed}: solved by Clarabel");
        let theirs = Qp::new(&problem, false, 1.0).solve(&problem, &x, &problem.at, &problem.at.constraints);
        match (ours, theirs) {
            (Ok(ours), Ok(theirs)) => {
                solved += 1;
                for (a, b) in ours.step.iter().zip(&theirs.step) {
                    assert!((a - b).abs() < 1e-4, "seed {seed}: {:?}, {:?}", ours.step, theirs.step);
                }
            }
            (Err(SubproblemError::Infeasible), Err(_)) => refused += 1,
            (ours, theirs) => panic!("seed {seed}: {ours:?}, {theirs:?}"),
        }
    }
    println!("{solved} solved, {refused} infeasible");
    assert!(solved > 50, "{solved} solved, {refused} infeasible");
}

#[test]
fn an_order_that_does_not_fit_is_refused() {
    let problem = Chain::new(3, 1);
    let new = |order: &Order| Ordered::<4, 4>::new(&problem, order, 1.0).is_some();
    let order = problem.order();
    assert!(new(&order));
    let without_a_stage = Order { stages: order.stages[..2].to_vec(), ..order.clone() };
    let with_an_unknown_too_many =
        Order { stages: vec![Stage { chain: vec![], core: vec![3, 4, 5, 9] }], ..order.clone() };
    let with_too_many_inputs = Order { inputs: vec![0, 1, 2, 3], ..order.clone() };
    for order in [without_a_stage, with_an_unknown_too_many, with_too_many_inputs] {
        assert!(!new(&order), "{order:?}");
    }
    let ordered = Ordered::<4, 4>::new(&problem, &order, 1.0).unwrap();
    assert!(ordered.fits(&Chain::new(3, 2), &order) && !ordered.fits(&Chain::new(4, 1), &order));
}

#[cfg(target_arch = "x86_64")]
#[test]
fn wider_registers_give_the_same_program_and_step_to_the_bit() {
    assert!(std::arch::is_x86_feature_detected!("avx2"), "this processor has no AVX2: there is nothing to compare");
    let problem = Chain::new(5, 3);
    let x = vec![0.1; problem.bounds.variable_lower.len()];
    let asked = Asked {
        x: &x,
        at: &problem.at,
        constraints: &problem.at.constraints,
        variable_values: &problem.bounds.variable_lower,
        constraint_values: &problem.bounds.constraint_lower,
    };
    let of = |wide: bool| {
        let mut ordered = Ordered::<8, 8>::new(&problem, &problem.order(), 1.0).unwrap();
        // SAFETY: this processor has the instructions.
        let step = if wide {
            unsafe { ordered.step_with_avx2(&problem, asked) }
        } else {
            ordered.step_of_any_width(&problem, asked)
        };
        (ordered.qp, step.unwrap().step)
    };
    assert_eq!(of(false), of(true));
}
