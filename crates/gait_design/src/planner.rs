//! Planning many gaits for one robot, with the memory and the program's structure kept from one to the next.

use crate::condensed::Condensed;
use crate::memory::Memory;
use crate::program::DecomposedProgram;
use crate::request::GaitRequest;
use crate::{
    Plan, PlanError, PlanOptions, ProgramSettings, Reference, SubproblemSolver, WarmStart, between_points, guess,
    leg_length_m, not_converged, on_slope, plan_full_order, program, program_of, recompose, summary,
};
use nlp::{Iteration, NullSpace, Solution, SqpSolver, Status};
use robot::Robot;
use std::ops::ControlFlow;

/// Plans gaits for one robot, with ([`Planner::with_memory`]) or without memory of the gaits before ([`Planner::new`]).
pub struct Planner {
    robot: Robot,
    leg_length_m: f64,
    prepared: Option<Prepared>,
    condensed: Condensed,
    workspace: nlp::Workspace,
    remembers: bool,
    /// Whether the rear legs can do as the front ones across do: the decomposed program has them so.
    rear_follows: bool,
}

/// Room for what the equalities leave free at 11 points, 14 and an internal force a point, up to 17 points; beyond, Clarabel solves.
const SHARED: usize = 32;

/// The program of the last request and what it was built for; another request on the same slope only changes its bounds.
struct Prepared {
    slope_rad: f64,
    settings: ProgramSettings,
    /// As on the slope.
    robot: Robot,
    program: DecomposedProgram,
    /// Gaits of this program, where the planner remembers.
    memory: Memory,
}

impl Planner {
    /// A planner for a robot that forgets: what a request gives does not depend on the requests before it.
    pub fn new(robot: &Robot) -> Self {
        Self {
            robot: robot.clone(),
            leg_length_m: leg_length_m(robot),
            prepared: None,
            condensed: Condensed::default(),
            workspace: nlp::Workspace::default(),
            remembers: false,
            rear_follows: robot.rear_offset_rad().is_ok(),
        }
    }

    /// A planner that starts a request from the gaits before it, which takes half the iterations. Its gaits are those of
    /// [`Planner::new`] to within the solver's tolerances, but not to the bit: they depend on what was planned before.
    pub fn with_memory(robot: &Robot) -> Self {
        Self { remembers: true, ..Self::new(robot) }
    }

    /// [`crate::plan`].
    ///
    /// # Errors
    ///
    /// If the request cannot be meant or has no gait.
    pub fn plan(
        &mut self,
        request: &GaitRequest,
        options: &PlanOptions,
        progress: impl FnMut(&Iteration) -> ControlFlow<()>,
    ) -> Result<Plan, PlanError> {
        if !self.rear_follows || !request.is_decomposable() || options.reference == Reference::InProgram {
            return plan_full_order(&self.robot, request, options, progress);
        }
        let solution = self.solve(request, options, progress)?;
        let Prepared { robot, program, .. } = self.prepared.as_ref().expect("solving prepares");
        let points = recompose::points(robot, program, &solution.x, recompose::BALANCE_TOLERANCE)?;
        let summary = summary(&solution);
        let (x, coefficients) = (&solution.x, recompose::coefficients(program, &solution.x));
        let mut gait = recompose::gait(robot, coefficients, x[program::layout::T], request, &points, summary, None)?;
        between_points(robot, request, &gait, &points).check(points.len())?;
        if options.reference == Reference::PlannedJoints {
            gait.reference_coefficients_rad = gait.coefficients_rad;
        }
        Ok(Plan { gait, points, second_points: Vec::new(), warm_start: WarmStart(solution.x), log: solution.log })
    }

    /// The program's converged solution. The decomposed program knows no sideways slope; [`Self::plan`] and a library's grid keep
    /// such requests from it.
    pub(crate) fn solve(
        &mut self,
        request: &GaitRequest,
        options: &PlanOptions,
        mut progress: impl FnMut(&Iteration) -> ControlFlow<()>,
    ) -> Result<Solution, PlanError> {
        request.validate(self.leg_length_m)?;
        let leg_length_m = self.leg_length_m;
        let remembers = self.remembers;
        let prepared = self.prepare(request, &options.program)?;
        let remembered = if remembers { prepared.memory.start(request, leg_length_m) } else { None };
        let mut solution = None;
        if let (Some(start), None) = (remembered, &options.warm_start) {
            solution = Some(self.solve_from(&start, options, &mut progress)?);
        }
        // What was remembered may be of no use; a request is refused on a start of its own only.
        let solution = match solution {
            Some(solution) if matches!(solution.status, Status::Converged | Status::Cancelled) => solution,
            _ => {
                let Prepared { robot, program, .. } = self.prepared.as_mut().expect("just prepared");
                let start = match &options.warm_start {
                    Some(WarmStart(x)) => x.clone(),
                    None => guess::nominal(robot, program, request)?,
                };
                self.solve_from(&start, options, &mut progress)?
            }
        };
        if solution.status != Status::Converged {
            return Err(not_converged(solution));
        }
        if remembers {
            self.prepared.as_mut().expect("just prepared").memory.keep(request, leg_length_m, &solution.x);
        }
        Ok(solution)
    }

    fn solve_from(
        &mut self,
        start: &[f64],
        options: &PlanOptions,
        progress: impl FnMut(&Iteration) -> ControlFlow<()>,
    ) -> Result<Solution, PlanError> {
        let solver = SqpSolver::new(options.solver.clone())?;
        let Prepared { program, .. } = self.prepared.as_mut().expect("the caller has prepared");
        Ok(match options.subproblem {
            SubproblemSolver::Condensed => {
                self.condensed.forget();
                solver.solve_with(program, &mut self.condensed, start, &mut self.workspace, progress)?
            }
            SubproblemSolver::Eliminated => {
                let mut subproblem = NullSpace::<SHARED>::new(options.solver.objective_scale);
                solver.solve_with(program, &mut subproblem, start, &mut self.workspace, progress)?
            }
            SubproblemSolver::Sparse => solver.solve(program, start, progress)?,
        })
    }

    fn prepare(&mut self, request: &GaitRequest, settings: &ProgramSettings) -> Result<&mut Prepared, PlanError> {
        match &mut self.prepared {
            Some(p) if p.slope_rad == request.slope_rad && p.settings == *settings => {
                p.program.ask(&p.robot, request);
            }
            prepared => {
                let robot = on_slope(&self.robot, request);
                let program = program_of(&robot, request, settings.clone())?;
                *prepared = Some(Prepared {
                    slope_rad: request.slope_rad,
                    settings: settings.clone(),
                    robot,
                    program,
                    memory: Memory::default(),
                });
            }
        }
        Ok(self.prepared.as_mut().expect("there is one now"))
    }
}
