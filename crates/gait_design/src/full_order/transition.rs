//! Steps from a given state to a gait, or to rest (docs/mathematics.md, 7): two steps of the trot, the full-order
//! program between two states. Over one step it cannot be done: the velocity across the line between the stance toes is
//! not free within a step.

mod start;

use super::FullOrderProgram;
use super::goal;
use super::order::{FREE_BETWEEN, INPUTS_BETWEEN};
use super::schedule::Schedule;
use super::state::{State, StateError};
use crate::limits::{Limits, ProgramSettings};
use crate::recompose::{self, PlanPoint};
use crate::request::{GaitRequest, RequestError, check_points};
use crate::{
    PlanError, PlanOptions, Reference, SubproblemSolver, between_points, leg_length_m, not_converged, on_slope, summary,
};
use gait::{Coefficients, Domain, Gait, GaitError, JOINTS, SecondStep, SolverSummary};
use nlp::{Iteration, NullSpace, Ordered, Settings, Solution, SqpSolver, Workspace};
use robot::Robot;
use std::ops::ControlFlow;

/// What a transition leads from and to.
#[derive(Clone, Debug)]
pub struct TransitionRequest {
    from: State,
    to: State,
    /// The gait whose steps are taken, but for how the first begins and the last ends.
    steps: Gait,
    /// What these are asked to be: half way between what they come from and what they lead to.
    request: GaitRequest,
}

/// What can be chosen about planning a transition.
#[derive(Clone, Debug, PartialEq)]
pub struct TransitionOptions {
    /// The program's settings.
    pub program: ProgramSettings,
    /// The solver's settings; a transition that takes many iterations is none that a robot can wait for.
    pub solver: Settings,
    /// How the convex subproblems are solved; all give the same steps.
    pub subproblem: SubproblemSolver,
    /// How far the steps may be longer or shorter than asked for, as a share of T.
    pub step_duration_tolerance: f64,
}

impl Default for TransitionOptions {
    fn default() -> Self {
        let options = PlanOptions::default();
        Self {
            // With 11 points one in ten departs from its polynomials between them.
            program: ProgramSettings {
                points: 13,
                height_tolerance_m: 0.03,
                toe_distance_tolerance_m: 0.15,
                ..options.program
            },
            // Steps that are walked once.
            solver: Settings { max_iterations: 15, objective_tolerance: 1e-6, ..options.solver },
            subproblem: options.subproblem,
            step_duration_tolerance: 0.2,
        }
    }
}

/// A number of the state that is to be reached, and by how much it is missed.
#[derive(Clone, Debug, PartialEq)]
pub struct Missed {
    /// Which.
    pub what: String,
    /// What it is at the end minus what it is to be.
    pub amount: f64,
    /// How much may be missed.
    pub allowed: f64,
    /// The unit of both.
    pub unit: &'static str,
}

/// Why there is no transition.
#[derive(Debug, thiserror::Error)]
pub enum TransitionError {
    /// No step begins at the given state.
    #[error("no step begins at the given state: {0}")]
    Start(#[from] StateError),
    /// The last step ends too far from what it is to reach.
    #[error("no transition: after two steps it misses {}", list(.0))]
    Missed(Vec<Missed>),
    /// The request is invalid, the solver does not converge, or the steps break something between the points.
    #[error(transparent)]
    Plan(#[from] PlanError),
}

impl Missed {
    /// Over what is allowed.
    fn share(&self) -> f64 {
        self.amount.abs() / self.allowed
    }
}

/// For people: the worst of what is missed by more than is allowed.
fn list(missed: &[Missed]) -> String {
    const NAMED: usize = 4;
    let mut worst: Vec<&Missed> = missed.iter().collect();
    worst.sort_by(|a, b| b.share().total_cmp(&a.share()));
    let one = |m: &&Missed| format!("{} by {:.3} {} (at most {})", m.what, m.amount, m.unit, m.allowed);
    let named: Vec<String> = worst.iter().take(NAMED).map(one).collect();
    let more = missed.len().saturating_sub(NAMED);
    if more == 0 { named.join(", ") } else { format!("{} and {more} more", named.join(", ")) }
}

/// Two planned steps. x and y of their points are 0 where the first begins; yaw is as it was given.
#[derive(Clone, Debug)]
pub struct Transition {
    /// The two steps: legs 1 and 2 stand, then legs 0 and 3.
    pub steps: [Domain; 2],
    /// The full robot at every point of the program, step by step.
    pub points: [Vec<PlanPoint>; 2],
    /// What is missed most of what is to be reached.
    pub missed: Missed,
    /// What the solver reports. `solve_time_s` is 0: this crate reads no clock, the caller does.
    pub solver: SolverSummary,
    /// The solver's log.
    pub log: Vec<Iteration>,
}

impl TransitionRequest {
    /// From standing to where a gait's first step begins.
    ///
    /// # Errors
    ///
    /// As [`Self::from_state`].
    pub fn from_rest(robot: &Robot, to: &Gait) -> Result<Self, PlanError> {
        let request = asked_of(to)?;
        let halved = GaitRequest {
            speed_m_s: 0.5 * request.speed_m_s,
            lateral_speed_m_s: 0.5 * request.lateral_speed_m_s,
            yaw_rate_rad_s: 0.5 * request.yaw_rate_rad_s,
            ..request
        };
        Ok(Self { from: State::standing(robot), to: State::start_of(robot, to), steps: to.clone(), request: halved })
    }

    /// From where a gait's first step begins to standing.
    ///
    /// # Errors
    ///
    /// As [`Self::from_state`].
    pub fn to_rest(robot: &Robot, from: &Gait) -> Result<Self, PlanError> {
        let forth = Self::from_rest(robot, from)?;
        Ok(Self { from: forth.to, to: forth.from, ..forth })
    }

    /// From where the first step of one gait begins to where the first step of another does.
    ///
    /// # Errors
    ///
    /// As [`Self::from_state`].
    pub fn between(robot: &Robot, from: &Gait, to: &Gait) -> Result<Self, PlanError> {
        let (before, after) = (asked_of(from)?, asked_of(to)?);
        let middle = |a: f64, b: f64| 0.5 * (a + b);
        let request = GaitRequest {
            step_duration_s: middle(before.step_duration_s, after.step_duration_s),
            speed_m_s: middle(before.speed_m_s, after.speed_m_s),
            lateral_speed_m_s: middle(before.lateral_speed_m_s, after.lateral_speed_m_s),
            yaw_rate_rad_s: middle(before.yaw_rate_rad_s, after.yaw_rate_rad_s),
            ..after
        };
        let [from, state] = [from, to].map(|gait| State::start_of(robot, gait));
        Ok(Self { from, to: state, steps: to.clone(), request })
    }

    /// From a state of the robot, the rear left and the front right toe on the floor and at rest, to where a gait's
    /// first step begins. The state's yaw is how far it is turned from where the gait is to lead.
    ///
    /// # Errors
    ///
    /// If the gait does not hold the request that it was planned for.
    pub fn from_state(robot: &Robot, from: State, to: &Gait) -> Result<Self, PlanError> {
        Ok(Self { from, to: State::start_of(robot, to), steps: to.clone(), request: asked_of(to)? })
    }
}

/// The request that a gait was planned for; torsos lean where they begin and end to, and not in between.
fn asked_of(gait: &Gait) -> Result<GaitRequest, PlanError> {
    let request: GaitRequest = serde_json::from_value(gait.request.clone()).map_err(|error| GaitError::Value {
        gait: gait.name.clone(),
        field: "request".into(),
        problem: format!("is not one that steps can be planned for: {error}; plan the gait again with `tandem plan`"),
    })?;
    Ok(GaitRequest { torso_pitch_rad: 0.0, torso_roll_rad: 0.0, ..request })
}

/// Plans two steps that lead from one state to another. What is to be reached may be missed at a price; a transition
/// that misses it by more than the robot can make up for is refused. The same request and options give the same steps.
///
/// # Errors
///
/// If no step can begin at the state, the request is invalid, the solver does not converge within its iterations, the
/// end is missed, or the steps break something between the program's points.
pub fn plan_transition(
    robot: &Robot,
    transition: &TransitionRequest,
    options: &TransitionOptions,
    progress: impl FnMut(&Iteration) -> ControlFlow<()>,
) -> Result<Transition, TransitionError> {
    let request = &transition.request;
    request.validate(leg_length_m(robot)).map_err(PlanError::from)?;
    check_points(options.program.points).map_err(PlanError::from)?;
    check_tolerance(options.step_duration_tolerance).map_err(PlanError::from)?;
    let robot = &on_slope(robot, request);
    let mut program = program(robot, transition, options)?;
    let start = start::of_the_steps(&program, robot, transition);
    program.stay_near(&start);
    let solution = solve(&mut program, &start, options, progress)?;
    let missed = missed(&program, &solution.x);
    let beyond: Vec<Missed> = missed.iter().filter(|m| m.share() > 1.0).cloned().collect();
    if !solution.status.is_solution() {
        return Err(unfinished(solution, &beyond).into());
    }
    if !beyond.is_empty() {
        return Err(TransitionError::Missed(beyond));
    }
    let points = [0, 1].map(|step| program.plan_points(&solution.x, step));
    let mut gait = gait_of(robot, &program, &solution, &points, transition);
    check_between(robot, request, &mut gait, &program.schedule, &points)?;
    let worst = missed.into_iter().max_by(|a, b| a.share().total_cmp(&b.share())).expect("an end has rows");
    Ok(Transition { steps: gait.steps(), points, missed: worst, solver: summary(&solution), log: solution.log })
}

fn program(
    robot: &Robot,
    transition: &TransitionRequest,
    options: &TransitionOptions,
) -> Result<FullOrderProgram, StateError> {
    let (request, settings) = (&transition.request, &options.program);
    let [from, to] = transition.ends();
    let schedule = Schedule::between(robot, [from, to], settings.points);
    from.check(robot, request)?;
    // The legs that land first stand last.
    let toes = to.toes_m(robot);
    let [a, b] = [schedule.domains[1].stance[0], schedule.domains[1].stance[1]];
    let mut limits = Limits::of(robot, request, settings, (toes[b] - toes[a]).norm());
    let tolerance = options.step_duration_tolerance;
    limits.step_duration_s = [1.0 - tolerance, 1.0 + tolerance].map(|share| share * request.step_duration_s);
    let height_m = [from.q[2].min(to.q[2]), from.q[2].max(to.q[2])];
    for (side, outward) in [-1.0, 1.0].into_iter().enumerate() {
        limits.base[side][1] = height_m[side] + outward * settings.height_tolerance_m;
    }
    Ok(FullOrderProgram::over(schedule, robot, request, settings, &limits, Reference::Compensated))
}

impl TransitionRequest {
    /// The two states, the second where the steps' planar motion turns it to.
    fn ends(&self) -> [State; 2] {
        let turn_rad = 2.0 * self.request.yaw_rate_rad_s * self.request.step_duration_s;
        [self.from.at_origin(), self.to.at_origin().turned(turn_rad)]
    }
}

fn solve(
    program: &mut FullOrderProgram,
    start: &[f64],
    options: &TransitionOptions,
    progress: impl FnMut(&Iteration) -> ControlFlow<()>,
) -> Result<Solution, PlanError> {
    /// Room for the unknowns that meet once the equalities are eliminated without an order of their own.
    const SHARED: usize = 128;
    let (solver, scale) = (SqpSolver::new(options.solver.clone())?, options.solver.objective_scale);
    let workspace = &mut Workspace::default();
    let along = if options.subproblem == SubproblemSolver::Condensed { elimination(program, scale) } else { None };
    Ok(match along {
        Some(mut along) => solver.solve_with(program, &mut along, start, workspace, progress)?,
        None if options.subproblem == SubproblemSolver::Sparse => solver.solve(program, start, progress)?,
        None => solver.solve_with(program, &mut NullSpace::<SHARED>::new(scale), start, workspace, progress)?,
    })
}

/// Along the steps.
fn elimination(program: &FullOrderProgram, scale: f64) -> Option<Ordered<INPUTS_BETWEEN, FREE_BETWEEN>> {
    Ordered::new(program, &program.order()?, scale)
}

/// That the solver did not converge, with what its last point misses.
fn unfinished(solution: Solution, missed: &[Missed]) -> PlanError {
    let mut error = not_converged(solution);
    if let PlanError::NotConverged { worst, .. } = &mut error
        && !missed.is_empty()
    {
        *worst += &format!("; its end misses {}", list(missed));
    }
    error
}

/// What is missed of each number of the state that is to be reached.
fn missed(program: &FullOrderProgram, x: &[f64]) -> Vec<Missed> {
    let last = program.schedule.domains.last().expect("two steps");
    let ends = [&last.stance[..], &last.swing[..]];
    let parts = goal::parts(ends[0], ends[1]).zip(&x[program.schedule.missed()]).enumerate();
    let missed = parts.map(|(index, (part, &amount))| Missed {
        what: goal::what(ends, index, &program.names),
        amount,
        allowed: part.allowed(),
        unit: part.unit(),
    });
    missed.collect()
}

/// The two steps as a gait's, which carries their polynomials.
fn gait_of(
    robot: &Robot,
    program: &FullOrderProgram,
    solution: &Solution,
    points: &[Vec<PlanPoint>; 2],
    transition: &TransitionRequest,
) -> Gait {
    let (x, schedule) = (&solution.x, &program.schedule);
    let t = x[schedule.t()];
    let polynomials = |step: usize| -> [Coefficients; JOINTS] {
        std::array::from_fn(|j| std::array::from_fn(|k| x[schedule.alpha(step, k, j)]))
    };
    let reference = |step: usize| recompose::compensated_reference(robot, &points[step], t);
    Gait {
        step_duration_s: t,
        coefficients_rad: polynomials(0),
        reference_coefficients_rad: reference(0),
        second_step: Some(SecondStep { coefficients_rad: polynomials(1), reference_coefficients_rad: reference(1) }),
        ..transition.steps.clone()
    }
}

/// Between the points of both steps, what holds for every plan has to hold. A stance hip roll's polynomial is that
/// nearest to its points, where the one of the program is not near enough.
fn check_between(
    robot: &Robot,
    request: &GaitRequest,
    gait: &mut Gait,
    schedule: &Schedule,
    points: &[Vec<PlanPoint>; 2],
) -> Result<(), PlanError> {
    let check = |gait: &Gait| {
        points.iter().try_for_each(|points| between_points(robot, request, gait, points).check(points.len()))
    };
    check(gait).or_else(|_| {
        let t = gait.step_duration_s;
        let rolls = [0, 1].map(|step| &schedule.domains[step].redundant_joints);
        recompose::fit_stance_rolls(&mut gait.coefficients_rad, rolls[0], &points[0], t);
        let second = gait.second_step.as_mut().expect("two steps of their own");
        recompose::fit_stance_rolls(&mut second.coefficients_rad, rolls[1], &points[1], t);
        check(gait)
    })
}

/// Refuses a tolerance that leaves no steps.
fn check_tolerance(value: f64) -> Result<(), RequestError> {
    let (field, lower, upper, unit) = ("step_duration_tolerance", 0.0, 0.5, "");
    if (lower..=upper).contains(&value) {
        return Ok(());
    }
    Err(RequestError::OutOfRange { field, value, lower, upper, unit })
}

#[cfg(test)]
mod tests;
