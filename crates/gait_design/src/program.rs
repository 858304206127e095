//! The paper's nonlinear program for the front biped (Ma & Ames 2020, section III, eq. (12)), with the corrections of
//! docs/mathematics.md and without its redundant rows.
//!
//! Unknowns: α ∈ R³⁶, T, and at each of the 2N + 1 Hermite–Simpson points q_f, q̇_f, q̈_f ∈ R¹², u_f ∈ R⁶, λ1, λ2 ∈ R³,
//! λc ∈ R⁶ and the rear torques u_r ∈ R⁶ (which the paper leaves unbounded). The impulses are left out: a soft touchdown has
//! none. In the first step, which is the one planned, toes 1 and 2 stand, toes 0 and 3 swing.

use crate::biped::{BipedPair, FRONT_SWING, PointDynamics, REAR_SWING};
use crate::limits::{Limits, ProgramSettings, keeps_stance_roll};
use crate::request::GaitRequest;
pub(crate) use crate::terms::COEFFICIENTS;
use crate::terms::{Rows, Sink};
use gait::bezier;
use nlp::{Bounds, Evaluation, Pattern, Problem};
use robot::Robot;

/// Coordinates of a biped.
pub(crate) const DOF: usize = 12;
/// Outputs of the front biped: its six joints.
pub(crate) const OUTPUTS: usize = 6;

/// Where α, T and the points' quantities lie in the vector of unknowns.
pub(crate) mod layout {
    use super::{COEFFICIENTS, DOF, OUTPUTS};

    pub const T: usize = OUTPUTS * COEFFICIENTS;
    pub const POINTS: usize = T + 1;
    pub const Q: usize = 0;
    pub const V: usize = Q + DOF;
    pub const A: usize = V + DOF;
    pub const U_FRONT: usize = A + DOF;
    pub const LAMBDA_1: usize = U_FRONT + 6;
    pub const LAMBDA_2: usize = LAMBDA_1 + 3;
    pub const LAMBDA_C: usize = LAMBDA_2 + 3;
    pub const U_REAR: usize = LAMBDA_C + 6;
    pub const POINT: usize = U_REAR + 6;

    /// α: coefficient `k` of output `j`.
    pub fn alpha(k: usize, j: usize) -> usize {
        k * OUTPUTS + j
    }

    /// Start of a point's unknowns.
    pub fn point(index: usize) -> usize {
        POINTS + POINT * index
    }
}
use layout as at;

/// Rows of one point's block, in order.
pub(crate) mod rows {
    /// D_f q̈_f + H_f − J_f2ᵀ λ2 − B u_f + J_cᵀ λc = 0.
    pub const FRONT: usize = 0;
    /// First six rows of D_r q̈_r + H_r − J_r1ᵀ λ1 − J_cᵀ λc = 0.
    pub const REAR_BASE: usize = 12;
    /// T² θ̈_f − B̈(s) = 0.
    pub const OUTPUT: usize = 18;
    /// Toe 2 does not accelerate.
    pub const TOE_2: usize = 24;
    /// Toe 1 does not accelerate.
    pub const TOE_1: usize = 27;
    /// Friction pyramids of toes 1 and 2, four faces each.
    pub const FRICTION: usize = 30;
    /// Heights of toes 0 and 3.
    pub const SWING: usize = 38;
    /// Last six rows of the rear biped's dynamics give u_r.
    pub const REAR_TORQUE: usize = 40;
    pub const COUNT: usize = 46;
    /// Rows of one Hermite–Simpson interval.
    pub const INTERVAL: usize = 48;
    /// y = 0, ẏ = 0, stance heights, stance distance, at the first point.
    pub const FIRST: usize = 15;
    /// Mirror periodicity and soft touchdown.
    pub const BOUNDARY: usize = 28;
}

const JOINTS: [&str; 3] = ["hip roll", "hip pitch", "knee"];
const BASE: [&str; 6] = ["x", "y", "z", "roll", "pitch", "yaw"];
/// The output (stance hip roll of leg 2) whose ÿ row the fixed distance of the stance toes makes redundant.
pub(crate) const STANCE_ROLL: usize = 3;

/// The program of one request on one robot.
pub struct DecomposedProgram {
    bipeds: BipedPair,
    settings: ProgramSettings,
    speed_m_s: f64,
    friction_face: f64,
    mirror: robot::Mirror,
    limits: Limits,
    bounds: Bounds,
    jacobian: Pattern,
    hessian: Pattern,
    weights: Vec<(usize, f64, f64)>,
    leg_names: [String; 4],
    dynamics: Vec<PointDynamics>,
}

impl DecomposedProgram {
    /// Builds the program. The request has been validated.
    pub fn new(robot: &Robot, bipeds: BipedPair, request: &GaitRequest, settings: ProgramSettings) -> Self {
        let points = settings.points;
        assert!(points >= 5 && points % 2 == 1, "{points} Hermite–Simpson points: expected an odd number from 5");
        let mut program = Self {
            speed_m_s: 0.0,
            friction_face: 0.0,
            mirror: robot.mirror,
            limits: Limits::default(),
            bounds: Bounds {
                variable_lower: Vec::new(),
                variable_upper: Vec::new(),
                constraint_lower: Vec::new(),
                constraint_upper: Vec::new(),
            },
            jacobian: Pattern::default(),
            hessian: Pattern::default(),
            weights: Vec::new(),
            leg_names: std::array::from_fn(|i| robot.legs[i].name.replace('_', " ")),
            dynamics: vec![PointDynamics::default(); points],
            bipeds,
            settings,
        };
        program.ask(robot, request);
        let x: Vec<f64> = vec![0.0; program.bounds.variable_lower.len()];
        let mut places = Sink::Places(Vec::new());
        program.derivatives(&x, &mut Rows::new(0, &mut places));
        program.jacobian = places.into_pattern();
        program.hessian = Pattern(program.weights.iter().map(|w| (w.0, w.0)).collect());
        program
    }

    /// Makes it the program of another request, which has been validated, to the same robot on the same slope.
    pub(crate) fn ask(&mut self, robot: &Robot, request: &GaitRequest) {
        let distance_m = self.bipeds.nominal_toe_distance_m(request.half_width_m);
        self.limits = Limits::of(robot, request, &self.settings, distance_m);
        self.speed_m_s = request.speed_m_s;
        self.friction_face = request.friction / std::f64::consts::SQRT_2;
        self.bipeds.with_derivatives = true;
        self.set_variable_bounds(robot);
        self.set_constraint_bounds();
        self.set_objective();
    }

    /// Hermite–Simpson points.
    pub fn points(&self) -> usize {
        self.settings.points
    }

    pub(crate) fn limits(&self) -> &Limits {
        &self.limits
    }

    pub(crate) fn bipeds(&self) -> &BipedPair {
        &self.bipeds
    }

    pub(crate) fn bipeds_mut(&mut self) -> &mut BipedPair {
        &mut self.bipeds
    }

    pub(crate) fn dynamics(&self, point: usize) -> &PointDynamics {
        &self.dynamics[point]
    }

    pub(crate) fn speed_m_s(&self) -> f64 {
        self.speed_m_s
    }

    pub(crate) fn friction_face(&self) -> f64 {
        self.friction_face
    }

    /// A point's terms of the objective: (unknown, weight, centre).
    pub(crate) fn weights_of(&self, point: usize) -> &[(usize, f64, f64)] {
        let each = self.weights.len() / self.points();
        &self.weights[each * point..each * (point + 1)]
    }

    /// s = t / T of a point.
    pub(crate) fn phase(&self, point: usize) -> f64 {
        point as f64 / (self.points() - 1) as f64
    }

    fn set_variable_bounds(&mut self, robot: &Robot) {
        let limits = &self.limits;
        let mut lower = std::mem::take(&mut self.bounds.variable_lower);
        let mut upper = std::mem::take(&mut self.bounds.variable_upper);
        lower.clear();
        upper.clear();
        let mut push = |l: &[f64], u: &[f64]| {
            lower.extend_from_slice(l);
            upper.extend_from_slice(u);
        };
        let front = self.bipeds.front_legs();
        let mut joint_lower: [f64; 6] = std::array::from_fn(|j| robot.legs[front[j / 3]].position_min_rad[j % 3]);
        let mut joint_upper: [f64; 6] = std::array::from_fn(|j| robot.legs[front[j / 3]].position_max_rad[j % 3]);
        // The rear legs follow the front ones, within limits of their own.
        let (rear, no_offset) = (self.bipeds.rear_legs(), self.bipeds.pairing().position(&[0.0; 12]));
        for j in 0..6 {
            let (leg, (source, sign)) = (&robot.legs[rear[j / 3]], self.bipeds.pairing().row(6 + j));
            let ends =
                [leg.position_min_rad[j % 3], leg.position_max_rad[j % 3]].map(|end| sign * (end - no_offset[6 + j]));
            joint_lower[source - 6] = joint_lower[source - 6].max(ends[0].min(ends[1]));
            joint_upper[source - 6] = joint_upper[source - 6].min(ends[0].max(ends[1]));
        }
        // A polynomial between its bounds may have coefficients a little outside; hip roll has none to spare.
        let spare = [0.0, 0.3, 0.3];
        for _ in 0..COEFFICIENTS {
            push(
                &std::array::from_fn::<f64, 6, _>(|j| joint_lower[j] - spare[j % 3]),
                &std::array::from_fn::<f64, 6, _>(|j| joint_upper[j] + spare[j % 3]),
            );
        }
        push(&[limits.step_duration_s[0]], &[limits.step_duration_s[1]]);
        let joint_rate: [f64; 6] = std::array::from_fn(|j| limits.joint_rate_rad_s[j % 3]);
        let torque: [f64; 6] = std::array::from_fn(|j| limits.torque_nm[j % 3]);
        for point in 0..self.settings.points {
            // x starts at 0: where the step begins is free.
            let x = if point == 0 { 0.0 } else { limits.reach_m };
            push(&[-x], &[x]);
            push(&limits.base[0], &limits.base[1]);
            push(&joint_lower, &joint_upper);
            push(&limits.base_rate.map(|v| -v), &limits.base_rate);
            push(&joint_rate.map(|v| -v), &joint_rate);
            push(&limits.base_acceleration.map(|v| -v), &limits.base_acceleration);
            push(&[-limits.joint_acceleration_rad_s2; 6], &[limits.joint_acceleration_rad_s2; 6]);
            push(&torque.map(|v| -v), &torque);
            for _ in 0..2 {
                push(&limits.force_n[0], &limits.force_n[1]);
            }
            push(&[-1e4; 6], &[1e4; 6]);
            push(&torque.map(|v| -v), &torque);
        }
        self.bounds.variable_lower = lower;
        self.bounds.variable_upper = upper;
    }

    fn set_constraint_bounds(&mut self) {
        let mut lower = std::mem::take(&mut self.bounds.constraint_lower);
        let mut upper = std::mem::take(&mut self.bounds.constraint_upper);
        lower.clear();
        upper.clear();
        let last = self.points() - 1;
        for point in 0..self.points() {
            let mut l = [0.0; rows::COUNT];
            let mut u = [0.0; rows::COUNT];
            if !keeps_stance_roll(point, self.points()) {
                (l[rows::OUTPUT + STANCE_ROLL], u[rows::OUTPUT + STANCE_ROLL]) = (f64::NEG_INFINITY, f64::INFINITY);
            }
            u[rows::FRICTION..rows::SWING].fill(f64::INFINITY);
            let [low, high] = self.limits.swing_height_m(point, self.points());
            l[rows::SWING..rows::SWING + 2].fill(low);
            u[rows::SWING..rows::SWING + 2].fill(high);
            lower.extend_from_slice(&l);
            upper.extend_from_slice(&u);
        }
        let equalities = rows::INTERVAL * (last / 2) + rows::FIRST - 1;
        lower.extend(std::iter::repeat_n(0.0, equalities));
        upper.extend(std::iter::repeat_n(0.0, equalities));
        lower.push(self.limits.toe_distance_squared_m2[0]);
        upper.push(self.limits.toe_distance_squared_m2[1]);
        lower.extend([0.0; rows::BOUNDARY]);
        upper.extend([0.0; rows::BOUNDARY]);
        self.bounds.constraint_lower = lower;
        self.bounds.constraint_upper = upper;
    }

    /// Σ over the points of ‖q̇_b − (v, 0, 0, 0, 0, 0)‖² + w_u ‖u‖² + w_a ‖q̈_f‖², a sum of weighted squares of single unknowns.
    fn set_objective(&mut self) {
        let s = &self.settings;
        self.weights.clear();
        for point in 0..s.points {
            let p = at::point(point);
            for i in 0..6 {
                let centre = if i == 0 { self.speed_m_s } else { 0.0 };
                self.weights.push((p + at::V + i, 1.0, centre));
            }
            self.weights.extend((0..DOF).map(|i| (p + at::A + i, s.acceleration_weight, 0.0)));
            self.weights.extend((0..6).map(|i| (p + at::U_FRONT + i, s.torque_weight, 0.0)));
            self.weights.extend((0..6).map(|i| (p + at::U_REAR + i, s.torque_weight, 0.0)));
        }
    }

    fn objective(&self, x: &[f64]) -> f64 {
        self.weights.iter().map(|&(i, weight, centre)| weight * (x[i] - centre).powi(2)).sum()
    }

    pub(crate) fn start_of_intervals(&self) -> usize {
        rows::COUNT * self.points()
    }

    pub(crate) fn start_of_first(&self) -> usize {
        self.start_of_intervals() + rows::INTERVAL * (self.points() / 2)
    }

    pub(crate) fn start_of_boundary(&self) -> usize {
        self.start_of_first() + rows::FIRST
    }

    fn constraints(&mut self, x: &[f64], g: &mut [f64]) {
        let t = x[at::T];
        let face = self.friction_face;
        for point in 0..self.points() {
            let p = &x[at::point(point)..at::point(point) + at::POINT];
            let (l1, l2) = (three(p, at::LAMBDA_1), three(p, at::LAMBDA_2));
            self.bipeds.evaluate(
                twelve(p, at::Q),
                twelve(p, at::V),
                twelve(p, at::A),
                l1,
                l2,
                &mut self.dynamics[point],
            );
            let d = &self.dynamics[point];
            let g = &mut g[rows::COUNT * point..rows::COUNT * (point + 1)];
            let second = bezier::basis_second_derivative(point as f64 / (self.settings.points - 1) as f64);
            for i in 0..6 {
                let wrench = p[at::LAMBDA_C + i];
                g[rows::FRONT + i] = d.front.tau[i] + wrench;
                g[rows::FRONT + 6 + i] = d.front.tau[6 + i] - p[at::U_FRONT + i];
                g[rows::REAR_BASE + i] = d.rear.tau[i] - wrench;
                g[rows::REAR_TORQUE + i] = d.rear.tau[6 + i] - p[at::U_REAR + i];
                let polynomial: f64 = (0..COEFFICIENTS).map(|k| x[at::alpha(k, i)] * second[k]).sum();
                g[rows::OUTPUT + i] = t * t * p[at::A + 6 + i] - polynomial;
            }
            for i in 0..3 {
                g[rows::TOE_2 + i] = d.front.stance.acceleration[i];
                g[rows::TOE_1 + i] = d.rear.stance.acceleration[i];
            }
            for (toe, l) in [l1, l2].into_iter().enumerate() {
                for axis in 0..2 {
                    g[rows::FRICTION + 4 * toe + 2 * axis] = face * l[2] - l[axis];
                    g[rows::FRICTION + 4 * toe + 2 * axis + 1] = face * l[2] + l[axis];
                }
            }
            g[rows::SWING] = d.front.swing.position[2];
            g[rows::SWING + 1] = d.rear.swing.position[2];
        }
        let start = self.start_of_intervals();
        let h = 2.0 * t / (self.points() - 1) as f64;
        for interval in 0..self.points() / 2 {
            let p: [&[f64]; 3] = std::array::from_fn(|k| {
                let b = at::point(2 * interval + k);
                &x[b..b + at::POINT]
            });
            let g = &mut g[start + rows::INTERVAL * interval..start + rows::INTERVAL * (interval + 1)];
            for (block, (value, slope)) in [(at::Q, at::V), (at::V, at::A)].into_iter().enumerate() {
                for i in 0..DOF {
                    let [x0, x1, x2] = p.map(|p| p[value + i]);
                    let [f0, f1, f2] = p.map(|p| p[slope + i]);
                    g[24 * block + i] = x1 - (x0 + x2) / 2.0 - h / 8.0 * (f0 - f2);
                    g[24 * block + DOF + i] = x2 - x0 - h / 6.0 * (f0 + 4.0 * f1 + f2);
                }
            }
        }

        let start = self.start_of_first();
        let first = &x[at::point(0)..at::point(0) + at::POINT];
        let (value, slope) = (bezier::basis(0.0), bezier::basis_first_derivative(0.0));
        for i in 0..OUTPUTS {
            let sum = |basis: &[f64; 6]| (0..COEFFICIENTS).map(|k| x[at::alpha(k, i)] * basis[k]).sum::<f64>();
            g[start + i] = first[at::Q + 6 + i] - sum(&value);
            g[start + 6 + i] = t * first[at::V + 6 + i] - sum(&slope);
        }
        let d = &self.dynamics[0];
        g[start + 12] = d.front.stance.position[2];
        g[start + 13] = d.rear.stance.position[2];
        g[start + 14] = (d.front.stance.position - d.rear.stance.position).norm_squared();

        let start = self.start_of_boundary();
        let end = &x[at::point(self.points() - 1)..];
        for i in 0..DOF {
            let (from, sign) = self.mirror(i);
            g[start + i] = end[at::Q + i] - sign * first[at::Q + from];
            g[start + 12 + i] = sign * first[at::V + from] - end[at::V + i];
        }
        g[start] -= self.speed_m_s * t;
        let d = &self.dynamics[self.points() - 1];
        for i in 0..3 {
            g[start + 24 + i] = d.front.swing.velocity[i];
        }
        g[start + 27] = d.rear.swing.velocity[2];
    }

    /// Coordinate `i` of the front biped in the next step, mirrored back to this one's: which coordinate and which sign.
    pub(crate) fn mirror(&self, i: usize) -> (usize, f64) {
        self.mirror.biped_coordinate_source(i)
    }

    /// Derivatives at the point of the last call of [`Self::constraints`] with derivatives evaluated.
    fn derivatives(&self, x: &[f64], sink: &mut Rows) {
        let t = x[at::T];
        let face = self.friction_face;
        for point in 0..self.points() {
            let r = rows::COUNT * point;
            let p = at::point(point);
            let d = &self.dynamics[point];
            let second = bezier::basis_second_derivative(self.phase(point));
            for i in 0..DOF {
                for column in 0..DOF {
                    if coupled(i, column) {
                        sink.put(r + rows::FRONT + i, p + at::Q + column, d.front.dtau_dq[(i, column)]);
                        sink.put(r + rows::FRONT + i, p + at::V + column, d.front.dtau_dv[(i, column)]);
                        sink.put(r + rows::FRONT + i, p + at::A + column, d.front.mass_matrix[(i, column)]);
                    }
                    let row = if i < 6 { rows::REAR_BASE + i } else { rows::REAR_TORQUE + i - 6 };
                    if coupled_rear(i, column) {
                        sink.put(r + row, p + at::Q + column, d.rear.dtau_dq[(i, column)]);
                        sink.put(r + row, p + at::V + column, d.rear.dtau_dv[(i, column)]);
                        sink.put(r + row, p + at::A + column, d.rear.mass_matrix[(i, column)]);
                    }
                }
                // −Jᵀ of the stance toes; toe 2 belongs to the second leg of the front biped, toe 1 to the first of the rear.
                for k in 0..3 {
                    if !(6..9).contains(&i) {
                        sink.put(r + rows::FRONT + i, p + at::LAMBDA_2 + k, -d.front.stance.jacobian[(k, i)]);
                    }
                    if i < 9 {
                        let row = if i < 6 { rows::REAR_BASE + i } else { rows::REAR_TORQUE + i - 6 };
                        sink.put(r + row, p + at::LAMBDA_1 + k, -d.rear.stance_jacobian_own[(k, i)]);
                    }
                }
            }
            for i in 0..6 {
                sink.put(r + rows::FRONT + i, p + at::LAMBDA_C + i, 1.0);
                sink.put(r + rows::REAR_BASE + i, p + at::LAMBDA_C + i, -1.0);
                sink.put(r + rows::FRONT + 6 + i, p + at::U_FRONT + i, -1.0);
                sink.put(r + rows::REAR_TORQUE + i, p + at::U_REAR + i, -1.0);
                sink.put(r + rows::OUTPUT + i, p + at::A + 6 + i, t * t);
                sink.put(r + rows::OUTPUT + i, at::T, 2.0 * t * x[p + at::A + 6 + i]);
                for k in 0..COEFFICIENTS {
                    sink.put(r + rows::OUTPUT + i, at::alpha(k, i), -second[k]);
                }
            }
            for column in (3..6).chain(9..DOF) {
                for k in 0..3 {
                    let toe = &d.front.stance;
                    sink.put(r + rows::TOE_2 + k, p + at::Q + column, toe.dacceleration_dq[(k, column)]);
                    sink.put(r + rows::TOE_2 + k, p + at::V + column, toe.dacceleration_dv[(k, column)]);
                    // Leg 1 follows leg 2, so toe 1 depends on the same columns.
                    let toe = &d.rear.stance;
                    sink.put(r + rows::TOE_1 + k, p + at::Q + column, toe.dacceleration_dq[(k, column)]);
                    sink.put(r + rows::TOE_1 + k, p + at::V + column, toe.dacceleration_dv[(k, column)]);
                }
            }
            for column in (0..6).chain(9..DOF) {
                for k in 0..3 {
                    // The base's translation moves a toe along its own axis only.
                    if column >= 3 || column == k {
                        sink.put(r + rows::TOE_2 + k, p + at::A + column, d.front.stance.jacobian[(k, column)]);
                        sink.put(r + rows::TOE_1 + k, p + at::A + column, d.rear.stance.jacobian[(k, column)]);
                    }
                }
            }
            for (toe, l) in [at::LAMBDA_1, at::LAMBDA_2].into_iter().enumerate() {
                for axis in 0..2 {
                    for (side, sign) in [-1.0, 1.0].into_iter().enumerate() {
                        let row = r + rows::FRICTION + 4 * toe + 2 * axis + side;
                        sink.put(row, p + l + 2, face);
                        sink.put(row, p + l + axis, sign);
                    }
                }
            }
            for column in 2..9 {
                sink.put(r + rows::SWING, p + at::Q + column, d.front.swing.jacobian[(2, column)]);
                // Leg 3 follows leg 0.
                sink.put(r + rows::SWING + 1, p + at::Q + column, d.rear.swing.jacobian[(2, column)]);
            }
        }

        let start = self.start_of_intervals();
        let per_t = 2.0 / (self.points() - 1) as f64;
        let h = per_t * t;
        for interval in 0..self.points() / 2 {
            let p: [usize; 3] = std::array::from_fn(|k| at::point(2 * interval + k));
            let r = start + rows::INTERVAL * interval;
            for (block, (value, slope)) in [(at::Q, at::V), (at::V, at::A)].into_iter().enumerate() {
                for i in 0..DOF {
                    let [f0, f1, f2] = p.map(|p| x[p + slope + i]);
                    let row = r + 24 * block + i;
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

        let start = self.start_of_first();
        let p = at::point(0);
        let (value, slope) = (bezier::basis(0.0), bezier::basis_first_derivative(0.0));
        for i in 0..OUTPUTS {
            sink.put(start + i, p + at::Q + 6 + i, 1.0);
            sink.put(start + i, at::alpha(0, i), -value[0]);
            sink.put(start + 6 + i, p + at::V + 6 + i, t);
            sink.put(start + 6 + i, at::T, x[p + at::V + 6 + i]);
            sink.put(start + 6 + i, at::alpha(0, i), -slope[0]);
            sink.put(start + 6 + i, at::alpha(1, i), -slope[1]);
        }
        let d = &self.dynamics[0];
        let between = (d.front.stance.position - d.rear.stance.position) * 2.0;
        for column in (2..6).chain(9..DOF) {
            sink.put(start + 12, p + at::Q + column, d.front.stance.jacobian[(2, column)]);
            sink.put(start + 13, p + at::Q + column, d.rear.stance.jacobian[(2, column)]);
        }
        for column in (3..6).chain(9..DOF) {
            let slope: f64 = (0..3)
                .map(|k| between[k] * (d.front.stance.jacobian[(k, column)] - d.rear.stance.jacobian[(k, column)]))
                .sum();
            sink.put(start + 14, p + at::Q + column, slope);
        }

        let start = self.start_of_boundary();
        let e = at::point(self.points() - 1);
        for i in 0..DOF {
            let (from, sign) = self.mirror(i);
            sink.put(start + i, e + at::Q + i, 1.0);
            sink.put(start + i, p + at::Q + from, -sign);
            sink.put(start + 12 + i, e + at::V + i, -1.0);
            sink.put(start + 12 + i, p + at::V + from, sign);
        }
        sink.put(start, at::T, -self.speed_m_s);
        let d = &self.dynamics[self.points() - 1];
        for k in 0..3 {
            for column in 0..9 {
                if column >= 3 {
                    sink.put(start + 24 + k, e + at::Q + column, d.front.swing.dvelocity_dq[(k, column)]);
                }
                if column >= 3 || column == k {
                    sink.put(start + 24 + k, e + at::V + column, d.front.swing.jacobian[(k, column)]);
                }
            }
        }
        for column in 2..9 {
            if column >= 3 {
                sink.put(start + 27, e + at::Q + column, d.rear.swing.dvelocity_dq[(2, column)]);
            }
            sink.put(start + 27, e + at::V + column, d.rear.swing.jacobian[(2, column)]);
        }
    }
}

/// Whether row `i` of the front biped's dynamics depends on coordinate `column`: two legs meet only in the base, and
/// nothing depends on where the base is. (x, y, z keep their columns for the velocities and accelerations.)
fn coupled(i: usize, column: usize) -> bool {
    i < 6 || column < 6 || (i < 9) == (column < 9)
}

/// The same for the rear biped's rows (legs 1, 3) and the front's coordinates: leg 1 follows leg 2, leg 3 follows leg 0.
fn coupled_rear(i: usize, column: usize) -> bool {
    i < 6 || column < 6 || (i < 9) != (column < 9)
}

fn twelve(p: &[f64], start: usize) -> &[f64; DOF] {
    p[start..start + DOF].try_into().expect("twelve entries")
}

pub(crate) fn three(p: &[f64], start: usize) -> nalgebra::Vector3<f64> {
    nalgebra::Vector3::new(p[start], p[start + 1], p[start + 2])
}

impl Problem for DecomposedProgram {
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
        self.bipeds.with_derivatives = true;
        self.constraints(x, &mut evaluation.constraints);
        if evaluation.jacobian_wanted {
            let mut values = Sink::Values(evaluation.jacobian.iter_mut());
            self.derivatives(x, &mut Rows::new(0, &mut values));
        }
        evaluation.objective = self.objective(x);
        evaluation.gradient.fill(0.0);
        for (k, &(i, weight, centre)) in self.weights.iter().enumerate() {
            evaluation.gradient[i] = 2.0 * weight * (x[i] - centre);
            evaluation.hessian[k] = 2.0 * weight;
        }
    }

    fn steepest(&mut self, x: &[f64], _: &mut Evaluation) -> Vec<f64> {
        let mut steepest = vec![0.0; self.bounds.constraint_lower.len()];
        self.derivatives(x, &mut Rows::new(0, &mut Sink::Steepest(&mut steepest)));
        steepest
    }

    fn values(&mut self, x: &[f64], constraints: &mut [f64]) -> f64 {
        self.bipeds.with_derivatives = false;
        self.constraints(x, constraints);
        self.objective(x)
    }

    fn constraint_name(&self, row: usize) -> String {
        let front = self.bipeds.front_legs();
        let rear = self.bipeds.rear_legs();
        let joint = |legs: [usize; 2], j: usize| format!("{} {}", self.leg_names[legs[j / 3]], JOINTS[j % 3]);
        let axis = |k: usize| ["x", "y", "z"][k];
        if row < self.start_of_intervals() {
            let (point, row) = (row / rows::COUNT, row % rows::COUNT);
            let what = match row {
                0..6 => format!("front biped's dynamics, base {}", BASE[row]),
                6..rows::REAR_BASE => format!("dynamics of {}", joint(front, row - 6)),
                rows::REAR_BASE..rows::OUTPUT => format!("rear biped's dynamics, base {}", BASE[row - rows::REAR_BASE]),
                rows::OUTPUT..rows::TOE_2 => format!("{} on its polynomial", joint(front, row - rows::OUTPUT)),
                rows::TOE_2..rows::TOE_1 => {
                    format!("{} toe at rest, {}", self.leg_names[2], axis(row - rows::TOE_2))
                }
                rows::TOE_1..rows::FRICTION => {
                    format!("{} toe at rest, {}", self.leg_names[1], axis(row - rows::TOE_1))
                }
                rows::FRICTION..rows::SWING => {
                    format!("friction of the {} toe", self.leg_names[1 + (row - rows::FRICTION) / 4])
                }
                rows::SWING => format!("height of the {} toe", self.leg_names[FRONT_SWING]),
                39 => format!("height of the {} toe", self.leg_names[REAR_SWING]),
                _ => format!("dynamics of {}", joint(rear, row - rows::REAR_TORQUE)),
            };
            return format!("{what}, point {} of {}", point + 1, self.points());
        }
        if row < self.start_of_first() {
            let row = row - self.start_of_intervals();
            return format!("Hermite–Simpson defect, interval {}", row / rows::INTERVAL + 1);
        }
        if row < self.start_of_boundary() {
            let row = row - self.start_of_first();
            return match row {
                0..6 => format!("{} starts on its polynomial", joint(front, row)),
                6..12 => format!("{} starts with its polynomial's velocity", joint(front, row - 6)),
                12 => format!("{} toe on the floor", self.leg_names[2]),
                13 => format!("{} toe on the floor", self.leg_names[1]),
                _ => "squared distance between the stance toes".into(),
            };
        }
        let row = row - self.start_of_boundary();
        let coordinate = |i: usize| if i < 6 { format!("base {}", BASE[i]) } else { joint(front, i - 6) };
        match row {
            0..12 => format!("periodicity of {}", coordinate(row)),
            12..24 => format!("periodicity of the velocity of {}", coordinate(row - 12)),
            24..27 => format!("soft touchdown of the {} toe, {}", self.leg_names[FRONT_SWING], axis(row - 24)),
            _ => format!("soft touchdown of the {} toe, z", self.leg_names[REAR_SWING]),
        }
    }

    fn variable_name(&self, column: usize) -> String {
        if column < at::T {
            let (k, output) = (column / OUTPUTS, column % OUTPUTS);
            let leg = self.bipeds.front_legs()[output / 3];
            return format!("Bézier coefficient {k} of {} {}", self.leg_names[leg], JOINTS[output % 3]);
        }
        if column == at::T {
            return "step duration".into();
        }
        let (point, i) = ((column - at::POINTS) / at::POINT, (column - at::POINTS) % at::POINT);
        let front = self.bipeds.front_legs();
        let rear = self.bipeds.rear_legs();
        let joint = |legs: [usize; 2], j: usize| format!("{} {}", self.leg_names[legs[j / 3]], JOINTS[j % 3]);
        let coordinate = |i: usize| if i < 6 { format!("base {}", BASE[i]) } else { joint(front, i - 6) };
        let what = match i {
            0..at::V => format!("position of {}", coordinate(i)),
            at::V..at::A => format!("velocity of {}", coordinate(i - at::V)),
            at::A..at::U_FRONT => format!("acceleration of {}", coordinate(i - at::A)),
            at::U_FRONT..at::LAMBDA_1 => format!("torque of {}", joint(front, i - at::U_FRONT)),
            at::LAMBDA_1..at::LAMBDA_2 => format!("force on the {} toe", self.leg_names[1]),
            at::LAMBDA_2..at::LAMBDA_C => format!("force on the {} toe", self.leg_names[2]),
            at::LAMBDA_C..at::U_REAR => "connection wrench".into(),
            _ => format!("torque of {}", joint(rear, i - at::U_REAR)),
        };
        format!("{what}, point {} of {}", point + 1, self.points())
    }
}
