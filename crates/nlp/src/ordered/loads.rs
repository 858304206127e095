//! A load: equalities that determine all of their unknowns but one, which stays an unknown of its own, and leave one
//! equality without them.

use super::analysis::LoadPattern;
use super::stages::subtract;
use super::{Asked, add};
use crate::problem::SubproblemError;

/// What may be left of a load's last pivot, relative to its largest entry.
const REPEATS: f64 = 1e-9;

/// Gauss with complete pivoting on the core of a load's matrix.
#[derive(Clone, Debug, Default)]
pub(super) struct Load {
    /// Numbers of the equality that is left, and what its sum has to be.
    pub left: Vec<f64>,
    pub left_wanted: f64,
    /// What each unknown takes of the load's own.
    pub own: Vec<f64>,
    /// (row, pivot's row, factor): what is subtracted from which row, in this order.
    forward: Vec<(usize, usize, f64)>,
    /// Inverse entries of the unknowns that belong to one equality each.
    singles: Vec<f64>,
    matrix: Vec<f64>,
    /// The pivot row's entries.
    later: Vec<(usize, f64)>,
    rows: Vec<usize>,
    columns: Vec<usize>,
}

impl Load {
    /// `work` is as long as the variables, and 0.
    pub fn factorise(&mut self, pattern: &LoadPattern, asked: Asked, work: &mut [f64]) -> Result<(), SubproblemError> {
        self.eliminate(pattern, asked)?;
        let n = pattern.core;
        // What is left of the last row: which sum of the rows it is, by going back.
        let mut weights = vec![0.0; n];
        weights[self.rows[n - 1]] = 1.0;
        for &(to, from, factor) in self.forward.iter().rev() {
            weights[from] -= factor * weights[to];
        }
        self.left_wanted = 0.0;
        for (row, weight) in pattern.rows.iter().zip(&weights) {
            self.left_wanted += weight * row.wanted(asked, &[]);
            for &(column, place) in &row.known {
                work[column] += weight * asked.at.jacobian[place];
            }
        }
        self.left.clear();
        self.left.extend(pattern.others.iter().map(|&column| std::mem::take(&mut work[column])));
        // The last unknown is the own one.
        self.own.clear();
        self.own.resize(pattern.columns.len(), 0.0);
        self.own[self.columns[n - 1]] = 1.0;
        for k in (0..n - 1).rev() {
            let row = &self.matrix[n * self.rows[k]..n * (self.rows[k] + 1)];
            let sum: f64 = self.columns[k + 1..].iter().map(|&c| row[c] * self.own[c]).sum();
            self.own[self.columns[k]] = -sum / row[self.columns[k]];
        }
        self.singles.clear();
        for (single, row) in pattern.rows.iter().enumerate().skip(n) {
            let (mut sum, mut pivot) = (0.0, 0.0);
            for &(column, place) in &row.inside {
                let number = asked.at.jacobian[place];
                if column == single { pivot = number } else { sum += number * self.own[column] }
            }
            if pivot == 0.0 || !pivot.is_finite() {
                return Err(SubproblemError::Stopped("a load's equality does not hold its unknown".into()));
            }
            self.own[single] = -sum / pivot;
            self.singles.push(1.0 / pivot);
        }
        Ok(())
    }

    fn eliminate(&mut self, pattern: &LoadPattern, asked: Asked) -> Result<(), SubproblemError> {
        let n = pattern.core;
        let matrix = &mut self.matrix;
        matrix.clear();
        matrix.resize(n * n, 0.0);
        for (r, row) in pattern.rows[..n].iter().enumerate() {
            for &(column, place) in &row.inside {
                matrix[n * r + column] = asked.at.jacobian[place];
            }
        }
        let largest = matrix.iter().fold(0.0_f64, |a, v| a.max(v.abs()));
        self.forward.clear();
        for places in [&mut self.rows, &mut self.columns] {
            places.clear();
            places.extend(0..n);
        }
        let (rows, columns) = (&mut self.rows, &mut self.columns);
        for k in 0..n {
            let (mut best, mut size) = ((k, k), -1.0);
            for (i, &row) in rows.iter().enumerate().skip(k) {
                let row = &matrix[n * row..n * (row + 1)];
                for (j, &column) in columns.iter().enumerate().skip(k) {
                    if row[column].abs() > size {
                        (best, size) = ((i, j), row[column].abs());
                    }
                }
            }
            rows.swap(k, best.0);
            columns.swap(k, best.1);
            // Written so that NaN is refused as well.
            if (k + 1 == n) != (size <= REPEATS * largest) {
                return Err(SubproblemError::Stopped("a load's equalities do not leave one unknown".into()));
            }
            let (row, pivot) = (rows[k], matrix[n * rows[k] + columns[k]]);
            let held = |&c: &usize| (c, matrix[n * row + c]);
            self.later.clear();
            self.later.extend(columns[k + 1..].iter().map(held).filter(|entry| entry.1 != 0.0));
            for &below in &rows[k + 1..] {
                let entry = matrix[n * below + columns[k]];
                if entry != 0.0 {
                    let factor = entry / pivot;
                    for &(c, value) in &self.later {
                        matrix[n * below + c] -= factor * value;
                    }
                    self.forward.push((below, row, factor));
                }
            }
        }
        Ok(())
    }

    /// The unknowns from those that their equalities hold beside them, without the own one's part.
    #[inline(always)]
    pub fn follow<const W: usize>(
        &self,
        pattern: &LoadPattern,
        asked: Asked,
        variables: &mut [[f64; W]],
        right: &mut Vec<[f64; W]>,
    ) {
        let n = pattern.core;
        right.resize(right.len().max(n), [0.0; W]);
        let last = self.rows[n - 1];
        for (r, (row, right)) in pattern.rows[..n].iter().zip(&mut *right).enumerate() {
            if r != last {
                row.put_right(asked, &[], variables, right);
            }
        }
        self.forward.iter().filter(|step| step.0 != last).for_each(|step| subtract(right, step));
        variables[pattern.columns[self.columns[n - 1]]] = [0.0; W];
        for k in (0..n - 1).rev() {
            let (row, mut value) = (self.rows[k], right[self.rows[k]]);
            for &c in &self.columns[k + 1..] {
                let entry = self.matrix[n * row + c];
                if entry != 0.0 {
                    add(&mut value, -entry, &variables[pattern.columns[c]]);
                }
            }
            let inverse = 1.0 / self.matrix[n * row + self.columns[k]];
            variables[pattern.columns[self.columns[k]]] = value.map(|v| v * inverse);
        }
        for (single, (row, inverse)) in (n..).zip(pattern.rows[n..].iter().zip(&self.singles)) {
            let mut value = [0.0; W];
            row.put_right(asked, &[], variables, &mut value);
            for &(column, place) in &row.inside {
                if column != single {
                    add(&mut value, -asked.at.jacobian[place], &variables[pattern.columns[column]]);
                }
            }
            variables[pattern.columns[single]] = value.map(|v| v * inverse);
        }
    }
}
