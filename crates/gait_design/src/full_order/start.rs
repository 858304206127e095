//! A start for a robot whose rear legs cannot do as the front ones do: all four legs by inverse kinematics, as
//! [`crate::guess::nominal`] places the front ones.

use super::{COEFFICIENTS, DOF, FullOrderProgram, STANCE, at, recomposed};
use crate::decomposed::DecomposedPlanner;
use crate::guess::{self, Unreachable, glide};
use crate::program::DecomposedProgram;
use crate::request::GaitRequest;
use crate::{PlanOptions, SubproblemSolver, on_slope};
use gait::{JOINTS, bezier};
use nalgebra::{DMatrix, Vector3};
use rigid_body::{Data, point_kinematics, rnea};
use robot::{Robot, mirrored_vector};
use std::ops::ControlFlow;

/// The decomposed program's own guess. `robot` is on the slope.
pub(super) fn of_the_guess(
    program: &FullOrderProgram,
    decomposed: &mut DecomposedProgram,
    robot: &Robot,
    level: &GaitRequest,
) -> Result<Vec<f64>, Unreachable> {
    let x = guess::nominal(robot, decomposed, level)?;
    Ok(recomposed(program, decomposed, &x))
}

/// The decomposed program's plan on level ground, or its guess where there is none.
pub(super) fn of_the_plan(
    program: &FullOrderProgram,
    decomposed: &mut DecomposedProgram,
    robot: &Robot,
    level: &GaitRequest,
    options: &PlanOptions,
) -> Result<Vec<f64>, Unreachable> {
    let options = PlanOptions { subproblem: SubproblemSolver::default(), warm_start: None, ..options.clone() };
    match DecomposedPlanner::new(robot, false).solve(level, &options, |_| ControlFlow::Continue(())) {
        Ok(solution) => Ok(recomposed(program, decomposed, &solution.x)),
        Err(_) => of_the_guess(program, decomposed, &on_slope(robot, level), level),
    }
}

/// All four legs by inverse kinematics. `robot` is on the slope; `decomposed` knows where the hips are.
pub(super) fn of_four_legs(
    program: &FullOrderProgram,
    decomposed: &DecomposedProgram,
    robot: &Robot,
    request: &GaitRequest,
) -> Result<Vec<f64>, Unreachable> {
    let layout = program.layout;
    let t = request.step_duration_s;
    let mut data = Data::new(&robot.model);
    let mut joints = DMatrix::zeros(layout.points, JOINTS);
    let mut near = robot.stand_rad();
    let phases: Vec<f64> = (0..layout.points).map(|p| layout.phase(p)).collect();
    for (p, &phase) in phases.iter().enumerate() {
        for leg in 0..4 {
            let is_stance = STANCE.contains(&leg);
            let hip_x_m = decomposed.bipeds().hip_x_m(leg);
            let target = glide(request, hip_x_m, phase, is_stance, leg < 2);
            let found = inverse_kinematics(robot, &mut data, leg, base(request, phase), &near, target);
            let ahead_m = request.speed_m_s * request.step_duration_s * phase;
            let found = found.ok_or_else(|| Unreachable::new(robot, request, leg, target, hip_x_m + ahead_m))?;
            near[3 * leg..3 * leg + 3].copy_from_slice(&found);
        }
        joints.row_mut(p).copy_from_slice(&near);
    }
    let values = DMatrix::from_fn(layout.points, COEFFICIENTS, |p, k| bezier::basis(phases[p])[k]);
    let fit = values.svd(true, true).solve(&joints, 1e-12).expect("both factors were asked for");
    let mut x = vec![0.0; layout.point(layout.all_points())];
    x[layout.t()] = t;
    for k in 0..COEFFICIENTS {
        for j in 0..JOINTS {
            x[layout.alpha(0, k, j)] = fit[(k, j)];
        }
    }
    let force = Vector3::new(0.0, 0.0, robot.model.total_mass() * robot.model.gravity.norm() / 2.0);
    for (p, &phase) in phases.iter().enumerate() {
        let bases = [
            (bezier::basis(phase), 1.0),
            (bezier::basis_first_derivative(phase), t),
            (bezier::basis_second_derivative(phase), t * t),
        ];
        let [mut q, mut v, a] = bases.map(|(basis, divisor)| {
            let mut w = [0.0; DOF];
            for j in 0..JOINTS {
                w[6 + j] = (0..COEFFICIENTS).map(|k| fit[(k, j)] * basis[k]).sum::<f64>() / divisor;
            }
            w
        });
        q[..6].copy_from_slice(&base(request, phase));
        v[0] = request.speed_m_s;
        let forces = STANCE.map(|leg| (robot.legs[leg].toe, force));
        let tau = rnea(&robot.model, &mut data, &q, &v, &a, &forces);
        let point = &mut x[layout.point(p)..layout.point(p + 1)];
        point[at::Q..at::V].copy_from_slice(&q);
        point[at::V..at::A].copy_from_slice(&v);
        point[at::A..at::U].copy_from_slice(&a);
        point[at::U..at::LAMBDA].copy_from_slice(&tau.as_slice()[6..]);
        point[at::LAMBDA..at::LAMBDA + 3].copy_from_slice(force.as_slice());
        point[at::LAMBDA + 3..].copy_from_slice(force.as_slice());
    }
    program.mirror_second_step(&mut x);
    Ok(x)
}

fn base(request: &GaitRequest, phase: f64) -> [f64; 6] {
    [request.speed_m_s * request.step_duration_s * phase, 0.0, request.height_m, 0.0, 0.0, 0.0]
}

/// Newton's method with damping from the leg's angles in `near`.
fn inverse_kinematics(
    robot: &Robot,
    data: &mut Data,
    leg: usize,
    base: [f64; 6],
    near: &[f64; JOINTS],
    target: Vector3<f64>,
) -> Option<[f64; 3]> {
    const TOLERANCE_M: f64 = 1e-9;
    const LONGEST_STEP_RAD: f64 = 0.3;
    let first = 6 + 3 * leg;
    let zero = [0.0; DOF];
    let mut q = zero;
    q[..6].copy_from_slice(&base);
    q[6..].copy_from_slice(near);
    for _ in 0..60 {
        let toe = point_kinematics(&robot.model, data, &q, &zero, &zero, robot.legs[leg].toe);
        let error = target - toe.position;
        if error.norm() < TOLERANCE_M {
            return Some([q[first], q[first + 1], q[first + 2]]);
        }
        let jacobian = toe.jacobian.fixed_columns::<3>(first).into_owned();
        let damped = jacobian.transpose() * jacobian + nalgebra::Matrix3::identity() * (1e-4 * error.norm_squared());
        let mut step = damped.try_inverse()? * jacobian.transpose() * error;
        let longest = step.amax();
        if longest > LONGEST_STEP_RAD {
            step *= LONGEST_STEP_RAD / longest;
        }
        for k in 0..3 {
            q[first + k] += step[k];
        }
    }
    None
}

impl FullOrderProgram {
    /// Fills in the second step, where there is one, as the first one's mirror image.
    pub(super) fn mirror_second_step(&self, x: &mut [f64]) {
        let layout = self.layout;
        if layout.steps == 1 {
            return;
        }
        for k in 0..COEFFICIENTS {
            for i in 6..DOF {
                let (from, sign) = self.robot.mirror.coordinate_source(i);
                x[layout.alpha(1, k, i - 6)] = sign * x[layout.alpha(0, k, from - 6)];
            }
        }
        let length_m = self.speed_m_s * x[layout.t()];
        for p in 0..layout.points {
            let first: [f64; at::POINT] =
                x[layout.point(p)..layout.point(p + 1)].try_into().expect("a point's unknowns");
            let second = &mut x[layout.point(layout.points + p)..layout.point(layout.points + p + 1)];
            for i in 0..DOF {
                let (from, sign) = self.robot.mirror.coordinate_source(i);
                for block in [at::Q, at::V, at::A] {
                    second[block + i] = sign * first[block + from];
                }
                if i >= 6 {
                    second[at::U + i - 6] = sign * first[at::U + from - 6];
                }
            }
            second[at::Q] += length_m;
            for toe in [0, 3] {
                for (axis, sign) in mirrored_vector([1.0; 3]).into_iter().enumerate() {
                    second[at::LAMBDA + toe + axis] = sign * first[at::LAMBDA + toe + axis];
                }
            }
        }
    }
}
