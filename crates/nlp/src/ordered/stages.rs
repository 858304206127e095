//! A stage: a small square system, solved for its unknowns as functions of something.

use super::analysis::{Source, StagePattern, StageRow};
use super::loads::Load;
use super::{Asked, add};
use crate::problem::SubproblemError;

/// A pivot smaller than this, relative to the entries of its row, is none.
const VANISHES: f64 = 1e-12;

/// Gauss on a stage's matrix, as what it does to the right-hand sides.
#[derive(Clone, Debug, Default)]
pub(super) struct Factor {
    /// (row, pivot's row, factor): what is subtracted from which row, in this order.
    forward: Vec<(usize, usize, f64)>,
    /// Each unknown's row and the inverse of its pivot, …
    pivots: Vec<(usize, f64)>,
    /// … and the entries of later unknowns in that row.
    backward: Vec<Vec<(usize, f64)>>,
    matrix: Vec<f64>,
    order: Vec<usize>,
}

impl StageRow {
    /// Numbers of the row's entries.
    fn numbers<'a>(&self, asked: Asked<'a>, loads: &'a [Load]) -> &'a [f64] {
        match self.source {
            Source::Constraint(_) => &asked.at.jacobian,
            Source::Left(load) => &loads[load].left,
        }
    }

    /// What the row's sum has to be.
    pub fn wanted(&self, asked: Asked, loads: &[Load]) -> f64 {
        match self.source {
            Source::Constraint(row) => asked.constraint_values[row] - asked.constraints[row],
            Source::Left(load) => loads[load].left_wanted,
        }
    }

    /// What is left of that when the known variables have had their part.
    #[inline(always)]
    pub fn put_right<const W: usize>(
        &self,
        asked: Asked,
        loads: &[Load],
        variables: &[[f64; W]],
        right: &mut [f64; W],
    ) {
        *right = [0.0; W];
        right[W - 1] = self.wanted(asked, loads);
        let numbers = self.numbers(asked, loads);
        for &(column, place) in &self.known {
            let number = numbers[place];
            if number != 0.0 {
                add(right, -number, &variables[column]);
            }
        }
    }
}

/// Subtracts what an elimination says from right-hand sides.
#[inline(always)]
pub(super) fn subtract<const W: usize>(rows: &mut [[f64; W]], &(to, from, factor): &(usize, usize, f64)) {
    let [to, from] = rows.get_disjoint_mut([to, from]).expect("two rows of a stage");
    add(to, -factor, from);
}

impl Factor {
    pub fn factorise(&mut self, pattern: &StagePattern, asked: Asked, loads: &[Load]) -> Result<(), SubproblemError> {
        let n = pattern.columns.len();
        let matrix = &mut self.matrix;
        matrix.clear();
        matrix.resize(n * n, 0.0);
        for (r, row) in pattern.rows.iter().enumerate() {
            let numbers = row.numbers(asked, loads);
            for &(column, place) in &row.inside {
                matrix[n * r + column] = numbers[place];
            }
        }
        self.forward.clear();
        self.pivots.clear();
        self.backward.resize_with(n, Vec::new);
        self.order.clear();
        self.order.extend(0..n);
        let order = &mut self.order;
        for k in 0..n {
            if k >= pattern.chain {
                let size = |place: &usize| matrix[n * order[*place] + k].abs();
                let best = (k..n).max_by(|a, b| size(a).total_cmp(&size(b))).expect("k < n");
                order.swap(k, best);
            }
            let row = order[k];
            let pivot = matrix[n * row + k];
            let largest = matrix[n * row + k..n * (row + 1)].iter().fold(0.0_f64, |a, v| a.max(v.abs()));
            if pivot.abs() <= VANISHES * largest || !pivot.is_finite() {
                return Err(SubproblemError::Stopped("a stage of the elimination is singular".into()));
            }
            let later = &mut self.backward[k];
            later.clear();
            later.extend((k + 1..n).map(|c| (c, matrix[n * row + c])).filter(|entry| entry.1 != 0.0));
            for &below in &order[k + 1..] {
                let entry = matrix[n * below + k];
                if entry != 0.0 {
                    let factor = entry / pivot;
                    for &(c, value) in &*later {
                        matrix[n * below + c] -= factor * value;
                    }
                    self.forward.push((below, row, factor));
                }
            }
            self.pivots.push((row, 1.0 / pivot));
        }
        Ok(())
    }

    /// The stage's unknowns from those before.
    #[inline(always)]
    pub fn follow<const W: usize>(
        &self,
        pattern: &StagePattern,
        asked: Asked,
        loads: &[Load],
        variables: &mut [[f64; W]],
        rows: &mut Vec<[f64; W]>,
    ) {
        rows.resize(rows.len().max(pattern.rows.len()), [0.0; W]);
        for (row, right) in pattern.rows.iter().zip(&mut *rows) {
            row.put_right(asked, loads, variables, right);
        }
        self.forward.iter().for_each(|step| subtract(rows, step));
        for (k, &(row, inverse)) in self.pivots.iter().enumerate().rev() {
            let mut value = rows[row];
            for &(later, entry) in &self.backward[k] {
                add(&mut value, -entry, &variables[pattern.columns[later]]);
            }
            variables[pattern.columns[k]] = value.map(|v| v * inverse);
        }
    }
}
