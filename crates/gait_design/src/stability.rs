//! Whether a gait is a stable periodic motion under the tracking law: the multipliers of the step-to-step map (Ma &
//! Ames 2020 claim periodic stability in section IV).
//!
//! The map takes the full robot's state at the start of a step, q and q̇ with 36 entries, to the state at the start of
//! the next, mirrored back. Linearised about the plan it is
//!
//! > P = S · I · C · Φ
//!
//! - Φ: the motion for T on stance toes 1 and 2 that neither slip nor leave the floor, with τ = u − kp (q − B) − kd (q̇
//!   − Ḃ): the law on the compensated reference, which gives the planned torque u on the planned motion
//!   (mathematics.md, 6).
//! - C: toes 0 and 3, which the clock sets down at T whether or not they are on the floor, are brought to it, by the
//!   change of posture of least kinetic metric that leaves toes 1 and 2 where they stand.
//! - I: the plastic impact of toes 0 and 3 (paper II-D). The plan's touchdown is soft, so that it changes
//!   nothing of the plan itself.
//! - S: the left–right mirror.
//!
//! The map is computed where a step can begin: stance toes on the floor and at rest, wherever they are. There the
//! robot has 28 coordinates: the body's and the swing legs' twelve, their rates, and the stance toes' four places;
//! the map's other eight multipliers are zero, for whatever leads off the manifold is gone at the next switch.
//!
//! Where the second step is no mirror image of the first (a sideways slope, a rolled torso) it is the map of a stride,
//!
//! > P = G⁻¹ · (I · C · Φ)₂ · (I · C · Φ)₁,
//!
//! where G is the turn of a gait that turns, by how much the robot heads elsewhere after a stride.
//!
//! Where the robot is and, on level ground, where it is heading do not matter to it: x, y and yaw have multipliers of
//! modulus 1 by symmetry, which are set apart. On a slope only x and y are. If all the others are inside the unit
//! circle, the gait is stable in this model. The converse does not hold for the robot: a toe that is too low lands
//! before T and catches the fall, which a linear map of steps with touchdown by the clock cannot show. docs/planning.md
//! has the measurement: MuJoCo's own map has these multipliers once its touchdown is by the clock.

mod flow;
mod generator;
mod growth;
mod product;

use crate::recompose::PlanPoint;
use crate::verification::step_of;
use decomposition::DynamicsError;
use flow::Flow;
use gait::Gait;
use generator::{PLACES, RATES, Row, generator, independent, lift};
use growth::step_growth;
use nalgebra::DMatrix;
use product::product;
use rigid_body::{Data, crba, last_point_kinematics_derivatives, rnea_derivatives};
use robot::Robot;

/// A complex number.
pub type Complex = nalgebra::Complex<f64>;

const DOF: usize = 18;
/// Coordinates of the stance manifold that move: the body's and the swing legs' joints.
const ROWS: usize = 12;
/// Those, their rates, and where the two stance toes are, x and y of each.
const STATE: usize = 2 * ROWS + 4;
/// Each Hermite–Simpson interval is integrated in so many steps, with which the largest multiplier of the five gaits is
/// exact to 1e-5.
const STEPS: usize = 3;

/// Multipliers of the step-to-step map, or of the stride's where two different steps make one.
#[derive(Clone, Debug, PartialEq)]
pub struct Stability {
    /// Of everything that is not neutral, largest modulus first.
    pub multipliers: Vec<Complex>,
    /// Of x, y and, on level ground, yaw: modulus 1 by symmetry. How far they are from it tells how exact the others
    /// are.
    pub neutral: Vec<Complex>,
    /// By how much a disturbance grows at most within a step, in the robot's own measure: lengths in nominal heights h,
    /// angles in rad, rates in √(g/h). It grows before it shrinks: over two legs the body tips as an inverted pendulum.
    pub step_growth: f64,
}

impl Stability {
    /// Largest modulus: below 1 a small disturbance shrinks by this factor a step (or stride) in the long run.
    pub fn spectral_radius(&self) -> f64 {
        self.multipliers.first().map_or(0.0, |m| m.norm())
    }
}

/// The multipliers of a plan's step-to-step map, or of its stride's. `points` and `second_points` are
/// [`crate::Plan`]'s. For a plan on a slope, `robot` is [`crate::on_slope`]'s.
///
/// # Errors
///
/// If the dynamics are singular at a point of the plan, or the map is not finite.
pub fn stability(
    robot: &Robot,
    gait: &Gait,
    points: &[PlanPoint],
    second_points: &[PlanPoint],
) -> Result<Stability, DynamicsError> {
    stability_in_steps(robot, gait, points, second_points, STEPS)
}

/// [`stability`] with each interval integrated in so many steps.
pub(crate) fn stability_in_steps(
    robot: &Robot,
    gait: &Gait,
    points: &[PlanPoint],
    second_points: &[PlanPoint],
    steps: usize,
) -> Result<Stability, DynamicsError> {
    let first_step = step_map(robot, gait, points, steps)?;
    let (map, step_growth) = if second_points.is_empty() {
        let map = product(&product(&on_manifold(robot, points), &mirror(robot)), &first_step);
        let growth = step_growth(robot, &map);
        (map, growth)
    } else {
        let second_step = step_map(robot, gait, second_points, steps)?;
        let turned_back = turned_by(-stride_yaw_rad(gait, points, second_points));
        let second = product(&product(&on_manifold(robot, points), &turned_back), &second_step);
        let first = product(&on_manifold(robot, second_points), &first_step);
        (product(&second, &first), step_growth(robot, &first).max(step_growth(robot, &second)))
    };

    // The iteration for eigenvalues would not end.
    if !map.iter().all(|entry| entry.is_finite()) {
        return Err(DynamicsError::NotFinite { what: "the linearised step" });
    }

    // x, y and yaw span an invariant subspace; the rest is the quotient by it. Turning the robot turns its velocity.
    let gravity = robot.model.gravity;
    let is_level = gravity.x.hypot(gravity.y) < 1e-9 * gravity.norm();
    let neutral: &[usize] = if is_level { &[0, 1, 5] } else { &[0, 1] };
    let first = &points[0];
    let toes = stance_toes(robot, points);
    let mut shifts = DMatrix::zeros(STATE, STATE);
    for axis in 0..2 {
        for row in [axis, PLACES + axis, PLACES + 2 + axis] {
            shifts[(row, axis)] = 1.0;
        }
    }
    if is_level {
        shifts[(5, 2)] = 1.0;
        let turned = [
            (0, [first.q[0], first.q[1]]),
            (RATES, [first.v[0], first.v[1]]),
            (PLACES, toes[0]),
            (PLACES + 2, toes[1]),
        ];
        for (row, [x, y]) in turned {
            shifts[(row, 2)] = -y;
            shifts[(row + 1, 2)] = x;
        }
    }
    // The columns after these complete the basis.
    let rest = STATE - neutral.len();
    for (column, unit) in (neutral.len()..STATE).zip((0..STATE).filter(|i| !neutral.contains(i))) {
        shifts[(unit, column)] = 1.0;
    }
    let basis = shifts.qr().q();
    let turned = product(&product(&basis.transpose(), &map), &basis);
    let eigenvalues = |from: usize, count: usize| -> Vec<Complex> {
        turned.view((from, from), (count, count)).into_owned().complex_eigenvalues().iter().copied().collect()
    };
    let mut multipliers = eigenvalues(neutral.len(), rest);
    multipliers.sort_by(|a, b| b.norm().total_cmp(&a.norm()));
    Ok(Stability { multipliers, neutral: eigenvalues(0, neutral.len()), step_growth })
}

/// I · C · Φ of one step: of the manifold's coordinates at its start, all of the robot's at its end.
fn step_map(robot: &Robot, gait: &Gait, points: &[PlanPoint], steps: usize) -> Result<DMatrix<f64>, DynamicsError> {
    let (_, stance, swing) = step_of(points);
    let ends = end_rows(robot, gait, points, steps)?;
    let end = points.last().expect("a plan has points");
    let ends = DMatrix::from_fn(2 * DOF, STATE, |r, c| ends[r][c]);
    Ok(product(&touchdown(robot, stance, swing, end), &ends))
}

/// Φ of one step, q and then q̇.
fn end_rows(robot: &Robot, gait: &Gait, points: &[PlanPoint], steps: usize) -> Result<[Row; 2 * DOF], DynamicsError> {
    #[cfg(target_arch = "x86_64")]
    if std::arch::is_x86_feature_detected!("avx2") {
        // SAFETY: this processor has the instructions that the function is compiled for.
        return unsafe { end_rows_with_avx2(robot, gait, points, steps) };
    }
    end_rows_as_compiled(robot, gait, points, steps)
}

/// [`end_rows_as_compiled`] for processors with registers twice as wide: the same sums to the bit, for none is fused.
#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
fn end_rows_with_avx2(
    robot: &Robot,
    gait: &Gait,
    points: &[PlanPoint],
    steps: usize,
) -> Result<[Row; 2 * DOF], DynamicsError> {
    end_rows_as_compiled(robot, gait, points, steps)
}

#[inline(always)]
fn end_rows_as_compiled(
    robot: &Robot,
    gait: &Gait,
    points: &[PlanPoint],
    steps: usize,
) -> Result<[Row; 2 * DOF], DynamicsError> {
    let (_, stance, swing) = step_of(points);
    let mut data = Data::new(&robot.model);
    let mut generators: Vec<[Row; ROWS]> = Vec::with_capacity(points.len());
    for point in points {
        generators.push(generator(robot, gait, &mut data, [stance, swing], point)?);
    }
    let mut flow = Flow::identity();
    let h = 2.0 * gait.step_duration_s / (points.len() - 1) as f64;
    for interval in generators.windows(3).step_by(2) {
        flow.advance([&interval[0], &interval[1], &interval[2]], h, steps)?;
    }
    // The last generator's kinematics are the end's.
    let lift = lift(robot, &mut data, stance, swing)?;
    let mut ends = [[0.0; STATE]; 2 * DOF];
    for (sum, row) in ends.iter_mut().zip(lift.position.iter().chain(&lift.velocity)) {
        sum[PLACES..].copy_from_slice(&row[PLACES..]);
        for k in 0..ROWS {
            generator::add(sum, row[k], &flow.position[k]);
            generator::add(sum, row[RATES + k], &flow.rate[k]);
        }
    }
    Ok(ends)
}

/// The manifold's coordinates of the step that starts at a plan's first point, of all of the robot's.
fn on_manifold(robot: &Robot, points: &[PlanPoint]) -> DMatrix<f64> {
    let (_, stance, swing) = step_of(points);
    let mut data = Data::new(&robot.model);
    let first = &points[0];
    rigid_body::forward_kinematics(&robot.model, &mut data, &first.q, &first.v, &first.a);
    let mut map = DMatrix::zeros(STATE, 2 * DOF);
    for (row, coordinate) in independent(swing).into_iter().enumerate() {
        map[(row, coordinate)] = 1.0;
        map[(RATES + row, DOF + coordinate)] = 1.0;
    }
    for (k, leg) in stance.into_iter().enumerate() {
        let toe = last_point_kinematics_derivatives(&robot.model, &mut data, robot.legs[leg].toe);
        map.view_mut((PLACES + 2 * k, 0), (2, DOF)).copy_from(&toe.jacobian.rows(0, 2));
    }
    map
}

/// Where the stance toes of a step are at its start, x and y, m.
fn stance_toes(robot: &Robot, points: &[PlanPoint]) -> [[f64; 2]; 2] {
    let mut data = Data::new(&robot.model);
    let first = &points[0];
    rigid_body::forward_kinematics(&robot.model, &mut data, &first.q, &first.v, &first.a);
    step_of(points).1.map(|leg| {
        let toe = rigid_body::frame_position(&robot.model, &data, robot.legs[leg].toe);
        [toe.x, toe.y]
    })
}

/// I · C at a step's end.
pub(crate) fn touchdown(
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
        let delassus = product(j, &carried);
        // Toes that can be moved one by one, as nearly all can, need no eigenvalues.
        let inverse = match delassus.clone().cholesky() {
            Some(own) if own.l_dirty().diagonal().min() > 1e-3 => own.inverse(),
            _ => pseudo_inverse(delassus),
        };
        product(&carried, &inverse)
    };
    let landing = stack(&[jacobian[swing_1].rows(2, 1), jacobian[swing_2].rows(2, 1)]);
    let held = stack(&[landing.rows(0, 2), jacobian[stance_1].rows(0, 3), jacobian[stance_2].rows(0, 3)]);
    let to_floor = DMatrix::identity(DOF, DOF) - least(&held).columns(0, 2) * landing;
    let land = stack(&[jacobian[swing_1].rows(0, 3), jacobian[swing_2].rows(0, 3)]);
    let land_by_q = stack(&[velocity_by_q[swing_1].rows(0, 3), velocity_by_q[swing_2].rows(0, 3)]);
    let stop = least(&land);
    let mut map = DMatrix::zeros(2 * DOF, 2 * DOF);
    map.view_mut((0, 0), (DOF, DOF)).copy_from(&to_floor);
    let moved = product(&product(&stop, &land_by_q), &to_floor);
    map.view_mut((DOF, 0), (DOF, DOF)).copy_from(&-moved);
    map.view_mut((DOF, DOF), (DOF, DOF)).copy_from(&(DMatrix::identity(DOF, DOF) - product(&stop, &land)));
    map
}

/// Of a symmetric matrix without negative eigenvalues; those below 1e-9 count as zero.
fn pseudo_inverse(matrix: DMatrix<f64>) -> DMatrix<f64> {
    let own = matrix.symmetric_eigen();
    let inverse = own.eigenvalues.map(|value| if value > 1e-9 { 1.0 / value } else { 0.0 });
    product(&product(&own.eigenvectors, &DMatrix::from_diagonal(&inverse)), &own.eigenvectors.transpose())
}

/// How far a gait turns in a stride, rad. To the bit 0 where none is asked for, whatever the solver left.
fn stride_yaw_rad(gait: &Gait, points: &[PlanPoint], second_points: &[PlanPoint]) -> f64 {
    let turns = gait.request["yaw_rate_rad_s"].as_f64().is_some_and(|rate| rate != 0.0);
    let end = second_points.last().expect("a plan has points");
    if turns { end.q[5] - points[0].q[5] } else { 0.0 }
}

/// A turn of the robot about the vertical through the origin, on positions and on velocities: of x and y, for rates of
/// Euler angles do not feel yaw, and where it heads is only moved.
fn turned_by(yaw_rad: f64) -> DMatrix<f64> {
    let mut turn = DMatrix::identity(2 * DOF, 2 * DOF);
    let rotation = nalgebra::Rotation2::new(yaw_rad);
    for block in [0, DOF] {
        turn.view_mut((block, block), (2, 2)).copy_from(rotation.matrix());
    }
    turn
}

/// S, on positions and on velocities.
pub(crate) fn mirror(robot: &Robot) -> DMatrix<f64> {
    let mut s = DMatrix::zeros(2 * DOF, 2 * DOF);
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

#[cfg(all(test, target_arch = "x86_64"))]
mod tests {
    use super::*;
    use crate::tests::{as_steps, go_on, vision60};

    #[test]
    fn wider_registers_give_the_same_flow_to_the_bit() {
        assert!(std::arch::is_x86_feature_detected!("avx2"), "this processor has no AVX2: there is nothing to compare");
        let robot = vision60();
        let plan = crate::plan(&robot, &as_steps("amble", &robot), &Default::default(), go_on).unwrap();
        let narrow = end_rows_as_compiled(&robot, &plan.gait, &plan.points, STEPS).unwrap();
        let wide = end_rows(&robot, &plan.gait, &plan.points, STEPS).unwrap();
        for (a, b) in narrow.as_flattened().iter().zip(wide.as_flattened()) {
            assert_eq!(a.to_bits(), b.to_bits(), "{a} and {b}");
        }
    }
}
