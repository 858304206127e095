//! Square linear systems of known rank deficiency: Gaussian elimination with complete pivoting.

/// A pivot this much smaller than the first one is a zero.
const RANK_TOLERANCE: f64 = 1e-10;

/// A square system of equations and its memory.
#[derive(Debug, Clone)]
pub(crate) struct Elimination {
    size: usize,
    /// Row-major, `size` × `size`.
    matrix: Vec<f64>,
    right: Vec<f64>,
    columns: Vec<usize>,
    solution: Vec<f64>,
    null: Vec<f64>,
}

/// What elimination found.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Outcome {
    pub rank: usize,
    /// Largest right-hand side left over in the redundant rows: how badly they contradict the others.
    pub residual: f64,
}

impl Elimination {
    pub fn with_capacity(size: usize) -> Self {
        Self {
            size: 0,
            matrix: vec![0.0; size * size],
            right: vec![0.0; size],
            columns: vec![0; size],
            solution: vec![0.0; size],
            null: vec![0.0; size],
        }
    }

    /// Starts an all-zero system of this size.
    pub fn reset(&mut self, size: usize) {
        assert!(size * size <= self.matrix.len(), "system larger than its memory");
        self.size = size;
        self.matrix[..size * size].fill(0.0);
        self.right[..size].fill(0.0);
    }

    pub fn add(&mut self, row: usize, column: usize, value: f64) {
        self.matrix[row * self.size + column] += value;
    }

    pub fn add_right(&mut self, row: usize, value: f64) {
        self.right[row] += value;
    }

    pub fn solution(&self) -> &[f64] {
        &self.solution[..self.size]
    }

    /// Solves. Where the rank falls short, the solution's entries in the range `least` get the least
    /// sum of squares among all solutions (the deficiency must show in that range).
    pub fn solve(&mut self, least: std::ops::Range<usize>) -> Outcome {
        let n = self.size;
        let (matrix, right) = (&mut self.matrix[..n * n], &mut self.right[..n]);
        let columns = &mut self.columns[..n];
        for (k, column) in columns.iter_mut().enumerate() {
            *column = k;
        }
        // Equations of different units meet here: bring every row to the same size.
        for row in 0..n {
            let entries = &mut matrix[row * n..(row + 1) * n];
            let largest = entries.iter().fold(0.0_f64, |m, x| m.max(x.abs()));
            if largest > 0.0 {
                entries.iter_mut().for_each(|x| *x /= largest);
                right[row] /= largest;
            }
        }
        let mut rank = n;
        let mut first_pivot = 0.0;
        for k in 0..n {
            let (mut best, mut at) = (0.0_f64, (k, k));
            for row in k..n {
                for column in k..n {
                    let size = matrix[row * n + column].abs();
                    if size > best {
                        (best, at) = (size, (row, column));
                    }
                }
            }
            if k == 0 {
                first_pivot = best;
            }
            if best <= RANK_TOLERANCE * first_pivot {
                rank = k;
                break;
            }
            if at.0 != k {
                for column in 0..n {
                    matrix.swap(k * n + column, at.0 * n + column);
                }
                right.swap(k, at.0);
            }
            if at.1 != k {
                for row in 0..n {
                    matrix.swap(row * n + k, row * n + at.1);
                }
                columns.swap(k, at.1);
            }
            for row in k + 1..n {
                let factor = matrix[row * n + k] / matrix[k * n + k];
                if factor == 0.0 {
                    continue;
                }
                for column in k..n {
                    matrix[row * n + column] -= factor * matrix[k * n + column];
                }
                right[row] -= factor * right[k];
            }
        }
        let residual = right[rank..].iter().fold(0.0_f64, |m, x| m.max(x.abs()));

        // Basic solution: the unknowns without a pivot are zero.
        let solution = &mut self.solution[..n];
        solution.fill(0.0);
        back_substitute(matrix, n, rank, columns, solution, |row| right[row]);
        // One direction of freedom after another, each made orthogonal to the sum so far in `least`.
        // Repeating the sweep converges where several directions overlap.
        let null = &mut self.null[..n];
        let free = n - rank;
        let sweeps = if free > 1 { 200 } else { 1 };
        for _ in 0..sweeps {
            let mut moved = 0.0_f64;
            for k in rank..n {
                null.fill(0.0);
                null[columns[k]] = 1.0;
                back_substitute(matrix, n, rank, columns, null, |row| -matrix[row * n + k]);
                let (mut along, mut length) = (0.0, 0.0);
                for i in least.clone() {
                    along += null[i] * solution[i];
                    length += null[i] * null[i];
                }
                if length > 0.0 {
                    let step = along / length;
                    for i in 0..n {
                        solution[i] -= step * null[i];
                    }
                    moved = moved.max(step.abs() * length.sqrt());
                }
            }
            if moved < 1e-12 {
                break;
            }
        }
        Outcome { rank, residual }
    }
}

/// Solves the upper triangle's first `rank` rows for the unknowns that have a pivot.
fn back_substitute(
    matrix: &[f64],
    n: usize,
    rank: usize,
    columns: &[usize],
    solution: &mut [f64],
    right: impl Fn(usize) -> f64,
) {
    for row in (0..rank).rev() {
        let mut sum = right(row);
        for column in row + 1..rank {
            sum -= matrix[row * n + column] * solution[columns[column]];
        }
        solution[columns[row]] = sum / matrix[row * n + row];
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn filled(entries: &[&[f64]], right: &[f64]) -> Elimination {
        let mut system = Elimination::with_capacity(right.len());
        system.reset(right.len());
        for (row, values) in entries.iter().enumerate() {
            for (column, &value) in values.iter().enumerate() {
                system.add(row, column, value);
            }
            system.add_right(row, right[row]);
        }
        system
    }

    #[test]
    fn solves_a_regular_system() {
        let mut system = filled(&[&[0.0, 2.0], &[4.0, 1.0]], &[6.0, 7.0]);
        let outcome = system.solve(0..0);
        assert_eq!(outcome.rank, 2);
        assert_eq!(system.solution(), [1.0, 3.0]);
    }

    #[test]
    fn picks_the_least_solution_and_sees_contradictions() {
        // x + y + z = 3 three times, last with a contradiction.
        let rows: [&[f64]; 3] = [&[1.0, 1.0, 1.0], &[2.0, 2.0, 2.0], &[1.0, 1.0, 1.0]];
        let mut system = filled(&rows, &[3.0, 6.0, 3.0]);
        let outcome = system.solve(0..3);
        assert_eq!(outcome.rank, 1);
        assert!(outcome.residual < 1e-14);
        assert!(system.solution().iter().all(|x| (x - 1.0).abs() < 1e-11), "{:?}", system.solution());
        let mut system = filled(&rows, &[3.0, 6.0, 3.5]);
        assert!((system.solve(0..3).residual - 0.5).abs() < 1e-14);
    }
}
