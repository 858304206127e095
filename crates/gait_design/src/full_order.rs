//! The same program without the decomposition: the whole robot's 18 coordinates at every point, a polynomial for each
//! of its twelve joints, the full-order dynamics (paper eq. 1), the same cost, limits and points. It is there to be
//! compared with ([`plan_full_order`]). The rear legs are not tied to the front ones by a pairing, so its optimum can
//! only be lower; for the Vision 60's gaits it costs about half.
//!
//! Robots whose rear legs cannot do as the front ones across do ([`Robot::rear_offset_rad`]), with knees that point
//! apart for example, need it, and three kinds of request. On a sideways slope, and with a torso that leans to a side,
//! a step's mirror image is no step: two steps are planned, each with its own polynomials and stance toes, joined by q
//! and q̇ at the first switch and closed over the stride. And the reference may be planned inside the program
//! ([`Reference::InProgram`]): the polynomials are then what the tracking law follows, its torque stands in place of y
//! = 0, and the joints are where that leads them.
//!
//! Redundant rows are left out as in [`crate::DecomposedProgram`]; without the pairing all six rows of a soft touchdown
//! count.

use crate::Reference;
use crate::program::{DecomposedProgram, Places, ProgramSettings, STANCE_ROLL, Sink, ValuesSink, three};
use crate::recompose::PlanPoint;
use crate::request::GaitRequest;
use gait::{Coefficients, JOINTS, bezier};
use nlp::{Bounds, Evaluation, Pattern, Problem};
use rigid_body::{Data, last_point_kinematics, last_point_kinematics_derivatives, rnea, rnea_derivatives};
use robot::Robot;

mod plan;
mod start;

pub use plan::plan_full_order;

const DOF: usize = 18;
/// Room for the unknowns that meet once the equalities are eliminated.
const SHARED: usize = 96;
const COEFFICIENTS: usize = bezier::DEGREE + 1;
/// Stance and swing legs of the first step; the second step's are their mirror images.
const STANCE: [usize; 2] = [1, 2];
const SWING: [usize; 2] = [0, 3];
/// The stance hip roll whose ÿ row the fixed distance of the stance toes makes redundant: leg 2's.
const LEG_2_ROLL: usize = 6;

/// Where a point's unknowns lie within it.
mod at {
    use super::{DOF, JOINTS};
    pub const Q: usize = 0;
    pub const V: usize = Q + DOF;
    pub const A: usize = V + DOF;
    pub const U: usize = A + DOF;
    pub const LAMBDA: usize = U + JOINTS;
    pub const POINT: usize = LAMBDA + 6;
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
    /// Stance toes on the floor, their distance; then, where the joints are prescribed, y = ẏ = 0.
    pub const FLOOR: usize = 3;
    /// q, q̇ at a switch, and the soft touchdown.
    pub const SWITCH: usize = 42;
    /// Over a stride: the body's y and yaw are opposite at the two switches, as the mirror makes them.
    pub const CENTRED: [usize; 2] = [1, 5];
}

/// Where unknowns and rows lie. Points are counted through both steps: a switch has two, the last of one step and the
/// first of the next.
#[derive(Clone, Copy)]
struct Layout {
    /// 1: a step and its mirror image; 2: a stride.
    steps: usize,
    /// Points of a step.
    points: usize,
    /// Whether the polynomials are the joints' own, and not the reference that they follow.
    joints_prescribed: bool,
}

impl Layout {
    fn alpha(&self, step: usize, k: usize, joint: usize) -> usize {
        (step * COEFFICIENTS + k) * JOINTS + joint
    }
    fn t(&self) -> usize {
        self.steps * COEFFICIENTS * JOINTS
    }
    fn all_points(&self) -> usize {
        self.steps * self.points
    }
    /// Start of a point's unknowns.
    fn point(&self, index: usize) -> usize {
        self.t() + 1 + at::POINT * index
    }
    fn phase(&self, index: usize) -> f64 {
        (index % self.points) as f64 / (self.points - 1) as f64
    }
    /// First row of a Hermite–Simpson interval, counted through both steps.
    fn interval(&self, index: usize) -> usize {
        rows::COUNT * self.all_points() + rows::INTERVAL * index
    }
    fn intervals(&self) -> usize {
        self.steps * (self.points / 2)
    }
    /// The three points of an interval.
    fn points_of(&self, interval: usize) -> [usize; 3] {
        let (step, inside) = (interval / (self.points / 2), interval % (self.points / 2));
        std::array::from_fn(|k| step * self.points + 2 * inside + k)
    }
    fn first_rows(&self) -> usize {
        rows::FLOOR + if self.joints_prescribed { 2 * JOINTS } else { 0 }
    }
    /// First row of what holds where a step begins.
    fn first(&self, step: usize) -> usize {
        self.interval(self.intervals()) + self.first_rows() * step
    }
    /// First row of what holds where a step ends.
    fn switch(&self, step: usize) -> usize {
        self.first(self.steps) + rows::SWITCH * step
    }
    fn rows(&self) -> usize {
        self.switch(self.steps) + if self.steps == 2 { rows::CENTRED.len() } else { 0 }
    }
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
    layout: Layout,
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
    /// Builds the program, with the bounds of the decomposed one: of a stride on a sideways slope, of a step elsewhere.
    /// `robot` is [`crate::on_slope`]'s; the request has been validated.
    pub fn new(
        robot: &Robot,
        request: &GaitRequest,
        settings: &ProgramSettings,
        decomposed: &DecomposedProgram,
        reference: Reference,
    ) -> Self {
        let layout = Layout {
            steps: if request.is_mirrored() { 1 } else { 2 },
            points: settings.points,
            joints_prescribed: reference != Reference::InProgram,
        };
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
            layout,
            data: Data::new(&robot.model),
            points: vec![point; layout.all_points()],
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
        for p in 0..layout.all_points() {
            let p = layout.point(p);
            let centre = |i| if i == 0 { request.speed_m_s } else { 0.0 };
            program.weights.extend((0..6).map(|i| (p + at::V + i, 1.0, centre(i))));
            // The decomposed program weighs the front biped's accelerations only; the same here.
            let front = (0..9).chain(12..15);
            program.weights.extend(front.map(|i| (p + at::A + i, settings.acceleration_weight, 0.0)));
            program.weights.extend((0..JOINTS).map(|j| (p + at::U + j, settings.torque_weight, 0.0)));
        }
        program.lean(request);
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
        /// How far a reference may be outside a joint's range, rad: torque over stiffness, and half as much again.
        const REFERENCE_SPARE_RAD: f64 = 0.4;
        let from = decomposed.bounds();
        let layout = self.layout;
        let last = layout.points - 1;
        let robot = &self.robot;
        let mut variables = [vec![], vec![]];
        for (side, bound) in variables.iter_mut().zip([&from.variable_lower, &from.variable_upper]) {
            let lower = std::ptr::eq(bound, &from.variable_lower);
            let outward = if lower { -1.0 } else { 1.0 };
            let range = |joint: usize| {
                let leg = &robot.legs[joint / 3];
                if lower { leg.position_min_rad[joint % 3] } else { leg.position_max_rad[joint % 3] }
            };
            let reference = if layout.joints_prescribed { 0.0 } else { REFERENCE_SPARE_RAD };
            let spare = |joint: usize| ([0.0, 0.3, 0.3][joint % 3] + reference) * outward;
            for _ in 0..layout.steps * COEFFICIENTS {
                side.extend((0..JOINTS).map(|j| range(j) + spare(j)));
            }
            side.push(bound[d::T]);
            // The first step's last point has the room of any point but the first, whose x is 0.
            let reach = bound[d::point(last) + d::Q];
            for index in 0..layout.all_points() {
                let (step, p) = (index / layout.points, index % layout.points);
                let b = &bound[d::point(p)..d::point(p + 1)];
                side.push(if step == 0 { b[d::Q] } else { 2.0 * reach });
                side.extend_from_slice(&b[d::Q + 1..d::Q + 6]);
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
            for index in 0..layout.all_points() {
                let (step, p) = (index / layout.points, index % layout.points);
                let b = &bound[d_rows::COUNT * p..d_rows::COUNT * (p + 1)];
                let mut own = [0.0; rows::COUNT];
                if layout.joints_prescribed {
                    own[rows::OUTPUT + self.stance_roll(step)] = b[d_rows::OUTPUT + STANCE_ROLL];
                }
                own[rows::FRICTION..rows::SWING].copy_from_slice(&b[d_rows::FRICTION..d_rows::SWING]);
                own[rows::SWING..].copy_from_slice(&b[d_rows::SWING..d_rows::SWING + 2]);
                side.extend_from_slice(&own);
            }
            side.resize(layout.rows(), 0.0);
            for step in 0..layout.steps {
                side[layout.first(step) + 2] = bound[decomposed.start_of_first() + d_rows::FIRST - 1];
            }
        }
        [self.bounds.variable_lower, self.bounds.variable_upper] = variables;
        [self.bounds.constraint_lower, self.bounds.constraint_upper] = constraints;
    }

    /// Holds the torso at the angles asked for, where they are not 0.
    fn lean(&mut self, request: &GaitRequest) {
        /// How far from its angle a leaning torso may sway, rad, and the cost of it, 1/rad².
        const SWAY_RAD: f64 = 0.05;
        const WEIGHT: f64 = 1.0;
        for (coordinate, angle) in [(3, request.torso_roll_rad), (4, request.torso_pitch_rad)] {
            if angle == 0.0 {
                continue;
            }
            for index in 0..self.layout.all_points() {
                let i = self.layout.point(index) + at::Q + coordinate;
                (self.bounds.variable_lower[i], self.bounds.variable_upper[i]) = (angle - SWAY_RAD, angle + SWAY_RAD);
                self.weights.push((i, WEIGHT, angle));
            }
        }
    }

    /// The leg that does in `step` what `leg` does in the first.
    fn leg(&self, step: usize, leg: usize) -> usize {
        if step == 0 { leg } else { self.robot.mirror.leg[leg] }
    }

    fn stance(&self, step: usize) -> [usize; 2] {
        STANCE.map(|leg| self.leg(step, leg))
    }

    fn swing(&self, step: usize) -> [usize; 2] {
        SWING.map(|leg| self.leg(step, leg))
    }

    /// The stance hip roll whose ÿ row is redundant.
    fn stance_roll(&self, step: usize) -> usize {
        3 * self.leg(step, LEG_2_ROLL / 3)
    }

    /// The tracking law's gains of a joint.
    fn gains(&self, joint: usize) -> (f64, f64) {
        let gains = &self.robot.gains;
        (gains.kp_nm_per_rad[joint % 3], gains.kd_nm_s_per_rad[joint % 3])
    }

    /// What follows coordinate `i` of the end of `step`: which coordinate of which point, and with which sign.
    fn next(&self, step: usize, i: usize) -> (usize, usize, f64) {
        if self.layout.steps == 1 {
            let (from, sign) = self.robot.mirror.coordinate_source(i);
            (0, from, sign)
        } else {
            ((step + 1) % self.layout.steps * self.layout.points, i, 1.0)
        }
    }

    fn objective(&self, x: &[f64]) -> f64 {
        self.weights.iter().map(|&(i, weight, centre)| weight * (x[i] - centre).powi(2)).sum()
    }

    fn constraints(&mut self, x: &[f64], g: &mut [f64]) {
        let layout = self.layout;
        let t = x[layout.t()];
        for index in 0..layout.all_points() {
            let step = index / layout.points;
            let (stance, swing) = (self.stance(step), self.swing(step));
            let model = &self.robot.model;
            let p = &x[layout.point(index)..layout.point(index + 1)];
            let l = [three(p, at::LAMBDA), three(p, at::LAMBDA + 3)];
            let forces = [(self.robot.legs[stance[0]].toe, l[0]), (self.robot.legs[stance[1]].toe, l[1])];
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
            let point = &self.points[index];
            let g = &mut g[rows::COUNT * index..rows::COUNT * (index + 1)];
            let phase = layout.phase(index);
            for i in 0..DOF {
                g[rows::DYNAMICS + i] = point.tau[i] - if i < 6 { 0.0 } else { p[at::U + i - 6] };
            }
            for j in 0..JOINTS {
                let polynomial = |basis: Coefficients| -> f64 {
                    (0..COEFFICIENTS).map(|k| x[layout.alpha(step, k, j)] * basis[k]).sum()
                };
                g[rows::OUTPUT + j] = if layout.joints_prescribed {
                    t * t * a[6 + j] - polynomial(bezier::basis_second_derivative(phase))
                } else {
                    // T / kp times (u − kp (B − q) − kd (Ḃ − q̇)).
                    let (kp, kd) = self.gains(j);
                    let (value, slope) =
                        (polynomial(bezier::basis(phase)), polynomial(bezier::basis_first_derivative(phase)));
                    t * (p[at::U + j] / kp - value + q[6 + j]) - kd / kp * (slope - t * v[6 + j])
                };
            }
            for (k, leg) in stance.into_iter().enumerate() {
                for axis in 0..3 {
                    g[rows::STANCE + 3 * k + axis] = point.toes[leg].acceleration[axis];
                }
                for axis in 0..2 {
                    let row = rows::FRICTION + 4 * k + 2 * axis;
                    g[row] = self.friction_face * l[k][2] - l[k][axis];
                    g[row + 1] = self.friction_face * l[k][2] + l[k][axis];
                }
            }
            for (k, leg) in swing.into_iter().enumerate() {
                g[rows::SWING + k] = point.toes[leg].position.z;
            }
        }
        let h = 2.0 * t / (layout.points - 1) as f64;
        for interval in 0..layout.intervals() {
            let p: [&[f64]; 3] =
                layout.points_of(interval).map(|index| &x[layout.point(index)..layout.point(index + 1)]);
            let g = &mut g[layout.interval(interval)..layout.interval(interval + 1)];
            for (block, (value, slope)) in [(at::Q, at::V), (at::V, at::A)].into_iter().enumerate() {
                for i in 0..DOF {
                    let [x0, x1, x2] = p.map(|p| p[value + i]);
                    let [f0, f1, f2] = p.map(|p| p[slope + i]);
                    g[2 * DOF * block + i] = x1 - (x0 + x2) / 2.0 - h / 8.0 * (f0 - f2);
                    g[2 * DOF * block + DOF + i] = x2 - x0 - h / 6.0 * (f0 + 4.0 * f1 + f2);
                }
            }
        }
        for step in 0..layout.steps {
            let start = layout.first(step);
            let index = step * layout.points;
            let toes = &self.points[index].toes;
            let [a, b] = self.stance(step);
            g[start] = toes[a].position.z;
            g[start + 1] = toes[b].position.z;
            g[start + 2] = (toes[b].position - toes[a].position).norm_squared();
            if layout.joints_prescribed {
                let first = &x[layout.point(index)..layout.point(index + 1)];
                let (value, slope) = (bezier::basis(0.0), bezier::basis_first_derivative(0.0));
                let start = start + rows::FLOOR;
                for j in 0..JOINTS {
                    let sum = |basis: &Coefficients| {
                        (0..COEFFICIENTS).map(|k| x[layout.alpha(step, k, j)] * basis[k]).sum::<f64>()
                    };
                    g[start + j] = first[at::Q + 6 + j] - sum(&value);
                    g[start + JOINTS + j] = t * first[at::V + 6 + j] - sum(&slope);
                }
            }
        }
        for step in 0..layout.steps {
            let start = layout.switch(step);
            let last = (step + 1) * layout.points - 1;
            let end = &x[layout.point(last)..layout.point(last + 1)];
            for i in 0..DOF {
                let (index, from, sign) = self.next(step, i);
                let next = &x[layout.point(index)..];
                g[start + i] = end[at::Q + i] - sign * next[at::Q + from];
                g[start + DOF + i] = sign * next[at::V + from] - end[at::V + i];
            }
            // The world moves back by a step, or by a stride where it is closed over two.
            if step + 1 == layout.steps {
                g[start] -= self.speed_m_s * t * layout.steps as f64;
            }
            for (k, leg) in self.swing(step).into_iter().enumerate() {
                for axis in 0..3 {
                    g[start + 2 * DOF + 3 * k + axis] = self.points[last].toes[leg].velocity[axis];
                }
            }
        }
        if layout.steps == 2 {
            for (k, i) in rows::CENTRED.into_iter().enumerate() {
                g[layout.switch(2) + k] = x[layout.point(0) + at::Q + i] + x[layout.point(layout.points) + at::Q + i];
            }
        }
    }

    /// Derivatives at the point of the last call of [`Self::constraints`] with derivatives.
    fn derivatives(&self, x: &[f64], sink: &mut impl Sink) {
        let layout = self.layout;
        let t = x[layout.t()];
        let own = |leg: usize| (0..6).chain(6 + 3 * leg..9 + 3 * leg);
        for (index, point) in self.points.iter().enumerate() {
            let (r, p) = (rows::COUNT * index, layout.point(index));
            let step = index / layout.points;
            let phase = layout.phase(index);
            let bases =
                [bezier::basis(phase), bezier::basis_first_derivative(phase), bezier::basis_second_derivative(phase)];
            for i in 0..DOF {
                for c in 0..DOF {
                    // Two legs meet only in the base.
                    if i < 6 || c < 6 || (i - 6) / 3 == (c - 6) / 3 {
                        sink.put(r + i, p + at::Q + c, point.dtau_dq[(i, c)]);
                        sink.put(r + i, p + at::V + c, point.dtau_dv[(i, c)]);
                        sink.put(r + i, p + at::A + c, point.mass[(i, c)]);
                    }
                }
                for (k, leg) in self.stance(step).into_iter().enumerate() {
                    if i < 6 || (i - 6) / 3 == leg {
                        for axis in 0..3 {
                            sink.put(r + i, p + at::LAMBDA + 3 * k + axis, -point.toes[leg].jacobian[(axis, i)]);
                        }
                    }
                }
            }
            for j in 0..JOINTS {
                sink.put(r + 6 + j, p + at::U + j, -1.0);
                let row = r + rows::OUTPUT + j;
                if layout.joints_prescribed {
                    sink.put(row, p + at::A + 6 + j, t * t);
                    sink.put(row, layout.t(), 2.0 * t * x[p + at::A + 6 + j]);
                    for k in 0..COEFFICIENTS {
                        sink.put(row, layout.alpha(step, k, j), -bases[2][k]);
                    }
                } else {
                    let (kp, kd) = self.gains(j);
                    let value: f64 = (0..COEFFICIENTS).map(|k| x[layout.alpha(step, k, j)] * bases[0][k]).sum();
                    let (u, q, v) = (x[p + at::U + j], x[p + at::Q + 6 + j], x[p + at::V + 6 + j]);
                    sink.put(row, p + at::U + j, t / kp);
                    sink.put(row, p + at::Q + 6 + j, t);
                    sink.put(row, p + at::V + 6 + j, kd / kp * t);
                    sink.put(row, layout.t(), u / kp - value + q + kd / kp * v);
                    for k in 0..COEFFICIENTS {
                        sink.put(row, layout.alpha(step, k, j), -t * bases[0][k] - kd / kp * bases[1][k]);
                    }
                }
            }
            for (k, leg) in self.stance(step).into_iter().enumerate() {
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
            for (k, leg) in self.swing(step).into_iter().enumerate() {
                for c in own(leg).filter(|c| *c >= 2) {
                    sink.put(r + rows::SWING + k, p + at::Q + c, point.toes[leg].jacobian[(2, c)]);
                }
            }
        }
        let per_t = 2.0 / (layout.points - 1) as f64;
        let h = per_t * t;
        for interval in 0..layout.intervals() {
            let p = layout.points_of(interval).map(|index| layout.point(index));
            for (block, (value, slope)) in [(at::Q, at::V), (at::V, at::A)].into_iter().enumerate() {
                for i in 0..DOF {
                    let [f0, f1, f2] = p.map(|p| x[p + slope + i]);
                    let row = layout.interval(interval) + 2 * DOF * block + i;
                    sink.put(row, p[0] + value + i, -0.5);
                    sink.put(row, p[1] + value + i, 1.0);
                    sink.put(row, p[2] + value + i, -0.5);
                    sink.put(row, p[0] + slope + i, -h / 8.0);
                    sink.put(row, p[2] + slope + i, h / 8.0);
                    sink.put(row, layout.t(), -per_t / 8.0 * (f0 - f2));
                    let row = row + DOF;
                    sink.put(row, p[0] + value + i, -1.0);
                    sink.put(row, p[2] + value + i, 1.0);
                    sink.put(row, p[0] + slope + i, -h / 6.0);
                    sink.put(row, p[1] + slope + i, -4.0 * h / 6.0);
                    sink.put(row, p[2] + slope + i, -h / 6.0);
                    sink.put(row, layout.t(), -per_t / 6.0 * (f0 + 4.0 * f1 + f2));
                }
            }
        }
        for step in 0..layout.steps {
            let start = layout.first(step);
            let (index, p) = (step * layout.points, layout.point(step * layout.points));
            let toes = &self.points[index].toes;
            let [a, b] = self.stance(step);
            for (row, leg) in [(0, a), (1, b)] {
                for c in own(leg).filter(|c| *c >= 2) {
                    sink.put(start + row, p + at::Q + c, toes[leg].jacobian[(2, c)]);
                }
            }
            let between = (toes[b].position - toes[a].position) * 2.0;
            for c in (3..6).chain(6 + 3 * a..9 + 3 * a).chain(6 + 3 * b..9 + 3 * b) {
                let slope = (toes[b].jacobian.column(c) - toes[a].jacobian.column(c)).dot(&between);
                sink.put(start + 2, p + at::Q + c, slope);
            }
            if layout.joints_prescribed {
                let (value, slope) = (bezier::basis(0.0), bezier::basis_first_derivative(0.0));
                let start = start + rows::FLOOR;
                for j in 0..JOINTS {
                    sink.put(start + j, p + at::Q + 6 + j, 1.0);
                    sink.put(start + j, layout.alpha(step, 0, j), -value[0]);
                    let row = start + JOINTS + j;
                    sink.put(row, p + at::V + 6 + j, t);
                    sink.put(row, layout.t(), x[p + at::V + 6 + j]);
                    sink.put(row, layout.alpha(step, 0, j), -slope[0]);
                    sink.put(row, layout.alpha(step, 1, j), -slope[1]);
                }
            }
        }
        for step in 0..layout.steps {
            let start = layout.switch(step);
            let last = (step + 1) * layout.points - 1;
            let e = layout.point(last);
            for i in 0..DOF {
                let (index, from, sign) = self.next(step, i);
                let next = layout.point(index);
                sink.put(start + i, e + at::Q + i, 1.0);
                sink.put(start + i, next + at::Q + from, -sign);
                sink.put(start + DOF + i, e + at::V + i, -1.0);
                sink.put(start + DOF + i, next + at::V + from, sign);
            }
            if step + 1 == layout.steps {
                sink.put(start, layout.t(), -self.speed_m_s * layout.steps as f64);
            }
            for (k, leg) in self.swing(step).into_iter().enumerate() {
                let toe = &self.points[last].toes[leg];
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
        if layout.steps == 2 {
            for (k, i) in rows::CENTRED.into_iter().enumerate() {
                sink.put(layout.switch(2) + k, layout.point(0) + at::Q + i, 1.0);
                sink.put(layout.switch(2) + k, layout.point(layout.points) + at::Q + i, 1.0);
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
        let layout = self.layout;
        let of = |step: usize| if layout.steps == 2 { format!(" of step {}", step + 1) } else { String::new() };
        if row < layout.interval(0) {
            let (index, row) = (row / rows::COUNT, row % rows::COUNT);
            let step = index / layout.points;
            let what = match row {
                rows::DYNAMICS..rows::OUTPUT => format!("dynamics of {}", self.coordinate(row)),
                rows::OUTPUT..rows::STANCE if layout.joints_prescribed => {
                    format!("{} on its polynomial", self.joint(row - rows::OUTPUT))
                }
                rows::OUTPUT..rows::STANCE => format!("tracking law of {}", self.joint(row - rows::OUTPUT)),
                rows::STANCE..rows::FRICTION => {
                    format!("{} at rest", self.toe(self.stance(step)[(row - rows::STANCE) / 3]))
                }
                rows::FRICTION..rows::SWING => {
                    format!("friction of {}", self.toe(self.stance(step)[(row - rows::FRICTION) / 4]))
                }
                _ => format!("height of {}", self.toe(self.swing(step)[row - rows::SWING])),
            };
            return format!("{what}, point {} of {}{}", index % layout.points + 1, layout.points, of(step));
        }
        if row < layout.first(0) {
            let interval = (row - layout.interval(0)) / rows::INTERVAL;
            let step = interval / (layout.points / 2);
            return format!("Hermite–Simpson defect, interval {}{}", interval % (layout.points / 2) + 1, of(step));
        }
        if row < layout.switch(0) {
            let (step, row) =
                ((row - layout.first(0)) / layout.first_rows(), (row - layout.first(0)) % layout.first_rows());
            let what = match row {
                0 | 1 => format!("{} on the floor", self.toe(self.stance(step)[row])),
                2 => "squared distance between the stance toes".into(),
                _ => format!("{} starts on its polynomial", self.joint((row - rows::FLOOR) % JOINTS)),
            };
            return what + &of(step);
        }
        if row >= layout.switch(layout.steps) {
            let i = rows::CENTRED[row - layout.switch(layout.steps)];
            return format!("{} opposite at the two switches", self.coordinate(i));
        }
        let step = (row - layout.switch(0)) / rows::SWITCH;
        let what = match row - layout.switch(step) {
            row @ 0..DOF => format!("periodicity of {}", self.coordinate(row)),
            row if row < 2 * DOF => format!("periodicity of the velocity of {}", self.coordinate(row - DOF)),
            row => format!("soft touchdown of {}", self.toe(self.swing(step)[(row - 2 * DOF) / 3])),
        };
        what + &of(step)
    }

    fn variable_name(&self, column: usize) -> String {
        let layout = self.layout;
        let of = |step: usize| if layout.steps == 2 { format!(" of step {}", step + 1) } else { String::new() };
        if column < layout.t() {
            let (step, k) = (column / JOINTS / COEFFICIENTS, column / JOINTS % COEFFICIENTS);
            return format!("Bézier coefficient {k} of {}{}", self.joint(column % JOINTS), of(step));
        }
        if column == layout.t() {
            return "step duration".into();
        }
        let (index, i) = ((column - layout.point(0)) / at::POINT, (column - layout.point(0)) % at::POINT);
        let step = index / layout.points;
        let what = match i {
            0..at::V => format!("position of {}", self.coordinate(i)),
            at::V..at::A => format!("velocity of {}", self.coordinate(i - at::V)),
            at::A..at::U => format!("acceleration of {}", self.coordinate(i - at::A)),
            at::U..at::LAMBDA => format!("torque of {}", self.joint(i - at::U)),
            _ => format!("force on {}", self.toe(self.stance(step)[(i - at::LAMBDA) / 3])),
        };
        format!("{what}, point {} of {}{}", index % layout.points + 1, layout.points, of(step))
    }
}

/// The program's unknowns for the decomposed program's: the second step, where there is one, is the first one's mirror
/// image.
pub(crate) fn recomposed(full: &FullOrderProgram, program: &DecomposedProgram, x: &[f64]) -> Vec<f64> {
    use crate::program::layout as d;
    let layout = full.layout;
    let pairing = program.bipeds().pairing();
    let mut out = vec![0.0; layout.point(layout.all_points())];
    for k in 0..COEFFICIENTS {
        let mut front = [0.0; 12];
        for j in 0..6 {
            front[6 + j] = x[d::alpha(k, j)];
        }
        let all = pairing.recompose_position(&front);
        out[layout.alpha(0, k, 0)..layout.alpha(0, k + 1, 0)].copy_from_slice(&all[6..]);
    }
    out[layout.t()] = x[d::T];
    for p in 0..layout.points {
        let from = &x[d::point(p)..d::point(p + 1)];
        let twelve = |start: usize| -> [f64; 12] { from[start..start + 12].try_into().expect("twelve entries") };
        let mut to = [0.0; at::POINT];
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
        out[layout.point(p)..layout.point(p + 1)].copy_from_slice(&to);
    }
    full.mirror_second_step(&mut out);
    out
}

impl FullOrderProgram {
    /// Adds the cost of moving the joints otherwise than in `x` (rate), and of holding them elsewhere (position).
    ///
    /// Without the pairing the cheapest gait is one that lets its nose down as far as it may and falls when it is
    /// walked. So the program asks for the motion of the level gait about a posture of its own, which is what a slope
    /// changes.
    fn stay_near(&mut self, x: &[f64]) {
        /// 1/rad² and 1/(rad/s)², chosen by walking the plans in MuJoCo (docs/planning.md).
        const WEIGHTS: [(usize, f64); 2] = [(at::Q, 1e-3), (at::V, 0.1)];
        for index in 0..self.layout.all_points() {
            for (block, weight) in WEIGHTS {
                let start = self.layout.point(index) + block + 6;
                self.weights.extend((start..start + JOINTS).map(|i| (i, weight, x[i])));
            }
        }
        self.hessian = Pattern(self.weights.iter().map(|w| (w.0, w.0)).collect());
    }

    /// The robot at every point of a step.
    fn plan_points(&self, x: &[f64], step: usize) -> Vec<PlanPoint> {
        let layout = self.layout;
        (step * layout.points..(step + 1) * layout.points)
            .map(|index| {
                let p = &x[layout.point(index)..layout.point(index + 1)];
                let eighteen =
                    |start: usize| -> [f64; DOF] { p[start..start + DOF].try_into().expect("eighteen entries") };
                let mut ground_force_n = [[0.0; 3]; 4];
                for (k, leg) in self.stance(step).into_iter().enumerate() {
                    ground_force_n[leg] = three(p, at::LAMBDA + 3 * k).into();
                }
                PlanPoint {
                    phase: layout.phase(index),
                    q: eighteen(at::Q),
                    v: eighteen(at::V),
                    a: eighteen(at::A),
                    torque_nm: p[at::U..at::LAMBDA].try_into().expect("twelve entries"),
                    ground_force_n,
                }
            })
            .collect()
    }
}
