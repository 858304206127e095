//! The flow of δẅ = G(t) (δw, δẇ, δp), δṗ = 0 over a step by Gauss' collocation of order 6 (Hairer, Nørsett & Wanner,
//! Solving Ordinary Differential Equations I, II.7). It is implicit: a swing leg's damping is fast beside the step.

use super::generator::{PLACES, RATES, Row, add};
use super::{ROWS, STATE};
use decomposition::DynamicsError;

const WHAT: &str = "an integration step of the linearised motion";
/// Points of a step at which the accelerations are unknown.
const STAGES: usize = 3;
const SIZE: usize = STAGES * ROWS;

/// w and ẇ as functions of what they and p were at the start.
pub(super) struct Flow {
    pub position: [Row; ROWS],
    pub rate: [Row; ROWS],
    rule: Rule,
}

/// Gauss' rule on [0, 1]: where the stages are, and the weights of their accelerations in the velocity and, integrated
/// once more, in the position at each stage (`velocity`, `position`) and at the end.
struct Rule {
    nodes: [f64; STAGES],
    velocity: [[f64; STAGES]; STAGES],
    position: [[f64; STAGES]; STAGES],
    end_velocity: [f64; STAGES],
    end_position: [f64; STAGES],
}

impl Rule {
    fn new() -> Self {
        let r = 15.0_f64.sqrt();
        let velocity = [
            [5.0 / 36.0, 2.0 / 9.0 - r / 15.0, 5.0 / 36.0 - r / 30.0],
            [5.0 / 36.0 + r / 24.0, 2.0 / 9.0, 5.0 / 36.0 - r / 24.0],
            [5.0 / 36.0 + r / 30.0, 2.0 / 9.0 + r / 15.0, 5.0 / 36.0],
        ];
        let end_velocity = [5.0 / 18.0, 4.0 / 9.0, 5.0 / 18.0];
        // The velocity's own integral by the same rule.
        let integrated = |weights: &[f64; STAGES]| -> [f64; STAGES] {
            std::array::from_fn(|j| (0..STAGES).map(|k| weights[k] * velocity[k][j]).sum())
        };
        Self {
            nodes: [0.5 - r / 10.0, 0.5, 0.5 + r / 10.0],
            position: velocity.map(|weights| integrated(&weights)),
            end_position: integrated(&end_velocity),
            velocity,
            end_velocity,
        }
    }
}

/// The generator at share `s` of an interval, by the parabola through its ends and middle.
#[inline(always)]
fn within(three: [&[Row; ROWS]; 3], s: f64) -> [Row; ROWS] {
    let mut rows = [[0.0; STATE]; ROWS];
    let weights = [(1.0 - s) * (1.0 - 2.0 * s), 4.0 * s * (1.0 - s), s * (2.0 * s - 1.0)];
    for (r, to) in rows.iter_mut().enumerate() {
        let mut row = [0.0; STATE];
        for (weight, of) in weights.iter().zip(three) {
            add(&mut row, *weight, &of[r]);
        }
        *to = row;
    }
    rows
}

impl Flow {
    pub fn identity() -> Self {
        let unit = |at: usize| std::array::from_fn(|r| std::array::from_fn(|c| f64::from(c == at + r)));
        Self { position: unit(0), rate: unit(RATES), rule: Rule::new() }
    }

    /// Over an interval of length `h` whose generators at its ends and middle are given, in so many steps.
    #[inline(always)]
    pub fn advance(&mut self, three: [&[Row; ROWS]; 3], h: f64, steps: usize) -> Result<(), DynamicsError> {
        for step in 0..steps {
            let share = |node: f64| (step as f64 + node) / steps as f64;
            let [a, b, c] = self.rule.nodes;
            self.step([within(three, share(a)), within(three, share(b)), within(three, share(c))], h / steps as f64)?;
        }
        Ok(())
    }

    /// One step by the generators at its stages. The accelerations there are linear in themselves:
    ///
    /// > aᵢ = G (x + cᵢ h v + h² Σ Āᵢⱼ aⱼ, v + h Σ Aᵢⱼ aⱼ, p)
    #[inline(always)]
    fn step(&mut self, stages: [[Row; ROWS]; STAGES], h: f64) -> Result<(), DynamicsError> {
        let Self { position, rate, rule } = self;
        let mut matrix = [[0.0; SIZE]; SIZE];
        let mut right = [[0.0; STATE]; SIZE];
        for (i, g) in stages.iter().enumerate() {
            let drift = rule.nodes[i] * h;
            for (r, row) in g.iter().enumerate() {
                let mut sum = [0.0; STATE];
                sum[PLACES..].copy_from_slice(&row[PLACES..]);
                for k in 0..ROWS {
                    add(&mut sum, row[k], &position[k]);
                    add(&mut sum, row[RATES + k] + drift * row[k], &rate[k]);
                }
                right[ROWS * i + r] = sum;
                for j in 0..STAGES {
                    let (by_x, by_v) = (-h * h * rule.position[i][j], -h * rule.velocity[i][j]);
                    for k in 0..ROWS {
                        matrix[ROWS * i + r][ROWS * j + k] = by_x * row[k] + by_v * row[RATES + k];
                    }
                }
                matrix[ROWS * i + r][ROWS * i + r] += 1.0;
            }
        }
        solve(&mut matrix, &mut right).map_err(|rank| DynamicsError::Singular { what: WHAT, rank, size: SIZE })?;
        for r in 0..ROWS {
            let (mut x, mut v) = (position[r], rate[r]);
            add(&mut x, h, &rate[r]);
            for j in 0..STAGES {
                add(&mut x, h * h * rule.end_position[j], &right[ROWS * j + r]);
                add(&mut v, h * rule.end_velocity[j], &right[ROWS * j + r]);
            }
            (position[r], rate[r]) = (x, v);
        }
        Ok(())
    }
}

/// Gauss' elimination with row exchanges, in place. The column at which no pivot is left, if there is one.
#[inline(always)]
fn solve(matrix: &mut [[f64; SIZE]; SIZE], right: &mut [Row; SIZE]) -> Result<(), usize> {
    eliminate::<0>(matrix, right)?;
    eliminate::<12>(matrix, right)?;
    eliminate::<24>(matrix, right)?;
    for r in (0..SIZE).rev() {
        let mut sum = right[r];
        for c in r + 1..SIZE {
            add(&mut sum, -matrix[r][c], &right[c]);
        }
        let inverse = 1.0 / matrix[r][r];
        for value in &mut sum {
            *value *= inverse;
        }
        right[r] = sum;
    }
    Ok(())
}

/// Twelve columns from FIRST on: their pivots, and zeros below them. A length known to the compiler is worth more than
/// the zeros that are computed.
#[inline(always)]
fn eliminate<const FIRST: usize>(matrix: &mut [[f64; SIZE]; SIZE], right: &mut [Row; SIZE]) -> Result<(), usize> {
    for c in FIRST..FIRST + ROWS {
        let mut pivot = c;
        for r in c + 1..SIZE {
            if matrix[r][c].abs() > matrix[pivot][c].abs() {
                pivot = r;
            }
        }
        if !matrix[pivot][c].is_normal() {
            return Err(c);
        }
        if pivot != c {
            matrix.swap(c, pivot);
            right.swap(c, pivot);
        }
        let (row, known, inverse) = (matrix[c], right[c], 1.0 / matrix[c][c]);
        for r in c + 1..SIZE {
            let factor = matrix[r][c] * inverse;
            if factor != 0.0 {
                for k in FIRST..SIZE {
                    matrix[r][k] -= factor * row[k];
                }
                add(&mut right[r], -factor, &known);
            }
        }
    }
    Ok(())
}
