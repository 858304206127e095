//! A plan by the full-order program.

use super::planning::{FullOrderPlanner, Program};
use super::schedule::Steps;
use super::{FullOrderProgram, start};
use crate::certificate::certificate;
use crate::decomposed::DecomposedPlanner;
use crate::planar::PlanarMotion;
use crate::request::{GaitRequest, RequestError, check_points};
use crate::{
    Plan, PlanError, PlanOptions, PlanPoint, Reference, Solved, WarmStart, between_points, leg_length_m, on_slope,
    program_with_offset, recompose, summary,
};
use gait::{Coefficients, Gait, JOINTS, SecondStep, SolverSummary};
use nlp::{Iteration, Solution};
use robot::Robot;
use std::ops::ControlFlow;

/// Plans by the full-order program from the decomposed program's guess; its subproblems are solved by elimination
/// ([`nlp::NullSpace`]), or by Clarabel if `options.subproblem` is [`crate::SubproblemSolver::Sparse`]. On a sideways
/// slope, and in a gait that turns or steps aside, both steps of the stride are planned; there, and with the reference
/// in the program, the start is the decomposed program's solution for the same request straight ahead without that
/// slope, if it has one, bent by what the legs' kinematics say of the turn.
/// What is planned with such a start is checked between the points as well; the others, there to be compared, are not.
///
/// # Errors
///
/// As [`crate::plan`].
pub fn plan_full_order(
    robot: &Robot,
    request: &GaitRequest,
    options: &PlanOptions,
    progress: impl FnMut(&Iteration) -> ControlFlow<()>,
) -> Result<Plan, PlanError> {
    FullOrderPlanner::new(false).plan(&mut DecomposedPlanner::new(robot, false), request, options, progress)
}

/// Where the solve of a stride starts, step by step: points whose joints its cost stays near (docs/mathematics.md, 7).
/// For other programs that are to find the same optimum.
///
/// # Errors
///
/// If the request is invalid, its second step is the first one's mirror image, or a leg cannot reach its toe's place.
pub fn stride_start(
    robot: &Robot,
    request: &GaitRequest,
    options: &PlanOptions,
) -> Result<[Vec<PlanPoint>; 2], PlanError> {
    request.validate(leg_length_m(robot))?;
    check_points(options.program.points)?;
    if request.is_mirrored() {
        return Err(RequestError::OneStep.into());
    }
    let mut decomposed = DecomposedPlanner::new(robot, false);
    let (program, start, _) = program_and_start(&mut decomposed, request, Steps::Both, options)?;
    Ok([0, 1].map(|step| program.plan_points(&start, step)))
}

/// The program, where its solve starts, and whether it is there to be compared with the decomposed one.
pub(super) fn program_and_start(
    planner: &mut DecomposedPlanner,
    request: &GaitRequest,
    steps: Steps,
    options: &PlanOptions,
) -> Result<(FullOrderProgram, Vec<f64>, bool), PlanError> {
    let moved = GaitRequest { sideways_slope_rad: 0.0, torso_pitch_rad: 0.0, torso_roll_rad: 0.0, ..request.clone() };
    let level = GaitRequest { lateral_speed_m_s: 0.0, yaw_rate_rad_s: 0.0, ..moved.clone() };
    let robot = &planner.robot().clone();
    let level_robot = &on_slope(robot, &level);
    let offset = planner.rear_offset_rad();
    // Of a decomposed program that cannot be, bounds and hips are used alone.
    let mut decomposed = program_with_offset(level_robot, &level, options.program.clone(), offset.unwrap_or_default())?;
    // Where the program differs from the decomposed one by its rear legs only, the two start alike, to be compared.
    let alike = offset.is_some()
        && request.is_decomposable()
        && steps == Steps::Mirrored
        && options.reference != Reference::InProgram;
    let (settings, limits) = (&options.program, &decomposed.limits);
    let mut program =
        FullOrderProgram::new(&on_slope(robot, request), request, steps, settings, limits, options.reference);
    let mut start = match (offset, alike) {
        (None, _) => start::of_four_legs(&program, decomposed.bipeds.hips_x_m(), level_robot, &moved)?,
        (_, true) => start::of_the_guess(&program, &mut decomposed, level_robot, &level)?,
        _ => start::of_the_plan(&program, &mut decomposed, planner, &level, options)?,
    };
    if offset.is_some() && !PlanarMotion::of(request).is_straight() {
        start = start::bent(&program, &decomposed, level_robot, start, [&level, &moved])?;
    }
    let robot = &on_slope(robot, request);
    if !alike {
        program.stay_near(&start);
    }
    if !program.joints_prescribed {
        start::put_reference(&program, robot, &mut start);
    }
    Ok((program, start, alike))
}

/// A gait without certificate, and the robot at the points of its first step and of its second, where that is planned.
pub(super) type GaitAndPoints = (Gait, [Vec<PlanPoint>; 2]);

/// The gait of a program's unknowns. `robot` is on the slope.
pub(super) fn gait_of(
    robot: &Robot,
    request: &GaitRequest,
    options: &PlanOptions,
    program: &FullOrderProgram,
    x: &[f64],
    summary: SolverSummary,
) -> Result<GaitAndPoints, PlanError> {
    let schedule = &program.schedule;
    let t = x[schedule.t()];
    // What is planned of a step: its points, the joints' polynomials and the reference's.
    let step = |step: usize| {
        let points = program.plan_points(x, step);
        let polynomials: [Coefficients; JOINTS] =
            std::array::from_fn(|j| std::array::from_fn(|k| x[schedule.alpha(step, k, j)]));
        let (joints, reference) = if program.joints_prescribed {
            let reference = match options.reference {
                Reference::PlannedJoints => polynomials,
                Reference::Compensated | Reference::InProgram => recompose::compensated_reference(robot, &points, t),
            };
            (polynomials, reference)
        } else {
            (recompose::fitted_joints(&points), polynomials)
        };
        (points, joints, reference)
    };
    let (points, joints, reference) = step(0);
    let (second_points, second_step) = if schedule.domains.len() == 2 {
        let (points, coefficients_rad, reference_coefficients_rad) = step(1);
        (points, Some(SecondStep { coefficients_rad, reference_coefficients_rad }))
    } else {
        (Vec::new(), None)
    };
    let mut gait = recompose::gait(robot, joints, t, request, &points, summary, second_step)?;
    gait.reference_coefficients_rad = reference;
    Ok((gait, [points, second_points]))
}

/// What a solution comes to, and whether it keeps its limits between the points, where that is looked at. `robot` is on
/// the slope.
pub(super) fn plan_of(
    robot: &Robot,
    request: &GaitRequest,
    options: &PlanOptions,
    program: &FullOrderProgram,
    solution: &Solution,
    alike: bool,
) -> Result<(Plan, Result<(), PlanError>), PlanError> {
    let schedule = &program.schedule;
    let (mut gait, [points, second_points]) =
        gait_of(robot, request, options, program, &solution.x, summary(solution))?;
    gait.certificate = certificate(robot, &gait, options.reference, [&points, &second_points])?;
    let of = Program::of(schedule, options.reference);
    if alike {
        return Ok((plan_with(gait, [points, second_points], of, solution), Ok(())));
    }
    let mut kept = check_steps(robot, request, &gait, [&points, &second_points]);
    if kept.is_err() && program.joints_prescribed {
        let t = gait.step_duration_s;
        recompose::fit_stance_rolls(&mut gait.coefficients_rad, &schedule.domains[0].redundant_joints, &points, t);
        if let Some(second) = &mut gait.second_step {
            recompose::fit_stance_rolls(
                &mut second.coefficients_rad,
                &schedule.domains[1].redundant_joints,
                &second_points,
                t,
            );
        }
        if options.reference == Reference::PlannedJoints {
            gait.reference_coefficients_rad = gait.coefficients_rad;
            if let Some(second) = &mut gait.second_step {
                second.reference_coefficients_rad = second.coefficients_rad;
            }
        }
        kept = check_steps(robot, request, &gait, [&points, &second_points]);
    }
    Ok((plan_with(gait, [points, second_points], of, solution), kept))
}

fn plan_with(
    gait: Gait,
    [points, second_points]: [Vec<PlanPoint>; 2],
    of: Program,
    Solution { x, log, .. }: &Solution,
) -> Plan {
    let warm_start = WarmStart(Solved::FullOrder(of, x.clone()));
    Plan { gait, points, second_points, warm_start, log: log.clone() }
}

/// Between the points of a plan that is to be walked: what holds for every plan of the decomposed program has to hold
/// there.
fn check_steps(
    robot: &Robot,
    request: &GaitRequest,
    gait: &Gait,
    steps: [&Vec<PlanPoint>; 2],
) -> Result<(), PlanError> {
    let mut planned = steps.into_iter().filter(|points| !points.is_empty());
    planned.try_for_each(|points| between_points(robot, request, gait, points).check(points.len()))
}
