//! Strides for a library: mirror images of strides, and what lies between strides.

use super::plan::{gait_of, program_and_start};
use super::schedule::{COEFFICIENTS, DOF, Schedule, Steps, at};
use crate::decomposed::DecomposedPlanner;
use crate::planar::PlanarMotion;
use crate::request::{GaitRequest, check_points};
use crate::{PlanError, PlanOptions, leg_length_m, on_slope};
use gait::{Gait, SolverSummary};
use nalgebra::{Matrix2, Vector2};
use nlp::{Problem, Violation};
use robot::{Robot, mirrored_vector};

/// A stride's unknowns in the program with its points.
pub(crate) fn unknowns(robot: &Robot, points: usize) -> usize {
    Schedule::of(robot, Steps::Both, points).unknowns
}

/// The gait of a stride's unknowns that need not be a solution, without certificate, and which constraint of the
/// request's own program they break most. `summary` is told what the program says of them.
///
/// # Errors
///
/// As [`crate::plan`], but for those of the solver.
pub(crate) fn interpolated_stride(
    robot: &Robot,
    request: &GaitRequest,
    options: &PlanOptions,
    x: &[f64],
    summary: SolverSummary,
) -> Result<(Gait, Violation), PlanError> {
    request.validate(leg_length_m(robot))?;
    check_points(options.program.points)?;
    let mut decomposed = DecomposedPlanner::new(robot, false);
    let (mut program, ..) = program_and_start(&mut decomposed, request, Steps::Both, options)?;
    let mut constraints = vec![0.0; program.bounds().constraint_lower.len()];
    let objective = program.values(x, &mut constraints);
    let violation = nlp::most_broken(&program, x, &constraints);
    let summary = SolverSummary { max_violation: violation.amount, objective, ..summary };
    let (gait, _) = gait_of(&on_slope(robot, request), request, options, &program, x, summary)?;
    Ok((gait, violation))
}

/// The mirror image of a request's stride, as the stride of the request's mirror image: the legs that stand first do so
/// in it too, so its first step is the image of the stride's second one, and its second step of the stride's first one,
/// a stride later.
pub(crate) fn mirrored_stride(robot: &Robot, request: &GaitRequest, points: usize, x: &[f64]) -> Vec<f64> {
    let schedule = Schedule::of(robot, Steps::Both, points);
    let (motion, t) = (PlanarMotion::of(request), x[schedule.t()]);
    let mut out = vec![0.0; schedule.unknowns];
    out[schedule.t()] = t;
    // As seen from where the motion leads in a step: the second step from there, the first one a stride later.
    let (turned, moved) = (motion.rotation(t), motion.displacement_m(t));
    let seen = [(turned, moved, motion.yaw_rad(t)), (turned.transpose(), -turned.tr_mul(&moved), -motion.yaw_rad(t))];
    for (from, (turned, moved, yaw_rad)) in seen.into_iter().enumerate() {
        let to = 1 - from;
        for k in 0..COEFFICIENTS {
            for i in 6..DOF {
                let (source, sign) = robot.mirror.coordinate_source(i);
                out[schedule.alpha(to, k, i - 6)] = sign * x[schedule.alpha(from, k, source - 6)];
            }
        }
        for (there, here) in schedule.places_of(from).iter().zip(schedule.places_of(to)) {
            let mut point = x[schedule.columns(there)].to_vec();
            turn(&mut point, &turned);
            point[0] += moved.x;
            point[1] += moved.y;
            point[5] += yaw_rad;
            mirror_point(robot, &point, &mut out[schedule.columns(here)]);
        }
    }
    out
}

/// Turns what a point's unknowns say in the world's axes about the vertical.
fn turn(point: &mut [f64], turned: &Matrix2<f64>) {
    let forces = (at::LAMBDA..point.len()).step_by(3);
    for first in [at::Q, at::V, at::A].into_iter().chain(forces) {
        let vector = turned * Vector2::new(point[first], point[first + 1]);
        point[first..first + 2].copy_from_slice(vector.as_slice());
    }
}

/// The mirror image of a point's unknowns; stance legs are each other's images in their order.
pub(super) fn mirror_point(robot: &Robot, point: &[f64], image: &mut [f64]) {
    for i in 0..DOF {
        let (from, sign) = robot.mirror.coordinate_source(i);
        for block in [at::Q, at::V, at::A] {
            image[block + i] = sign * point[block + from];
        }
        if i >= 6 {
            image[at::U + i - 6] = sign * point[at::U + from - 6];
        }
    }
    for (i, force) in image[at::LAMBDA..].iter_mut().enumerate() {
        *force = mirrored_vector([1.0; 3])[i % 3] * point[at::LAMBDA + i];
    }
}
