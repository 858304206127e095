//! The subproblem of the front biped's program, by elimination of its structure.
//!
//! The linearised program has 697 unknowns (11 points) but only 14 ways for the motion to change and one internal force a
//! point. They are found without a general sparse factorisation:
//!
//! 1. **Along the step.** The joints' accelerations follow from α and T. What is left at a point is the base's six
//!    accelerations and the stance hip roll's: seven unknowns, which six stance-toe rows and one row of the dynamics (the
//!    moment about the line through the stance toes, free of both ground forces) determine. A Hermite–Simpson interval couples
//!    two points, so one 14 × 14 system an interval gives the motion as a linear function of 44 numbers: the state at the
//!    first point, the coefficients of the five other outputs, and T.
//! 2. **At the ends.** Mirror periodicity, soft touchdown and the toes' start on the floor are 30 rows on those 44.
//! 3. **Forces.** The remaining base rows give both ground forces up to the internal force along the line between the toes,
//!    one number a point; torques and connection wrench follow explicitly.
//!
//! What remains are 14 unknowns that everything depends on and one internal force a point that meets only that point's rows:
//! an arrow, which [`nlp::DualActiveSet`] solves. The step is the same as the sparse subproblem's.

mod ends;
mod motion;
mod sums;

use crate::biped::BipedDynamics;
use crate::program::{COEFFICIENTS, DOF, DecomposedProgram, OUTPUTS, STANCE_ROLL, layout as at, rows};
use gait::bezier;
use motion::{
    Interval, OwnOutputs, PointRows, SpreadOutputs, move_along, point_rows, stance_roll_coefficients, turning,
};
use nalgebra::{Matrix3, SMatrix, Vector3};
use nlp::{
    ArrowQp, ArrowQpError, ArrowRow, DualActiveSet, Evaluation, Own, Problem, Step, Subproblem, SubproblemError,
};
use std::ops::Range;
use sums::{add, add_squares, dot, scaled};

/// The numbers that the motion depends on: base angles (3), base angular velocity (3), the stance hip roll's position and
/// velocity (2), all at the first point; six coefficients of each of the other five outputs (30); T; and, at the first point again,
/// the base's y, z (2) and straight velocity (3).
const INPUTS: usize = 44;
const ANGLES: usize = 0;
const TURNING_RATES: usize = 3;
const ROLL: usize = 6;
const POLYNOMIALS: usize = 8;
const STEP_DURATION: usize = POLYNOMIALS + COEFFICIENTS * (OUTPUTS - 1);
/// The last five only shift the base: no acceleration depends on them, so the motion along the step leaves them out.
const SHIFTS: usize = STEP_DURATION + 1;
const STRAIGHT_RATES: usize = SHIFTS + 2;
/// What the end rows leave free: 14, one more for each that repeats others.
const FREE_MAX: usize = 15;
/// Coordinates whose accelerations are unknown at a point: the base's and the stance hip roll's.
const UNKNOWN: [usize; 7] = [0, 1, 2, 3, 4, 5, 6 + STANCE_ROLL];
/// Coordinates whose positions and velocities change an acceleration or a force: the body's angles and the joints.
const TURNING: Range<usize> = 3..DOF;

/// An affine function of the inputs but the shifts: coefficients, then the constant.
type Affine = [f64; SHIFTS + 1];
/// An affine function of what the end rows leave free: coefficients, then the constant.
type Reduced = [f64; WIDTH];
const WIDTH: usize = FREE_MAX + 1;
/// An output's motion as a function of its own six coefficients, T, and the constant.
type Own8 = [f64; COEFFICIENTS + 2];

/// The inputs as functions of themselves; the shifts are left out.
fn units() -> [Affine; INPUTS] {
    std::array::from_fn(|input| {
        let mut row = [0.0; SHIFTS + 1];
        if input < SHIFTS {
            row[input] = 1.0;
        }
        row
    })
}

/// Input number of the first coefficient of an output that is not the stance hip roll.
fn coefficients(output: usize) -> usize {
    let place = if output < STANCE_ROLL { output } else { output - 1 };
    POLYNOMIALS + COEFFICIENTS * place
}

/// An output's motion, by the free inputs.
#[inline(always)]
fn spread(own: &Own8, coefficients: &[Reduced], duration: &Reduced) -> Reduced {
    let mut row = [0.0; WIDTH];
    row[FREE_MAX] = own[COEFFICIENTS + 1];
    for (value, input) in own.iter().zip(coefficients) {
        add(&mut row, *value, input);
    }
    add(&mut row, own[COEFFICIENTS], duration);
    row
}

/// The outputs whose polynomials prescribe their motion: all but the stance hip roll.
fn prescribed() -> impl Iterator<Item = usize> {
    (0..OUTPUTS).filter(|&i| i != STANCE_ROLL)
}

/// q, q̇, q̈ of `K` coordinates at one point, each a function of something.
#[derive(Clone)]
struct Motion<const K: usize, R> {
    q: [R; K],
    v: [R; K],
    a: [R; K],
}

impl<const K: usize, const N: usize> Default for Motion<K, [f64; N]> {
    fn default() -> Self {
        Self { q: [[0.0; N]; K], v: [[0.0; N]; K], a: [[0.0; N]; K] }
    }
}

/// Forces and torques of one point in terms of the free inputs.
#[derive(Clone, Default)]
struct PointForces {
    lambda_1: [Reduced; 3],
    lambda_2: [Reduced; 3],
    front_torque: [Reduced; 6],
    rear_torque: [Reduced; 6],
    /// Share of the internal force in λ2 (its negative is λ1's) and in the torques.
    direction: Vector3<f64>,
    front_internal: [f64; 6],
    rear_internal: [f64; 6],
}

/// The structured solver of the subproblems of a [`DecomposedProgram`]. Kept from one to the next, it saves the memory's
/// setting up, and the rows that were active are tried first.
#[derive(Default)]
pub struct Condensed {
    rows: Vec<PointRows>,
    outputs: Vec<Motion<OUTPUTS, Own8>>,
    /// The unknown coordinates at both ends as functions of all inputs.
    ends: [Motion<7, Affine>; 2],
    /// Prescribed and unknown coordinates at every point as functions of the free inputs.
    prescribed: Vec<Motion<OUTPUTS, Reduced>>,
    unknown: Vec<Motion<7, Reduced>>,
    forces: Vec<PointForces>,
    qp: ArrowQp<WIDTH>,
    solver: DualActiveSet<WIDTH>,
}

impl Subproblem<DecomposedProgram> for Condensed {
    fn solve(
        &mut self,
        program: &DecomposedProgram,
        x: &[f64],
        _: &Evaluation,
        constraints: &[f64],
    ) -> Result<Step, SubproblemError> {
        #[cfg(target_arch = "x86_64")]
        if std::arch::is_x86_feature_detected!("avx2") {
            // SAFETY: this processor has the instructions that the function is compiled for.
            return unsafe { self.step_with_avx2(program, x, constraints) };
        }
        self.step(program, x, constraints)
    }

    fn needs_jacobian(&self) -> bool {
        false
    }
}

impl Condensed {
    /// [`Self::step`] for processors with registers twice as wide. Without fused multiplications every sum is rounded as it is
    /// elsewhere, so both give the same step to the bit.
    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx2")]
    fn step_with_avx2(
        &mut self,
        program: &DecomposedProgram,
        x: &[f64],
        constraints: &[f64],
    ) -> Result<Step, SubproblemError> {
        self.step(program, x, constraints)
    }

    #[inline(always)]
    fn step(&mut self, program: &DecomposedProgram, x: &[f64], constraints: &[f64]) -> Result<Step, SubproblemError> {
        self.rows.clear();
        for point in 0..program.points() {
            self.rows.push(point_rows(program, point, constraints));
        }
        self.follow_polynomials(program, x, constraints);
        // Along the step twice: once for what the ends need, with all inputs, once more with what the ends leave free. The
        // second time costs less than substituting would.
        let (rows, last, ends) = (&self.rows, program.points() - 1, &mut self.ends);
        let own = OwnOutputs { rows, motion: &self.outputs };
        move_along(program, x, constraints, rows, &units(), own, |point, motion| {
            if point == 0 || point == last {
                ends[usize::from(point > 0)].clone_from(motion);
            }
        })?;
        let (free, inputs) = self.tie_ends(program, x, constraints)?;
        self.spread_outputs(&inputs);
        let (rows, unknown) = (&self.rows, &mut self.unknown);
        let spread = SpreadOutputs { rows, motion: &self.prescribed };
        unknown.clear();
        move_along(program, x, constraints, rows, &inputs, spread, |_, motion| unknown.push(motion.clone()))?;
        self.find_forces(program, constraints);
        let roll = stance_roll_coefficients(program, x, constraints, &self.unknown, &inputs)?;
        self.assemble(program, x, constraints, free, &inputs, &roll);
        self.solver.solve(&self.qp).map_err(|e| match e {
            ArrowQpError::Infeasible { .. } => SubproblemError::Infeasible,
            e => SubproblemError::Stopped(e.to_string()),
        })?;
        let step = self.expand(program, constraints, x.len(), &inputs, &roll);
        if step.iter().any(|p| !p.is_finite()) {
            return Err(SubproblemError::Stopped("the step is not a number".into()));
        }
        Ok(Step { step, multipliers: None, iterations: self.solver.iterations })
    }
}

impl Condensed {
    /// Forgets which rows were active: what it gives next depends on nothing before.
    pub(crate) fn forget(&mut self) {
        self.solver.forget();
    }
}

impl Condensed {
    /// The prescribed outputs' motion: T² θ̈ = B̈(s), linearised, and the Hermite–Simpson rows.
    #[inline(always)]
    fn follow_polynomials(&mut self, program: &DecomposedProgram, x: &[f64], g: &[f64]) {
        const T: usize = COEFFICIENTS;
        const CONSTANT: usize = COEFFICIENTS + 1;
        let t = x[at::T];
        let points = program.points();
        self.outputs.resize(points, Motion::default());
        for (point, motion) in self.outputs.iter_mut().enumerate() {
            let second = bezier::basis_second_derivative(program.phase(point));
            for i in prescribed() {
                let row = &mut motion.a[i];
                for (row, second) in row.iter_mut().zip(second) {
                    *row = second / (t * t);
                }
                row[T] = -2.0 * x[at::point(point) + at::A + 6 + i] / t;
                row[CONSTANT] = -g[rows::COUNT * point + rows::OUTPUT + i] / (t * t);
            }
        }
        let slope = bezier::basis_first_derivative(0.0);
        let start = rows::first(program.points());
        let first = &mut self.outputs[0];
        for i in prescribed() {
            first.q[i][0] = 1.0;
            first.q[i][CONSTANT] = -g[start + rows::BEGINS + i];
            first.v[i][0] = slope[0] / t;
            first.v[i][1] = slope[1] / t;
            first.v[i][T] = -x[at::point(0) + at::V + 6 + i] / t;
            first.v[i][CONSTANT] = -g[start + rows::BEGINS + OUTPUTS + i] / t;
        }
        let mut duration = [0.0; COEFFICIENTS + 2];
        duration[T] = 1.0;
        for interval in 0..points / 2 {
            let hs = Interval::new(program, x, g, interval);
            let [start, middle, end] = &mut self.outputs[2 * interval..2 * interval + 3] else {
                unreachable!("an interval has three points")
            };
            for i in prescribed() {
                let (a0, a1, a2) = (start.a[i], middle.a[i], end.a[i]);
                (middle.v[i], end.v[i]) = hs.integrate(at::A, 6 + i, &start.v[i], [&a0, &a1, &a2], &duration);
                let (v0, v1, v2) = (start.v[i], middle.v[i], end.v[i]);
                (middle.q[i], end.q[i]) = hs.integrate(at::V, 6 + i, &start.q[i], [&v0, &v1, &v2], &duration);
            }
        }
    }

    /// The prescribed outputs' motion as functions of the free inputs.
    #[inline(always)]
    fn spread_outputs(&mut self, inputs: &[Reduced; INPUTS]) {
        self.prescribed.resize(self.outputs.len(), Motion::default());
        for (to, from) in self.prescribed.iter_mut().zip(&self.outputs) {
            for i in prescribed() {
                let inputs_of = &inputs[coefficients(i)..coefficients(i) + COEFFICIENTS];
                to.q[i] = spread(&from.q[i], inputs_of, &inputs[STEP_DURATION]);
                to.v[i] = spread(&from.v[i], inputs_of, &inputs[STEP_DURATION]);
                to.a[i] = spread(&from.a[i], inputs_of, &inputs[STEP_DURATION]);
            }
        }
    }

    /// Part 3: forces and torques of every point in terms of the free inputs and the internal forces.
    #[inline(always)]
    fn find_forces(&mut self, program: &DecomposedProgram, g: &[f64]) {
        self.forces.resize(self.unknown.len(), PointForces::default());
        for (point, (m, out)) in along(&self.unknown, &self.prescribed).zip(&mut self.forces).enumerate() {
            let d = &program.dynamics[point];
            let g = &g[rows::COUNT * point..rows::COUNT * (point + 1)];
            // Both bipeds' base rows: J_1bᵀ δλ1 + J_2bᵀ δλ2 = net, with J_b = [I K].
            let mut net: [Reduced; 6] = [[0.0; WIDTH]; 6];
            for (r, of_row) in net.iter_mut().enumerate() {
                let mut sum = [0.0; WIDTH];
                for i in TURNING {
                    add(&mut sum, d.front.dtau_dq[(r, i)] + d.rear.dtau_dq[(r, i)], m.q[i]);
                    add(&mut sum, d.front.dtau_dv[(r, i)] + d.rear.dtau_dv[(r, i)], m.v[i]);
                }
                for i in 0..DOF {
                    add(&mut sum, d.front.mass_matrix[(r, i)] + d.rear.mass_matrix[(r, i)], m.a[i]);
                }
                sum[FREE_MAX] += g[rows::FRONT + r] + g[rows::REAR_BASE + r];
                *of_row = sum;
            }
            let (k1, k2) = (turning(&d.rear.stance.jacobian), turning(&d.front.stance.jacobian));
            let n = (k2 - k1).transpose();
            let direction = (d.front.stance.position - d.rear.stance.position).normalize();
            // δλ2 = N⁺ (moment − K1ᵀ force) + μ · direction; N has rank 2, its kernel is the direction.
            let inverse = (n.transpose() * n + direction * direction.transpose())
                .try_inverse()
                .map_or_else(Matrix3::zeros, |inverse| inverse * n.transpose());
            let mut moment: [Reduced; 3] = [net[3], net[4], net[5]];
            for (r, row) in moment.iter_mut().enumerate() {
                for k in 0..3 {
                    add(row, -k1[(k, r)], &net[k]);
                }
            }
            for r in 0..3 {
                let mut row = [0.0; WIDTH];
                for k in 0..3 {
                    add(&mut row, inverse[(r, k)], &moment[k]);
                }
                out.lambda_2[r] = row;
                out.lambda_1[r] = net[r];
                add(&mut out.lambda_1[r], -1.0, &row);
            }
            let (j2, j1) = (&d.front.stance.jacobian, &d.rear.stance_jacobian_own);
            for i in 0..6 {
                // The rear biped's legs follow the front one's diagonally.
                let (own, opposite) = if i < 3 { (6..9, 9..DOF) } else { (9..DOF, 6..9) };
                let mut front = torque(&m, &d.front, i, own, g[rows::FRONT + 6 + i]);
                let mut rear = torque(&m, &d.rear, i, opposite, g[rows::REAR_TORQUE + i]);
                for k in 0..3 {
                    add(&mut front, -j2[(k, 6 + i)], &out.lambda_2[k]);
                    add(&mut rear, -j1[(k, 6 + i)], &out.lambda_1[k]);
                }
                (out.front_torque[i], out.rear_torque[i]) = (front, rear);
                out.front_internal[i] = -j2.column(6 + i).dot(&direction);
                out.rear_internal[i] = j1.column(6 + i).dot(&direction);
            }
            out.direction = direction;
        }
    }

    /// The program in the free inputs and the internal forces.
    #[inline(always)]
    #[allow(clippy::too_many_arguments)]
    fn assemble(
        &mut self,
        program: &DecomposedProgram,
        x: &[f64],
        g: &[f64],
        free: usize,
        inputs: &[Reduced; INPUTS],
        roll: &[Reduced; COEFFICIENTS],
    ) {
        let qp = &mut self.qp;
        qp.rows.clear();
        let bounds = program.bounds();
        // No internal force in it.
        const NONE: (usize, f64) = (0, 0.0);
        let mut push = |row: &Reduced, own: (usize, f64), value: f64, lower: f64, upper: f64| {
            let mut normal = *row;
            let offset = value + std::mem::take(&mut normal[FREE_MAX]);
            qp.rows.push(ArrowRow { normal, own, offset, lower, upper });
        };
        let mut variable = |row: &Reduced, own: (usize, f64), i: usize| {
            push(row, own, x[i], bounds.variable_lower[i], bounds.variable_upper[i]);
        };
        for k in 0..COEFFICIENTS {
            for output in 0..OUTPUTS {
                let row = if output == STANCE_ROLL { &roll[k] } else { &inputs[coefficients(output) + k] };
                variable(row, NONE, at::alpha(k, output));
            }
        }
        variable(&inputs[STEP_DURATION], NONE, at::T);
        for (index, (motion, forces)) in along(&self.unknown, &self.prescribed).zip(&self.forces).enumerate() {
            let base = at::point(index);
            for i in 0..6 {
                variable(&forces.front_torque[i], (index, forces.front_internal[i]), base + at::U_FRONT + i);
                variable(&forces.rear_torque[i], (index, forces.rear_internal[i]), base + at::U_REAR + i);
            }
            for i in 1..DOF {
                variable(motion.q[i], NONE, base + at::Q + i);
            }
            for i in 6..DOF {
                variable(motion.v[i], NONE, base + at::V + i);
            }
            variable(&forces.lambda_1[2], (index, -forces.direction.z), base + at::LAMBDA_1 + 2);
            variable(&forces.lambda_2[2], (index, forces.direction.z), base + at::LAMBDA_2 + 2);
        }
        let mut constraint = |row: &Reduced, own: (usize, f64), i: usize| {
            push(row, own, g[i], bounds.constraint_lower[i], bounds.constraint_upper[i]);
        };
        let stance_distance = rows::first(program.points()) + rows::TOE_DISTANCE;
        let mut distance = [0.0; WIDTH];
        let first = Along::new(&self.unknown[0], &self.prescribed[0]);
        let (toe_2, toe_1) = (&program.dynamics[0].front.stance, &program.dynamics[0].rear.stance);
        for i in 0..DOF {
            let apart = toe_2.jacobian.column(i) - toe_1.jacobian.column(i);
            add(&mut distance, 2.0 * apart.dot(&(toe_2.position - toe_1.position)), first.q[i]);
        }
        constraint(&distance, NONE, stance_distance);
        let face = program.friction_face;
        for (index, (motion, forces)) in along(&self.unknown, &self.prescribed).zip(&self.forces).enumerate() {
            let r = rows::COUNT * index;
            for (toe, (lambda, sign)) in [(&forces.lambda_1, -1.0), (&forces.lambda_2, 1.0)].into_iter().enumerate() {
                let share = sign * forces.direction;
                for axis in 0..2 {
                    for (side, s) in [-1.0, 1.0].into_iter().enumerate() {
                        let mut row = scaled(&lambda[2], face);
                        add(&mut row, s, &lambda[axis]);
                        let internal = face * share.z + s * share[axis];
                        constraint(&row, (index, internal), r + rows::FRICTION + 4 * toe + 2 * axis + side);
                    }
                }
            }
            let d = &program.dynamics[index];
            for (k, toe) in [&d.front.swing, &d.rear.swing].into_iter().enumerate() {
                let mut row = [0.0; WIDTH];
                // Leg 3 follows leg 0.
                for i in 2..9 {
                    add(&mut row, toe.jacobian[(2, i)], motion.q[i]);
                }
                constraint(&row, NONE, r + rows::SWING + k);
            }
        }

        // Σ w (x + δ − c)²: the constant part of a row becomes its residual, so that one product gives Hessian and gradient.
        let mut hessian = [[0.0; WIDTH]; WIDTH];
        qp.own.clear();
        let mut terms = [(0.0, [0.0; WIDTH]); 6 + DOF + 12];
        for (index, (motion, forces)) in along(&self.unknown, &self.prescribed).zip(&self.forces).enumerate() {
            let mut own = Own { coupling: [0.0; WIDTH], hessian: 0.0, gradient: 0.0 };
            let weights = program.weights_of(index);
            assert_eq!(weights.len(), terms.len(), "a point's terms of the objective");
            for (term, &(i, weight, centre)) in terms.iter_mut().zip(weights) {
                let place = i - at::point(index);
                let (row, share) = match place {
                    at::V..at::A => (motion.v[place - at::V], 0.0),
                    at::A..at::U_FRONT => (motion.a[place - at::A], 0.0),
                    at::U_FRONT..at::LAMBDA_1 => {
                        (&forces.front_torque[place - at::U_FRONT], forces.front_internal[place - at::U_FRONT])
                    }
                    at::U_REAR..at::POINT => {
                        (&forces.rear_torque[place - at::U_REAR], forces.rear_internal[place - at::U_REAR])
                    }
                    _ => unreachable!("only velocities, accelerations and torques are in the objective"),
                };
                *term = (2.0 * weight, *row);
                term.1[FREE_MAX] += x[i] - centre;
                if share != 0.0 {
                    add(&mut own.coupling, term.0 * share, &term.1);
                    own.hessian += term.0 * share * share;
                }
            }
            own.gradient = std::mem::take(&mut own.coupling[FREE_MAX]);
            qp.own.push(own);
            add_squares::<0>(&mut hessian, &terms);
            add_squares::<4>(&mut hessian, &terms);
            add_squares::<8>(&mut hessian, &terms);
            add_squares::<12>(&mut hessian, &terms);
        }
        for a in 0..WIDTH {
            qp.gradient[a] = std::mem::take(&mut hessian[a][FREE_MAX]);
            for b in a + 1..FREE_MAX {
                hessian[b][a] = hessian[a][b];
            }
            if a >= free {
                // Places that stand for nothing stay at zero.
                hessian[a][a] = 1.0;
            }
        }
        qp.hessian = hessian;
    }

    /// The step of all unknowns.
    #[inline(always)]
    fn expand(
        &self,
        program: &DecomposedProgram,
        g: &[f64],
        unknowns: usize,
        inputs: &[Reduced; INPUTS],
        roll: &[Reduced; COEFFICIENTS],
    ) -> Vec<f64> {
        let mut values = self.solver.shared;
        values[FREE_MAX] = 1.0;
        let of = |row: &Reduced| dot(row, &values);
        let mut p = vec![0.0; unknowns];
        for k in 0..COEFFICIENTS {
            for output in 0..OUTPUTS {
                let row = if output == STANCE_ROLL { &roll[k] } else { &inputs[coefficients(output) + k] };
                p[at::alpha(k, output)] = of(row);
            }
        }
        p[at::T] = of(&inputs[STEP_DURATION]);
        for (index, (motion, forces)) in along(&self.unknown, &self.prescribed).zip(&self.forces).enumerate() {
            let internal = self.solver.own[index];
            let p = &mut p[at::point(index)..at::point(index + 1)];
            for i in 0..DOF {
                p[at::Q + i] = of(motion.q[i]);
                p[at::V + i] = of(motion.v[i]);
                p[at::A + i] = of(motion.a[i]);
            }
            for i in 0..3 {
                p[at::LAMBDA_1 + i] = of(&forces.lambda_1[i]) - internal * forces.direction[i];
                p[at::LAMBDA_2 + i] = of(&forces.lambda_2[i]) + internal * forces.direction[i];
            }
            for i in 0..6 {
                p[at::U_FRONT + i] = of(&forces.front_torque[i]) + internal * forces.front_internal[i];
                p[at::U_REAR + i] = of(&forces.rear_torque[i]) + internal * forces.rear_internal[i];
            }
            // The front biped's base rows give the wrench.
            let front = &program.dynamics[index].front;
            let mut out_of_balance: [f64; 6] = std::array::from_fn(|i| g[rows::COUNT * index + rows::FRONT + i]);
            for k in 0..DOF {
                for (i, sum) in out_of_balance.iter_mut().enumerate() {
                    *sum += front.dtau_dq[(i, k)] * p[at::Q + k]
                        + front.dtau_dv[(i, k)] * p[at::V + k]
                        + front.mass_matrix[(i, k)] * p[at::A + k];
                }
            }
            for (i, mut sum) in out_of_balance.into_iter().enumerate() {
                for k in 0..3 {
                    sum -= front.stance.jacobian[(k, i)] * p[at::LAMBDA_2 + k];
                }
                p[at::LAMBDA_C + i] = -sum;
            }
        }
        p
    }
}

/// A leg's torque without the ground force's share: it feels the body and the leg's own joints.
#[inline(always)]
fn torque(m: &Along, biped: &BipedDynamics, r: usize, own: Range<usize>, residual: f64) -> Reduced {
    let mut sum = [0.0; WIDTH];
    for i in (3..6).chain(own.clone()) {
        add(&mut sum, biped.dtau_dq[(6 + r, i)], m.q[i]);
        add(&mut sum, biped.dtau_dv[(6 + r, i)], m.v[i]);
    }
    for i in (0..6).chain(own) {
        add(&mut sum, biped.mass_matrix[(6 + r, i)], m.a[i]);
    }
    sum[FREE_MAX] += residual;
    sum
}

/// All coordinates of a point.
struct Along<'a> {
    q: [&'a Reduced; DOF],
    v: [&'a Reduced; DOF],
    a: [&'a Reduced; DOF],
}

impl<'a> Along<'a> {
    #[inline(always)]
    fn new(unknown: &'a Motion<7, Reduced>, prescribed: &'a Motion<OUTPUTS, Reduced>) -> Self {
        let of = |unknown: &'a [Reduced; 7], prescribed: &'a [Reduced; OUTPUTS]| {
            std::array::from_fn(|i| match i {
                0..6 => &unknown[i],
                _ if i == 6 + STANCE_ROLL => &unknown[6],
                _ => &prescribed[i - 6],
            })
        };
        Self { q: of(&unknown.q, &prescribed.q), v: of(&unknown.v, &prescribed.v), a: of(&unknown.a, &prescribed.a) }
    }
}

#[inline(always)]
fn along<'a>(
    unknown: &'a [Motion<7, Reduced>],
    prescribed: &'a [Motion<OUTPUTS, Reduced>],
) -> impl Iterator<Item = Along<'a>> {
    unknown.iter().zip(prescribed).map(|(unknown, prescribed)| Along::new(unknown, prescribed))
}

#[cfg(all(test, target_arch = "x86_64"))]
mod tests {
    use super::*;
    use crate::tests::{as_steps, vision60};
    use crate::{ProgramSettings, guess, program_of};

    #[test]
    fn wider_registers_give_the_same_step_to_the_bit() {
        assert!(std::arch::is_x86_feature_detected!("avx2"), "this processor has no AVX2: there is nothing to compare");
        let robot = vision60();
        for name in ["gait3", "amble"] {
            let request = as_steps(name, &robot);
            let mut program = program_of(&robot, &request, ProgramSettings::default()).unwrap();
            let x = guess::nominal(&robot, &mut program, &request).unwrap();
            program.ask(&robot, &request);
            let mut at = Evaluation::new(&program);
            program.evaluate(&x, &mut at);
            let narrow = Condensed::default().step(&program, &x, &at.constraints).unwrap();
            let wide = Condensed::default().solve(&program, &x, &at, &at.constraints).unwrap();
            assert_eq!(narrow.iterations, wide.iterations);
            for (a, b) in narrow.step.iter().zip(&wide.step) {
                assert_eq!(a.to_bits(), b.to_bits(), "{name}: {a} and {b}");
            }
        }
    }
}
