//! The ties: what they leave of the inputs.

use super::analysis::{Structure, Tie};
use super::{Asked, add};
use crate::problem::SubproblemError;

/// A tie is taken to repeat the others when what is left of it is below this, relative to its largest entry at first …
const REPEATS: f64 = 1e-9;
/// … and to contradict them when its constant is above this, relative to the same.
const CONTRADICTS: f64 = 1e-6;

/// A tie on the inputs, its constant last; the sum is to be 0.
struct Row<const W: usize> {
    entries: [f64; W],
    /// Its largest entry at first.
    size: f64,
}

/// How many inputs the ties leave free, and all inputs as functions of those: Gauss with complete pivoting, rows
/// measured by their largest entry.
#[inline(always)]
pub(super) fn solve<const INPUTS: usize, const FREE: usize>(
    structure: &Structure,
    asked: Asked,
    variables: &[[f64; INPUTS]],
) -> Result<(usize, Vec<[f64; FREE]>), SubproblemError> {
    let mut waiting = rows(structure, asked, variables);
    let mut done: Vec<([f64; INPUTS], usize)> = Vec::with_capacity(waiting.len());
    while let Some((place, largest)) =
        waiting.iter().map(|row| largest(&row.entries) / row.size).enumerate().max_by(|a, b| a.1.total_cmp(&b.1))
    {
        if largest <= REPEATS || largest.is_nan() {
            break;
        }
        let Row { entries: mut pivot, size } = waiting.swap_remove(place);
        let is_largest = |v: &f64| v.abs() / size == largest;
        let column = pivot[..INPUTS - 1].iter().position(is_largest).expect("the largest entry is one of them");
        let inverse = 1.0 / pivot[column];
        pivot.iter_mut().for_each(|v| *v *= inverse);
        for row in &mut waiting {
            let factor = row.entries[column];
            if factor != 0.0 {
                add(&mut row.entries, -factor, &pivot);
                row.entries[column] = 0.0;
            }
        }
        done.push((pivot, column));
    }
    for row in &waiting {
        let constant = row.entries[INPUTS - 1].abs();
        if constant > CONTRADICTS * row.size || constant.is_nan() {
            return Err(SubproblemError::Infeasible);
        }
    }
    let inputs = structure.inputs.len();
    let free: Vec<usize> = (0..inputs).filter(|k| done.iter().all(|(_, column)| column != k)).collect();
    if free.len() >= FREE {
        return Err(SubproblemError::Stopped(format!("{} ties repeat others", waiting.len())));
    }
    let mut found = vec![[0.0; FREE]; inputs];
    for (k, &input) in free.iter().enumerate() {
        found[input][k] = 1.0;
    }
    for (place, (row, column)) in done.iter().enumerate().rev() {
        let mut input = [0.0; FREE];
        for (k, &f) in free.iter().enumerate() {
            input[k] = -row[f];
        }
        input[FREE - 1] = -row[INPUTS - 1];
        for (_, later) in &done[place + 1..] {
            add(&mut input, -row[*later], &found[*later]);
        }
        found[*column] = input;
    }
    Ok((free.len(), found))
}

#[inline(always)]
fn rows<const W: usize>(structure: &Structure, asked: Asked, variables: &[[f64; W]]) -> Vec<Row<W>> {
    let mut rows = Vec::with_capacity(structure.ties.len());
    for tie in &structure.ties {
        let entries = match *tie {
            Tie::Variable(i) => {
                let mut row = variables[i];
                row[W - 1] += asked.x[i] - asked.variable_values[i];
                row
            }
            Tie::Constraint(i) => {
                let mut row = [0.0; W];
                for &(column, place) in &structure.rows[i] {
                    add(&mut row, asked.at.jacobian[place], &variables[column]);
                }
                row[W - 1] += asked.constraints[i] - asked.constraint_values[i];
                row
            }
        };
        let size = largest(&entries).max(f64::MIN_POSITIVE);
        rows.push(Row { entries, size });
    }
    rows
}

/// The largest entry but the constant, without its sign.
#[inline(always)]
fn largest<const W: usize>(row: &[f64; W]) -> f64 {
    // Lane by lane first: one comparison after the other would take longer than the elimination.
    let (fours, rest) = row[..W - 1].as_chunks::<4>();
    let mut lanes = [0.0_f64; 4];
    for four in fours {
        for (lane, value) in lanes.iter_mut().zip(four) {
            *lane = if value.abs() > *lane { value.abs() } else { *lane };
        }
    }
    rest.iter().map(|v| v.abs()).chain(lanes).fold(0.0, f64::max)
}
