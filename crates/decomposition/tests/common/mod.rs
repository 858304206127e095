#![allow(dead_code)] // each test file uses its own part

use nalgebra::{DMatrix, DVector, Vector3};
use proptest::prelude::*;
use rigid_body::{Data, Model, point_kinematics};
use robot::Robot;

pub fn vision60() -> Robot {
    Robot::from_toml_str(
        include_str!("../../../../config/robots/vision60/robot.toml"),
        include_str!("../../../../config/robots/vision60/vision60.urdf"),
    )
    .expect("the project's own robot loads")
}

/// This many cases, and no file of past failures: a failure found is written down as a test.
pub fn cases(count: u32) -> ProptestConfig {
    ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(count) }
}

/// Numbers in [-1, 1].
pub fn numbers<const N: usize>() -> impl Strategy<Value = [f64; N]> {
    proptest::array::uniform::<_, N>(-1.0..1.0_f64)
}

/// A posture with bent legs, the torso anywhere and leaning up to 0.8 rad.
pub fn posture(x: &[f64; 18]) -> [f64; 18] {
    std::array::from_fn(|i| match i {
        0..3 => 3.0 * x[i],
        3..5 => 0.8 * x[i],
        5 => 3.0 * x[i],
        _ => match (i - 6) % 3 {
            0 => 0.43 * x[i],
            1 => 0.95 + 0.8 * x[i],
            _ => 1.6 + 1.1 * x[i],
        },
    })
}

pub fn scaled<const N: usize>(x: &[f64; N], scale: f64) -> [f64; N] {
    x.map(|x| scale * x)
}

/// Largest difference relative to the larger of `scale` and the largest entry.
pub fn relative_error<'a>(
    a: impl IntoIterator<Item = &'a f64>,
    b: impl IntoIterator<Item = &'a f64>,
    scale: f64,
) -> f64 {
    let (mut worst, mut scale) = (0.0_f64, scale);
    let (mut a, mut b) = (a.into_iter(), b.into_iter());
    loop {
        match (a.next(), b.next()) {
            (Some(x), Some(y)) => {
                assert!(x.is_finite() && y.is_finite(), "{x} or {y} is not finite");
                worst = worst.max((x - y).abs());
                scale = scale.max(x.abs()).max(y.abs());
            }
            (None, None) => return worst / scale,
            _ => panic!("lengths differ"),
        }
    }
}

pub fn flat(vectors: &[Vector3<f64>]) -> Vec<f64> {
    vectors.iter().flat_map(|v| v.iter().copied()).collect()
}

/// Joint torques as generalised forces of the whole robot.
pub fn generalised(u: &[f64; 12]) -> [f64; 18] {
    std::array::from_fn(|i| if i < 6 { 0.0 } else { u[i - 6] })
}

/// Jacobian and J̇ q̇ of some toes of the whole robot.
pub fn toes(robot: &Robot, q: &[f64], v: &[f64], legs: &[usize]) -> (DMatrix<f64>, DVector<f64>) {
    let model: &Model = &robot.model;
    let mut data = Data::new(model);
    let zero = vec![0.0; model.dof()];
    let mut jacobian = DMatrix::zeros(3 * legs.len(), model.dof());
    let mut drift = DVector::zeros(3 * legs.len());
    for (k, &leg) in legs.iter().enumerate() {
        let point = point_kinematics(model, &mut data, q, v, &zero, robot.legs[leg].toe);
        jacobian.rows_mut(3 * k, 3).copy_from(&point.jacobian);
        drift.rows_mut(3 * k, 3).copy_from(&point.acceleration);
    }
    (jacobian, drift)
}
