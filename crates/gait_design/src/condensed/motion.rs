//! Along the step: a point's seven unknown accelerations, and the Hermite–Simpson intervals that carry them on.

use super::*;
use crate::limits::keeps_stance_roll;

/// Those of [`UNKNOWN`] whose positions and velocities change an acceleration or a force. The body's place and its
/// straight speed do not.
const FELT: Range<usize> = 3..7;

/// Seven linear rows on a point's q, q̇, q̈ with their residuals: stance toes 2 and 1, then the moment about their
/// line.
#[derive(Clone)]
pub(super) struct PointRows {
    pub(super) q: [[f64; DOF]; 7],
    pub(super) v: [[f64; DOF]; 7],
    pub(super) a: [[f64; DOF]; 7],
    residual: [f64; 7],
}

/// One Hermite–Simpson interval of the linearised program.
pub(super) struct Interval<'a> {
    x: &'a [f64],
    /// Residuals of the interval's rows.
    g: &'a [f64],
    first_point: usize,
    /// Its duration, and that over T.
    h: f64,
    per_t: f64,
}

impl<'a> Interval<'a> {
    pub(super) fn new(program: &DecomposedProgram, x: &'a [f64], g: &'a [f64], interval: usize) -> Self {
        let per_t = 2.0 / (program.points() - 1) as f64;
        let g = &g[rows::intervals(program.points()) + rows::INTERVAL * interval..];
        Self { x, g, first_point: 2 * interval, h: per_t * x[at::T], per_t }
    }

    /// What T and the residuals add to the value in the middle and at the end: the end's share of T and its constant,
    /// then the middle's, which holds half of the end's.
    #[inline(always)]
    fn own(&self, slope: usize, i: usize) -> [[f64; 2]; 2] {
        let f: [f64; 3] = std::array::from_fn(|k| self.x[at::point(self.first_point + k) + slope + i]);
        let block = if slope == at::V { 0 } else { 24 };
        let end = [self.per_t / 6.0 * (f[0] + 4.0 * f[1] + f[2]), -self.g[block + DOF + i]];
        let middle = [0.5 * end[0] + self.per_t / 8.0 * (f[0] - f[2]), 0.5 * end[1] - self.g[block + i]];
        [end, middle]
    }

    /// Value of coordinate `i` in the middle and at the end from the value at the start and the slopes at the three
    /// points (velocities if `slope` is [`at::V`], accelerations if it is [`at::A`]).
    #[inline(always)]
    pub(super) fn integrate<const N: usize>(
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

/// Part 1: q, q̇, q̈ of the unknown coordinates at every point, as affine functions of whatever the inputs are
/// functions of; `each` gets the points one after the other.
#[inline(always)]
pub(super) fn move_along<const N: usize>(
    program: &DecomposedProgram,
    x: &[f64],
    g: &[f64],
    rows: &[PointRows],
    inputs: &[[f64; N]; INPUTS],
    outputs: impl Outputs<N>,
    mut each: impl FnMut(usize, &Motion<7, [f64; N]>),
) -> Result<(), SubproblemError> {
    let constant = N - 1;
    let duration = &inputs[STEP_DURATION];
    // An interval's three points; the last is the next one's first.
    let [mut start, mut middle, mut end]: [Motion<7, [f64; N]>; 3] = Default::default();
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
    known_part(&rows[0], first, &mut right);
    outputs.subtract(0, &mut right);
    solve_square(&mut matrix, &mut right)?;
    first.a = right;
    each(0, &start);

    let mut matrix = [[0.0; 14]; 14];
    let mut right = [[0.0; N]; 14];
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
                if from[0] != 0.0 {
                    add(&mut row, from[0], q0);
                }
                add(&mut row, from[2], a0);
                add(&mut row, own[0], duration);
                row[constant] += own[1];
                *to = row;
            }
        }
        let (c1, c2) = (&rows[p1], &rows[p1 + 1]);
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
        known_part(c1, &middle, of_middle);
        known_part(c2, &end, of_end);
        outputs.subtract(p1, of_middle);
        outputs.subtract(p1 + 1, of_end);
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

/// The prescribed outputs' motion, of which `subtract` takes what it adds to a point's rows from their right-hand
/// sides. (A closure in its place would not be compiled for the processor at hand.)
pub(super) trait Outputs<const N: usize> {
    fn subtract(&self, point: usize, right: &mut [[f64; N]]);
}

/// By each output's own coefficients, T, and the constant.
pub(super) struct OwnOutputs<'a> {
    pub(super) rows: &'a [PointRows],
    pub(super) motion: &'a [Motion<OUTPUTS, Own8>],
}

impl Outputs<{ SHIFTS + 1 }> for OwnOutputs<'_> {
    #[inline(always)]
    fn subtract(&self, point: usize, right: &mut [Affine]) {
        let (rows, motion) = (&self.rows[point], &self.motion[point]);
        for i in prescribed() {
            let first = coefficients(i);
            for (r, right) in right.iter_mut().enumerate() {
                let mut felt = scaled(&motion.q[i], rows.q[r][6 + i]);
                add(&mut felt, rows.v[r][6 + i], &motion.v[i]);
                add(&mut felt, rows.a[r][6 + i], &motion.a[i]);
                for (k, value) in felt[..COEFFICIENTS].iter().enumerate() {
                    right[first + k] -= value;
                }
                right[STEP_DURATION] -= felt[COEFFICIENTS];
                right[SHIFTS] -= felt[COEFFICIENTS + 1];
            }
        }
    }
}

/// By what the end rows leave free.
pub(super) struct SpreadOutputs<'a> {
    pub(super) rows: &'a [PointRows],
    pub(super) motion: &'a [Motion<OUTPUTS, Reduced>],
}

impl Outputs<WIDTH> for SpreadOutputs<'_> {
    #[inline(always)]
    fn subtract(&self, point: usize, right: &mut [Reduced]) {
        let (c, motion) = (&self.rows[point], &self.motion[point]);
        for (r, right) in right.iter_mut().enumerate() {
            let mut sum = *right;
            for i in prescribed() {
                add(&mut sum, -c.q[r][6 + i], &motion.q[i]);
                add(&mut sum, -c.v[r][6 + i], &motion.v[i]);
                add(&mut sum, -c.a[r][6 + i], &motion.a[i]);
            }
            *right = sum;
        }
    }
}

/// The right-hand sides of a point's rows, by what of its motion is known already.
#[inline(always)]
fn known_part<const N: usize>(rows: &PointRows, motion: &Motion<7, [f64; N]>, right: &mut [[f64; N]]) {
    for (r, right) in right.iter_mut().enumerate() {
        let mut sum = [0.0; N];
        sum[N - 1] = -rows.residual[r];
        for k in FELT {
            add(&mut sum, -rows.q[r][UNKNOWN[k]], &motion.q[k]);
            add(&mut sum, -rows.v[r][UNKNOWN[k]], &motion.v[k]);
        }
        *right = sum;
    }
}

/// The base's rotational part of a toe's Jacobian.
#[inline(always)]
pub(super) fn turning(jacobian: &SMatrix<f64, 3, DOF>) -> Matrix3<f64> {
    jacobian.fixed_columns::<3>(3).into_owned()
}

#[inline(always)]
pub(super) fn point_rows(program: &DecomposedProgram, point: usize, g: &[f64]) -> PointRows {
    let d = &program.dynamics[point];
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
pub(super) fn stance_roll_coefficients(
    program: &DecomposedProgram,
    x: &[f64],
    g: &[f64],
    unknown: &[Motion<7, Reduced>],
    inputs: &[Reduced; INPUTS],
) -> Result<[Reduced; COEFFICIENTS], SubproblemError> {
    let t = x[at::T];
    let coordinate = 6 + STANCE_ROLL;
    let start = rows::first(program.points());
    let mut matrix = [[0.0; COEFFICIENTS]; COEFFICIENTS];
    let mut right = [[0.0; WIDTH]; COEFFICIENTS];
    matrix[0] = bezier::basis(0.0);
    right[0] = unknown[0].q[6];
    right[0][FREE_MAX] += g[start + rows::BEGINS + STANCE_ROLL];
    matrix[1] = bezier::basis_first_derivative(0.0);
    right[1] = scaled(&unknown[0].v[6], t);
    add(&mut right[1], x[at::point(0) + at::V + coordinate], &inputs[STEP_DURATION]);
    right[1][FREE_MAX] += g[start + rows::BEGINS + OUTPUTS + STANCE_ROLL];
    let kept = (0..program.points()).filter(|&p| keeps_stance_roll(p, program.points()));
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
        let mut pivot = c;
        for r in c + 1..N {
            if matrix[r][c].abs() >= matrix[pivot][c].abs() {
                pivot = r;
            }
        }
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
    for r in (0..N).rev() {
        let mut sum = right[r];
        for c in r + 1..N {
            add(&mut sum, -matrix[r][c], &right[c]);
        }
        right[r] = scaled(&sum, 1.0 / matrix[r][r]);
    }
    Ok(())
}
