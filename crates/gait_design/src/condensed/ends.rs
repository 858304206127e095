//! The ends of the step: mirror periodicity, soft touchdown and the toes' start on the floor, as rows on the inputs.

use super::*;

/// The stance toes' heights, which come first; then the program's rows of both ends.
const FLOORS: usize = 2;
/// Rows that tie both ends of the step.
const END_ROWS: usize = FLOORS + 28;
/// An end row whose largest entry is below this, relative to where it began, repeats the others.
const REPEATED: f64 = 1e-9;
/// An end row: the inputs' coefficients, zeros that round the length up to vector registers, the constant.
type EndRow = [f64; 48];
const CONSTANT: usize = 47;

/// All coordinates at an end of the step.
struct EndMotion {
    q: [EndRow; DOF],
    v: [EndRow; DOF],
}

impl Condensed {
    /// Part 2: how many numbers the end rows leave free, and the inputs as affine functions of them.
    #[inline(always)]
    pub(super) fn tie_ends(
        &self,
        program: &DecomposedProgram,
        x: &[f64],
        g: &[f64],
    ) -> Result<(usize, [Reduced; INPUTS]), SubproblemError> {
        let last = program.points() - 1;
        let mut ends: [EndMotion; 2] = std::array::from_fn(|_| EndMotion { q: [[0.0; 48]; DOF], v: [[0.0; 48]; DOF] });
        for (end, point) in ends.iter_mut().zip([0, last]) {
            self.write_end(program, x, point, end);
        }
        let ([first, last], d0, d1) = (&ends, &program.dynamics[0], &program.dynamics[last]);
        let mut e = [[0.0; 48]; END_ROWS];
        let start = rows::first(program.points());
        for (row, toe, residual) in
            [(0, &d0.front.stance, g[start + rows::FLOOR_2]), (1, &d0.rear.stance, g[start + rows::FLOOR_1])]
        {
            for i in 0..DOF {
                add(&mut e[row], toe.jacobian[(2, i)], &first.q[i]);
            }
            e[row][CONSTANT] += residual;
        }
        let start = rows::boundary(program.points());
        for i in 0..DOF {
            let (from, sign) = program.mirror(i);
            let row = &mut e[FLOORS + rows::PERIODICITY + i];
            add(row, 1.0, &last.q[i]);
            add(row, -sign, &first.q[from]);
            row[CONSTANT] += g[start + rows::PERIODICITY + i];
            let row = &mut e[FLOORS + rows::PERIODICITY + DOF + i];
            add(row, sign, &first.v[from]);
            add(row, -1.0, &last.v[i]);
            row[CONSTANT] += g[start + rows::PERIODICITY + DOF + i];
        }
        e[FLOORS + rows::PERIODICITY][STEP_DURATION] -= program.speed_m_s;
        for (row, toe, axis) in [
            (rows::TOUCHDOWN_0, &d1.front.swing, 0),
            (rows::TOUCHDOWN_0 + 1, &d1.front.swing, 1),
            (rows::TOUCHDOWN_0 + 2, &d1.front.swing, 2),
            (rows::TOUCHDOWN_3, &d1.rear.swing, 2),
        ] {
            for i in 0..DOF {
                add(&mut e[FLOORS + row], toe.dvelocity_dq[(axis, i)], &last.q[i]);
                add(&mut e[FLOORS + row], toe.jacobian[(axis, i)], &last.v[i]);
            }
            e[FLOORS + row][CONSTANT] += g[start + row];
        }

        // Gauss with complete pivoting, then the pivots' inputs from the last back to the first.
        let mut pivots: Vec<(usize, usize)> = Vec::with_capacity(END_ROWS);
        let mut waiting: Vec<usize> = (0..END_ROWS).collect();
        let mut sizes = e.each_ref().map(largest);
        let size = sizes.into_iter().fold(1.0, f64::max);
        while !waiting.is_empty() {
            let (mut place, mut best) = (0, 0.0);
            for (k, &r) in waiting.iter().enumerate() {
                (place, best) = if sizes[r] > best { (k, sizes[r]) } else { (place, best) };
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
                    sizes[r] = largest(&e[r]);
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

    /// The motion at the first or the last point, into rows of zeros.
    #[inline(always)]
    fn write_end(&self, program: &DecomposedProgram, x: &[f64], point: usize, motion: &mut EndMotion) {
        let ends = &self.ends[usize::from(point > 0)];
        for (k, i) in UNKNOWN.into_iter().enumerate() {
            for (to, from) in [(&mut motion.q[i], &ends.q[k]), (&mut motion.v[i], &ends.v[k])] {
                to[..SHIFTS].copy_from_slice(&from[..SHIFTS]);
                to[CONSTANT] = from[SHIFTS];
            }
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
        let own = &self.outputs[point];
        for i in prescribed() {
            for (to, from) in [(&mut motion.q[6 + i], &own.q[i]), (&mut motion.v[6 + i], &own.v[i])] {
                let first = coefficients(i);
                to[first..first + COEFFICIENTS].copy_from_slice(&from[..COEFFICIENTS]);
                to[STEP_DURATION] = from[COEFFICIENTS];
                to[CONSTANT] = from[COEFFICIENTS + 1];
            }
        }
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
