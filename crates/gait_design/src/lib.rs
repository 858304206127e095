//! Gait generation by the dynamics decomposition of Ma & Ames 2020: a request becomes a nonlinear program for the front
//! biped, its solution is recomposed to the quadruped's gait, and the reference that the tracking law follows is
//! fitted.
//!
//! ```no_run
//! # fn show(robot: &robot::Robot) -> Result<(), Box<dyn std::error::Error>> {
//! let mut request = gait_design::GaitRequest::named("amble", robot)?;
//! request.speed_m_s = 0.4;
//! let plan = gait_design::plan(robot, &request, &Default::default(), |_| std::ops::ControlFlow::Continue(()))?;
//! println!("{} iterations", plan.gait.solver.iterations);
//! # Ok(()) }
//! ```

mod biped;
mod certificate;
mod condensed;
mod contact_schedule;
mod decomposed;
mod full_order;
mod guess;
pub mod library;
mod limits;
mod memory;
mod nearest;
mod planar;
mod planner;
mod program;
mod recompose;
mod refine;
mod request;
mod stability;
mod stable;
mod terms;
mod tolerance;
mod verification;

pub use biped::BipedPair;
pub use certificate::{MOST_STEP_GROWTH, certificate};
pub use condensed::Condensed;
pub use contact_schedule::ContactSchedule;
pub use full_order::{
    Missed, ScheduleOptions, SchedulePlan, State, StateError, Transition, TransitionError, TransitionOptions,
    TransitionRequest, plan_full_order, plan_schedule, plan_transition, stride_start,
};
pub use guess::{Unreachable, nominal};
pub use limits::ProgramSettings;
pub use nearest::{Changed, Nearest, Refusal, nearest, plan_or_nearest};
pub use planner::Planner;
pub use program::DecomposedProgram;
pub use recompose::PlanPoint;
pub use request::{
    GaitRequest, RequestError, TableOne, behaviours, step_duration_from_step_frequency,
    step_duration_from_stride_frequency, table_one,
};

pub use stability::{Complex, Stability, stability};
pub use stable::{Open, choose, plan_stable};
pub use tolerance::Tolerances;
pub use verification::{BetweenPoints, SimulatedPoint, StepComparison, StepLaw, between_points, simulate_planned_step};

use decomposition::Pairing;
use gait::{Gait, GaitError, SolverSummary};
use nlp::{Iteration, Settings, Solution, Status};
use robot::Robot;
use std::ops::ControlFlow;

/// What can be chosen about planning beside the request itself.
#[derive(Clone, Debug, PartialEq)]
pub struct PlanOptions {
    /// The program's settings.
    pub program: ProgramSettings,
    /// The solver's settings.
    pub solver: Settings,
    /// How the convex subproblems are solved.
    pub subproblem: SubproblemSolver,
    /// Start from another gait's solution instead of a guess. A grid of intervals twice or half as long is fitted.
    pub warm_start: Option<WarmStart>,
    /// What the tracking law is to follow.
    pub reference: Reference,
}

/// What a gait gives the tracking law to follow.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Reference {
    /// The reference that makes the bare law give the planned torques (docs/mathematics.md, 6).
    #[default]
    Compensated,
    /// The planned joints themselves. The robot sags by torque over stiffness: for comparison.
    PlannedJoints,
    /// The reference planned inside the full-order program, as the polynomials whose tracking gives the torques: the
    /// joints are where the law leads them (docs/mathematics.md, 6).
    InProgram,
}

/// A plan's solution, to start a like request from. Where a request is planned by another program, it is not used.
#[derive(Clone, Debug, PartialEq)]
pub struct WarmStart(Solved);

/// Solved unknowns, and which program's they are.
#[derive(Clone, Debug, PartialEq)]
enum Solved {
    Decomposed(Vec<f64>),
    FullOrder(full_order::Program, Vec<f64>),
}

/// How the program's convex subproblems are solved. All give the same steps.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum SubproblemSolver {
    /// By elimination of the program's structure ([`Condensed`]).
    #[default]
    Condensed,
    /// By elimination of the equalities, without knowing what they mean ([`nlp::NullSpace`]).
    Eliminated,
    /// By Clarabel, as one sparse program: the reference.
    Sparse,
}

impl Reference {
    /// The law under which a step of such a plan is simulated to verify it.
    pub fn step_law(self) -> StepLaw {
        match self {
            Self::Compensated | Self::PlannedJoints => StepLaw::Linearising,
            Self::InProgram => StepLaw::Tracking,
        }
    }
}

impl Default for PlanOptions {
    fn default() -> Self {
        let solver = Settings {
            objective_tolerance: 1e-8,
            constraint_tolerance: 1e-5,
            acceptable_tolerance: 1e-6,
            acceptable_iterations: 20,
            max_iterations: 100,
            // Costs are about 0.05; Clarabel's tolerances are absolute.
            objective_scale: 1e3,
        };
        Self {
            program: ProgramSettings::default(),
            solver,
            subproblem: SubproblemSolver::default(),
            warm_start: None,
            reference: Reference::default(),
        }
    }
}

/// A planned gait and how it came about.
#[derive(Clone, Debug)]
pub struct Plan {
    /// The gait. Its `solver.solve_time_s` is 0: this crate reads no clock, the caller does.
    pub gait: Gait,
    /// The full robot at every point of the program, in the first step.
    pub points: Vec<PlanPoint>,
    /// In the second step, where it is no mirror image of the first; else empty.
    pub second_points: Vec<PlanPoint>,
    /// The solution, to start a like request from.
    pub warm_start: WarmStart,
    /// The solver's log.
    pub log: Vec<Iteration>,
}

/// Why there is no gait.
#[derive(Debug, thiserror::Error)]
pub enum PlanError {
    /// The request is invalid.
    #[error(transparent)]
    Request(#[from] RequestError),
    /// No posture of the legs fits the request.
    #[error(transparent)]
    Unreachable(#[from] Unreachable),
    /// The robot cannot be split into two bipeds.
    #[error("the robot cannot be split into two bipeds: {0}")]
    Robot(#[from] robot::RobotError),
    /// The program contradicts itself before the first iteration.
    #[error(transparent)]
    Problem(#[from] nlp::ProblemError),
    /// A solver setting is out of range.
    #[error(transparent)]
    Settings(#[from] nlp::SettingsError),
    /// The solver did not converge: no gait.
    #[error("no gait: {status} after {iterations} iterations; {worst}")]
    NotConverged {
        /// How the solver ended.
        status: Status,
        /// Iterations taken.
        iterations: u32,
        /// What stood in the way.
        worst: String,
        /// Every iteration.
        log: Vec<Iteration>,
    },
    /// The solution fails the check by the full-order model.
    #[error("no gait: the solution fails the check by the full-order model: {0}")]
    Unverified(String),
    /// The step's map cannot be had.
    #[error("no gait: how it stands by itself cannot be computed: {0}")]
    Certificate(#[from] decomposition::DynamicsError),
    /// The recomposed gait is not one that can be walked.
    #[error(transparent)]
    Gait(#[from] GaitError),
}

/// Plans one gait. `progress` sees every iteration of the solver and may stop it. The same request and options give the
/// same gait. For one gait after the other, [`Planner`] saves the setting up.
///
/// On a slope the world's x–y plane is the slope's surface and gravity is turned: the gait's initial state and the
/// robot's height are relative to the surface.
pub fn plan(
    robot: &Robot,
    request: &GaitRequest,
    options: &PlanOptions,
    progress: impl FnMut(&Iteration) -> ControlFlow<()>,
) -> Result<Plan, PlanError> {
    Planner::new(robot).plan(request, options, progress)
}

fn program_of(robot: &Robot, request: &GaitRequest, settings: ProgramSettings) -> Result<DecomposedProgram, PlanError> {
    program_with_offset(robot, request, settings, robot.rear_offset_rad()?)
}

fn program_with_offset(
    robot: &Robot,
    request: &GaitRequest,
    settings: ProgramSettings,
    rear_offset_rad: [f64; 6],
) -> Result<DecomposedProgram, PlanError> {
    let pairing = Pairing::diagonal(robot.mirror.sign).with_offset_rad(rear_offset_rad);
    let bipeds = BipedPair::new(robot, pairing)?;
    Ok(DecomposedProgram::new(robot, bipeds, request, settings))
}

/// The robot with gravity as it is on the slope of a request: the world's x–y plane is the ground.
pub fn on_slope(robot: &Robot, request: &GaitRequest) -> Robot {
    let mut robot = robot.clone();
    let gravity = robot.model.gravity.norm();
    let ((up, level), (side, across)) = (request.slope_rad.sin_cos(), request.sideways_slope_rad.sin_cos());
    robot.model.gravity = nalgebra::Vector3::new(-up * across, 0.0 - side, -level * across) * gravity;
    robot
}

/// What a gait reports of its solve. This crate reads no clock: the caller puts the time in.
fn summary(solution: &Solution) -> SolverSummary {
    SolverSummary {
        status: solution.status.to_string(),
        iterations: solution.iterations(),
        solve_time_s: 0.0,
        max_violation: solution.worst.amount,
        objective: solution.objective,
    }
}

fn not_converged(solution: Solution) -> PlanError {
    let worst = match &solution.status {
        Status::Infeasible { fighting } if !fighting.is_empty() => {
            let named: Vec<String> = fighting.iter().map(|v| format!("{} (by {:.3e})", v.name, v.amount)).collect();
            format!("these cannot hold together with the rest: {}", named.join("; "))
        }
        _ => format!("the most broken constraint is {} (by {:.3e})", solution.worst.name, solution.worst.amount),
    };
    PlanError::NotConverged { iterations: solution.iterations(), status: solution.status, worst, log: solution.log }
}

/// Longest distance of a toe from its hip-roll axis' origin over all legs, m: the sum of the links' lengths.
fn leg_length_m(robot: &Robot) -> f64 {
    let names = robot.joint_names();
    let mut data = rigid_body::Data::new(&robot.model);
    let zero = vec![0.0; robot.model.dof()];
    rigid_body::forward_kinematics(&robot.model, &mut data, &zero, &zero, &zero);
    let origin = |joint: &str| {
        let dof = robot.model.joint_index(joint).expect("the robot's joints are the model's");
        let frame = robot.model.frame_id(robot.model.link_name(dof)).expect("every link is a frame");
        rigid_body::frame_position(&robot.model, &data, frame)
    };
    (0..4)
        .map(|leg| {
            let [roll, pitch, knee] = [0, 1, 2].map(|k| origin(&names[3 * leg + k]));
            let toe = rigid_body::frame_position(&robot.model, &data, robot.legs[leg].toe);
            (pitch - roll).norm() + (knee - pitch).norm() + (toe - knee).norm()
        })
        .fold(0.0, f64::max)
}

/// Between the front and the rear hips, m.
fn hip_distance_m(robot: &Robot) -> f64 {
    let [front, rear, ..] = hip_x_m(robot);
    (front - rear).abs()
}

/// x of every leg's hip from the base's origin, m.
fn hip_x_m(robot: &Robot) -> [f64; 4] {
    let mut data = rigid_body::Data::new(&robot.model);
    let zero = vec![0.0; robot.model.dof()];
    rigid_body::forward_kinematics(&robot.model, &mut data, &zero, &zero, &zero);
    let names = robot.joint_names();
    std::array::from_fn(|leg| {
        let dof = robot.model.joint_index(&names[3 * leg]).expect("the robot's joints are the model's");
        let frame = robot.model.frame_id(robot.model.link_name(dof)).expect("every link is a frame");
        rigid_body::frame_position(&robot.model, &data, frame).x
    })
}

#[cfg(test)]
mod tests;
#[cfg(test)]
mod tests_derivatives;
#[cfg(test)]
mod tests_edges;
#[cfg(test)]
mod tests_library;
#[cfg(test)]
mod tests_ranges;
#[cfg(test)]
mod tests_rear;
#[cfg(test)]
mod tests_replanning;
#[cfg(test)]
mod tests_stability;
#[cfg(test)]
mod tests_strides;
