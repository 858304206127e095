//! The paper's nonlinear program for the front biped (Ma & Ames 2020, section III, eq. (12)), with the corrections of
//! docs/mathematics.md and without its redundant rows.
//!
//! Unknowns: α ∈ R³⁶, T, and at each of the 2N + 1 Hermite–Simpson points q_f, q̇_f, q̈_f ∈ R¹², u_f ∈ R⁶, λ1, λ2 ∈ R³,
//! λc ∈ R⁶ and the rear torques u_r ∈ R⁶ (which the paper leaves unbounded). The impulses are left out: a soft
//! touchdown has none. Only the first step is planned. Its constraints are [`crate::terms`].

use crate::biped::{BipedPair, FRONT, FRONT_STANCE, PointDynamics, REAR, REAR_STANCE};
use crate::limits::{Limits, ProgramSettings};
use crate::request::GaitRequest;
pub(crate) use crate::terms::COEFFICIENTS;
use crate::terms::friction::face;
use crate::terms::{At, Names, Terms};
use nlp::{Bounds, Evaluation, Pattern, Problem};
use robot::Robot;
use std::cell::OnceCell;

mod terms;

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

    /// At the first point: y = 0 and ẏ = 0 of six outputs,
    pub const BEGINS: usize = 0;
    /// toe 2's height,
    pub const FLOOR_2: usize = 12;
    /// toe 1's,
    pub const FLOOR_1: usize = 13;
    /// and the squared distance between them.
    pub const TOE_DISTANCE: usize = 14;
    pub const FIRST: usize = 15;

    /// At the ends: mirror periodicity of q and q̇,
    pub const PERIODICITY: usize = 0;
    /// toe 0's soft touchdown
    pub const TOUCHDOWN_0: usize = 24;
    /// and toe 3's, of which only z is left.
    pub const TOUCHDOWN_3: usize = 27;

    /// Where the intervals' rows begin.
    pub fn intervals(points: usize) -> usize {
        COUNT * points
    }

    /// Where those of the first point begin.
    pub fn first(points: usize) -> usize {
        intervals(points) + INTERVAL * (points / 2)
    }

    /// Where those of both ends begin.
    pub fn boundary(points: usize) -> usize {
        first(points) + FIRST
    }
}

/// The output (stance hip roll of leg 2) whose ÿ row the fixed distance of the stance toes makes redundant.
pub(crate) const STANCE_ROLL: usize = 3;

/// The program of one request on one robot.
pub struct DecomposedProgram {
    pub(crate) bipeds: BipedPair,
    settings: ProgramSettings,
    pub(crate) speed_m_s: f64,
    pub(crate) friction_face: f64,
    mirror: robot::Mirror,
    pub(crate) limits: Limits,
    bounds: Bounds,
    /// Found where it is asked for: [`crate::Condensed`] reads derivatives of its own.
    jacobian: OnceCell<Pattern>,
    hessian: Pattern,
    weights: Vec<(usize, f64, f64)>,
    names: Names,
    terms: Terms,
    pub(crate) dynamics: Vec<PointDynamics>,
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
            bounds: Bounds::default(),
            jacobian: OnceCell::new(),
            hessian: Pattern::default(),
            weights: Vec::new(),
            names: Names::of_legs(robot, &FRONT),
            terms: Terms::default(),
            dynamics: vec![PointDynamics::default(); points],
            bipeds,
            settings,
        };
        program.ask(robot, request);
        program.hessian = Pattern(program.weights.iter().map(|w| (w.0, w.0)).collect());
        program
    }

    /// Makes it the program of another request, which has been validated, to the same robot on the same slope.
    pub(crate) fn ask(&mut self, robot: &Robot, request: &GaitRequest) {
        let distance_m = self.bipeds.nominal_toe_distance_m(request.half_width_m);
        self.limits = Limits::of(robot, request, &self.settings, distance_m);
        self.speed_m_s = request.speed_m_s;
        self.friction_face = face(request.friction);
        self.terms = terms::of(request, &self.limits, self.mirror, self.settings.points);
        self.bipeds.with_derivatives = true;
        [self.bounds.variable_lower, self.bounds.variable_upper] = self.variable_bounds(robot);
        self.bounds.constraint_lower = self.terms.bounds(0).collect();
        self.bounds.constraint_upper = self.terms.bounds(1).collect();
        self.set_objective();
    }

    /// Hermite–Simpson points.
    pub fn points(&self) -> usize {
        self.settings.points
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

    /// Lower and upper ends of the front joints' ranges. The rear legs follow them, within limits of their own.
    fn joint_ranges(&self, robot: &Robot) -> [[f64; OUTPUTS]; 2] {
        let range = |legs: [usize; 2], j: usize| {
            let leg = &robot.legs[legs[j / 3]];
            [leg.position_min_rad[j % 3], leg.position_max_rad[j % 3]]
        };
        let mut ranges = [0, 1].map(|side| std::array::from_fn(|j| range(FRONT, j)[side]));
        let no_offset = self.bipeds.pairing().position(&[0.0; DOF]);
        for j in 0..OUTPUTS {
            let (source, sign) = self.bipeds.pairing().row(6 + j);
            let ends = range(REAR, j).map(|end| sign * (end - no_offset[6 + j]));
            ranges[0][source - 6] = ranges[0][source - 6].max(ends[0].min(ends[1]));
            ranges[1][source - 6] = ranges[1][source - 6].min(ends[0].max(ends[1]));
        }
        ranges
    }

    fn variable_bounds(&self, robot: &Robot) -> [Vec<f64>; 2] {
        let (limits, ranges) = (&self.limits, self.joint_ranges(robot));
        // A polynomial between its bounds may have coefficients a little outside; hip roll has none to spare.
        let spare = [0.0, 0.3, 0.3];
        [(0, -1.0), (1, 1.0)].map(|(side, outward)| {
            let mut bounds = Vec::with_capacity(at::point(self.points()));
            for _ in 0..COEFFICIENTS {
                bounds.extend((0..OUTPUTS).map(|j| ranges[side][j] + spare[j % 3] * outward));
            }
            bounds.push(limits.step_duration_s[side]);
            for point in 0..self.points() {
                // x starts at 0: where the step begins is free.
                bounds.push(if point == 0 { 0.0 } else { limits.reach_m } * outward);
                bounds.extend(limits.base[side]);
                bounds.extend(ranges[side].map(|end| end - limits.joint_inward_rad * outward));
                bounds.extend(limits.base_rate.map(|rate| rate * outward));
                bounds.extend((0..OUTPUTS).map(|j| limits.joint_rate_rad_s[j % 3] * outward));
                bounds.extend(limits.base_acceleration.map(|acceleration| acceleration * outward));
                bounds.extend([limits.joint_acceleration_rad_s2 * outward; OUTPUTS]);
                let torques = (0..6).map(|j| limits.torque_nm[j % 3] * outward);
                bounds.extend(torques.clone().chain(limits.force_n[side]).chain(limits.force_n[side]));
                bounds.extend([1e4 * outward; 6].into_iter().chain(torques));
            }
            bounds
        })
    }

    /// Σ over the points of ‖q̇_b − (v, 0, 0, 0, 0, 0)‖² + w_u ‖u‖² + w_a ‖q̈_f‖²: weighted squares of single unknowns.
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

    fn at<'a>(&'a self, x: &'a [f64]) -> At<'a> {
        At { x, t_column: at::T, bodies: &self.dynamics }
    }

    /// Both bipeds at every point, and then every row.
    fn constraints(&mut self, x: &[f64], derivatives: bool, g: &mut [f64]) {
        self.bipeds.with_derivatives = derivatives;
        for (point, dynamics) in self.dynamics.iter_mut().enumerate() {
            let p = &x[at::point(point)..at::point(point) + at::POINT];
            let (l1, l2) = (three(p, at::LAMBDA_1), three(p, at::LAMBDA_2));
            self.bipeds.evaluate(twelve(p, at::Q), twelve(p, at::V), twelve(p, at::A), l1, l2, dynamics);
        }
        self.terms.values(&self.at(x), g);
    }

    /// Coordinate `i` of the front biped in the next step, mirrored back to this one's: which coordinate, which sign.
    pub(crate) fn mirror(&self, i: usize) -> (usize, f64) {
        self.mirror.biped_coordinate_source(i)
    }
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
        let x = || vec![0.0; self.bounds.variable_lower.len()];
        self.jacobian.get_or_init(|| self.terms.pattern(&self.at(&x())))
    }

    fn hessian_pattern(&self) -> &Pattern {
        &self.hessian
    }

    fn evaluate(&mut self, x: &[f64], evaluation: &mut Evaluation) {
        self.constraints(x, true, &mut evaluation.constraints);
        if evaluation.jacobian_wanted {
            self.terms.jacobian(&self.at(x), &mut evaluation.jacobian);
        }
        evaluation.objective = self.objective(x);
        evaluation.gradient.fill(0.0);
        for (k, &(i, weight, centre)) in self.weights.iter().enumerate() {
            evaluation.gradient[i] = 2.0 * weight * (x[i] - centre);
            evaluation.hessian[k] = 2.0 * weight;
        }
    }

    fn steepest(&mut self, x: &[f64], _: &mut Evaluation) -> Vec<f64> {
        self.terms.steepest(&self.at(x))
    }

    fn values(&mut self, x: &[f64], constraints: &mut [f64]) -> f64 {
        self.constraints(x, false, constraints);
        self.objective(x)
    }

    fn constraint_name(&self, row: usize) -> String {
        let name = self.terms.name(row, &self.names);
        name.strip_prefix("the ").map_or_else(|| name.clone(), str::to_owned)
    }

    fn variable_name(&self, column: usize) -> String {
        let names = &self.names;
        if column < at::T {
            return format!("Bézier coefficient {} of {}", column / OUTPUTS, names.joint(column % OUTPUTS));
        }
        if column == at::T {
            return "step duration".into();
        }
        let (point, i) = ((column - at::POINTS) / at::POINT, (column - at::POINTS) % at::POINT);
        let what = match i {
            0..at::V => format!("position of {}", names.coordinate(i)),
            at::V..at::A => format!("velocity of {}", names.coordinate(i - at::V)),
            at::A..at::U_FRONT => format!("acceleration of {}", names.coordinate(i - at::A)),
            at::U_FRONT..at::LAMBDA_1 => format!("torque of {}", names.joint(i - at::U_FRONT)),
            at::LAMBDA_1..at::LAMBDA_2 => format!("force on {}", names.toe(REAR_STANCE)),
            at::LAMBDA_2..at::LAMBDA_C => format!("force on {}", names.toe(FRONT_STANCE)),
            at::LAMBDA_C..at::U_REAR => "connection wrench".into(),
            _ => format!("torque of {}", names.joint_of(REAR[(i - at::U_REAR) / 3], (i - at::U_REAR) % 3)),
        };
        format!("{what}, point {} of {}", point + 1, self.points())
    }
}
