//! The linearised motion on two stance toes in coordinates of the stance manifold: the body's six and the swing legs'
//! six joints w, their rates ẇ, and where the two toes stand, p (x and y of each), which a step does not change:
//!
//! > δẅ = G (δw, δẇ, δp).
//!
//! The stance legs' joints follow: J δq = δp. Multiplied by Nᵀ, N = ∂q/∂w, the ground forces' changes drop out of the
//! dynamics.

use super::{DOF, ROWS, STATE};
use crate::recompose::PlanPoint;
use decomposition::DynamicsError;
use gait::{Gait, JOINTS};
use nalgebra::Matrix3;
use rigid_body::{Data, PointKinematics, last_point_kinematics_derivatives, rnea_derivatives};
use robot::Robot;

/// Changes of one coordinate by the manifold's: columns w, ẇ, p.
pub(super) type Row = [f64; STATE];
/// First column of ẇ.
pub(super) const RATES: usize = ROWS;
/// First column of p.
pub(super) const PLACES: usize = 2 * ROWS;

#[inline(always)]
pub(super) fn add(to: &mut Row, scale: f64, from: &Row) {
    for (t, f) in to.iter_mut().zip(from) {
        *t += scale * f;
    }
}

/// A posture's changes of q and q̇ by the manifold's coordinates, with what δẅ adds to δq̈ left out of `acceleration`.
pub(super) struct Lift {
    pub position: [Row; DOF],
    pub velocity: [Row; DOF],
    acceleration: [Row; DOF],
    /// Changes of the stance joints by the body's: the rows of N that are not those of w itself.
    follows: [[[f64; 6]; 3]; 2],
}

/// The robot's coordinates that w takes: the body and the joints of the swing legs.
pub(super) fn independent(swing: [usize; 2]) -> [usize; ROWS] {
    std::array::from_fn(|i| if i < 6 { i } else { 6 + 3 * swing[(i - 6) / 3] + (i - 6) % 3 })
}

/// Of the posture whose dynamics were last evaluated in `data`.
#[inline(always)]
pub(super) fn lift(
    robot: &Robot,
    data: &mut Data,
    stance: [usize; 2],
    swing: [usize; 2],
) -> Result<Lift, DynamicsError> {
    const ZERO: [Row; DOF] = [[0.0; STATE]; DOF];
    let mut lift = Lift { position: ZERO, velocity: ZERO, acceleration: ZERO, follows: [[[0.0; 6]; 3]; 2] };
    for (column, coordinate) in independent(swing).into_iter().enumerate() {
        lift.position[coordinate][column] = 1.0;
        lift.velocity[coordinate][RATES + column] = 1.0;
    }
    for (k, leg) in stance.into_iter().enumerate() {
        let toe = last_point_kinematics_derivatives(&robot.model, data, robot.legs[leg].toe);
        let first = 6 + 3 * leg;
        let own: Matrix3<f64> = toe.jacobian.fixed_columns::<3>(first).into_owned();
        let inverse = own.try_inverse().ok_or_else(|| DynamicsError::SingularContacts {
            toes: robot.legs[leg].name.clone(),
            rows: 3,
            rank: own.rank(1e-9),
        })?;
        let by_body = -inverse * toe.jacobian.fixed_columns::<6>(0);
        for r in 0..3 {
            for c in 0..6 {
                lift.follows[k][r][c] = by_body[(r, c)];
                lift.position[first + r][c] = by_body[(r, c)];
                lift.velocity[first + r][RATES + c] = by_body[(r, c)];
            }
            for axis in 0..2 {
                lift.position[first + r][PLACES + 2 * k + axis] = inverse[(r, axis)];
            }
        }
        let moved = toe_changes(toe, first, &lift.position, &lift.velocity);
        let turned = along(&inverse, &moved.0);
        for (row, change) in lift.velocity[first..first + 3].iter_mut().zip(&turned) {
            add(row, -1.0, change);
        }
        let moved = toe_changes(toe, first, &lift.position, &lift.velocity);
        let turned = along(&inverse, &moved.1);
        for (row, change) in lift.acceleration[first..first + 3].iter_mut().zip(&turned) {
            add(row, -1.0, change);
        }
    }
    Ok(lift)
}

/// Changes of a toe's velocity by position, and of its acceleration by position and velocity.
#[inline(always)]
fn toe_changes(toe: &PointKinematics, first: usize, q: &[Row; DOF], v: &[Row; DOF]) -> ([Row; 3], [Row; 3]) {
    let (mut velocity, mut acceleration) = ([[0.0; STATE]; 3], [[0.0; STATE]; 3]);
    for r in 0..3 {
        for i in (3..6).chain(first..first + 3) {
            add(&mut velocity[r], toe.dvelocity_dq[(r, i)], &q[i]);
            add(&mut acceleration[r], toe.dacceleration_dq[(r, i)], &q[i]);
            add(&mut acceleration[r], toe.dacceleration_dv[(r, i)], &v[i]);
        }
    }
    (velocity, acceleration)
}

#[inline(always)]
fn along(inverse: &Matrix3<f64>, rows: &[Row; 3]) -> [Row; 3] {
    let mut sums = [[0.0; STATE]; 3];
    for (r, sum) in sums.iter_mut().enumerate() {
        for (k, row) in rows.iter().enumerate() {
            add(sum, inverse[(r, k)], row);
        }
    }
    sums
}

/// G at a point of the plan under the tracking law.
#[inline(always)]
pub(super) fn generator(
    robot: &Robot,
    gait: &Gait,
    data: &mut Data,
    [stance, swing]: [[usize; 2]; 2],
    point: &PlanPoint,
) -> Result<[Row; ROWS], DynamicsError> {
    let forces = stance.map(|leg| (robot.legs[leg].toe, point.ground_force_n[leg].into()));
    rnea_derivatives(&robot.model, data, &point.q, &point.v, &point.a, &forces);
    let lift = lift(robot, data, stance, swing)?;
    let own = independent(swing);
    let mut right = [[0.0; STATE]; DOF];
    for (r, row) in right.iter_mut().enumerate() {
        let mut sum = [0.0; STATE];
        for leg in stance {
            for i in 6 + 3 * leg..9 + 3 * leg {
                add(&mut sum, -data.dtau_dq[(r, i)], &lift.position[i]);
                add(&mut sum, -data.dtau_dv[(r, i)], &lift.velocity[i]);
                add(&mut sum, -data.mass_matrix[(r, i)], &lift.acceleration[i]);
            }
        }
        // The others are coordinates of the manifold.
        for (column, &i) in own.iter().enumerate().skip(3) {
            sum[column] -= data.dtau_dq[(r, i)];
            sum[RATES + column] -= data.dtau_dv[(r, i)];
        }
        *row = sum;
    }
    for j in 0..JOINTS {
        add(&mut right[6 + j], -gait.gains.kp[j], &lift.position[6 + j]);
        add(&mut right[6 + j], -gait.gains.kd[j], &lift.velocity[6 + j]);
    }
    // Nᵀ of rows of the robot's coordinates.
    let mut g: [Row; ROWS] = own.map(|i| right[i]);
    let mut mass: [[f64; DOF]; ROWS] = own.map(|i| std::array::from_fn(|c| data.mass_matrix[(i, c)]));
    for (k, leg) in stance.into_iter().enumerate() {
        for r in 0..3 {
            for c in 0..6 {
                let share = lift.follows[k][r][c];
                add(&mut g[c], share, &right[6 + 3 * leg + r]);
                for (to, i) in mass[c].iter_mut().zip(0..DOF) {
                    *to += share * data.mass_matrix[(6 + 3 * leg + r, i)];
                }
            }
        }
    }
    let mut reduced: [[f64; ROWS]; ROWS] = std::array::from_fn(|r| own.map(|i| mass[r][i]));
    for (k, leg) in stance.into_iter().enumerate() {
        for r in 0..3 {
            for (row, mass) in reduced.iter_mut().zip(&mass) {
                for c in 0..6 {
                    row[c] += lift.follows[k][r][c] * mass[6 + 3 * leg + r];
                }
            }
        }
    }
    solve_symmetric(&mut reduced, &mut g)
        .map_err(|coordinate| DynamicsError::SingularMassMatrix { coordinate, pitch_rad: point.q[4] })?;
    Ok(g)
}

/// By Cholesky's factor, in place. The row at which the matrix is not positive definite, if there is one.
#[inline(always)]
fn solve_symmetric(l: &mut [[f64; ROWS]; ROWS], right: &mut [Row; ROWS]) -> Result<(), usize> {
    for c in 0..ROWS {
        for r in c..ROWS {
            let known: f64 = (0..c).map(|k| l[r][k] * l[c][k]).sum();
            let rest = l[r][c] - known;
            if r == c {
                if rest.is_nan() || rest <= 0.0 {
                    return Err(c);
                }
                l[r][c] = rest.sqrt();
            } else {
                l[r][c] = rest / l[c][c];
            }
        }
    }
    for i in 0..ROWS {
        let (above, below) = right.split_at_mut(i);
        for (k, row) in above.iter().enumerate() {
            add(&mut below[0], -l[i][k], row);
        }
        below[0].iter_mut().for_each(|v| *v /= l[i][i]);
    }
    for i in (0..ROWS).rev() {
        let (above, below) = right.split_at_mut(i + 1);
        for (k, row) in below.iter().enumerate() {
            add(&mut above[i], -l[i + 1 + k][i], row);
        }
        above[i].iter_mut().for_each(|v| *v /= l[i][i]);
    }
    Ok(())
}
