//! Times of the algorithms on the Vision 60 (18 coordinates) and on its front biped (12).

use std::hint::black_box;

use criterion::{Criterion, criterion_group, criterion_main};
use rigid_body::{Data, Model, aba, crba, last_point_kinematics_derivatives, rnea, rnea_derivatives};

fn benchmark(c: &mut Criterion) {
    let urdf = include_str!("../../../config/robots/vision60/vision60.urdf");
    let whole = Model::floating_base_from_urdf(urdf).expect("the project's own robot loads");
    let joints: Vec<String> = ["front_left", "front_right"]
        .iter()
        .flat_map(|leg| ["hip_roll", "hip_pitch", "knee"].map(|joint| format!("{leg}_{joint}")))
        .collect();
    let biped = whole.subtree(&joints, 0.5).expect("the legs exist");
    for (name, model) in [("quadruped", whole), ("biped", biped)] {
        let n = model.dof();
        let mut data = Data::new(&model);
        let q: Vec<f64> = (0..n).map(|i| 0.7 * (i as f64).sin()).collect();
        let v: Vec<f64> = (0..n).map(|i| (2.0 * i as f64).sin()).collect();
        let a: Vec<f64> = (0..n).map(|i| (3.0 * i as f64).sin()).collect();
        let toe = model.frame_id("front_left_toe").expect("the toe exists");
        let force = [(toe, nalgebra::Vector3::new(10.0, -20.0, 180.0))];
        let mut group = c.benchmark_group(name);
        group.bench_function("rnea", |b| b.iter(|| rnea(&model, &mut data, black_box(&q), &v, &a, &[])[0]));
        group.bench_function("crba", |b| b.iter(|| crba(&model, &mut data, black_box(&q))[(0, 0)]));
        group.bench_function("aba", |b| b.iter(|| aba(&model, &mut data, black_box(&q), &v, &a, &[])[0]));
        group.bench_function("rnea_derivatives", |b| {
            b.iter(|| rnea_derivatives(&model, &mut data, black_box(&q), &v, &a, &[]))
        });
        group.bench_function("rnea_derivatives_with_a_force", |b| {
            b.iter(|| rnea_derivatives(&model, &mut data, black_box(&q), &v, &a, &force))
        });
        group.bench_function("point_derivatives", |b| {
            b.iter(|| last_point_kinematics_derivatives(&model, &mut data, black_box(toe)).position)
        });
        group.finish();
    }
}

criterion_group!(benches, benchmark);
criterion_main!(benches);
