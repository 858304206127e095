//! Whether a gait is a stable periodic motion under the tracking law: the multipliers of the step-to-step map (Ma & Ames 2020
//! claim periodic stability in section IV).
//!
//! The map takes the full robot's state at the start of a step, q and q̇ with 36 entries, to the state at the start of the next,
//! mirrored back. Linearised about the plan it is
//!
//! > P = S · I · C · Φ
//!
//! - Φ: the motion for T on stance toes 1 and 2 that neither slip nor leave the floor, with τ = u − kp (q − B) − kd (q̇ − Ḃ): the
//!   law on the compensated reference, which gives the planned torque u on the planned motion (mathematics.md, 6).
//! - C: toes 0 and 3, which the clock sets down at T whether or not they are on the floor, are brought to it, by the change of
//!   posture of least kinetic metric that leaves toes 1 and 2 where they stand.
//! - I: the plastic impact of toes 0 and 3 (paper II-D). The plan's touchdown is soft, so the plan itself does not feel it.
//! - S: the left–right mirror.
//!
//! Where the second step is no mirror image of the first (a sideways slope, a rolled torso) it is the map of a stride,
//!
//! > P = (I · C · Φ)₂ · (I · C · Φ)₁.
//!
//! Where the robot is and, on level ground, where it is heading do not matter to it: x, y and yaw have multipliers of modulus 1 by
//! symmetry, which are set apart. On a slope only x and y are. If all the others are inside the unit circle, the gait is stable in this model. The converse does not hold for
//! the robot: a toe that is too low lands before T and catches the fall, which a linear map of steps with touchdown by the clock
//! cannot show. docs/planning.md has the measurement: MuJoCo's own map has these multipliers once its touchdown is by the clock.

use crate::recompose::PlanPoint;
use crate::verification::step_of;
use decomposition::{ContactDynamics, DynamicsError};
use gait::{Gait, JOINTS};
use nalgebra::{DMatrix, DVector};
use rigid_body::{Data, crba, last_point_kinematics_derivatives, rnea_derivatives};
use robot::Robot;

/// A complex number.
pub type Complex = nalgebra::Complex<f64>;

const DOF: usize = 18;
const STATE: usize = 2 * DOF;
/// The flow is taken as constant over so many parts of a Hermite–Simpson interval.
const PARTS: usize = 6;
/// Step of the difference quotients, rad or m, and per second.
const DIFFERENCE: f64 = 1e-6;

/// Multipliers of the step-to-step map, or of the stride's where two different steps make one.
#[derive(Clone, Debug, PartialEq)]
pub struct Stability {
    /// Of everything that is not neutral, largest modulus first.
    pub multipliers: Vec<Complex>,
    /// Of x, y and, on level ground, yaw: modulus 1 by symmetry. How far they are from it tells how exact the others are.
    pub neutral: Vec<Complex>,
}

impl Stability {
    /// Largest modulus: below 1 a small disturbance shrinks by this factor a step (or stride) in the long run.
    pub fn spectral_radius(&self) -> f64 {
        self.multipliers.first().map_or(0.0, |m| m.norm())
    }

    /// Whether every multiplier that is not neutral is inside the unit circle.
    pub fn is_stable(&self) -> bool {
        self.spectral_radius() < 1.0
    }
}

/// The multipliers of a plan's step-to-step map, or of its stride's. `points` and `second_points` are [`crate::Plan`]'s. For a plan on a
/// slope, `robot` is [`crate::on_slope`]'s.
///
/// # Errors
///
/// If the dynamics are singular at a point of the plan.
pub fn stability(
    robot: &Robot,
    gait: &Gait,
    points: &[PlanPoint],
    second_points: &[PlanPoint],
) -> Result<Stability, DynamicsError> {
    let first_step = step_map(robot, gait, points)?;
    let map = if second_points.is_empty() {
        mirror(robot) * first_step
    } else {
        step_map(robot, gait, second_points)? * first_step
    };

    // x, y and yaw span an invariant subspace; the rest is the quotient by it. Turning the robot turns its velocity.
    let gravity = robot.model.gravity;
    let is_level = gravity.x.hypot(gravity.y) < 1e-9 * gravity.norm();
    let neutral: &[usize] = if is_level { &[0, 1, 5] } else { &[0, 1] };
    let first = &points[0];
    let mut shifts = DMatrix::zeros(STATE, STATE);
    shifts[(0, 0)] = 1.0;
    shifts[(1, 1)] = 1.0;
    if is_level {
        for (row, value) in [(0, -first.q[1]), (1, first.q[0]), (5, 1.0), (DOF, -first.v[1]), (DOF + 1, first.v[0])] {
            shifts[(row, 2)] = value;
        }
    }
    // The columns after these complete the basis.
    let rest = STATE - neutral.len();
    for (column, unit) in (neutral.len()..STATE).zip((0..STATE).filter(|i| !neutral.contains(i))) {
        shifts[(unit, column)] = 1.0;
    }
    let basis = shifts.qr().q();
    let turned = basis.transpose() * map * basis;
    let eigenvalues = |from: usize, count: usize| -> Vec<Complex> {
        turned.view((from, from), (count, count)).into_owned().complex_eigenvalues().iter().copied().collect()
    };
    let mut multipliers = eigenvalues(neutral.len(), rest);
    multipliers.sort_by(|a, b| b.norm().total_cmp(&a.norm()));
    Ok(Stability { multipliers, neutral: eigenvalues(0, neutral.len()) })
}

/// I · C · Φ of one step.
fn step_map(robot: &Robot, gait: &Gait, points: &[PlanPoint]) -> Result<DMatrix<f64>, DynamicsError> {
    let (_, stance, swing) = step_of(points);
    let generators: Vec<DMatrix<f64>> =
        points.iter().map(|point| generator(robot, gait, stance, point)).collect::<Result<_, _>>()?;
    let mut flow = DMatrix::identity(STATE, STATE);
    let h = 2.0 * gait.step_duration_s / (points.len() - 1) as f64 / PARTS as f64;
    for interval in generators.windows(3).step_by(2) {
        for part in 0..PARTS {
            // The quadratic through the three points, in the middle of the part.
            let s = (part as f64 + 0.5) / PARTS as f64;
            let weights = [(1.0 - s) * (1.0 - 2.0 * s), 4.0 * s * (1.0 - s), s * (2.0 * s - 1.0)];
            let middle = &interval[0] * weights[0] + &interval[1] * weights[1] + &interval[2] * weights[2];
            flow = (middle * h).exp() * flow;
        }
    }
    let last = points.last().expect("a plan has points");
    Ok(touchdown(robot, stance, swing, last) * flow)
}

/// d/dt (δq, δq̇) = G (δq, δq̇) at a point of the plan under the tracking law.
fn generator(robot: &Robot, gait: &Gait, stance: [usize; 2], point: &PlanPoint) -> Result<DMatrix<f64>, DynamicsError> {
    let stance = stance.map(|leg| robot.legs[leg].toe);
    let mut dynamics = ContactDynamics::new(&robot.model, stance.len());
    let mut acceleration = |q: &[f64; DOF], v: &[f64; DOF]| -> Result<DVector<f64>, DynamicsError> {
        let mut tau = [0.0; DOF];
        for j in 0..JOINTS {
            let (dq, dv) = (q[6 + j] - point.q[6 + j], v[6 + j] - point.v[6 + j]);
            tau[6 + j] = point.torque_nm[j] - gait.kp[j] * dq - gait.kd[j] * dv;
        }
        Ok(dynamics.motion(&robot.model, q, v, &tau, &stance)?.acceleration.clone())
    };
    let mut g = DMatrix::zeros(STATE, STATE);
    for column in 0..STATE {
        let mut at = |change: f64| {
            let (mut q, mut v) = (point.q, point.v);
            if column < DOF {
                q[column] += change
            } else {
                v[column - DOF] += change
            }
            acceleration(&q, &v)
        };
        let difference = (at(DIFFERENCE)? - at(-DIFFERENCE)?) / (2.0 * DIFFERENCE);
        g.view_mut((DOF, column), (DOF, 1)).copy_from(&difference);
    }
    for i in 0..DOF {
        g[(i, DOF + i)] = 1.0;
    }
    Ok(g)
}

/// I · C at a step's end.
fn touchdown(
    robot: &Robot,
    [stance_1, stance_2]: [usize; 2],
    [swing_1, swing_2]: [usize; 2],
    end: &PlanPoint,
) -> DMatrix<f64> {
    let model = &robot.model;
    let mut data = Data::new(model);
    let mass = crba(model, &mut data, &end.q).clone();
    let factor = mass.cholesky().expect("a robot's mass matrix is positive definite");
    rnea_derivatives(model, &mut data, &end.q, &end.v, &end.a, &[]);
    let mut jacobian = [(); 4].map(|()| DMatrix::zeros(3, DOF));
    let mut velocity_by_q = jacobian.clone();
    for leg in 0..4 {
        let toe = last_point_kinematics_derivatives(model, &mut data, robot.legs[leg].toe);
        jacobian[leg].copy_from(&toe.jacobian);
        velocity_by_q[leg].copy_from(&toe.dvelocity_dq);
    }
    let stack = |rows: &[nalgebra::DMatrixView<f64>]| {
        let mut all = DMatrix::zeros(rows.iter().map(|r| r.nrows()).sum(), DOF);
        let mut next = 0;
        for r in rows {
            all.view_mut((next, 0), (r.nrows(), DOF)).copy_from(r);
            next += r.nrows();
        }
        all
    };
    // M⁻¹ Jᵀ (J M⁻¹ Jᵀ)⁻¹: the motion of least kinetic metric for given motions of the toes.
    let least = |j: &DMatrix<f64>| {
        let carried = factor.solve(&j.transpose());
        let delassus = j * &carried;
        carried * delassus.pseudo_inverse(1e-9).expect("the tolerance is positive")
    };
    let landing = stack(&[jacobian[swing_1].rows(2, 1), jacobian[swing_2].rows(2, 1)]);
    let held = stack(&[landing.rows(0, 2), jacobian[stance_1].rows(0, 3), jacobian[stance_2].rows(0, 3)]);
    let to_floor = DMatrix::identity(DOF, DOF) - least(&held).columns(0, 2) * landing;
    let land = stack(&[jacobian[swing_1].rows(0, 3), jacobian[swing_2].rows(0, 3)]);
    let land_by_q = stack(&[velocity_by_q[swing_1].rows(0, 3), velocity_by_q[swing_2].rows(0, 3)]);
    let stop = least(&land);
    let mut map = DMatrix::zeros(STATE, STATE);
    map.view_mut((0, 0), (DOF, DOF)).copy_from(&to_floor);
    map.view_mut((DOF, 0), (DOF, DOF)).copy_from(&(-&stop * land_by_q * to_floor));
    map.view_mut((DOF, DOF), (DOF, DOF)).copy_from(&(DMatrix::identity(DOF, DOF) - stop * land));
    map
}

/// S, on positions and on velocities.
fn mirror(robot: &Robot) -> DMatrix<f64> {
    let mut s = DMatrix::zeros(STATE, STATE);
    for column in 0..DOF {
        let mut unit = [0.0; DOF];
        unit[column] = 1.0;
        for (row, value) in robot.mirror.coordinates(&unit).into_iter().enumerate() {
            s[(row, column)] = value;
            s[(DOF + row, DOF + column)] = value;
        }
    }
    s
}
