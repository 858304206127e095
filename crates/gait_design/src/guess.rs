//! A start for the solver: the body glides at constant height and speed, stance toes stay where they are, swing toes
//! follow a smooth arc; joints by inverse kinematics, fitted by Bézier polynomials.

use crate::biped::{BipedPair, FRONT_STANCE, FRONT_SWING, PointDynamics};
use crate::program::{DOF, DecomposedProgram, layout as at};
use crate::request::GaitRequest;
use gait::bezier;
use nalgebra::{DMatrix, Vector3};
use robot::Robot;
use std::f64::consts::PI;

/// A toe position that a leg cannot reach.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error(
    "the {leg} leg cannot reach a toe {below_m:.3} m below and {outward_m:.3} m beside the body's middle, {ahead_m:+.3} m ahead of its hip: ask for another height, half-width, clearance or step length (speed times step duration)"
)]
pub struct Unreachable {
    leg: String,
    below_m: f64,
    outward_m: f64,
    ahead_m: f64,
}

impl Unreachable {
    /// `toe` is the place out of reach from a hip at `hip_x_m`, in the body's axes or such that are parallel to them.
    pub(crate) fn new(robot: &Robot, request: &GaitRequest, leg: usize, toe: Vector3<f64>, hip_x_m: f64) -> Self {
        Self {
            leg: robot.legs[leg].name.replace('_', " "),
            below_m: request.height_m - toe.z,
            outward_m: toe.y.abs(),
            ahead_m: toe.x - hip_x_m,
        }
    }
}

/// Where a toe is at a phase of the step while the body glides: stance toes stay, swing toes follow a smooth arc.
fn glide(request: &GaitRequest, hip_x_m: f64, phase: f64, is_stance: bool, is_left: bool) -> Vector3<f64> {
    let y = if is_left { request.half_width_m } else { -request.half_width_m };
    let length = request.speed_m_s * request.step_duration_s;
    if is_stance {
        return Vector3::new(hip_x_m + length / 2.0, y, 0.0);
    }
    // 2 L s for the toe while the body moves L s.
    let (along, lift) = swing_arc(phase);
    Vector3::new(hip_x_m - length / 2.0 + 2.0 * length * along, y, request.clearance_m * lift)
}

/// How far along its way a swing toe is at a phase of the step, and how high over the clearance: at rest at both ends.
pub(crate) fn swing_arc(phase: f64) -> (f64, f64) {
    (phase - (2.0 * PI * phase).sin() / (2.0 * PI), (PI * phase).sin().powi(2))
}

/// The vector of unknowns that a program's solve starts from without another solution.
///
/// # Errors
///
/// If a leg cannot reach a toe's place.
pub fn nominal(robot: &Robot, program: &mut DecomposedProgram, request: &GaitRequest) -> Result<Vec<f64>, Unreachable> {
    let points = program.points();
    let t = request.step_duration_s;
    let length = request.speed_m_s * t;
    let phases: Vec<f64> = (0..points).map(|p| program.phase(p)).collect();
    let bipeds = &mut program.bipeds;
    let (swing_leg, stance_leg) = (FRONT_SWING, FRONT_STANCE);
    let (swing_hip, stance_hip) = (bipeds.hip_x_m(swing_leg), bipeds.hip_x_m(stance_leg));

    let mut base = vec![[0.0; 6]; points];
    let mut joints = DMatrix::zeros(points, 6);
    let mut near = [0.0; 6];
    near[..3].copy_from_slice(&robot.legs[swing_leg].stand_rad);
    near[3..].copy_from_slice(&robot.legs[stance_leg].stand_rad);
    for (p, &s) in phases.iter().enumerate() {
        base[p][0] = length * s;
        base[p][2] = request.height_m;
        let swing = glide(request, swing_hip, s, false, true);
        let stance = glide(request, stance_hip, s, true, false);
        for (is_swing, leg, target, hip) in
            [(true, swing_leg, swing, swing_hip), (false, stance_leg, stance, stance_hip)]
        {
            inverse_kinematics(bipeds, is_swing, &base[p], &mut near, target)
                .ok_or_else(|| Unreachable::new(robot, request, leg, target, hip + length * s))?;
        }
        for j in 0..6 {
            joints[(p, j)] = near[j];
        }
    }

    let values = DMatrix::from_fn(points, 6, |p, k| bezier::basis(phases[p])[k]);
    let fit = values.svd(true, true).solve(&joints, 1e-12).expect("both factors were asked for");

    let mut x = vec![0.0; at::point(points)];
    x[at::T] = t;
    for k in 0..6 {
        for j in 0..6 {
            x[at::alpha(k, j)] = fit[(k, j)];
        }
    }
    let weight = 9.81 * bipeds.total_mass_kg();
    let force = Vector3::new(0.0, 0.0, weight / 2.0);
    let mut dynamics = PointDynamics::default();
    bipeds.with_derivatives = false;
    for (p, &s) in phases.iter().enumerate() {
        let bases = [
            (bezier::basis(s), 1.0),
            (bezier::basis_first_derivative(s), t),
            (bezier::basis_second_derivative(s), t * t),
        ];
        let [mut q, mut v, a] = bases.map(|(basis, divisor)| {
            let mut w = [0.0; DOF];
            for j in 0..6 {
                w[6 + j] = (0..6).map(|k| fit[(k, j)] * basis[k]).sum::<f64>() / divisor;
            }
            w
        });
        q[..6].copy_from_slice(&base[p]);
        v[0] = request.speed_m_s;
        bipeds.evaluate(&q, &v, &a, force, force, &mut dynamics);
        let point = &mut x[at::point(p)..at::point(p + 1)];
        point[at::Q..at::V].copy_from_slice(&q);
        point[at::V..at::A].copy_from_slice(&v);
        point[at::A..at::U_FRONT].copy_from_slice(&a);
        point[at::LAMBDA_1..at::LAMBDA_2].copy_from_slice(force.as_slice());
        point[at::LAMBDA_2..at::LAMBDA_C].copy_from_slice(force.as_slice());
        for i in 0..6 {
            point[at::U_FRONT + i] = dynamics.front.tau[6 + i];
            point[at::U_REAR + i] = dynamics.rear.tau[6 + i];
            point[at::LAMBDA_C + i] = -dynamics.front.tau[i];
        }
    }
    Ok(x)
}

/// Damped Newton from `near`, whose three joints of the leg it replaces.
fn inverse_kinematics(
    bipeds: &mut BipedPair,
    swing: bool,
    base: &[f64; 6],
    near: &mut [f64; 6],
    target: Vector3<f64>,
) -> Option<()> {
    const TOLERANCE_M: f64 = 1e-9;
    const LONGEST_STEP_RAD: f64 = 0.3;
    let first = if swing { 0 } else { 3 };
    let mut q = [0.0; DOF];
    q[..6].copy_from_slice(base);
    q[6..].copy_from_slice(near);
    for _ in 0..60 {
        let (position, jacobian) = bipeds.front_toe(swing, &q);
        let error = target - position;
        if error.norm() < TOLERANCE_M {
            near[first..first + 3].copy_from_slice(&q[6 + first..9 + first]);
            return Some(());
        }
        let damped = jacobian.transpose() * jacobian + nalgebra::Matrix3::identity() * (1e-4 * error.norm_squared());
        let mut step = damped.try_inverse()? * jacobian.transpose() * error;
        let longest = step.amax();
        if longest > LONGEST_STEP_RAD {
            step *= LONGEST_STEP_RAD / longest;
        }
        for k in 0..3 {
            q[6 + first + k] += step[k];
        }
    }
    None
}
