//! Gaits of any contact schedule (docs/mathematics.md, 7): domains with their own stance legs, duration and
//! polynomials. The reference is planned inside the program: the tracking law then gives every torque, and with them
//! the forces inside three and four stance legs, which nothing else would determine.

use super::footfalls::Footfalls;
use super::schedule::{Grid, Schedule};
use super::{FullOrderProgram, start};
use crate::contact_schedule::ContactSchedule;
use crate::limits::{Limits, ProgramSettings};
use crate::recompose::{self, PlanPoint};
use crate::request::{GaitRequest, RequestError, check_points};
use crate::verification::{DomainPlan, between_points_of_domain};
use crate::{
    PlanError, PlanOptions, Reference, SubproblemSolver, hip_x_m, leg_length_m, not_converged, on_slope, summary,
};
use gait::{Coefficients, Domain, Gait, JOINTS, LEGS};
use nlp::{Iteration, Ordered, Solution, SqpSolver, Workspace};
use robot::{Mirror, Robot};
use std::ops::ControlFlow;

/// Room for two domains of the law: 181 inputs, of which up to 137 are free, each with a place for the constant.
const INPUTS: usize = 184;
const FREE: usize = 144;

/// What can be chosen about planning a schedule.
#[derive(Clone, Debug, PartialEq)]
pub struct ScheduleOptions {
    /// The program's settings; points are those of a domain in which legs swing.
    pub program: ProgramSettings,
    /// The solver's settings.
    pub solver: nlp::Settings,
    /// How the subproblems are solved: by elimination along the schedule, or by Clarabel.
    pub subproblem: SubproblemSolver,
    /// Whether all toes land a whole number of strides apart: in the middles of stairs of the request's slope, of which
    /// each leg climbs one a stride.
    pub treads: bool,
}

impl Default for ScheduleOptions {
    fn default() -> Self {
        let options = PlanOptions::default();
        Self {
            program: ProgramSettings { height_tolerance_m: 0.03, toe_distance_tolerance_m: 0.03, ..options.program },
            solver: options.solver,
            subproblem: SubproblemSolver::default(),
            treads: false,
        }
    }
}

/// A gait of a contact schedule.
#[derive(Clone, Debug)]
pub struct SchedulePlan {
    /// The gait, whose cycle is a stride; its request names the schedule too. `solve_time_s` is 0: this crate reads no
    /// clock, the caller does.
    pub gait: Gait,
    /// The robot at the program's points of each domain that was planned: of the first half of a stride whose second
    /// half is its mirror image, or of all.
    pub points: Vec<Vec<PlanPoint>>,
    /// The solver's log.
    pub log: Vec<Iteration>,
}

/// Plans a gait of a contact schedule. The same request, schedule and options give the same gait.
///
/// # Errors
///
/// If the request or the schedule is invalid, a leg cannot reach its toe's place, the solver does not converge, or the
/// gait breaks something between the program's points: of domains of the kind that does, also with every interval
/// halved.
pub fn plan_schedule(
    robot: &Robot,
    request: &GaitRequest,
    contacts: &ContactSchedule,
    options: &ScheduleOptions,
    mut progress: impl FnMut(&Iteration) -> ControlFlow<()>,
) -> Result<SchedulePlan, PlanError> {
    request.validate(leg_length_m(robot))?;
    contacts.validate(request.step_duration_s)?;
    check_points(options.program.points)?;
    check_upright(request)?;
    if options.treads {
        check_straight(request)?;
    }
    let coarse = Grid::coarse(options.program.points);
    let mut grid = coarse;
    loop {
        let (mut program, start) = program_and_start(robot, request, contacts, options, grid)?;
        let solution = solve(&mut program, &start, options, &mut progress)?;
        if !solution.status.is_solution() {
            return Err(not_converged(solution));
        }
        let mut plan = plan_of(&program, &solution, robot, request, contacts)?;
        match first_broken_between(&program, request, &plan) {
            None => {
                if options.treads {
                    plan.gait.request["treads"] = true.into();
                }
                return Ok(plan);
            }
            Some((domain, error)) => {
                grid = grid.finer(&program.schedule.domains[domain], coarse).ok_or(error)?;
            }
        }
    }
}

/// Leaning torsos and slopes have start and bounds of their own in the trot's program, which these gaits have not.
fn check_upright(request: &GaitRequest) -> Result<(), RequestError> {
    for (field, value) in [
        ("torso_pitch_rad", request.torso_pitch_rad),
        ("torso_roll_rad", request.torso_roll_rad),
        ("sideways_slope_rad", request.sideways_slope_rad),
    ] {
        if value != 0.0 {
            let unit = "rad with a contact schedule of its own";
            return Err(RequestError::OutOfRange { field, value, lower: 0.0, upper: 0.0, unit });
        }
    }
    Ok(())
}

/// Stairs are climbed straight ahead.
fn check_straight(request: &GaitRequest) -> Result<(), RequestError> {
    for (field, value, unit) in [
        ("lateral_speed_m_s", request.lateral_speed_m_s, "m/s on treads"),
        ("yaw_rate_rad_s", request.yaw_rate_rad_s, "rad/s on treads"),
    ] {
        if value != 0.0 {
            return Err(RequestError::OutOfRange { field, value, lower: 0.0, upper: 0.0, unit });
        }
    }
    Ok(())
}

fn program_and_start(
    robot: &Robot,
    request: &GaitRequest,
    contacts: &ContactSchedule,
    options: &ScheduleOptions,
    grid: Grid,
) -> Result<(FullOrderProgram, Vec<f64>), PlanError> {
    let (robot, settings) = (&on_slope(robot, request), &options.program);
    let hips = hip_x_m(robot);
    let mut schedule = Schedule::of_contacts(&robot.mirror, request, contacts, grid, options.treads);
    let footfalls = Footfalls::new(&schedule, &robot.mirror, request, hips);
    for domain in 0..schedule.domains.len() {
        schedule.domains[domain].footholds = footfalls.footholds(&schedule, &robot.mirror, domain);
    }
    // What is asked of the stance toes is where they land, and not how far apart they are.
    let limits = Limits::of(robot, request, settings, 0.0);
    let mut program = FullOrderProgram::over(schedule, robot, request, settings, &limits, Reference::InProgram);
    let mut x = start::of_four_legs(&program, hips, robot, request)?;
    program.stay_near(&x);
    start::put_reference(&program, robot, &mut x);
    Ok((program, x))
}

fn solve(
    program: &mut FullOrderProgram,
    start: &[f64],
    options: &ScheduleOptions,
    progress: impl FnMut(&Iteration) -> ControlFlow<()>,
) -> Result<Solution, PlanError> {
    let (solver, scale) = (SqpSolver::new(options.solver.clone())?, options.solver.objective_scale);
    let mut workspace = Workspace::default();
    let order = program.order().filter(|_| options.subproblem != SubproblemSolver::Sparse);
    // Of more than two domains Clarabel's sparse factors are smaller than what is left by elimination.
    match order.and_then(|order| Ordered::<INPUTS, FREE>::new(program, &order, scale)) {
        Some(mut elimination) => Ok(solver.solve_with(program, &mut elimination, start, &mut workspace, progress)?),
        None => Ok(solver.solve(program, start, progress)?),
    }
}

fn plan_of(
    program: &FullOrderProgram,
    solution: &Solution,
    robot: &Robot,
    request: &GaitRequest,
    contacts: &ContactSchedule,
) -> Result<SchedulePlan, PlanError> {
    let (schedule, x, mirror) = (&program.schedule, &solution.x, &program.robot.mirror);
    let t = x[schedule.t()];
    let points: Vec<_> = (0..schedule.domains.len()).map(|domain| program.plan_points(x, domain)).collect();
    let domain = |(domain, d): (usize, &super::schedule::Domain)| Domain {
        stands: std::array::from_fn(|leg| d.stance.contains(&leg)),
        duration_s: t * d.share,
        planned_rad: recompose::fitted_joints(&points[domain]),
        reference_rad: std::array::from_fn(|j| std::array::from_fn(|k| x[schedule.alpha(domain, k, j)])),
    };
    let mut cycle: Vec<Domain> = schedule.domains.iter().enumerate().map(domain).collect();
    if schedule.closure == super::schedule::Closure::Mirrored {
        let images: Vec<Domain> = cycle.iter().map(|domain| mirrored(mirror, domain)).collect();
        cycle.extend(images);
    }
    let gait = recompose::gait_of_cycle(robot, t, request, contacts, &points[0][0], summary(solution), cycle)?;
    Ok(SchedulePlan { gait, points, log: solution.log.clone() })
}

/// A domain's mirror image.
fn mirrored(mirror: &Mirror, domain: &Domain) -> Domain {
    let image = |rows: &[Coefficients; JOINTS]| -> [Coefficients; JOINTS] {
        std::array::from_fn(|row| {
            let (from, sign) = mirror.source(row);
            rows[from].map(|c| sign * c)
        })
    };
    let mut stands = [false; LEGS];
    (0..LEGS).for_each(|leg| stands[mirror.leg[leg]] = domain.stands[leg]);
    let (planned_rad, reference_rad) = (image(&domain.planned_rad), image(&domain.reference_rad));
    Domain { stands, planned_rad, reference_rad, ..*domain }
}

/// The first domain in which a plan breaks something between the program's points, and what.
fn first_broken_between(
    program: &FullOrderProgram,
    request: &GaitRequest,
    plan: &SchedulePlan,
) -> Option<(usize, PlanError)> {
    let schedule = &program.schedule;
    plan.points.iter().enumerate().find_map(|(index, points)| {
        let (domain, first) = (&plan.gait.cycle[index], schedule.places_of(index)[0]);
        let planned = DomainPlan { domain, before: first.time, share: first.share, points, joints_prescribed: false };
        let kept = between_points_of_domain(&program.robot, request, planned).check(points.len());
        kept.err().map(|error| (index, error))
    })
}

#[cfg(test)]
mod tests;
