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
//! What remains is a dense program of about 25 unknowns with the inequalities, which [`nlp::DualActiveSet`] solves. The step
//! is the same as the sparse subproblem's.

use crate::program::{COEFFICIENTS, DOF, DecomposedProgram, OUTPUTS, STANCE_ROLL, layout as at, rows};
use gait::bezier;
use nalgebra::{Matrix3, SMatrix, Vector3};
use nlp::{DenseQp, DenseQpError, DualActiveSet, Evaluation, Problem, Step, Subproblem, SubproblemError};

/// The numbers that the motion depends on: base position at the first point without x (5), its velocity (6), the stance hip
/// roll's position and velocity (2), six coefficients of each of the other five outputs (30), T.
const INPUTS: usize = 44;
const STEP_DURATION: usize = INPUTS - 1;
/// Constant part, after the inputs.
const CONSTANT: usize = INPUTS;
/// Rows that tie both ends of the step.
const END_ROWS: usize = 30;
/// Room for what the end rows leave free (14) and the constant part, which comes last.
const FREE_MAX: usize = 15;
const WIDTH: usize = FREE_MAX + 1;
/// Coordinates whose accelerations are unknown at a point: the base's and the stance hip roll's.
const UNKNOWN: [usize; 7] = [0, 1, 2, 3, 4, 5, 6 + STANCE_ROLL];
/// An end row whose largest entry is below this, relative to where it began, repeats the others.
const REPEATED: f64 = 1e-9;

/// An affine function of the inputs: coefficients, then the constant.
type Affine = [f64; INPUTS + 1];
/// An affine function of what the end rows leave free: coefficients, then the constant.
type Reduced = [f64; WIDTH];

/// The inputs as functions of themselves.
fn units() -> [Affine; INPUTS] {
    std::array::from_fn(|input| {
        let mut row = [0.0; INPUTS + 1];
        row[input] = 1.0;
        row
    })
}

fn add<const N: usize>(to: &mut [f64; N], scale: f64, from: &[f64; N]) {
    for (t, f) in to.iter_mut().zip(from) {
        *t += scale * f;
    }
}

fn scaled<const N: usize>(row: &[f64; N], scale: f64) -> [f64; N] {
    row.map(|v| scale * v)
}

/// Input number of coefficient `k` of an output that is not the stance hip roll.
fn coefficient(output: usize, k: usize) -> usize {
    let place = if output < STANCE_ROLL { output } else { output - 1 };
    13 + COEFFICIENTS * place + k
}

/// q, q̇, q̈ of one point as functions of the inputs.
#[derive(Clone)]
struct Motion<R> {
    q: [R; DOF],
    v: [R; DOF],
    a: [R; DOF],
}

/// Seven linear rows on a point's q, q̇, q̈ with their residuals: stance toes 2 and 1, then the moment about their line.
struct PointRows {
    q: SMatrix<f64, 7, DOF>,
    v: SMatrix<f64, 7, DOF>,
    a: SMatrix<f64, 7, DOF>,
    residual: [f64; 7],
}

/// A bounded quantity: how it depends on the free inputs and on a point's internal force.
struct Bounded {
    row: Reduced,
    internal: Option<(usize, f64)>,
    value: f64,
    lower: f64,
    upper: f64,
}

/// Everything of one point in terms of the free inputs.
#[derive(Clone)]
struct ReducedPoint {
    motion: Motion<Reduced>,
    lambda_1: [Reduced; 3],
    lambda_2: [Reduced; 3],
    wrench: [Reduced; 6],
    front_torque: [Reduced; 6],
    rear_torque: [Reduced; 6],
    /// Share of the internal force in λ2 (its negative is λ1's), the torques and the wrench.
    direction: Vector3<f64>,
    front_internal: [f64; 6],
    rear_internal: [f64; 6],
    wrench_internal: [f64; 6],
}

/// The structured solver of the subproblems of a [`DecomposedProgram`].
#[derive(Default)]
pub struct Condensed {
    motion: Vec<Motion<Affine>>,
    reduced_motion: Vec<Motion<Reduced>>,
    points: Vec<ReducedPoint>,
    qp: DenseQp,
    solver: DualActiveSet,
}

impl Subproblem<DecomposedProgram> for Condensed {
    fn solve(
        &mut self,
        program: &DecomposedProgram,
        x: &[f64],
        at: &Evaluation,
        constraints: &[f64],
    ) -> Result<Step, SubproblemError> {
        // Along the step twice: once for what the ends need, with all inputs, once more with what the ends leave free. The
        // second time costs less than substituting would.
        move_along(program, x, constraints, &units(), &mut self.motion)?;
        let (free, inputs) = self.tie_ends(program, constraints)?;
        move_along(program, x, constraints, &inputs, &mut self.reduced_motion)?;
        self.reduce(program, constraints);
        let roll = stance_roll_coefficients(program, x, constraints, &self.points, &inputs)?;
        self.assemble(program, x, at, constraints, free, &inputs, &roll);
        self.solver.solve(&self.qp).map_err(|e| match e {
            DenseQpError::Infeasible { .. } => SubproblemError::Infeasible,
            e => SubproblemError::Stopped(e.to_string()),
        })?;
        let step = self.expand(x.len(), free, &inputs, &roll);
        if step.iter().any(|p| !p.is_finite()) {
            return Err(SubproblemError::Stopped("the step is not a number".into()));
        }
        Ok(Step { step, multipliers: None, iterations: self.solver.iterations })
    }
}

impl Condensed {
    /// Part 2: how many numbers the end rows leave free, and the inputs as affine functions of them.
    fn tie_ends(&self, program: &DecomposedProgram, g: &[f64]) -> Result<(usize, [Reduced; INPUTS]), SubproblemError> {
        let (first, last) = (&self.motion[0], self.motion.last().expect("a program has points"));
        let (d0, d1) = (program.dynamics(0), program.dynamics(program.points() - 1));
        let mut e = [[0.0; INPUTS + 1]; END_ROWS];
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

        // Gauss–Jordan with complete pivoting.
        let mut pivot_of = [None; INPUTS];
        let mut done = [false; END_ROWS];
        let size = e.iter().flatten().take(INPUTS).fold(0.0, |a: f64, v| a.max(v.abs())).max(1.0);
        for _ in 0..END_ROWS {
            let (mut best, mut row, mut column) = (0.0, 0, 0);
            for r in (0..END_ROWS).filter(|&r| !done[r]) {
                for c in 0..INPUTS {
                    if e[r][c].abs() > best {
                        (best, row, column) = (e[r][c].abs(), r, c);
                    }
                }
            }
            if best <= REPEATED * size {
                // Rows that repeat the others; what is left of their residual is for the next iteration to see.
                break;
            }
            done[row] = true;
            pivot_of[column] = Some(row);
            e[row] = scaled(&e[row], 1.0 / e[row][column]);
            let pivot = e[row];
            for r in (0..END_ROWS).filter(|&r| r != row) {
                let factor = e[r][column];
                if factor != 0.0 {
                    add(&mut e[r], -factor, &pivot);
                    e[r][column] = 0.0;
                }
            }
        }
        let free: Vec<usize> = (0..INPUTS).filter(|&c| pivot_of[c].is_none()).collect();
        if free.len() > FREE_MAX {
            return Err(SubproblemError::Stopped(format!("{} of {END_ROWS} end rows repeat others", free.len() - 14)));
        }
        let mut inputs = [[0.0; WIDTH]; INPUTS];
        for (input, row) in inputs.iter_mut().enumerate() {
            match pivot_of[input] {
                Some(r) => {
                    for (k, &f) in free.iter().enumerate() {
                        row[k] = -e[r][f];
                    }
                    row[FREE_MAX] = -e[r][CONSTANT];
                }
                None => row[free.iter().position(|&f| f == input).expect("an input without pivot is free")] = 1.0,
            }
        }
        Ok((free.len(), inputs))
    }

    /// Part 3: motion, forces and torques of every point in terms of the free inputs and the internal forces.
    fn reduce(&mut self, program: &DecomposedProgram, g: &[f64]) {
        self.points.clear();
        for (point, m) in self.reduced_motion.iter().enumerate() {
            let d = program.dynamics(point);
            let g = &g[rows::COUNT * point..rows::COUNT * (point + 1)];
            let change = |biped: &crate::biped::BipedDynamics, row: usize, residual: f64| {
                let mut out = [0.0; WIDTH];
                for i in 0..DOF {
                    add(&mut out, biped.dtau_dq[(row, i)], &m.q[i]);
                    add(&mut out, biped.dtau_dv[(row, i)], &m.v[i]);
                    add(&mut out, biped.mass_matrix[(row, i)], &m.a[i]);
                }
                out[FREE_MAX] += residual;
                out
            };
            let front: [Reduced; DOF] = std::array::from_fn(|r| change(&d.front, r, g[rows::FRONT + r]));
            let rear: [Reduced; DOF] = std::array::from_fn(|r| {
                change(&d.rear, r, if r < 6 { g[rows::REAR_BASE + r] } else { g[rows::REAR_TORQUE + r - 6] })
            });
            // Both bipeds' base rows: J_1bᵀ δλ1 + J_2bᵀ δλ2 = net, with J_b = [I K].
            let net: [Reduced; 6] = std::array::from_fn(|r| {
                let mut sum = front[r];
                add(&mut sum, 1.0, &rear[r]);
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
            let lambda_2: [Reduced; 3] = std::array::from_fn(|r| {
                let mut row = [0.0; WIDTH];
                for k in 0..3 {
                    add(&mut row, inverse[(r, k)], &moment[k]);
                }
                row
            });
            let lambda_1: [Reduced; 3] = std::array::from_fn(|r| {
                let mut row = net[r];
                add(&mut row, -1.0, &lambda_2[r]);
                row
            });
            let (j2, j1) = (&d.front.stance.jacobian, &d.rear.stance_jacobian_own);
            let with_force =
                |mut row: Reduced, jacobian: &SMatrix<f64, 3, DOF>, column: usize, force: &[Reduced; 3]| {
                    for k in 0..3 {
                        add(&mut row, -jacobian[(k, column)], &force[k]);
                    }
                    row
                };
            let along = |jacobian: &SMatrix<f64, 3, DOF>, column: usize| jacobian.column(column).dot(&direction);
            self.points.push(ReducedPoint {
                front_torque: std::array::from_fn(|i| with_force(front[6 + i], j2, 6 + i, &lambda_2)),
                rear_torque: std::array::from_fn(|i| with_force(rear[6 + i], j1, 6 + i, &lambda_1)),
                wrench: std::array::from_fn(|i| scaled(&with_force(front[i], j2, i, &lambda_2), -1.0)),
                front_internal: std::array::from_fn(|i| -along(j2, 6 + i)),
                rear_internal: std::array::from_fn(|i| along(j1, 6 + i)),
                wrench_internal: std::array::from_fn(|i| along(j2, i)),
                motion: m.clone(),
                lambda_1,
                lambda_2,
                direction,
            });
        }
    }

    /// The dense program in the free inputs and the internal forces.
    fn assemble(
        &mut self,
        program: &DecomposedProgram,
        x: &[f64],
        evaluation: &Evaluation,
        g: &[f64],
        free: usize,
        inputs: &[Reduced; INPUTS],
        roll: &[Reduced; COEFFICIENTS],
    ) {
        let n = free + program.points();
        let qp = &mut self.qp;
        qp.variables = n;
        qp.hessian.clear();
        qp.hessian.resize(n * n, 0.0);
        qp.gradient.clear();
        qp.gradient.resize(n, 0.0);
        for list in [&mut qp.normals, &mut qp.offset, &mut qp.lower, &mut qp.upper] {
            list.clear();
        }
        let bounds = program.bounds();
        let mut bound = |b: Bounded| {
            let start = qp.normals.len();
            qp.normals.resize(start + n, 0.0);
            qp.normals[start..start + free].copy_from_slice(&b.row[..free]);
            if let Some((point, share)) = b.internal {
                qp.normals[start + free + point] = share;
            }
            qp.offset.push(b.value + b.row[FREE_MAX]);
            qp.lower.push(b.lower);
            qp.upper.push(b.upper);
        };
        let variable = |row: &Reduced, internal: Option<(usize, f64)>, i: usize| Bounded {
            row: *row,
            internal,
            value: x[i],
            lower: bounds.variable_lower[i],
            upper: bounds.variable_upper[i],
        };
        for k in 0..COEFFICIENTS {
            for output in 0..OUTPUTS {
                let row = if output == STANCE_ROLL { &roll[k] } else { &inputs[coefficient(output, k)] };
                bound(variable(row, None, at::alpha(k, output)));
            }
        }
        bound(variable(&inputs[STEP_DURATION], None, at::T));
        let start = program.start_of_first() + 14;
        let mut distance = [0.0; WIDTH];
        for (&(row, column), value) in program.jacobian_pattern().0.iter().zip(&evaluation.jacobian) {
            if row == start {
                add(&mut distance, *value, &self.points[0].motion.q[column - at::point(0) - at::Q]);
            }
        }
        let constraint = |row: Reduced, internal: Option<(usize, f64)>, i: usize| Bounded {
            row,
            internal,
            value: g[i],
            lower: bounds.constraint_lower[i],
            upper: bounds.constraint_upper[i],
        };
        bound(constraint(distance, None, start));
        let face = program.friction_face();
        for (index, point) in self.points.iter().enumerate() {
            let base = at::point(index);
            for i in 0..6 {
                bound(variable(&point.front_torque[i], Some((index, point.front_internal[i])), base + at::U_FRONT + i));
                bound(variable(&point.rear_torque[i], Some((index, point.rear_internal[i])), base + at::U_REAR + i));
            }
            for i in 1..DOF {
                bound(variable(&point.motion.q[i], None, base + at::Q + i));
            }
            for i in 6..DOF {
                bound(variable(&point.motion.v[i], None, base + at::V + i));
            }
            let r = rows::COUNT * index;
            for (toe, (lambda, place, sign)) in
                [(&point.lambda_1, at::LAMBDA_1, -1.0), (&point.lambda_2, at::LAMBDA_2, 1.0)].into_iter().enumerate()
            {
                let share = sign * point.direction;
                bound(variable(&lambda[2], Some((index, share.z)), base + place + 2));
                for axis in 0..2 {
                    for (side, s) in [-1.0, 1.0].into_iter().enumerate() {
                        let mut row = scaled(&lambda[2], face);
                        add(&mut row, s, &lambda[axis]);
                        let internal = face * share.z + s * share[axis];
                        bound(constraint(row, Some((index, internal)), r + rows::FRICTION + 4 * toe + 2 * axis + side));
                    }
                }
            }
            let d = program.dynamics(index);
            for (k, toe) in [&d.front.swing, &d.rear.swing].into_iter().enumerate() {
                let mut row = [0.0; WIDTH];
                for i in 0..DOF {
                    add(&mut row, toe.jacobian[(2, i)], &point.motion.q[i]);
                }
                bound(constraint(row, None, r + rows::SWING + k));
            }
        }

        // Σ w (x + δ − c)².
        for &(i, weight, centre) in program.weights() {
            let (index, place) = ((i - at::POINTS) / at::POINT, (i - at::POINTS) % at::POINT);
            let point = &self.points[index];
            let (row, share) = match place {
                at::V..at::A => (&point.motion.v[place - at::V], 0.0),
                at::A..at::U_FRONT => (&point.motion.a[place - at::A], 0.0),
                at::U_FRONT..at::LAMBDA_1 => {
                    (&point.front_torque[place - at::U_FRONT], point.front_internal[place - at::U_FRONT])
                }
                at::U_REAR..at::POINT => {
                    (&point.rear_torque[place - at::U_REAR], point.rear_internal[place - at::U_REAR])
                }
                _ => unreachable!("only velocities, accelerations and torques are in the objective"),
            };
            let residual = x[i] - centre + row[FREE_MAX];
            let internal = free + index;
            for a in 0..free {
                let w = 2.0 * weight * row[a];
                qp.gradient[a] += w * residual;
                for (h, b) in qp.hessian[a * n..a * n + free].iter_mut().zip(row) {
                    *h += w * b;
                }
                if share != 0.0 {
                    qp.hessian[a * n + internal] += w * share;
                    qp.hessian[internal * n + a] += w * share;
                }
            }
            qp.gradient[internal] += 2.0 * weight * share * residual;
            qp.hessian[internal * n + internal] += 2.0 * weight * share * share;
        }
    }

    /// The step of all unknowns.
    fn expand(
        &self,
        unknowns: usize,
        free: usize,
        inputs: &[Reduced; INPUTS],
        roll: &[Reduced; COEFFICIENTS],
    ) -> Vec<f64> {
        let mut values = [0.0; WIDTH];
        values[..free].copy_from_slice(&self.solver.x[..free]);
        values[FREE_MAX] = 1.0;
        let of = |row: &Reduced| row.iter().zip(&values).map(|(a, b)| a * b).sum::<f64>();
        let mut p = vec![0.0; unknowns];
        for k in 0..COEFFICIENTS {
            for output in 0..OUTPUTS {
                let row = if output == STANCE_ROLL { &roll[k] } else { &inputs[coefficient(output, k)] };
                p[at::alpha(k, output)] = of(row);
            }
        }
        p[at::T] = of(&inputs[STEP_DURATION]);
        for (index, point) in self.points.iter().enumerate() {
            let internal = self.solver.x[free + index];
            let p = &mut p[at::point(index)..at::point(index + 1)];
            for i in 0..DOF {
                p[at::Q + i] = of(&point.motion.q[i]);
                p[at::V + i] = of(&point.motion.v[i]);
                p[at::A + i] = of(&point.motion.a[i]);
            }
            for i in 0..3 {
                p[at::LAMBDA_1 + i] = of(&point.lambda_1[i]) - internal * point.direction[i];
                p[at::LAMBDA_2 + i] = of(&point.lambda_2[i]) + internal * point.direction[i];
            }
            for i in 0..6 {
                p[at::U_FRONT + i] = of(&point.front_torque[i]) + internal * point.front_internal[i];
                p[at::U_REAR + i] = of(&point.rear_torque[i]) + internal * point.rear_internal[i];
                p[at::LAMBDA_C + i] = of(&point.wrench[i]) + internal * point.wrench_internal[i];
            }
        }
        p
    }
}

/// Part 1: q, q̇, q̈ at every point, as affine functions of whatever the inputs are functions of.
fn move_along<const N: usize>(
    program: &DecomposedProgram,
    x: &[f64],
    g: &[f64],
    inputs: &[[f64; N]; INPUTS],
    motion: &mut Vec<Motion<[f64; N]>>,
) -> Result<(), SubproblemError> {
    let t = x[at::T];
    let constant = N - 1;
    let zero = [0.0; N];
    let duration = &inputs[STEP_DURATION];
    motion.clear();
    motion.resize(program.points(), Motion { q: [zero; DOF], v: [zero; DOF], a: [zero; DOF] });

    // Output rows: T² θ̈ = B̈(s), linearised.
    for point in 0..program.points() {
        let second = bezier::basis_second_derivative(program.phase(point));
        for i in (0..OUTPUTS).filter(|&i| i != STANCE_ROLL) {
            let row = &mut motion[point].a[6 + i];
            for k in 0..COEFFICIENTS {
                add(row, second[k] / (t * t), &inputs[coefficient(i, k)]);
            }
            add(row, -2.0 * x[at::point(point) + at::A + 6 + i] / t, duration);
            row[constant] -= g[rows::COUNT * point + rows::OUTPUT + i] / (t * t);
        }
    }

    let first = &mut motion[0];
    first.q[0][constant] = -x[at::point(0) + at::Q];
    first.q[1..6].copy_from_slice(&inputs[..5]);
    first.v[..6].copy_from_slice(&inputs[5..11]);
    first.q[6 + STANCE_ROLL] = inputs[11];
    first.v[6 + STANCE_ROLL] = inputs[12];
    let slope = bezier::basis_first_derivative(0.0);
    let start = program.start_of_first();
    for i in (0..OUTPUTS).filter(|&i| i != STANCE_ROLL) {
        first.q[6 + i] = inputs[coefficient(i, 0)];
        first.q[6 + i][constant] -= g[start + i];
        let row = &mut first.v[6 + i];
        add(row, slope[0] / t, &inputs[coefficient(i, 0)]);
        add(row, slope[1] / t, &inputs[coefficient(i, 1)]);
        add(row, -x[at::point(0) + at::V + 6 + i] / t, duration);
        row[constant] -= g[start + 6 + i] / t;
    }
    let c = point_rows(program, 0, g);
    let mut matrix: [[f64; 7]; 7] = std::array::from_fn(|r| UNKNOWN.map(|u| c.a[(r, u)]));
    let mut right: [[f64; N]; 7] = std::array::from_fn(|r| minus_known(&c, r, &motion[0]));
    solve_square(&mut matrix, &mut right)?;
    for (k, u) in UNKNOWN.into_iter().enumerate() {
        motion[0].a[u] = right[k];
    }

    let per_t = 2.0 / (program.points() - 1) as f64;
    let h = per_t * t;
    for interval in 0..program.points() / 2 {
        let [p0, p1, p2]: [usize; 3] = std::array::from_fn(|k| 2 * interval + k);
        let g_interval = &g[program.start_of_intervals() + rows::INTERVAL * interval..];
        let (before, after) = motion.split_at_mut(p1);
        let (start, [middle, end]) = (&before[p0], &mut after[..2]) else {
            unreachable!("an interval has three points")
        };
        // With the unknown accelerations 0 at first.
        for i in 0..DOF {
            let values = |base: usize| [p0, p1, p2].map(|p| x[at::point(p) + base + i]);
            let f = values(at::A);
            let (a0, a1, a2) = (start.a[i], middle.a[i], end.a[i]);
            (middle.v[i], end.v[i]) = hermite_simpson(
                &start.v[i],
                [&a0, &a1, &a2],
                f,
                h,
                per_t,
                duration,
                [g_interval[24 + i], g_interval[24 + DOF + i]],
            );
            let f = values(at::V);
            let (v0, v1, v2) = (start.v[i], middle.v[i], end.v[i]);
            (middle.q[i], end.q[i]) = hermite_simpson(
                &start.q[i],
                [&v0, &v1, &v2],
                f,
                h,
                per_t,
                duration,
                [g_interval[i], g_interval[DOF + i]],
            );
        }
        let (c1, c2) = (point_rows(program, p1, g), point_rows(program, p2, g));
        let mut matrix = [[0.0; 14]; 14];
        let mut right = [zero; 14];
        for r in 0..7 {
            for (k, u) in UNKNOWN.into_iter().enumerate() {
                // What a unit of acceleration in the middle and at the end does to q̇ and q of both points.
                let (q, v, a) = (c1.q[(r, u)], c1.v[(r, u)], c1.a[(r, u)]);
                matrix[r][k] = a + v * h / 3.0 + q * h * h / 12.0;
                matrix[r][7 + k] = -v * h / 24.0 - q * h * h / 48.0;
                let (q, v, a) = (c2.q[(r, u)], c2.v[(r, u)], c2.a[(r, u)]);
                matrix[7 + r][k] = v * 2.0 * h / 3.0 + q * h * h / 3.0;
                matrix[7 + r][7 + k] = a + v * h / 6.0;
            }
            right[r] = minus_known(&c1, r, middle);
            right[7 + r] = minus_known(&c2, r, end);
        }
        solve_square(&mut matrix, &mut right)?;
        for (k, u) in UNKNOWN.into_iter().enumerate() {
            let (a1, a2) = (right[k], right[7 + k]);
            middle.a[u] = a1;
            end.a[u] = a2;
            add(&mut middle.v[u], h / 3.0, &a1);
            add(&mut middle.v[u], -h / 24.0, &a2);
            add(&mut middle.q[u], h * h / 12.0, &a1);
            add(&mut middle.q[u], -h * h / 48.0, &a2);
            add(&mut end.v[u], 2.0 * h / 3.0, &a1);
            add(&mut end.v[u], h / 6.0, &a2);
            add(&mut end.q[u], h * h / 3.0, &a1);
        }
    }
    Ok(())
}

/// The base's rotational part of a toe's Jacobian.
fn turning(jacobian: &SMatrix<f64, 3, DOF>) -> Matrix3<f64> {
    jacobian.fixed_columns::<3>(3).into_owned()
}

fn point_rows(program: &DecomposedProgram, point: usize, g: &[f64]) -> PointRows {
    let d = program.dynamics(point);
    let g = &g[rows::COUNT * point..rows::COUNT * (point + 1)];
    let mut c = PointRows { q: SMatrix::zeros(), v: SMatrix::zeros(), a: SMatrix::zeros(), residual: [0.0; 7] };
    for (first, toe, place) in [(0, &d.front.stance, rows::TOE_2), (3, &d.rear.stance, rows::TOE_1)] {
        c.q.fixed_rows_mut::<3>(first).copy_from(&toe.dacceleration_dq);
        c.v.fixed_rows_mut::<3>(first).copy_from(&toe.dacceleration_dv);
        c.a.fixed_rows_mut::<3>(first).copy_from(&toe.jacobian);
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
    for r in 0..6 {
        let weight = if r < 3 { shift[r] } else { turn[r - 3] };
        for i in 0..DOF {
            c.q[(6, i)] += weight * (d.front.dtau_dq[(r, i)] + d.rear.dtau_dq[(r, i)]);
            c.v[(6, i)] += weight * (d.front.dtau_dv[(r, i)] + d.rear.dtau_dv[(r, i)]);
            c.a[(6, i)] += weight * (d.front.mass_matrix[(r, i)] + d.rear.mass_matrix[(r, i)]);
        }
        c.residual[6] += weight * (g[rows::FRONT + r] + g[rows::REAR_BASE + r]);
    }
    c
}

/// −(residual + row · motion).
fn minus_known<const N: usize>(c: &PointRows, r: usize, motion: &Motion<[f64; N]>) -> [f64; N] {
    let mut out = [0.0; N];
    out[N - 1] = -c.residual[r];
    for i in 0..DOF {
        for (factor, row) in [(c.q[(r, i)], &motion.q[i]), (c.v[(r, i)], &motion.v[i]), (c.a[(r, i)], &motion.a[i])] {
            if factor != 0.0 {
                add(&mut out, -factor, row);
            }
        }
    }
    out
}

/// Value in the middle and at the end of an interval from the value at its start and the slopes at its three points, as the
/// linearised Hermite–Simpson rows give them. `slopes` are the slopes' current values, `residuals` those of the two rows.
fn hermite_simpson<const N: usize>(
    start: &[f64; N],
    [f0, f1, f2]: [&[f64; N]; 3],
    slopes: [f64; 3],
    h: f64,
    per_t: f64,
    duration: &[f64; N],
    residuals: [f64; 2],
) -> ([f64; N], [f64; N]) {
    let mut end = *start;
    add(&mut end, h / 6.0, f0);
    add(&mut end, 4.0 * h / 6.0, f1);
    add(&mut end, h / 6.0, f2);
    add(&mut end, per_t / 6.0 * (slopes[0] + 4.0 * slopes[1] + slopes[2]), duration);
    end[N - 1] -= residuals[1];
    let mut middle = scaled(start, 0.5);
    add(&mut middle, 0.5, &end);
    add(&mut middle, h / 8.0, f0);
    add(&mut middle, -h / 8.0, f2);
    add(&mut middle, per_t / 8.0 * (slopes[0] - slopes[2]), duration);
    middle[N - 1] -= residuals[0];
    (middle, end)
}

/// Coefficients of the stance hip roll: its value and slope at the first point and its accelerations at four more.
fn stance_roll_coefficients(
    program: &DecomposedProgram,
    x: &[f64],
    g: &[f64],
    points: &[ReducedPoint],
    inputs: &[Reduced; INPUTS],
) -> Result<[Reduced; COEFFICIENTS], SubproblemError> {
    let t = x[at::T];
    let coordinate = 6 + STANCE_ROLL;
    let start = program.start_of_first();
    let mut matrix = [[0.0; COEFFICIENTS]; COEFFICIENTS];
    let mut right = [[0.0; WIDTH]; COEFFICIENTS];
    matrix[0] = bezier::basis(0.0);
    right[0] = points[0].motion.q[coordinate];
    right[0][FREE_MAX] += g[start + STANCE_ROLL];
    matrix[1] = bezier::basis_first_derivative(0.0);
    right[1] = scaled(&points[0].motion.v[coordinate], t);
    add(&mut right[1], x[at::point(0) + at::V + coordinate], &inputs[STEP_DURATION]);
    right[1][FREE_MAX] += g[start + 6 + STANCE_ROLL];
    let kept = (0..program.points()).filter(|&p| program.keeps_stance_roll(p));
    for (row, point) in (2..).zip(kept) {
        matrix[row] = bezier::basis_second_derivative(program.phase(point));
        right[row] = scaled(&points[point].motion.a[coordinate], t * t);
        let acceleration = x[at::point(point) + at::A + coordinate];
        add(&mut right[row], 2.0 * t * acceleration, &inputs[STEP_DURATION]);
        right[row][FREE_MAX] += g[rows::COUNT * point + rows::OUTPUT + STANCE_ROLL];
    }
    solve_square(&mut matrix, &mut right)?;
    Ok(right)
}

/// Gauss with row pivoting; the solution replaces `right`.
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
