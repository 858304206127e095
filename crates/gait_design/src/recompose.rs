//! From the front biped's solution to the quadruped's gait (Ma & Ames 2020, II-C and III), checked by the full-order
//! model.

use crate::PlanError;
use crate::contact_schedule::ContactSchedule;
use crate::program::{DOF, DecomposedProgram, layout as at};
use crate::request::GaitRequest;
use gait::{Coefficients, Domain, Gains, Gait, InitialState, JOINTS, SolverSummary, bezier};
use nalgebra::{DMatrix, Rotation3, UnitQuaternion, Vector3};
use rigid_body::{Data, rnea};
use robot::Robot;

/// Force or moment that the full-order model may be out of balance by at a point, N or N m. The program's own equality
/// tolerance is 1e-5.
pub(crate) const BALANCE_TOLERANCE: f64 = 1e-3;

/// The whole robot at one point of a plan. Coordinates are (x, y, z, roll, pitch, yaw, 12 joints), z of the base
/// measured from the toe centres' plane; velocities are their plain derivatives.
#[derive(Clone, Debug, PartialEq)]
pub struct PlanPoint {
    /// s = t / T.
    pub phase: f64,
    /// q, 18.
    pub q: [f64; 18],
    /// q̇, 18.
    pub v: [f64; 18],
    /// q̈, 18.
    pub a: [f64; 18],
    /// Torques of all twelve joints, N m.
    pub torque_nm: [f64; JOINTS],
    /// Ground force on each toe in world axes, N; zero for the swing toes.
    pub ground_force_n: [[f64; 3]; 4],
}

/// All points of a solution, torques by the full-order inverse dynamics.
/// Refused if the full-order model's base is out of balance by more than `balance_tolerance`, N or N m.
pub(crate) fn points(
    robot: &Robot,
    program: &DecomposedProgram,
    x: &[f64],
    balance_tolerance: f64,
) -> Result<Vec<PlanPoint>, PlanError> {
    let mut data = Data::new(&robot.model);
    (0..program.points())
        .map(|index| {
            let p = &x[at::point(index)..at::point(index + 1)];
            let front = |start: usize| -> [f64; DOF] { p[start..start + DOF].try_into().expect("twelve entries") };
            let pairing = program.bipeds.pairing();
            let q = pairing.recompose_position(&front(at::Q));
            let (v, a) = (pairing.recompose_rate(&front(at::V)), pairing.recompose_rate(&front(at::A)));
            let force = |start: usize| Vector3::from_column_slice(&p[start..start + 3]);
            let (lambda_1, lambda_2) = (force(at::LAMBDA_1), force(at::LAMBDA_2));
            let forces = [(robot.legs[1].toe, lambda_1), (robot.legs[2].toe, lambda_2)];
            let tau = rnea(&robot.model, &mut data, &q, &v, &a, &forces);
            let unbalanced = tau.rows(0, 6).amax();
            if unbalanced > balance_tolerance {
                return Err(PlanError::Unverified(format!(
                    "the base is out of balance by {unbalanced:.2e} N or N m at point {} of {}",
                    index + 1,
                    program.points()
                )));
            }
            Ok(PlanPoint {
                phase: program.phase(index),
                q,
                v,
                a,
                torque_nm: std::array::from_fn(|j| tau[6 + j]),
                ground_force_n: [[0.0; 3], lambda_1.into(), lambda_2.into(), [0.0; 3]],
            })
        })
        .collect()
}

/// The polynomials of all twelve joints of a solution.
pub(crate) fn coefficients(program: &DecomposedProgram, x: &[f64]) -> [Coefficients; JOINTS] {
    let mut coefficients_rad = [[0.0; 6]; JOINTS];
    for k in 0..=bezier::DEGREE {
        let mut front = [0.0; DOF];
        for j in 0..6 {
            front[6 + j] = x[at::alpha(k, j)];
        }
        // The basis sums to one, so an offset of the joint is one of each of them.
        let all = program.bipeds.pairing().recompose_position(&front);
        for j in 0..JOINTS {
            coefficients_rad[j][k] = all[6 + j];
        }
    }
    coefficients_rad
}

/// How far a joint's polynomial is from the joint where the step ends, rad.
pub(crate) fn departs_at_the_end_rad(coefficients_rad: &[Coefficients; JOINTS], points: &[PlanPoint]) -> f64 {
    let last = &points[points.len() - 1];
    (0..JOINTS).map(|j| (coefficients_rad[j][bezier::DEGREE] - last.q[6 + j]).abs()).fold(0.0, f64::max)
}

/// The stance hip rolls' polynomials once more, nearest to how they move at the points. The program holds a stance
/// hip roll to its polynomial at four points only, for the distance of the toes determines it (mathematics.md, 5); in
/// long steps its motion is no polynomial, and one through the ends is nearer than one through four accelerations.
/// `rolls` are their places among the joints.
pub(crate) fn fit_stance_rolls(
    coefficients_rad: &mut [Coefficients; JOINTS],
    rolls: &[usize],
    points: &[PlanPoint],
    t: f64,
) {
    let (first, last) = (&points[0], &points[points.len() - 1]);
    for &j in rolls {
        let c = &mut coefficients_rad[j];
        let degree = bezier::DEGREE as f64;
        *c = [0.0; 6];
        (c[0], c[5]) = (first.q[6 + j], last.q[6 + j]);
        (c[1], c[4]) = (c[0] + first.v[6 + j] * t / degree, c[5] - last.v[6 + j] * t / degree);
        let (mut normal, mut right) = (nalgebra::Matrix2::zeros(), nalgebra::Vector2::zeros());
        for point in points {
            let basis = bezier::basis(point.phase);
            let inner = nalgebra::Vector2::new(basis[2], basis[3]);
            normal += inner * inner.transpose();
            right += inner * (point.q[6 + j] - bezier::combine(c, &basis));
        }
        let inner = normal.try_inverse().expect("two of the basis differ on five points") * right;
        (c[2], c[3]) = (inner[0], inner[1]);
    }
}

/// The gait of a solution.
pub(crate) fn gait(
    robot: &Robot,
    coefficients_rad: [Coefficients; JOINTS],
    t: f64,
    request: &GaitRequest,
    points: &[PlanPoint],
    solver: SolverSummary,
    second_step: Option<gait::SecondStep>,
) -> Result<Gait, PlanError> {
    let reference_rad = compensated_reference(robot, points, t);
    let gait =
        Gait { second_step, ..of_request(robot, [coefficients_rad, reference_rad], t, request, &points[0], solver) };
    gait.validate()?;
    Ok(gait)
}

/// The gait of a contact schedule's cycle, which begins at `first`.
pub(crate) fn gait_of_cycle(
    robot: &Robot,
    t: f64,
    request: &GaitRequest,
    contacts: &ContactSchedule,
    first: &PlanPoint,
    solver: SolverSummary,
    cycle: Vec<Domain>,
) -> Result<Gait, PlanError> {
    let begins = [cycle[0].planned_rad, cycle[0].reference_rad];
    let mut gait = Gait { cycle, ..of_request(robot, begins, t, request, first, solver) };
    gait.request["contact_schedule"] = serde_json::to_value(contacts).expect("a schedule is a name and a share");
    gait.validate()?;
    Ok(gait)
}

/// A gait of one step: planned joints and reference, rad.
fn of_request(
    robot: &Robot,
    [coefficients_rad, reference_coefficients_rad]: [[Coefficients; JOINTS]; 2],
    t: f64,
    request: &GaitRequest,
    first: &PlanPoint,
    solver: SolverSummary,
) -> Gait {
    let kp: [f64; JOINTS] = std::array::from_fn(|j| robot.gains.kp_nm_per_rad[j % 3]);
    let kd: [f64; JOINTS] = std::array::from_fn(|j| robot.gains.kd_nm_s_per_rad[j % 3]);
    Gait {
        robot: robot.name.clone(),
        name: request.behaviour.clone(),
        joint_names: robot.joint_names(),
        step_duration_s: t,
        step_length_m: request.speed_m_s * t,
        bezier_degree: bezier::DEGREE,
        coefficients_rad,
        mirror: robot.mirror,
        second_step: None,
        lead: Vec::new(),
        cycle: Vec::new(),
        initial: initial_state(robot, first),
        reference_coefficients_rad,
        gains: Gains { kp, kd },
        torque_limit_nm: std::array::from_fn(|j| request.torque_limit_nm[j % 3]),
        request: serde_json::to_value(request).expect("a request is plain numbers and a name"),
        solver,
        certificate: None,
    }
}

/// A point's state as a gait's start.
pub(crate) fn initial_state(robot: &Robot, first: &PlanPoint) -> InitialState {
    let angles = [first.q[3], first.q[4], first.q[5]];
    let orientation =
        UnitQuaternion::from_rotation_matrix(&Rotation3::from_euler_angles(angles[0], angles[1], angles[2]));
    let c = orientation.coords;
    InitialState {
        // The plan's floor is the toe centres' plane, one toe radius above the real one.
        base_position_m: [first.q[0], first.q[1], first.q[2] + robot.toe_radius_m],
        base_quaternion_xyzw: [c.x, c.y, c.z, c.w],
        base_linear_velocity_world: [first.v[0], first.v[1], first.v[2]],
        base_angular_velocity_body: body_rates(angles, [first.v[3], first.v[4], first.v[5]]),
        joint_position_rad: std::array::from_fn(|j| first.q[6 + j]),
        joint_velocity_rad_s: std::array::from_fn(|j| first.v[6 + j]),
    }
}

/// Angular velocity in the body's axes from the rates of roll, pitch, yaw (R = R_z R_y R_x).
fn body_rates([roll, pitch, _]: [f64; 3], [droll, dpitch, dyaw]: [f64; 3]) -> [f64; 3] {
    let ((sr, cr), (sp, cp)) = (roll.sin_cos(), pitch.sin_cos());
    [droll - sp * dyaw, cr * dpitch + sr * cp * dyaw, -sr * dpitch + cr * cp * dyaw]
}

/// B̃ with kp B̃ + kd dB̃/dt = u + kp q + kd q̇ along the plan: the bare law u = −kp (q − B̃) − kd (q̇ − dB̃/dt) then
/// gives the planned torque on the planned motion. Least squares over the points, one polynomial a joint.
pub(crate) fn compensated_reference(
    robot: &Robot,
    points: &[PlanPoint],
    step_duration_s: f64,
) -> [Coefficients; JOINTS] {
    // A joint's gains are its type's: legs share the least-squares problem's matrix.
    let gains: [(f64, f64); 3] =
        std::array::from_fn(|k| (robot.gains.kp_nm_per_rad[k], robot.gains.kd_nm_s_per_rad[k]));
    let fits = gains.map(|(kp, kd)| {
        Fit::new(points, |s, k| kp * bezier::basis(s)[k] + kd * bezier::basis_first_derivative(s)[k] / step_duration_s)
    });
    std::array::from_fn(|j| {
        let (kp, kd) = gains[j % 3];
        fits[j % 3].coefficients(points, |p| p.torque_nm[j] + kp * p.q[6 + j] + kd * p.v[6 + j])
    })
}

/// The polynomials nearest to the joints of a plan that does not prescribe them.
pub(crate) fn fitted_joints(points: &[PlanPoint]) -> [Coefficients; JOINTS] {
    let fit = Fit::new(points, |s, k| bezier::basis(s)[k]);
    std::array::from_fn(|j| fit.coefficients(points, |p| p.q[6 + j]))
}

/// Least squares over a plan's points for a polynomial's coefficients.
struct Fit(nalgebra::SVD<f64, nalgebra::Dyn, nalgebra::Dyn>);

impl Fit {
    /// `basis` gives what coefficient k contributes at phase s.
    fn new(points: &[PlanPoint], basis: impl Fn(f64, usize) -> f64) -> Self {
        Self(DMatrix::from_fn(points.len(), bezier::DEGREE + 1, |p, k| basis(points[p].phase, k)).svd(true, true))
    }

    fn coefficients(&self, points: &[PlanPoint], wanted: impl Fn(&PlanPoint) -> f64) -> Coefficients {
        let right = nalgebra::DVector::from_fn(points.len(), |p, _| wanted(&points[p]));
        let solution = self.0.solve(&right, 1e-12).expect("both factors were asked for");
        std::array::from_fn(|k| solution[k])
    }
}
