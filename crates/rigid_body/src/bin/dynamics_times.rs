//! Times of the algorithms on a floating-base robot: one line an algorithm, "name nanoseconds".
//!
//! Each figure is the median over batches of the mean time of a call, each call at another of 64
//! states: the same protocol as `tests/pinocchio/bench.cpp`, which `launch-scripts/bench dynamics`
//! runs beside it.

use std::hint::black_box;
use std::time::Instant;

use rigid_body::{Data, Model, aba, crba, rnea, rnea_derivatives};

const STATES: usize = 64;
const BATCHES: usize = 4001;
const CALLS_PER_BATCH: usize = 16;

fn main() {
    let Some(path) = std::env::args().nth(1) else {
        eprintln!("usage: dynamics_times ROBOT.urdf");
        std::process::exit(2);
    };
    let urdf = std::fs::read_to_string(&path).unwrap_or_else(|error| {
        eprintln!("cannot read {path}: {error}");
        std::process::exit(1);
    });
    let model = Model::floating_base_from_urdf(&urdf).unwrap_or_else(|error| {
        eprintln!("{path}: {error}");
        std::process::exit(1);
    });
    let n = model.dof();
    let mut data = Data::new(&model);
    // Numbers in [-1, 1] without a pattern: fractional parts of multiples of the golden ratio.
    let mut count = 0.0;
    let mut number = || {
        count += 1.0;
        2.0 * (count * 0.618_033_988_749_894_9_f64).fract() - 1.0
    };
    let mut states = || -> Vec<Vec<f64>> { (0..STATES).map(|_| (0..n).map(|_| number()).collect()).collect() };
    let (q, v, a) = (states(), states(), states());
    for i in 0..2000 {
        let i = i % STATES;
        rnea_derivatives(&model, &mut data, &q[i], &v[i], &a[i], &[]);
    }
    measure("rnea", |i| {
        black_box(rnea(&model, &mut data, &q[i], &v[i], &a[i], &[]));
    });
    measure("crba", |i| {
        black_box(crba(&model, &mut data, &q[i]));
    });
    measure("aba", |i| {
        black_box(aba(&model, &mut data, &q[i], &v[i], &a[i], &[]));
    });
    measure("rnea_derivatives", |i| {
        rnea_derivatives(&model, &mut data, &q[i], &v[i], &a[i], &[]);
        black_box(&data.dtau_dq);
    });
}

fn measure(name: &str, mut call: impl FnMut(usize)) {
    let mut times: Vec<f64> = (0..BATCHES)
        .map(|batch| {
            let start = Instant::now();
            for i in 0..CALLS_PER_BATCH {
                call((batch * CALLS_PER_BATCH + i) % STATES);
            }
            start.elapsed().as_nanos() as f64 / CALLS_PER_BATCH as f64
        })
        .collect();
    times.sort_by(f64::total_cmp);
    println!("{name} {:.1}", times[BATCHES / 2]);
}
