//! The same program without the decomposition: the whole robot's 18 coordinates at every point, a polynomial for each of its twelve
//! joints, the full-order dynamics (paper eq. 1), the same cost, limits and points. It is there to be compared with
//! ([`plan_full_order`]). The rear legs are not tied to the front ones by a pairing, so its optimum can only be lower; for the
//! Vision 60's gaits it costs about half.
//!
//! Redundant rows are left out as in [`crate::DecomposedProgram`]; without the pairing all six rows of the soft touchdown count.

use crate::program::{DecomposedProgram, Places, ProgramSettings, STANCE_ROLL, Sink, ValuesSink, three};
use crate::recompose::{self, PlanPoint};
use crate::request::GaitRequest;
use crate::{Plan, PlanError, PlanOptions, WarmStart, guess, leg_length_m, not_converged, on_slope, program_of};
use gait::{JOINTS, SolverSummary, bezier};
use nlp::{Bounds, Evaluation, Iteration, Pattern, Problem, SqpSolver, Status};
use rigid_body::{Data, last_point_kinematics, last_point_kinematics_derivatives, rnea, rnea_derivatives};
use robot::Robot;
use std::ops::ControlFlow;

const DOF: usize = 18;
const COEFFICIENTS: usize = bezier::DEGREE + 1;
/// Stance and swing legs of the step that is planned.
const STANCE: [usize; 2] = [1, 2];
const SWING: [usize; 2] = [0, 3];
/// The stance hip roll whose ÿ row the fixed distance of the stance toes makes redundant: leg 2's.
const LEG_2_ROLL: usize = 6;

/// Where the unknowns lie.
mod at {
    use super::{COEFFICIENTS, DOF, JOINTS};
    pub const T: usize = JOINTS * COEFFICIENTS;
    pub const POINTS: usize = T + 1;
    pub const Q: usize = 0;
    pub const V: usize = Q + DOF;
    pub const A: usize = V + DOF;
    pub const U: usize = A + DOF;
    pub const LAMBDA: usize = U + JOINTS;
    pub const POINT: usize = LAMBDA + 6;
    pub fn alpha(k: usize, joint: usize) -> usize {
        k * JOINTS + joint
    }
    pub fn point(index: usize) -> usize {
        POINTS + POINT * index
    }
}

/// Rows of a point.
mod rows {
    pub const DYNAMICS: usize = 0;
    pub const OUTPUT: usize = 18;
    pub const STANCE: usize = 30;
    pub const FRICTION: usize = 36;
    pub const SWING: usize = 44;
    pub const COUNT: usize = 46;
    pub const INTERVAL: usize = 72;
    pub const FIRST: usize = 27;
    pub const BOUNDARY: usize = 42;
}

/// A toe's motion with its derivatives.
#[derive(Clone)]
struct Toe {
    position: nalgebra::Vector3<f64>,
    velocity: nalgebra::Vector3<f64>,
    acceleration: nalgebra::Vector3<f64>,
    jacobian: nalgebra::Matrix3xX<f64>,
    dvelocity_dq: nalgebra::Matrix3xX<f64>,
    dacceleration_dq: nalgebra::Matrix3xX<f64>,
    dacceleration_dv: nalgebra::Matrix3xX<f64>,
}

#[derive(Clone)]
struct Point {
    tau: nalgebra::DVector<f64>,
    dtau_dq: nalgebra::DMatrix<f64>,
    dtau_dv: nalgebra::DMatrix<f64>,
    mass: nalgebra::DMatrix<f64>,
    toes: [Toe; 4],
}

/// The full-order program of one request on one robot.
pub struct FullOrderProgram {
    robot: Robot,
    data: Data,
    points: Vec<Point>,
    speed_m_s: f64,
    friction_face: f64,
    bounds: Bounds,
    jacobian: Pattern,
    hessian: Pattern,
    weights: Vec<(usize, f64, f64)>,
    with_derivatives: bool,
}

impl FullOrderProgram {
    /// Builds the program, with the bounds of the decomposed one. `robot` is [`on_slope`]'s; the request has been validated.
    pub fn new(
        robot: &Robot,
        request: &GaitRequest,
        settings: &ProgramSettings,
        decomposed: &DecomposedProgram,
    ) -> Self {
        let toe = Toe {
            position: nalgebra::Vector3::zeros(),
            velocity: nalgebra::Vector3::zeros(),
            acceleration: nalgebra::Vector3::zeros(),
            jacobian: nalgebra::Matrix3xX::zeros(DOF),
            dvelocity_dq: nalgebra::Matrix3xX::zeros(DOF),
            dacceleration_dq: nalgebra::Matrix3xX::zeros(DOF),
            dacceleration_dv: nalgebra::Matrix3xX::zeros(DOF),
        };
        let square = nalgebra::DMatrix::zeros(DOF, DOF);
        let point = Point {
            tau: nalgebra::DVector::zeros(DOF),
            dtau_dq: square.clone(),
            dtau_dv: square.clone(),
            mass: square,
            toes: std::array::from_fn(|_| toe.clone()),
        };
        let none = Vec::new;
        let mut program = Self {
            robot: robot.clone(),
            data: Data::new(&robot.model),
            points: vec![point; settings.points],
            speed_m_s: request.speed_m_s,
            friction_face: request.friction / std::f64::consts::SQRT_2,
            bounds: Bounds {
                variable_lower: none(),
                variable_upper: none(),
                constraint_lower: none(),
                constraint_upper: none(),
            },
            jacobian: Pattern::default(),
            hessian: Pattern::default(),
            weights: Vec::new(),
            with_derivatives: true,
        };
        program.set_bounds(decomposed);
        for p in 0..settings.points {
            let p = at::point(p);
            let centre = |i| if i == 0 { request.speed_m_s } else { 0.0 };
            program.weights.extend((0..6).map(|i| (p + at::V + i, 1.0, centre(i))));
            // The decomposed program weighs the front biped's accelerations only; the same here.
            let front = (0..9).chain(12..15);
            program.weights.extend(front.map(|i| (p + at::A + i, settings.acceleration_weight, 0.0)));
            program.weights.extend((0..JOINTS).map(|j| (p + at::U + j, settings.torque_weight, 0.0)));
        }
        program.hessian = Pattern(program.weights.iter().map(|w| (w.0, w.0)).collect());
        let x = vec![0.0; program.bounds.variable_lower.len()];
        let mut places = Places(Vec::new());
        program.derivatives(&x, &mut places);
        program.jacobian = Pattern(places.0);
        program
    }

    /// Every bound is the decomposed program's: of a joint, of its leg's image in the front biped.
    fn set_bounds(&mut self, decomposed: &DecomposedProgram) {
        use crate::program::{layout as d, rows as d_rows};
        let from = decomposed.bounds();
        let last = self.points.len() - 1;
        let robot = &self.robot;
        let mut variables = [vec![], vec![]];
        for (side, bound) in variables.iter_mut().zip([&from.variable_lower, &from.variable_upper]) {
            let lower = std::ptr::eq(bound, &from.variable_lower);
            let range = |joint: usize| {
                let leg = &robot.legs[joint / 3];
                if lower { leg.position_min_rad[joint % 3] } else { leg.position_max_rad[joint % 3] }
            };
            let spare = |joint: usize| [0.0, 0.3, 0.3][joint % 3] * if lower { -1.0 } else { 1.0 };
            for _ in 0..COEFFICIENTS {
                side.extend((0..JOINTS).map(|j| range(j) + spare(j)));
            }
            side.push(bound[d::T]);
            for p in 0..=last {
                let b = &bound[d::point(p)..d::point(p + 1)];
                side.extend_from_slice(&b[d::Q..d::Q + 6]);
                side.extend((0..JOINTS).map(range));
                for start in [d::V, d::A] {
                    side.extend_from_slice(&b[start..start + 6]);
                    side.extend((0..JOINTS).map(|j| b[start + 6 + j % 3]));
                }
                side.extend((0..JOINTS).map(|j| b[d::U_FRONT + j % 3]));
                side.extend_from_slice(&b[d::LAMBDA_1..d::LAMBDA_1 + 6]);
            }
        }
        let mut constraints = [vec![], vec![]];
        for (side, bound) in constraints.iter_mut().zip([&from.constraint_lower, &from.constraint_upper]) {
            for p in 0..=last {
                let b = &bound[d_rows::COUNT * p..d_rows::COUNT * (p + 1)];
                let mut own = [0.0; rows::COUNT];
                own[rows::OUTPUT + LEG_2_ROLL] = b[d_rows::OUTPUT + STANCE_ROLL];
                own[rows::FRICTION..rows::SWING].copy_from_slice(&b[d_rows::FRICTION..d_rows::SWING]);
                own[rows::SWING..].copy_from_slice(&b[d_rows::SWING..d_rows::SWING + 2]);
                side.extend_from_slice(&own);
            }
            side.extend(std::iter::repeat_n(0.0, rows::INTERVAL * (last / 2) + rows::FIRST - 1));
            side.push(bound[decomposed.start_of_first() + d_rows::FIRST - 1]);
            side.extend([0.0; rows::BOUNDARY]);
        }
        [self.bounds.variable_lower, self.bounds.variable_upper] = variables;
        [self.bounds.constraint_lower, self.bounds.constraint_upper] = constraints;
    }

    fn phase(&self, point: usize) -> f64 {
        point as f64 / (self.points.len() - 1) as f64
    }

    fn start_of_intervals(&self) -> usize {
        rows::COUNT * self.points.len()
    }

    fn start_of_first(&self) -> usize {
        self.start_of_intervals() + rows::INTERVAL * (self.points.len() / 2)
    }

    fn start_of_boundary(&self) -> usize {
        self.start_of_first() + rows::FIRST
    }

    /// Coordinate `i` of the mirrored robot: from which coordinate and with which sign.
    fn mirror(&self, i: usize) -> (usize, f64) {
        if i < 6 {
            return (i, robot::Mirror::BASE_SIGN[i]);
        }
        let (leg, joint) = ((i - 6) / 3, (i - 6) % 3);
        (6 + 3 * self.robot.mirror.leg[leg] + joint, self.robot.mirror.joint_sign[joint])
    }

    fn objective(&self, x: &[f64]) -> f64 {
        self.weights.iter().map(|&(i, weight, centre)| weight * (x[i] - centre).powi(2)).sum()
    }

    fn constraints(&mut self, x: &[f64], g: &mut [f64]) {
        let t = x[at::T];
        let model = &self.robot.model;
        let count = self.points.len();
        for index in 0..count {
            let p = &x[at::point(index)..at::point(index + 1)];
            let l = [three(p, at::LAMBDA), three(p, at::LAMBDA + 3)];
            let forces = [(self.robot.legs[STANCE[0]].toe, l[0]), (self.robot.legs[STANCE[1]].toe, l[1])];
            let (q, v, a) = (&p[at::Q..at::V], &p[at::V..at::A], &p[at::A..at::U]);
            let point = &mut self.points[index];
            if self.with_derivatives {
                rnea_derivatives(model, &mut self.data, q, v, a, &forces);
                point.dtau_dq.copy_from(&self.data.dtau_dq);
                point.dtau_dv.copy_from(&self.data.dtau_dv);
                point.mass.copy_from(&self.data.mass_matrix);
                point.tau.copy_from(&self.data.tau);
            } else {
                point.tau.copy_from(rnea(model, &mut self.data, q, v, a, &forces));
            }
            for (leg, toe) in point.toes.iter_mut().enumerate() {
                let frame = self.robot.legs[leg].toe;
                let k = if self.with_derivatives {
                    last_point_kinematics_derivatives(model, &mut self.data, frame)
                } else {
                    last_point_kinematics(model, &mut self.data, frame)
                };
                (toe.position, toe.velocity, toe.acceleration) = (k.position, k.velocity, k.acceleration);
                if self.with_derivatives {
                    toe.jacobian.copy_from(&k.jacobian);
                    toe.dvelocity_dq.copy_from(&k.dvelocity_dq);
                    toe.dacceleration_dq.copy_from(&k.dacceleration_dq);
                    toe.dacceleration_dv.copy_from(&k.dacceleration_dv);
                }
            }
            let g = &mut g[rows::COUNT * index..rows::COUNT * (index + 1)];
            let second = bezier::basis_second_derivative(index as f64 / (count - 1) as f64);
            for i in 0..DOF {
                g[rows::DYNAMICS + i] = point.tau[i] - if i < 6 { 0.0 } else { p[at::U + i - 6] };
            }
            for j in 0..JOINTS {
                let polynomial: f64 = (0..COEFFICIENTS).map(|k| x[at::alpha(k, j)] * second[k]).sum();
                g[rows::OUTPUT + j] = t * t * a[6 + j] - polynomial;
            }
            for (k, leg) in STANCE.into_iter().enumerate() {
                for axis in 0..3 {
                    g[rows::STANCE + 3 * k + axis] = point.toes[leg].acceleration[axis];
                }
                for axis in 0..2 {
                    let row = rows::FRICTION + 4 * k + 2 * axis;
                    g[row] = self.friction_face * l[k][2] - l[k][axis];
                    g[row + 1] = self.friction_face * l[k][2] + l[k][axis];
                }
            }
            for (k, leg) in SWING.into_iter().enumerate() {
                g[rows::SWING + k] = point.toes[leg].position.z;
            }
        }
        let start = self.start_of_intervals();
        let h = 2.0 * t / (count - 1) as f64;
        for interval in 0..count / 2 {
            let p: [&[f64]; 3] =
                std::array::from_fn(|k| &x[at::point(2 * interval + k)..at::point(2 * interval + k + 1)]);
            let g = &mut g[start + rows::INTERVAL * interval..start + rows::INTERVAL * (interval + 1)];
            for (block, (value, slope)) in [(at::Q, at::V), (at::V, at::A)].into_iter().enumerate() {
                for i in 0..DOF {
                    let [x0, x1, x2] = p.map(|p| p[value + i]);
                    let [f0, f1, f2] = p.map(|p| p[slope + i]);
                    g[2 * DOF * block + i] = x1 - (x0 + x2) / 2.0 - h / 8.0 * (f0 - f2);
                    g[2 * DOF * block + DOF + i] = x2 - x0 - h / 6.0 * (f0 + 4.0 * f1 + f2);
                }
            }
        }
        let start = self.start_of_first();
        let first = &x[at::point(0)..at::point(1)];
        let (value, slope) = (bezier::basis(0.0), bezier::basis_first_derivative(0.0));
        for j in 0..JOINTS {
            let sum = |basis: &[f64; 6]| (0..COEFFICIENTS).map(|k| x[at::alpha(k, j)] * basis[k]).sum::<f64>();
            g[start + j] = first[at::Q + 6 + j] - sum(&value);
            g[start + JOINTS + j] = t * first[at::V + 6 + j] - sum(&slope);
        }
        let toes = &self.points[0].toes;
        g[start + 24] = toes[1].position.z;
        g[start + 25] = toes[2].position.z;
        g[start + 26] = (toes[2].position - toes[1].position).norm_squared();
        let start = self.start_of_boundary();
        let end = &x[at::point(count - 1)..];
        for i in 0..DOF {
            let (from, sign) = self.mirror(i);
            g[start + i] = end[at::Q + i] - sign * first[at::Q + from];
            g[start + DOF + i] = sign * first[at::V + from] - end[at::V + i];
        }
        g[start] -= self.speed_m_s * t;
        for (k, leg) in SWING.into_iter().enumerate() {
            for axis in 0..3 {
                g[start + 2 * DOF + 3 * k + axis] = self.points[count - 1].toes[leg].velocity[axis];
            }
        }
    }

    /// Derivatives at the point of the last call of [`Self::constraints`] with derivatives.
    fn derivatives(&self, x: &[f64], sink: &mut impl Sink) {
        let t = x[at::T];
        let count = self.points.len();
        let own = |leg: usize| (0..6).chain(6 + 3 * leg..9 + 3 * leg);
        for (index, point) in self.points.iter().enumerate() {
            let (r, p) = (rows::COUNT * index, at::point(index));
            let second = bezier::basis_second_derivative(self.phase(index));
            for i in 0..DOF {
                for c in 0..DOF {
                    // Two legs meet only in the base.
                    if i < 6 || c < 6 || (i - 6) / 3 == (c - 6) / 3 {
                        sink.put(r + i, p + at::Q + c, point.dtau_dq[(i, c)]);
                        sink.put(r + i, p + at::V + c, point.dtau_dv[(i, c)]);
                        sink.put(r + i, p + at::A + c, point.mass[(i, c)]);
                    }
                }
                for (k, leg) in STANCE.into_iter().enumerate() {
                    if i < 6 || (i - 6) / 3 == leg {
                        for axis in 0..3 {
                            sink.put(r + i, p + at::LAMBDA + 3 * k + axis, -point.toes[leg].jacobian[(axis, i)]);
                        }
                    }
                }
            }
            for j in 0..JOINTS {
                sink.put(r + 6 + j, p + at::U + j, -1.0);
                sink.put(r + rows::OUTPUT + j, p + at::A + 6 + j, t * t);
                sink.put(r + rows::OUTPUT + j, at::T, 2.0 * t * x[p + at::A + 6 + j]);
                for k in 0..COEFFICIENTS {
                    sink.put(r + rows::OUTPUT + j, at::alpha(k, j), -second[k]);
                }
            }
            for (k, leg) in STANCE.into_iter().enumerate() {
                let toe = &point.toes[leg];
                for axis in 0..3 {
                    let row = r + rows::STANCE + 3 * k + axis;
                    for c in own(leg) {
                        if c >= 3 {
                            sink.put(row, p + at::Q + c, toe.dacceleration_dq[(axis, c)]);
                            sink.put(row, p + at::V + c, toe.dacceleration_dv[(axis, c)]);
                        }
                        if c >= 3 || c == axis {
                            sink.put(row, p + at::A + c, toe.jacobian[(axis, c)]);
                        }
                    }
                }
                for axis in 0..2 {
                    for (side, sign) in [-1.0, 1.0].into_iter().enumerate() {
                        let row = r + rows::FRICTION + 4 * k + 2 * axis + side;
                        sink.put(row, p + at::LAMBDA + 3 * k + 2, self.friction_face);
                        sink.put(row, p + at::LAMBDA + 3 * k + axis, sign);
                    }
                }
            }
            for (k, leg) in SWING.into_iter().enumerate() {
                for c in own(leg).filter(|c| *c >= 2) {
                    sink.put(r + rows::SWING + k, p + at::Q + c, point.toes[leg].jacobian[(2, c)]);
                }
            }
        }
        let start = self.start_of_intervals();
        let per_t = 2.0 / (count - 1) as f64;
        let h = per_t * t;
        for interval in 0..count / 2 {
            let p: [usize; 3] = std::array::from_fn(|k| at::point(2 * interval + k));
            for (block, (value, slope)) in [(at::Q, at::V), (at::V, at::A)].into_iter().enumerate() {
                for i in 0..DOF {
                    let [f0, f1, f2] = p.map(|p| x[p + slope + i]);
                    let row = start + rows::INTERVAL * interval + 2 * DOF * block + i;
                    sink.put(row, p[0] + value + i, -0.5);
                    sink.put(row, p[1] + value + i, 1.0);
                    sink.put(row, p[2] + value + i, -0.5);
                    sink.put(row, p[0] + slope + i, -h / 8.0);
                    sink.put(row, p[2] + slope + i, h / 8.0);
                    sink.put(row, at::T, -per_t / 8.0 * (f0 - f2));
                    let row = row + DOF;
                    sink.put(row, p[0] + value + i, -1.0);
                    sink.put(row, p[2] + value + i, 1.0);
                    sink.put(row, p[0] + slope + i, -h / 6.0);
                    sink.put(row, p[1] + slope + i, -4.0 * h / 6.0);
                    sink.put(row, p[2] + slope + i, -h / 6.0);
                    sink.put(row, at::T, -per_t / 6.0 * (f0 + 4.0 * f1 + f2));
                }
            }
        }
        let (start, p) = (self.start_of_first(), at::point(0));
        let (value, slope) = (bezier::basis(0.0), bezier::basis_first_derivative(0.0));
        for j in 0..JOINTS {
            sink.put(start + j, p + at::Q + 6 + j, 1.0);
            sink.put(start + j, at::alpha(0, j), -value[0]);
            let row = start + JOINTS + j;
            sink.put(row, p + at::V + 6 + j, t);
            sink.put(row, at::T, x[p + at::V + 6 + j]);
            sink.put(row, at::alpha(0, j), -slope[0]);
            sink.put(row, at::alpha(1, j), -slope[1]);
        }
        let toes = &self.points[0].toes;
        let between = (toes[2].position - toes[1].position) * 2.0;
        for (row, leg) in [(24, 1), (25, 2)] {
            for c in own(leg).filter(|c| *c >= 2) {
                sink.put(start + row, p + at::Q + c, toes[leg].jacobian[(2, c)]);
            }
        }
        for c in (3..6).chain(9..15) {
            let slope = (toes[2].jacobian.column(c) - toes[1].jacobian.column(c)).dot(&between);
            sink.put(start + 26, p + at::Q + c, slope);
        }
        let (start, e) = (self.start_of_boundary(), at::point(count - 1));
        for i in 0..DOF {
            let (from, sign) = self.mirror(i);
            sink.put(start + i, e + at::Q + i, 1.0);
            sink.put(start + i, p + at::Q + from, -sign);
            sink.put(start + DOF + i, e + at::V + i, -1.0);
            sink.put(start + DOF + i, p + at::V + from, sign);
        }
        sink.put(start, at::T, -self.speed_m_s);
        for (k, leg) in SWING.into_iter().enumerate() {
            let toe = &self.points[count - 1].toes[leg];
            for axis in 0..3 {
                let row = start + 2 * DOF + 3 * k + axis;
                for c in own(leg) {
                    if c >= 3 {
                        sink.put(row, e + at::Q + c, toe.dvelocity_dq[(axis, c)]);
                    }
                    if c >= 3 || c == axis {
                        sink.put(row, e + at::V + c, toe.jacobian[(axis, c)]);
                    }
                }
            }
        }
    }

    fn joint(&self, j: usize) -> String {
        format!("{} {}", self.robot.legs[j / 3].name.replace('_', " "), ["hip roll", "hip pitch", "knee"][j % 3])
    }

    fn coordinate(&self, i: usize) -> String {
        const BASE: [&str; 6] = ["base x", "base y", "base z", "base roll", "base pitch", "base yaw"];
        if i < 6 { BASE[i].into() } else { self.joint(i - 6) }
    }

    fn toe(&self, leg: usize) -> String {
        format!("the {} toe", self.robot.legs[leg].name.replace('_', " "))
    }
}

impl Problem for FullOrderProgram {
    fn bounds(&self) -> &Bounds {
        &self.bounds
    }

    fn jacobian_pattern(&self) -> &Pattern {
        &self.jacobian
    }

    fn hessian_pattern(&self) -> &Pattern {
        &self.hessian
    }

    fn evaluate(&mut self, x: &[f64], evaluation: &mut Evaluation) {
        self.with_derivatives = true;
        self.constraints(x, &mut evaluation.constraints);
        self.derivatives(x, &mut ValuesSink { values: &mut evaluation.jacobian, next: 0 });
        evaluation.objective = self.objective(x);
        evaluation.gradient.fill(0.0);
        for (k, &(i, weight, centre)) in self.weights.iter().enumerate() {
            evaluation.gradient[i] = 2.0 * weight * (x[i] - centre);
            evaluation.hessian[k] = 2.0 * weight;
        }
    }

    fn values(&mut self, x: &[f64], constraints: &mut [f64]) -> f64 {
        self.with_derivatives = false;
        self.constraints(x, constraints);
        self.objective(x)
    }

    fn constraint_name(&self, row: usize) -> String {
        let count = self.points.len();
        if row < self.start_of_intervals() {
            let (point, row) = (row / rows::COUNT, row % rows::COUNT);
            let what = match row {
                rows::DYNAMICS..rows::OUTPUT => format!("dynamics of {}", self.coordinate(row)),
                rows::OUTPUT..rows::STANCE => format!("{} on its polynomial", self.joint(row - rows::OUTPUT)),
                rows::STANCE..rows::FRICTION => format!("{} at rest", self.toe(STANCE[(row - rows::STANCE) / 3])),
                rows::FRICTION..rows::SWING => format!("friction of {}", self.toe(STANCE[(row - rows::FRICTION) / 4])),
                _ => format!("height of {}", self.toe(SWING[row - rows::SWING])),
            };
            return format!("{what}, point {} of {count}", point + 1);
        }
        if row < self.start_of_first() {
            return format!(
                "Hermite–Simpson defect, interval {}",
                (row - self.start_of_intervals()) / rows::INTERVAL + 1
            );
        }
        if row < self.start_of_boundary() {
            return match row - self.start_of_first() {
                row @ 0..24 => format!("{} starts on its polynomial", self.joint(row % JOINTS)),
                24 => format!("{} on the floor", self.toe(1)),
                25 => format!("{} on the floor", self.toe(2)),
                _ => "squared distance between the stance toes".into(),
            };
        }
        match row - self.start_of_boundary() {
            row @ 0..DOF => format!("periodicity of {}", self.coordinate(row)),
            row if row < 2 * DOF => format!("periodicity of the velocity of {}", self.coordinate(row - DOF)),
            row => format!("soft touchdown of {}", self.toe(SWING[(row - 2 * DOF) / 3])),
        }
    }

    fn variable_name(&self, column: usize) -> String {
        if column < at::T {
            return format!("Bézier coefficient {} of {}", column / JOINTS, self.joint(column % JOINTS));
        }
        if column == at::T {
            return "step duration".into();
        }
        let (point, i) = ((column - at::POINTS) / at::POINT, (column - at::POINTS) % at::POINT);
        let what = match i {
            0..at::V => format!("position of {}", self.coordinate(i)),
            at::V..at::A => format!("velocity of {}", self.coordinate(i - at::V)),
            at::A..at::U => format!("acceleration of {}", self.coordinate(i - at::A)),
            at::U..at::LAMBDA => format!("torque of {}", self.joint(i - at::U)),
            _ => format!("force on {}", self.toe(STANCE[(i - at::LAMBDA) / 3])),
        };
        format!("{what}, point {} of {}", point + 1, self.points.len())
    }
}

/// The full-order program's unknowns for the decomposed program's.
pub(crate) fn recomposed(program: &DecomposedProgram, x: &[f64]) -> Vec<f64> {
    use crate::program::layout as d;
    let pairing = program.bipeds().pairing();
    let mut out = vec![0.0; at::point(program.points())];
    for k in 0..COEFFICIENTS {
        let mut front = [0.0; 12];
        for j in 0..6 {
            front[6 + j] = x[d::alpha(k, j)];
        }
        out[at::alpha(k, 0)..at::alpha(k + 1, 0)].copy_from_slice(&pairing.recompose_position(&front)[6..]);
    }
    out[at::T] = x[d::T];
    for p in 0..program.points() {
        let from = &x[d::point(p)..d::point(p + 1)];
        let to = &mut out[at::point(p)..at::point(p + 1)];
        let twelve = |start: usize| -> [f64; 12] { from[start..start + 12].try_into().expect("twelve entries") };
        to[at::Q..at::V].copy_from_slice(&pairing.recompose_position(&twelve(d::Q)));
        to[at::V..at::A].copy_from_slice(&pairing.recompose_rate(&twelve(d::V)));
        to[at::A..at::U].copy_from_slice(&pairing.recompose_rate(&twelve(d::A)));
        for j in 0..3 {
            to[at::U + j] = from[d::U_FRONT + j];
            to[at::U + 3 + j] = from[d::U_REAR + j];
            to[at::U + 6 + j] = from[d::U_FRONT + 3 + j];
            to[at::U + 9 + j] = from[d::U_REAR + 3 + j];
        }
        to[at::LAMBDA..].copy_from_slice(&from[d::LAMBDA_1..d::LAMBDA_1 + 6]);
    }
    out
}

/// Plans by the full-order program, its subproblems by Clarabel, from the decomposed program's guess. `options.subproblem` and
/// `options.warm_start` have no meaning here.
///
/// # Errors
///
/// As [`crate::plan`].
pub fn plan_full_order(
    robot: &Robot,
    request: &GaitRequest,
    options: &PlanOptions,
    progress: impl FnMut(&Iteration) -> ControlFlow<()>,
) -> Result<Plan, PlanError> {
    request.validate(leg_length_m(robot))?;
    let robot = &on_slope(robot, request.slope_rad);
    let mut decomposed = program_of(robot, request, options.program.clone())?;
    let start = guess::nominal(robot, &mut decomposed, request)?;
    let start = recomposed(&decomposed, &start);
    let mut program = FullOrderProgram::new(robot, request, &options.program, &decomposed);
    let solution = SqpSolver::new(options.solver.clone())?.solve(&mut program, &start, progress)?;
    if solution.status != Status::Converged {
        return Err(not_converged(solution));
    }
    let points: Vec<PlanPoint> = (0..program.points.len())
        .map(|index| {
            let p = &solution.x[at::point(index)..at::point(index + 1)];
            let eighteen = |start: usize| -> [f64; DOF] { p[start..start + DOF].try_into().expect("eighteen entries") };
            PlanPoint {
                phase: program.phase(index),
                q: eighteen(at::Q),
                v: eighteen(at::V),
                a: eighteen(at::A),
                torque_nm: p[at::U..at::LAMBDA].try_into().expect("twelve entries"),
                ground_force_n: [[0.0; 3], three(p, at::LAMBDA).into(), three(p, at::LAMBDA + 3).into(), [0.0; 3]],
            }
        })
        .collect();
    let summary = SolverSummary {
        status: solution.status.to_string(),
        iterations: solution.iterations(),
        solve_time_s: 0.0,
        max_violation: solution.worst.amount,
        objective: solution.objective,
    };
    let coefficients = std::array::from_fn(|j| std::array::from_fn(|k| solution.x[at::alpha(k, j)]));
    let gait = recompose::gait(robot, coefficients, solution.x[at::T], request, &points, summary)?;
    Ok(Plan { gait, points, warm_start: WarmStart(Vec::new()), log: solution.log })
}
