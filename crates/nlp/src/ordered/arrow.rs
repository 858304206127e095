//! What remains: the program in the free inputs and the loads' own unknowns, and back.

use super::analysis::Structure;
use super::{Asked, Numbers, add};
use crate::arrow_qp::{ArrowQp, ArrowRow, DualActiveSet, Own};
use crate::problem::Problem;

/// Squares that are summed at once.
const SQUARES: usize = 4;

impl<const INPUTS: usize, const FREE: usize> Numbers<INPUTS, FREE> {
    #[inline(always)]
    pub(super) fn assemble(&self, structure: &Structure, problem: &impl Problem, asked: Asked, qp: &mut ArrowQp<FREE>) {
        self.put_rows(structure, problem, asked, qp);
        self.put_objective(structure, asked, qp);
    }

    #[inline(always)]
    fn put_rows(&self, structure: &Structure, problem: &impl Problem, asked: Asked, qp: &mut ArrowQp<FREE>) {
        let b = problem.bounds();
        qp.rows.clear();
        qp.rows.reserve(structure.bounded.len() + structure.inequalities.len());
        for &i in &structure.bounded {
            let mut normal = self.by_free[i];
            let offset = asked.x[i] + std::mem::take(&mut normal[FREE - 1]);
            let own = (structure.load_of[i], self.own[i]);
            qp.rows.push(ArrowRow { normal, own, offset, lower: b.variable_lower[i], upper: b.variable_upper[i] });
        }
        for &(i, load) in &structure.inequalities {
            let (mut normal, mut own) = ([0.0; FREE], 0.0);
            for &(column, place) in &structure.rows[i] {
                let number = asked.at.jacobian[place];
                if number != 0.0 {
                    add(&mut normal, number, &self.by_free[column]);
                    own += number * self.own[column];
                }
            }
            let offset = asked.constraints[i] + std::mem::take(&mut normal[FREE - 1]);
            let (lower, upper) = (b.constraint_lower[i], b.constraint_upper[i]);
            qp.rows.push(ArrowRow { normal, own: (load, own), offset, lower, upper });
        }
    }

    #[inline(always)]
    fn put_objective(&self, structure: &Structure, asked: Asked, qp: &mut ArrowQp<FREE>) {
        qp.own.clear();
        qp.own.resize(structure.loads.len(), Own { coupling: [0.0; FREE], hessian: 0.0, gradient: 0.0 });
        let mut hessian = [[0.0; FREE]; FREE];
        let mut linear = [0.0; FREE];
        let mut squares = [[0.0; FREE]; SQUARES];
        let mut weights = [0.0; SQUARES];
        let mut count = 0;
        for i in 0..structure.variables {
            let slope = asked.at.gradient[i];
            let weight = structure.hessian[i].map_or(0.0, |place| asked.at.hessian[place]);
            let share = self.own[i];
            if weight == 0.0 {
                if slope != 0.0 {
                    add(&mut linear, slope, &self.by_free[i]);
                }
                if share != 0.0 {
                    qp.own[structure.load_of[i]].gradient += slope * share;
                }
                continue;
            }
            // ½ w (δ + slope / w)²: the constant part becomes the residual, so one product gives Hessian and gradient.
            let mut square = self.by_free[i];
            square[FREE - 1] += slope / weight;
            if share != 0.0 {
                let own = &mut qp.own[structure.load_of[i]];
                add(&mut own.coupling, weight * share, &square);
                own.hessian += weight * share * share;
            }
            (squares[count], weights[count]) = (square, weight);
            count += 1;
            if count == SQUARES {
                add_squares(&mut hessian, &squares, &weights);
                count = 0;
            }
        }
        weights[count..].fill(0.0);
        add_squares(&mut hessian, &squares, &weights);
        for own in &mut qp.own {
            own.gradient += std::mem::take(&mut own.coupling[FREE - 1]);
        }
        for row in 0..FREE {
            for column in 0..row {
                hessian[row][column] = hessian[column][row];
            }
        }
        for (k, row) in hessian.iter_mut().enumerate() {
            qp.gradient[k] = std::mem::take(&mut row[FREE - 1]) + linear[k];
            // Places that stand for nothing stay at zero.
            if k >= self.free {
                row[k] = 1.0;
            }
        }
        hessian[FREE - 1] = [0.0; FREE];
        hessian[FREE - 1][FREE - 1] = 1.0;
        qp.gradient[FREE - 1] = 0.0;
        qp.hessian = hessian;
    }

    /// The step of all variables.
    #[inline(always)]
    pub(super) fn expand(&self, structure: &Structure, solver: &DualActiveSet<FREE>) -> Vec<f64> {
        let mut values = solver.shared;
        values[FREE - 1] = 1.0;
        let of = |i: usize| {
            let own = if self.own[i] == 0.0 { 0.0 } else { self.own[i] * solver.own[structure.load_of[i]] };
            self.by_free[i].iter().zip(&values).map(|(a, b)| a * b).sum::<f64>() + own
        };
        (0..structure.variables).map(of).collect()
    }
}

/// Adds Σ w s sᵀ above the diagonal and on it, and a little below.
#[inline(always)]
fn add_squares<const W: usize>(to: &mut [[f64; W]; W], squares: &[[f64; W]; SQUARES], weights: &[f64; SQUARES]) {
    for (k, row) in to.iter_mut().enumerate() {
        let first = k & !3;
        let scales: [f64; SQUARES] = std::array::from_fn(|s| weights[s] * squares[s][k]);
        let [a, b, c, d] = [&squares[0][first..], &squares[1][first..], &squares[2][first..], &squares[3][first..]];
        let others = a.iter().zip(b).zip(c.iter().zip(d));
        for (value, ((a, b), (c, d))) in row[first..].iter_mut().zip(others) {
            *value += (scales[0] * a + scales[1] * b) + (scales[2] * c + scales[3] * d);
        }
    }
}
