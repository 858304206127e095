//! Inverse dynamics and its derivatives against an implementation that shares nothing with the library.
//!
//! It goes from the URDF's links, unmerged, straight to virtual work. Every number is a polynomial in time of degree
//! two (so that velocities and accelerations come out of positions) whose coefficients are dual numbers (so that
//! derivatives come out exact): q(t) = q + v t + a t²/2, then τ_j = Σ over links of m (c̈ − g)·∂c/∂q_j + (d/dt I
//! ω)·ω_j.

mod common;

use std::ops::{Add, Mul, Neg, Sub};

use common::{Random, VISION60, random_state, relative_error, vision60};
use rigid_body::{Data, rnea_derivatives};

/// A number with its derivative in one direction.
#[derive(Clone, Copy)]
struct Dual(f64, f64);

/// A polynomial in t: x[0] + x[1] t + x[2] t².
#[derive(Clone, Copy)]
struct Jet([Dual; 3]);

impl Add for Dual {
    type Output = Self;
    fn add(self, o: Self) -> Self {
        Self(self.0 + o.0, self.1 + o.1)
    }
}
impl Mul for Dual {
    type Output = Self;
    fn mul(self, o: Self) -> Self {
        Self(self.0 * o.0, self.0 * o.1 + self.1 * o.0)
    }
}
impl Jet {
    fn constant(x: f64) -> Self {
        Self([Dual(x, 0.0), Dual(0.0, 0.0), Dual(0.0, 0.0)])
    }
    fn scaled(self, s: f64) -> Self {
        Self(self.0.map(|x| Dual(x.0 * s, x.1 * s)))
    }
    /// Sine and cosine, by their Taylor polynomials about the value at t = 0.
    fn sin_cos(self) -> (Self, Self) {
        let [x, v, a] = self.0;
        let (sine, cosine) = (Dual(x.0.sin(), x.1 * x.0.cos()), Dual(x.0.cos(), -x.1 * x.0.sin()));
        let half_square = v * v * Dual(0.5, 0.0);
        let minus = Dual(-1.0, 0.0);
        (
            Self([sine, cosine * v, cosine * a + minus * sine * half_square]),
            Self([cosine, minus * sine * v, minus * sine * a + minus * cosine * half_square]),
        )
    }
    /// First and second derivative at t = 0.
    fn rate(self) -> Dual {
        self.0[1]
    }
    fn second_rate(self) -> Dual {
        self.0[2] * Dual(2.0, 0.0)
    }
    /// The derivative as a polynomial, known to first order.
    fn differentiated(self) -> Self {
        Self([self.0[1], self.0[2] * Dual(2.0, 0.0), Dual(0.0, 0.0)])
    }
}
impl Add for Jet {
    type Output = Self;
    fn add(self, o: Self) -> Self {
        Self(std::array::from_fn(|i| self.0[i] + o.0[i]))
    }
}
impl Neg for Jet {
    type Output = Self;
    fn neg(self) -> Self {
        self.scaled(-1.0)
    }
}
impl Sub for Jet {
    type Output = Self;
    fn sub(self, o: Self) -> Self {
        self + -o
    }
}
impl Mul for Jet {
    type Output = Self;
    fn mul(self, o: Self) -> Self {
        let (a, b) = (self.0, o.0);
        Self([a[0] * b[0], a[0] * b[1] + a[1] * b[0], a[0] * b[2] + a[1] * b[1] + a[2] * b[0]])
    }
}

type Vector = [Jet; 3];
type Matrix = [Vector; 3]; // rows

fn vector(x: &[f64]) -> Vector {
    std::array::from_fn(|i| Jet::constant(x[i]))
}
fn plus(a: Vector, b: Vector) -> Vector {
    std::array::from_fn(|i| a[i] + b[i])
}
fn cross(a: Vector, b: Vector) -> Vector {
    std::array::from_fn(|i| a[(i + 1) % 3] * b[(i + 2) % 3] - a[(i + 2) % 3] * b[(i + 1) % 3])
}
fn dot(a: Vector, b: Vector) -> Jet {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}
fn apply(m: &Matrix, v: Vector) -> Vector {
    m.map(|row| dot(row, v))
}
fn transposed(m: &Matrix) -> Matrix {
    std::array::from_fn(|r| std::array::from_fn(|c| m[c][r]))
}
fn product(a: &Matrix, b: &Matrix) -> Matrix {
    let columns = transposed(b).map(|column| apply(a, column));
    transposed(&columns)
}

/// The rotation by an angle about a unit axis (Rodrigues).
fn turn(axis: &[f64; 3], angle: Jet) -> Matrix {
    let (sine, cosine) = angle.sin_cos();
    let one = Jet::constant(1.0);
    std::array::from_fn(|r| {
        std::array::from_fn(|c| {
            let along = (one - cosine).scaled(axis[r] * axis[c]);
            let across = match (3 + c - r) % 3 {
                0 => cosine,
                1 => sine.scaled(-axis[3 - r - c]),
                _ => sine.scaled(axis[3 - r - c]),
            };
            along + across
        })
    })
}

fn euler(rpy: [Jet; 3]) -> Matrix {
    let (x, y, z) = ([1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]);
    product(&product(&turn(&z, rpy[2]), &turn(&y, rpy[1])), &turn(&x, rpy[0]))
}

/// A turning or sliding coordinate as a link sees it: its axis in the world and a point on it.
#[derive(Clone)]
struct Mover {
    dof: usize,
    axis: Vector,
    through: Option<Vector>,
}

/// τ of the motion, with its derivative in the direction of the duals.
fn inverse_dynamics(urdf: &urdf_rs::Robot, names: &[String], q: &[Jet], gravity: &[f64; 3]) -> Vec<Dual> {
    let mut tau = vec![Dual(0.0, 0.0); q.len()];
    let rotation = euler([q[3], q[4], q[5]]);
    let position = [q[0], q[1], q[2]];
    let [z, y] = [[0.0, 0.0, 1.0], [0.0, 1.0, 0.0]];
    let yawed = turn(&z, q[5]);
    let pitched = product(&yawed, &turn(&y, q[4]));
    let mut movers: Vec<Mover> = (0..3)
        .map(|i| {
            let mut axis = [0.0; 3];
            axis[i] = 1.0;
            Mover { dof: i, axis: vector(&axis), through: None }
        })
        .collect();
    let turns = [(5, vector(&z)), (4, apply(&yawed, vector(&y))), (3, apply(&pitched, vector(&[1.0, 0.0, 0.0])))];
    movers.extend(turns.map(|(dof, axis)| Mover { dof, axis, through: Some(position) }));
    let root = urdf.links.iter().find(|link| urdf.joints.iter().all(|joint| joint.child.link != link.name));
    let mut pending = vec![(root.expect("a root").name.clone(), rotation, position, movers)];
    while let Some((name, rotation, position, movers)) = pending.pop() {
        let link = urdf.links.iter().find(|link| link.name == name).expect("the link");
        let body = &link.inertial;
        let mass = body.mass.value;
        if mass > 0.0 {
            let own = product(&rotation, &euler(vector(&*body.origin.rpy)));
            let c = plus(position, apply(&rotation, vector(&*body.origin.xyz)));
            let i = &body.inertia;
            let inertia: Matrix =
                [vector(&[i.ixx, i.ixy, i.ixz]), vector(&[i.ixy, i.iyy, i.iyz]), vector(&[i.ixz, i.iyz, i.izz])];
            // ω from dR/dt = ω× R.
            let spin_matrix = product(&own.map(|row| row.map(Jet::differentiated)), &transposed(&own));
            let spin = [spin_matrix[2][1], spin_matrix[0][2], spin_matrix[1][0]];
            let momentum = apply(&own, apply(&inertia, apply(&transposed(&own), spin)));
            for mover in &movers {
                let arm = match mover.through {
                    Some(point) => cross(mover.axis, plus(c, point.map(|x| -x))),
                    None => mover.axis,
                };
                for k in 0..3 {
                    let lifted = c[k].second_rate() + Dual(-gravity[k], 0.0);
                    tau[mover.dof] = tau[mover.dof] + Dual(mass, 0.0) * lifted * arm[k].0[0];
                    if mover.through.is_some() {
                        tau[mover.dof] = tau[mover.dof] + momentum[k].rate() * mover.axis[k].0[0];
                    }
                }
            }
        }
        for joint in urdf.joints.iter().filter(|joint| joint.parent.link == name) {
            let place = plus(position, apply(&rotation, vector(&*joint.origin.xyz)));
            let mut turned = product(&rotation, &euler(vector(&*joint.origin.rpy)));
            let mut movers = movers.clone();
            if joint.joint_type != urdf_rs::JointType::Fixed {
                let dof = names.iter().position(|known| *known == joint.name).expect("the joint");
                movers.push(Mover { dof, axis: apply(&turned, vector(&*joint.axis.xyz)), through: Some(place) });
                turned = product(&turned, &turn(&joint.axis.xyz, q[dof]));
            }
            pending.push((joint.child.link.clone(), turned, place, movers));
        }
    }
    tau
}

#[test]
fn derivatives_are_those_of_dual_numbers() {
    let mut model = vision60();
    model.gravity = nalgebra::Vector3::new(0.8, -0.5, -9.6);
    let urdf = urdf_rs::read_from_string(VISION60).expect("the project's own robot reads");
    let names = model.joint_names().to_vec();
    let mut data = Data::new(&model);
    let mut random = Random(12);
    for _ in 0..5 {
        let s = random_state(&model, &mut random);
        rnea_derivatives(&model, &mut data, &s.q, &s.v, &s.a, &[]);
        for (kind, matrix) in [&data.dtau_dq, &data.dtau_dv, &data.mass_matrix].into_iter().enumerate() {
            for direction in 0..18 {
                let q: Vec<Jet> = (0..18)
                    .map(|i| {
                        let seed = |of: usize| if of == kind && i == direction { 1.0 } else { 0.0 };
                        Jet([Dual(s.q[i], seed(0)), Dual(s.v[i], seed(1)), Dual(0.5 * s.a[i], 0.5 * seed(2))])
                    })
                    .collect();
                let expected = inverse_dynamics(&urdf, &names, &q, &model.gravity.into());
                let values: Vec<f64> = expected.iter().map(|x| x.0).collect();
                let slopes: Vec<f64> = expected.iter().map(|x| x.1).collect();
                assert!(relative_error(&data.tau, &values) < 1e-12, "τ: {:e}", relative_error(&data.tau, &values));
                let column = matrix.column(direction).into_owned();
                let error = relative_error(&column, &slopes);
                assert!(error < 1e-12, "kind {kind}, direction {direction}: {error:e}");
            }
        }
    }
}
