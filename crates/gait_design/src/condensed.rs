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

use crate::biped::BipedDynamics;
use crate::program::{COEFFICIENTS, DOF, DecomposedProgram, OUTPUTS, STANCE_ROLL, layout as at, rows};
use gait::bezier;
use nalgebra::{Matrix3, SMatrix, Vector3};
use nlp::{
    ArrowQp, ArrowQpError, ArrowRow, DualActiveSet, Evaluation, Own, Problem, Step, Subproblem, SubproblemError,
};
use std::ops::Range;

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
/// Rows that tie both ends of the step.
const END_ROWS: usize = 30;
/// What the end rows leave free: 14, one more for each that repeats others.
const FREE_MAX: usize = 15;
/// Coordinates whose accelerations are unknown at a point: the base's and the stance hip roll's.
const UNKNOWN: [usize; 7] = [0, 1, 2, 3, 4, 5, 6 + STANCE_ROLL];
/// Those of [`UNKNOWN`] whose positions and velocities change an acceleration or a force. The body's place and its straight
/// speed do not.
const FELT: Range<usize> = 3..7;
/// Coordinates whose positions and velocities change an acceleration or a force: the body's angles and the joints.
const TURNING: Range<usize> = 3..DOF;
/// An end row whose largest entry is below this, relative to where it began, repeats the others.
const REPEATED: f64 = 1e-9;

/// An affine function of the inputs but the shifts: coefficients, then the constant.
type Affine = [f64; SHIFTS + 1];
/// An end row: the inputs' coefficients, zeros that round the length up to vector registers, the constant.
type EndRow = [f64; 48];
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

#[inline(always)]
fn add<const N: usize>(to: &mut [f64; N], scale: f64, from: &[f64; N]) {
    for (t, f) in to.iter_mut().zip(from) {
        *t += scale * f;
    }
}

#[inline(always)]
fn scaled<const N: usize>(row: &[f64; N], scale: f64) -> [f64; N] {
    row.map(|v| scale * v)
}

/// Input number of the first coefficient of an output that is not the stance hip roll.
fn coefficients(output: usize) -> usize {
    let place = if output < STANCE_ROLL { output } else { output - 1 };
    POLYNOMIALS + COEFFICIENTS * place
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

/// Seven linear rows on a point's q, q̇, q̈ with their residuals: stance toes 2 and 1, then the moment about their line.
#[derive(Clone)]
struct PointRows {
    q: [[f64; DOF]; 7],
    v: [[f64; DOF]; 7],
    a: [[f64; DOF]; 7],
    residual: [f64; 7],
}

/// Forces and torques of one point in terms of the free inputs.
#[derive(Clone)]
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

impl Default for PointForces {
    fn default() -> Self {
        Self {
            lambda_1: [[0.0; WIDTH]; 3],
            lambda_2: [[0.0; WIDTH]; 3],
            front_torque: [[0.0; WIDTH]; 6],
            rear_torque: [[0.0; WIDTH]; 6],
            direction: Vector3::zeros(),
            front_internal: [0.0; 6],
            rear_internal: [0.0; 6],
        }
    }
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
        self.rows.extend((0..program.points()).map(|point| point_rows(program, point, constraints)));
        self.follow_polynomials(program, x, constraints);
        // Along the step twice: once for what the ends need, with all inputs, once more with what the ends leave free. The
        // second time costs less than substituting would.
        let (rows, outputs) = (&self.rows, &self.outputs);
        let (last, ends) = (program.points() - 1, &mut self.ends);
        let subtract_outputs = |point: usize, right: &mut [Affine]| {
            for i in prescribed() {
                let first = coefficients(i);
                for (right, c) in right.iter_mut().zip(outputs[point].felt(&rows[point], i)) {
                    for (k, value) in c[..COEFFICIENTS].iter().enumerate() {
                        right[first + k] -= value;
                    }
                    right[STEP_DURATION] -= c[COEFFICIENTS];
                    right[SHIFTS] -= c[COEFFICIENTS + 1];
                }
            }
        };
        move_along(program, x, constraints, rows, &units(), subtract_outputs, |point, motion| {
            if point == 0 || point == last {
                ends[usize::from(point > 0)].clone_from(motion);
            }
        })?;
        let (free, inputs) = self.tie_ends(program, x, constraints)?;
        self.spread_outputs(&inputs);
        let (rows, prescribed_motion, unknown) = (&self.rows, &self.prescribed, &mut self.unknown);
        let subtract_outputs = |point: usize, right: &mut [Reduced]| {
            let (c, motion) = (&rows[point], &prescribed_motion[point]);
            for (r, right) in right.iter_mut().enumerate() {
                for i in prescribed() {
                    add(right, -c.q[r][6 + i], &motion.q[i]);
                    add(right, -c.v[r][6 + i], &motion.v[i]);
                    add(right, -c.a[r][6 + i], &motion.a[i]);
                }
            }
        };
        unknown.clear();
        move_along(program, x, constraints, rows, &inputs, subtract_outputs, |_, motion| unknown.push(motion.clone()))?;
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

impl Motion<OUTPUTS, Own8> {
    /// What an output's motion adds to the seven rows of its point.
    #[inline(always)]
    fn felt(&self, rows: &PointRows, output: usize) -> [Own8; 7] {
        std::array::from_fn(|r| {
            let mut sum = scaled(&self.q[output], rows.q[r][6 + output]);
            add(&mut sum, rows.v[r][6 + output], &self.v[output]);
            add(&mut sum, rows.a[r][6 + output], &self.a[output]);
            sum
        })
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
        let start = program.start_of_first();
        let first = &mut self.outputs[0];
        for i in prescribed() {
            first.q[i][0] = 1.0;
            first.q[i][CONSTANT] = -g[start + i];
            first.v[i][0] = slope[0] / t;
            first.v[i][1] = slope[1] / t;
            first.v[i][T] = -x[at::point(0) + at::V + 6 + i] / t;
            first.v[i][CONSTANT] = -g[start + 6 + i] / t;
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

    /// Part 2: how many numbers the end rows leave free, and the inputs as affine functions of them.
    #[inline(always)]
    fn tie_ends(
        &self,
        program: &DecomposedProgram,
        x: &[f64],
        g: &[f64],
    ) -> Result<(usize, [Reduced; INPUTS]), SubproblemError> {
        const CONSTANT: usize = 47;
        let last = program.points() - 1;
        let end = |point: usize, ends: &Motion<7, Affine>| {
            let mut motion: Motion<DOF, EndRow> = Motion::default();
            let widen = |from: &Affine| {
                let mut row = [0.0; 48];
                row[..SHIFTS].copy_from_slice(&from[..SHIFTS]);
                row[CONSTANT] = from[SHIFTS];
                row
            };
            for (k, i) in UNKNOWN.into_iter().enumerate() {
                (motion.q[i], motion.v[i]) = (widen(&ends.q[k]), widen(&ends.v[k]));
            }
            // The base starts elsewhere or drifts; where along x the step begins is nobody's choice.
            let elapsed = program.phase(point) * x[at::T];
            for axis in 0..3 {
                if axis > 0 {
                    motion.q[axis][SHIFTS + axis - 1] = 1.0;
                }
                motion.q[axis][STRAIGHT_RATES + axis] = elapsed;
                motion.v[axis][STRAIGHT_RATES + axis] = 1.0;
            }
            for i in prescribed() {
                let own = &self.outputs[point];
                for (to, from) in [(&mut motion.q[6 + i], &own.q[i]), (&mut motion.v[6 + i], &own.v[i])] {
                    let first = coefficients(i);
                    to[first..first + COEFFICIENTS].copy_from_slice(&from[..COEFFICIENTS]);
                    to[STEP_DURATION] = from[COEFFICIENTS];
                    to[CONSTANT] = from[COEFFICIENTS + 1];
                }
            }
            motion
        };
        let (first, last, d0, d1) =
            (end(0, &self.ends[0]), end(last, &self.ends[1]), program.dynamics(0), program.dynamics(last));
        let mut e = [[0.0; 48]; END_ROWS];
        let start = program.start_of_first();
        for (row, toe, residual) in [(0, &d0.front.stance, g[start + 12]), (1, &d0.rear.stance, g[start + 13])] {
            for i in 0..DOF {
                add(&mut e[row], toe.jacobian[(2, i)], &first.q[i]);
            }
            e[row][CONSTANT] += residual;
        }
        let start = program.start_of_boundary();
        for i in 0..DOF {
            let (from, sign) = program.mirror(i);
            let row = &mut e[2 + i];
            add(row, 1.0, &last.q[i]);
            add(row, -sign, &first.q[from]);
            row[CONSTANT] += g[start + i];
            let row = &mut e[14 + i];
            add(row, sign, &first.v[from]);
            add(row, -1.0, &last.v[i]);
            row[CONSTANT] += g[start + 12 + i];
        }
        e[2][STEP_DURATION] -= program.speed_m_s();
        for (row, toe, axis) in
            [(26, &d1.front.swing, 0), (27, &d1.front.swing, 1), (28, &d1.front.swing, 2), (29, &d1.rear.swing, 2)]
        {
            for i in 0..DOF {
                add(&mut e[row], toe.dvelocity_dq[(axis, i)], &last.q[i]);
                add(&mut e[row], toe.jacobian[(axis, i)], &last.v[i]);
            }
            e[row][CONSTANT] += g[start + row - 2];
        }

        // Gauss with complete pivoting, then the pivots' inputs from the last back to the first.
        let mut pivots: Vec<(usize, usize)> = Vec::with_capacity(END_ROWS);
        let mut waiting: Vec<usize> = (0..END_ROWS).collect();
        let size = e.iter().map(largest).fold(1.0, f64::max);
        while !waiting.is_empty() {
            let (mut place, mut best) = (0, 0.0);
            for (k, &r) in waiting.iter().enumerate() {
                let size = largest(&e[r]);
                if size > best {
                    (place, best) = (k, size);
                }
            }
            if best.is_nan() || best <= REPEATED * size {
                // Rows that repeat the others; what is left of their residual is for the next iteration to see.
                break;
            }
            let row = waiting.swap_remove(place);
            let column = e[row].iter().position(|v| v.abs() == best).expect("the largest entry is one of them");
            pivots.push((row, column));
            e[row] = scaled(&e[row], 1.0 / e[row][column]);
            let pivot = e[row];
            for &r in &waiting {
                let factor = e[r][column];
                if factor != 0.0 {
                    add(&mut e[r], -factor, &pivot);
                    e[r][column] = 0.0;
                }
            }
        }
        let free: Vec<usize> = (0..INPUTS).filter(|c| pivots.iter().all(|p| p.1 != *c)).collect();
        if free.len() > FREE_MAX {
            return Err(SubproblemError::Stopped(format!("{} of {END_ROWS} end rows repeat others", free.len() - 14)));
        }
        let mut inputs = [[0.0; WIDTH]; INPUTS];
        for (k, &input) in free.iter().enumerate() {
            inputs[input][k] = 1.0;
        }
        for (done, &(row, column)) in pivots.iter().enumerate().rev() {
            let mut input = [0.0; WIDTH];
            for (k, &f) in free.iter().enumerate() {
                input[k] = -e[row][f];
            }
            input[FREE_MAX] = -e[row][CONSTANT];
            for &(_, later) in &pivots[done + 1..] {
                add(&mut input, -e[row][later], &inputs[later]);
            }
            inputs[column] = input;
        }
        Ok((free.len(), inputs))
    }

    /// The prescribed outputs' motion as functions of the free inputs.
    #[inline(always)]
    fn spread_outputs(&mut self, inputs: &[Reduced; INPUTS]) {
        self.prescribed.resize(self.outputs.len(), Motion::default());
        for (to, from) in self.prescribed.iter_mut().zip(&self.outputs) {
            for i in prescribed() {
                let inputs_of = &inputs[coefficients(i)..coefficients(i) + COEFFICIENTS];
                let spread = |own: &Own8| {
                    let mut row = [0.0; WIDTH];
                    row[FREE_MAX] = own[COEFFICIENTS + 1];
                    for (value, input) in own.iter().zip(inputs_of) {
                        add(&mut row, *value, input);
                    }
                    add(&mut row, own[COEFFICIENTS], &inputs[STEP_DURATION]);
                    row
                };
                to.q[i] = spread(&from.q[i]);
                to.v[i] = spread(&from.v[i]);
                to.a[i] = spread(&from.a[i]);
            }
        }
    }

    /// Part 3: forces and torques of every point in terms of the free inputs and the internal forces.
    #[inline(always)]
    fn find_forces(&mut self, program: &DecomposedProgram, g: &[f64]) {
        self.forces.resize(self.unknown.len(), PointForces::default());
        for (point, (m, out)) in along(&self.unknown, &self.prescribed).zip(&mut self.forces).enumerate() {
            let d = program.dynamics(point);
            let g = &g[rows::COUNT * point..rows::COUNT * (point + 1)];
            // Both bipeds' base rows: J_1bᵀ δλ1 + J_2bᵀ δλ2 = net, with J_b = [I K].
            let net: [Reduced; 6] = std::array::from_fn(|r| {
                let mut sum = [0.0; WIDTH];
                for i in TURNING {
                    add(&mut sum, d.front.dtau_dq[(r, i)] + d.rear.dtau_dq[(r, i)], m.q(i));
                    add(&mut sum, d.front.dtau_dv[(r, i)] + d.rear.dtau_dv[(r, i)], m.v(i));
                }
                for i in 0..DOF {
                    add(&mut sum, d.front.mass_matrix[(r, i)] + d.rear.mass_matrix[(r, i)], m.a(i));
                }
                sum[FREE_MAX] += g[rows::FRONT + r] + g[rows::REAR_BASE + r];
                sum
            });
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
            // A leg's torques feel the body and the leg's own joints; the stance leg's the ground force as well.
            let torque = |biped: &BipedDynamics, r: usize, own: Range<usize>, residual: f64| {
                let mut sum = [0.0; WIDTH];
                for i in (3..6).chain(own.clone()) {
                    add(&mut sum, biped.dtau_dq[(6 + r, i)], m.q(i));
                    add(&mut sum, biped.dtau_dv[(6 + r, i)], m.v(i));
                }
                for i in (0..6).chain(own) {
                    add(&mut sum, biped.mass_matrix[(6 + r, i)], m.a(i));
                }
                sum[FREE_MAX] += residual;
                sum
            };
            let (j2, j1) = (&d.front.stance.jacobian, &d.rear.stance_jacobian_own);
            for i in 0..6 {
                // The rear biped's legs follow the front one's diagonally.
                let (own, opposite) = if i < 3 { (6..9, 9..DOF) } else { (9..DOF, 6..9) };
                out.front_torque[i] = torque(&d.front, i, own, g[rows::FRONT + 6 + i]);
                out.rear_torque[i] = torque(&d.rear, i, opposite, g[rows::REAR_TORQUE + i]);
                for k in 0..3 {
                    add(&mut out.front_torque[i], -j2[(k, 6 + i)], &out.lambda_2[k]);
                    add(&mut out.rear_torque[i], -j1[(k, 6 + i)], &out.lambda_1[k]);
                }
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
                variable(motion.q(i), NONE, base + at::Q + i);
            }
            for i in 6..DOF {
                variable(motion.v(i), NONE, base + at::V + i);
            }
            variable(&forces.lambda_1[2], (index, -forces.direction.z), base + at::LAMBDA_1 + 2);
            variable(&forces.lambda_2[2], (index, forces.direction.z), base + at::LAMBDA_2 + 2);
        }
        let mut constraint = |row: &Reduced, own: (usize, f64), i: usize| {
            push(row, own, g[i], bounds.constraint_lower[i], bounds.constraint_upper[i]);
        };
        let stance_distance = program.start_of_first() + 14;
        let mut distance = [0.0; WIDTH];
        let first = Along { unknown: &self.unknown[0], prescribed: &self.prescribed[0] };
        let (toe_2, toe_1) = (&program.dynamics(0).front.stance, &program.dynamics(0).rear.stance);
        for i in 0..DOF {
            let apart = toe_2.jacobian.column(i) - toe_1.jacobian.column(i);
            add(&mut distance, 2.0 * apart.dot(&(toe_2.position - toe_1.position)), first.q(i));
        }
        constraint(&distance, NONE, stance_distance);
        let face = program.friction_face();
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
            let d = program.dynamics(index);
            for (k, toe) in [&d.front.swing, &d.rear.swing].into_iter().enumerate() {
                let mut row = [0.0; WIDTH];
                // Leg 3 follows leg 0.
                for i in 2..9 {
                    add(&mut row, toe.jacobian[(2, i)], motion.q(i));
                }
                constraint(&row, NONE, r + rows::SWING + k);
            }
        }

        // Σ w (x + δ − c)²: the constant part of a row becomes its residual, so that one product gives Hessian and gradient.
        let mut hessian = [[0.0; WIDTH]; WIDTH];
        qp.own.clear();
        for (index, (motion, forces)) in along(&self.unknown, &self.prescribed).zip(&self.forces).enumerate() {
            let mut own = Own { coupling: [0.0; WIDTH], hessian: 0.0, gradient: 0.0 };
            let mut terms = [(0.0, [0.0; WIDTH]); 6 + DOF + 12];
            let weights = program.weights_of(index);
            assert_eq!(weights.len(), terms.len(), "a point's terms of the objective");
            for (term, &(i, weight, centre)) in terms.iter_mut().zip(weights) {
                let place = i - at::point(index);
                let (row, share) = match place {
                    at::V..at::A => (motion.v(place - at::V), 0.0),
                    at::A..at::U_FRONT => (motion.a(place - at::A), 0.0),
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
            for (a, sum) in hessian[..FREE_MAX].iter_mut().enumerate() {
                let mut row = *sum;
                for (weight, term) in &terms {
                    add(&mut row, weight * term[a], term);
                }
                *sum = row;
            }
        }
        for (a, row) in hessian.iter_mut().enumerate() {
            qp.gradient[a] = std::mem::take(&mut row[FREE_MAX]);
            if a >= free {
                // Places that stand for nothing stay at zero.
                row[a] = 1.0;
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
        let of = |row: &Reduced| row.iter().zip(&values).map(|(a, b)| a * b).sum::<f64>();
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
                p[at::Q + i] = of(motion.q(i));
                p[at::V + i] = of(motion.v(i));
                p[at::A + i] = of(motion.a(i));
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
            let front = &program.dynamics(index).front;
            for i in 0..6 {
                let mut out_of_balance = g[rows::COUNT * index + rows::FRONT + i];
                for k in 0..DOF {
                    out_of_balance += front.dtau_dq[(i, k)] * p[at::Q + k]
                        + front.dtau_dv[(i, k)] * p[at::V + k]
                        + front.mass_matrix[(i, k)] * p[at::A + k];
                }
                for k in 0..3 {
                    out_of_balance -= front.stance.jacobian[(k, i)] * p[at::LAMBDA_2 + k];
                }
                p[at::LAMBDA_C + i] = -out_of_balance;
            }
        }
        p
    }
}

/// All coordinates of a point.
#[derive(Clone, Copy)]
struct Along<'a> {
    unknown: &'a Motion<7, Reduced>,
    prescribed: &'a Motion<OUTPUTS, Reduced>,
}

fn along<'a>(
    unknown: &'a [Motion<7, Reduced>],
    prescribed: &'a [Motion<OUTPUTS, Reduced>],
) -> impl Iterator<Item = Along<'a>> {
    unknown.iter().zip(prescribed).map(|(unknown, prescribed)| Along { unknown, prescribed })
}

impl<'a> Along<'a> {
    #[inline(always)]
    fn of(i: usize, unknown: &'a [Reduced; 7], prescribed: &'a [Reduced; OUTPUTS]) -> &'a Reduced {
        match i {
            0..6 => &unknown[i],
            _ if i == 6 + STANCE_ROLL => &unknown[6],
            _ => &prescribed[i - 6],
        }
    }

    #[inline(always)]
    fn q(&self, i: usize) -> &'a Reduced {
        Self::of(i, &self.unknown.q, &self.prescribed.q)
    }

    #[inline(always)]
    fn v(&self, i: usize) -> &'a Reduced {
        Self::of(i, &self.unknown.v, &self.prescribed.v)
    }

    #[inline(always)]
    fn a(&self, i: usize) -> &'a Reduced {
        Self::of(i, &self.unknown.a, &self.prescribed.a)
    }
}

/// The largest entry of a row among the inputs, without its sign.
#[inline(always)]
fn largest(row: &EndRow) -> f64 {
    // Lane by lane first: one comparison after the other would take longer than the elimination.
    let (fours, _) = row[..INPUTS].as_chunks::<4>();
    let mut lanes = [0.0_f64; 4];
    for four in fours {
        for (lane, value) in lanes.iter_mut().zip(four) {
            *lane = if value.abs() > *lane { value.abs() } else { *lane };
        }
    }
    lanes.into_iter().fold(0.0, f64::max)
}

/// One Hermite–Simpson interval of the linearised program.
struct Interval<'a> {
    x: &'a [f64],
    /// Residuals of the interval's rows.
    g: &'a [f64],
    first_point: usize,
    /// Its duration, and that over T.
    h: f64,
    per_t: f64,
}

impl<'a> Interval<'a> {
    fn new(program: &DecomposedProgram, x: &'a [f64], g: &'a [f64], interval: usize) -> Self {
        let per_t = 2.0 / (program.points() - 1) as f64;
        let g = &g[program.start_of_intervals() + rows::INTERVAL * interval..];
        Self { x, g, first_point: 2 * interval, h: per_t * x[at::T], per_t }
    }

    /// What T and the residuals add to the value in the middle and at the end: the end's share of T and its constant, then the
    /// middle's, which holds half of the end's.
    #[inline(always)]
    fn own(&self, slope: usize, i: usize) -> [[f64; 2]; 2] {
        let f: [f64; 3] = std::array::from_fn(|k| self.x[at::point(self.first_point + k) + slope + i]);
        let block = if slope == at::V { 0 } else { 24 };
        let end = [self.per_t / 6.0 * (f[0] + 4.0 * f[1] + f[2]), -self.g[block + DOF + i]];
        let middle = [0.5 * end[0] + self.per_t / 8.0 * (f[0] - f[2]), 0.5 * end[1] - self.g[block + i]];
        [end, middle]
    }

    /// Value of coordinate `i` in the middle and at the end from the value at the start and the slopes at the three points
    /// (velocities if `slope` is [`at::V`], accelerations if it is [`at::A`]).
    #[inline(always)]
    fn integrate<const N: usize>(
        &self,
        slope: usize,
        i: usize,
        start: &[f64; N],
        [f0, f1, f2]: [&[f64; N]; 3],
        duration: &[f64; N],
    ) -> ([f64; N], [f64; N]) {
        let h = self.h;
        let [of_end, of_middle] = self.own(slope, i);
        let mut end = *start;
        add(&mut end, h / 6.0, f0);
        add(&mut end, 4.0 * h / 6.0, f1);
        add(&mut end, h / 6.0, f2);
        let mut middle = scaled(start, 0.5);
        add(&mut middle, 0.5, &end);
        add(&mut middle, h / 8.0, f0);
        add(&mut middle, -h / 8.0, f2);
        add(&mut end, of_end[0], duration);
        end[N - 1] += of_end[1];
        add(&mut middle, of_middle[0], duration);
        middle[N - 1] += of_middle[1];
        (middle, end)
    }
}

/// Part 1: q, q̇, q̈ of the unknown coordinates at every point, as affine functions of whatever the inputs are functions of.
/// `subtract_outputs` takes what the prescribed outputs add to a point's rows from their right-hand sides; `each` gets the
/// points one after the other.
#[inline(always)]
fn move_along<const N: usize>(
    program: &DecomposedProgram,
    x: &[f64],
    g: &[f64],
    rows: &[PointRows],
    inputs: &[[f64; N]; INPUTS],
    subtract_outputs: impl Fn(usize, &mut [[f64; N]]),
    mut each: impl FnMut(usize, &Motion<7, [f64; N]>),
) -> Result<(), SubproblemError> {
    let constant = N - 1;
    let duration = &inputs[STEP_DURATION];
    // An interval's three points; the last is the next one's first.
    let [mut start, mut middle, mut end]: [Motion<7, [f64; N]>; 3] = Default::default();
    let right_hand_side = |point: usize, motion: &Motion<7, [f64; N]>, right: &mut [[f64; N]]| {
        let c = &rows[point];
        for (r, right) in right.iter_mut().enumerate() {
            let mut sum = [0.0; N];
            sum[constant] = -c.residual[r];
            for k in FELT {
                add(&mut sum, -c.q[r][UNKNOWN[k]], &motion.q[k]);
                add(&mut sum, -c.v[r][UNKNOWN[k]], &motion.v[k]);
            }
            *right = sum;
        }
        subtract_outputs(point, right);
    };

    let first = &mut start;
    first.q[0] = [0.0; N];
    first.q[0][constant] = -x[at::point(0) + at::Q];
    first.q[1..3].copy_from_slice(&inputs[SHIFTS..STRAIGHT_RATES]);
    first.q[3..6].copy_from_slice(&inputs[ANGLES..TURNING_RATES]);
    first.q[6] = inputs[ROLL];
    first.v[..3].copy_from_slice(&inputs[STRAIGHT_RATES..INPUTS]);
    first.v[3..6].copy_from_slice(&inputs[TURNING_RATES..ROLL]);
    first.v[6] = inputs[ROLL + 1];
    let mut matrix: [[f64; 7]; 7] = std::array::from_fn(|r| UNKNOWN.map(|u| rows[0].a[r][u]));
    let mut right = [[0.0; N]; 7];
    right_hand_side(0, first, &mut right);
    solve_square(&mut matrix, &mut right)?;
    first.a = right;
    each(0, &start);

    for interval in 0..program.points() / 2 {
        let hs = Interval::new(program, x, g, interval);
        let h = hs.h;
        let p1 = 2 * interval + 1;
        // With the unknown accelerations 0 at first.
        for (k, i) in UNKNOWN.into_iter().enumerate() {
            let (q0, v0, a0) = (&start.q[k], &start.v[k], &start.a[k]);
            let [end_v, middle_v] = hs.own(at::A, i);
            let [mut end_q, mut middle_q] = hs.own(at::V, i);
            // The end's position integrates the velocities in the middle and at the end, the middle's uses the end's.
            for n in 0..2 {
                let slopes = h / 6.0 * (4.0 * middle_v[n] + end_v[n]);
                end_q[n] += slopes;
                middle_q[n] += 0.5 * slopes - h / 8.0 * end_v[n];
            }
            for (to, from, own) in [
                (&mut middle.v[k], [0.0, 1.0, 5.0 * h / 24.0], middle_v),
                (&mut end.v[k], [0.0, 1.0, h / 6.0], end_v),
                (&mut middle.q[k], [1.0, h / 2.0, h * h / 16.0], middle_q),
                (&mut end.q[k], [1.0, h, h * h / 6.0], end_q),
            ] {
                let mut row = scaled(v0, from[1]);
                add(&mut row, from[0], q0);
                add(&mut row, from[2], a0);
                add(&mut row, own[0], duration);
                row[constant] += own[1];
                *to = row;
            }
        }
        let (c1, c2) = (&rows[p1], &rows[p1 + 1]);
        let mut matrix = [[0.0; 14]; 14];
        let mut right = [[0.0; N]; 14];
        for r in 0..7 {
            for (k, u) in UNKNOWN.into_iter().enumerate() {
                // What a unit of acceleration in the middle and at the end does to q̇ and q of both points.
                let (q, v, a) = (c1.q[r][u], c1.v[r][u], c1.a[r][u]);
                matrix[r][k] = a + v * h / 3.0 + q * h * h / 12.0;
                matrix[r][7 + k] = -v * h / 24.0 - q * h * h / 48.0;
                let (q, v, a) = (c2.q[r][u], c2.v[r][u], c2.a[r][u]);
                matrix[7 + r][k] = v * 2.0 * h / 3.0 + q * h * h / 3.0;
                matrix[7 + r][7 + k] = a + v * h / 6.0;
            }
        }
        let (of_middle, of_end) = right.split_at_mut(7);
        right_hand_side(p1, &middle, of_middle);
        right_hand_side(p1 + 1, &end, of_end);
        solve_square(&mut matrix, &mut right)?;
        for k in 0..7 {
            let (a1, a2) = (&right[k], &right[7 + k]);
            middle.a[k] = *a1;
            end.a[k] = *a2;
            add(&mut middle.v[k], h / 3.0, a1);
            add(&mut middle.v[k], -h / 24.0, a2);
            add(&mut middle.q[k], h * h / 12.0, a1);
            add(&mut middle.q[k], -h * h / 48.0, a2);
            add(&mut end.v[k], 2.0 * h / 3.0, a1);
            add(&mut end.v[k], h / 6.0, a2);
            add(&mut end.q[k], h * h / 3.0, a1);
        }
        each(p1, &middle);
        each(p1 + 1, &end);
        std::mem::swap(&mut start, &mut end);
    }
    Ok(())
}

/// The base's rotational part of a toe's Jacobian.
#[inline(always)]
fn turning(jacobian: &SMatrix<f64, 3, DOF>) -> Matrix3<f64> {
    jacobian.fixed_columns::<3>(3).into_owned()
}

#[inline(always)]
fn point_rows(program: &DecomposedProgram, point: usize, g: &[f64]) -> PointRows {
    let d = program.dynamics(point);
    let g = &g[rows::COUNT * point..rows::COUNT * (point + 1)];
    let mut c = PointRows { q: [[0.0; DOF]; 7], v: [[0.0; DOF]; 7], a: [[0.0; DOF]; 7], residual: [0.0; 7] };
    for (first, toe, place) in [(0, &d.front.stance, rows::TOE_2), (3, &d.rear.stance, rows::TOE_1)] {
        for r in 0..3 {
            for i in 0..DOF {
                c.q[first + r][i] = toe.dacceleration_dq[(r, i)];
                c.v[first + r][i] = toe.dacceleration_dv[(r, i)];
                c.a[first + r][i] = toe.jacobian[(r, i)];
            }
        }
        c.residual[first..first + 3].copy_from_slice(&g[place..place + 3]);
    }
    // The base motion that leaves both stance toes where they are: a turn about the line between them. Along it neither
    // ground force does work, so that combination of the base rows is free of both.
    let (k1, k2) = (turning(&d.rear.stance.jacobian), turning(&d.front.stance.jacobian));
    let n = k2 - k1;
    let r: [Vector3<f64>; 3] = std::array::from_fn(|i| n.row(i).transpose());
    let turn = [r[0].cross(&r[1]), r[1].cross(&r[2]), r[2].cross(&r[0])]
        .into_iter()
        .max_by(|a, b| a.norm_squared().total_cmp(&b.norm_squared()))
        .expect("three candidates")
        .normalize();
    let shift = -(k1 * turn);
    let weights: [f64; 6] = std::array::from_fn(|r| if r < 3 { shift[r] } else { turn[r - 3] });
    for i in 0..DOF {
        for (r, weight) in weights.iter().enumerate() {
            c.q[6][i] += weight * (d.front.dtau_dq[(r, i)] + d.rear.dtau_dq[(r, i)]);
            c.v[6][i] += weight * (d.front.dtau_dv[(r, i)] + d.rear.dtau_dv[(r, i)]);
            c.a[6][i] += weight * (d.front.mass_matrix[(r, i)] + d.rear.mass_matrix[(r, i)]);
        }
    }
    for (r, weight) in weights.iter().enumerate() {
        c.residual[6] += weight * (g[rows::FRONT + r] + g[rows::REAR_BASE + r]);
    }
    c
}

/// Coefficients of the stance hip roll: its value and slope at the first point and its accelerations at four more.
#[inline(always)]
fn stance_roll_coefficients(
    program: &DecomposedProgram,
    x: &[f64],
    g: &[f64],
    unknown: &[Motion<7, Reduced>],
    inputs: &[Reduced; INPUTS],
) -> Result<[Reduced; COEFFICIENTS], SubproblemError> {
    let t = x[at::T];
    let coordinate = 6 + STANCE_ROLL;
    let start = program.start_of_first();
    let mut matrix = [[0.0; COEFFICIENTS]; COEFFICIENTS];
    let mut right = [[0.0; WIDTH]; COEFFICIENTS];
    matrix[0] = bezier::basis(0.0);
    right[0] = unknown[0].q[6];
    right[0][FREE_MAX] += g[start + STANCE_ROLL];
    matrix[1] = bezier::basis_first_derivative(0.0);
    right[1] = scaled(&unknown[0].v[6], t);
    add(&mut right[1], x[at::point(0) + at::V + coordinate], &inputs[STEP_DURATION]);
    right[1][FREE_MAX] += g[start + 6 + STANCE_ROLL];
    let kept = (0..program.points()).filter(|&p| program.keeps_stance_roll(p));
    for (row, point) in (2..).zip(kept) {
        matrix[row] = bezier::basis_second_derivative(program.phase(point));
        right[row] = scaled(&unknown[point].a[6], t * t);
        let acceleration = x[at::point(point) + at::A + coordinate];
        add(&mut right[row], 2.0 * t * acceleration, &inputs[STEP_DURATION]);
        right[row][FREE_MAX] += g[rows::COUNT * point + rows::OUTPUT + STANCE_ROLL];
    }
    solve_square(&mut matrix, &mut right)?;
    Ok(right)
}

/// Gauss with row pivoting; the solution replaces `right`.
#[inline(always)]
fn solve_square<const N: usize, const W: usize>(
    matrix: &mut [[f64; N]; N],
    right: &mut [[f64; W]; N],
) -> Result<(), SubproblemError> {
    for c in 0..N {
        let pivot = (c..N).max_by(|&a, &b| matrix[a][c].abs().total_cmp(&matrix[b][c].abs())).expect("c < N");
        matrix.swap(c, pivot);
        right.swap(c, pivot);
        let size = matrix[c][c];
        if size.abs() < 1e-12 || !size.is_finite() {
            return Err(SubproblemError::Stopped("the stance toes do not hold the base".into()));
        }
        let (row, known) = (matrix[c], right[c]);
        for r in c + 1..N {
            let factor = matrix[r][c] / size;
            if factor != 0.0 {
                for k in c + 1..N {
                    matrix[r][k] -= factor * row[k];
                }
                add(&mut right[r], -factor, &known);
            }
        }
    }
    for c in (0..N).rev() {
        right[c] = scaled(&right[c], 1.0 / matrix[c][c]);
        let known = right[c];
        for r in 0..c {
            add(&mut right[r], -matrix[r][c], &known);
        }
    }
    Ok(())
}

#[cfg(all(test, target_arch = "x86_64"))]
mod tests {
    use super::*;
    use crate::tests::vision60;
    use crate::{GaitRequest, ProgramSettings, guess, program_of};

    #[test]
    fn wider_registers_give_the_same_step_to_the_bit() {
        assert!(std::arch::is_x86_feature_detected!("avx2"), "this processor has no AVX2: there is nothing to compare");
        let robot = vision60();
        for name in ["gait3", "amble"] {
            let request = GaitRequest::named(name, &robot).unwrap();
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
