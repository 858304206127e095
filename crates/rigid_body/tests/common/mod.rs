#![allow(dead_code)] // each test file uses its own part

use nalgebra::{DMatrix, Vector3};
use rigid_body::{FrameId, Model};

pub const VISION60: &str = include_str!("../../../../config/robots/vision60/vision60.urdf");
pub const TOES: [&str; 4] = ["front_left_toe", "rear_left_toe", "front_right_toe", "rear_right_toe"];

pub fn vision60() -> Model {
    Model::floating_base_from_urdf(VISION60).expect("the robot's own URDF loads")
}

/// Numbers in [-1, 1] that are the same in every run (SplitMix64).
pub struct Random(pub u64);

impl Random {
    pub fn number(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^= z >> 31;
        (z >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    }

    pub fn vector(&mut self, n: usize, scale: f64) -> Vec<f64> {
        (0..n).map(|_| scale * self.number()).collect()
    }

    pub fn vector3(&mut self, scale: f64) -> Vector3<f64> {
        Vector3::from_fn(|_, _| scale * self.number())
    }
}

pub struct State {
    pub q: Vec<f64>,
    pub v: Vec<f64>,
    pub a: Vec<f64>,
    pub forces: Vec<(FrameId, Vector3<f64>)>,
}

/// Any posture with pitch away from ±90°, quick joints, and forces of a walking robot's size.
pub fn random_state(model: &Model, random: &mut Random) -> State {
    let n = model.dof();
    let mut q = random.vector(n, 1.2);
    q[0] *= 10.0;
    let v = random.vector(n, 5.0);
    let a = random.vector(n, 30.0);
    let forces = TOES.iter().filter_map(|toe| model.frame_id(toe)).map(|toe| (toe, random.vector3(200.0))).collect();
    State { q, v, a, forces }
}

/// Derivative of f at x by central differences with Richardson extrapolation: column per entry of x.
pub fn difference(x: &[f64], mut f: impl FnMut(&[f64]) -> Vec<f64>) -> DMatrix<f64> {
    let mut x = x.to_vec();
    let rows = f(&x).len();
    let mut out = DMatrix::zeros(rows, x.len());
    for k in 0..x.len() {
        let at = x[k];
        let mut slope = |h: f64| -> Vec<f64> {
            x[k] = at + h;
            let up = f(&x);
            x[k] = at - h;
            let down = f(&x);
            x[k] = at;
            up.iter().zip(&down).map(|(u, d)| (u - d) / (2.0 * h)).collect()
        };
        let (wide, narrow) = (slope(2e-4), slope(1e-4));
        for r in 0..rows {
            out[(r, k)] = (4.0 * narrow[r] - wide[r]) / 3.0;
        }
    }
    out
}

/// Largest difference of two matrices relative to the larger of 1 and their largest entry.
pub fn relative_error<'a>(a: impl IntoIterator<Item = &'a f64>, b: impl IntoIterator<Item = &'a f64>) -> f64 {
    let (mut worst, mut scale) = (0.0_f64, 1.0_f64);
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
