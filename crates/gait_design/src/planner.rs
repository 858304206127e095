//! Planning many gaits for one robot, with the memory and the program's structure kept from one to the next.

use crate::condensed::Condensed;
use crate::program::DecomposedProgram;
use crate::request::GaitRequest;
use crate::{
    Plan, PlanError, PlanOptions, ProgramSettings, Reference, SubproblemSolver, WarmStart, between_points, guess,
    leg_length_m, not_converged, on_slope, plan_full_order, program, program_of, recompose, summary,
};
use nlp::{Iteration, Solution, SqpSolver, Status};
use robot::Robot;
use std::ops::ControlFlow;

/// Plans gaits for one robot. What a request gives does not depend on the requests before it.
pub struct Planner {
    robot: Robot,
    leg_length_m: f64,
    prepared: Option<Prepared>,
    condensed: Condensed,
}

/// The program of the last request and what it was built for; another request on the same slope only changes its bounds.
struct Prepared {
    slope_rad: f64,
    settings: ProgramSettings,
    /// As on the slope.
    robot: Robot,
    program: DecomposedProgram,
}

impl Planner {
    /// A planner for a robot.
    pub fn new(robot: &Robot) -> Self {
        Self {
            robot: robot.clone(),
            leg_length_m: leg_length_m(robot),
            prepared: None,
            condensed: Condensed::default(),
        }
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
        if !request.is_decomposable() || options.reference == Reference::InProgram {
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
        progress: impl FnMut(&Iteration) -> ControlFlow<()>,
    ) -> Result<Solution, PlanError> {
        request.validate(self.leg_length_m)?;
        let Prepared { robot, program, .. } = self.prepare(request, &options.program)?;
        let start = match &options.warm_start {
            Some(WarmStart(x)) => x.clone(),
            None => guess::nominal(robot, program, request)?,
        };
        let solver = SqpSolver::new(options.solver.clone())?;
        let Prepared { program, .. } = self.prepared.as_mut().expect("just prepared");
        let solution = match options.subproblem {
            SubproblemSolver::Condensed => {
                self.condensed.forget();
                solver.solve_with(program, &mut self.condensed, &start, progress)?
            }
            SubproblemSolver::Sparse => solver.solve(program, &start, progress)?,
        };
        if solution.status == Status::Converged { Ok(solution) } else { Err(not_converged(solution)) }
    }

    fn prepare(&mut self, request: &GaitRequest, settings: &ProgramSettings) -> Result<&mut Prepared, PlanError> {
        match &mut self.prepared {
            Some(p) if p.slope_rad == request.slope_rad && p.settings == *settings => {
                p.program.ask(&p.robot, request);
            }
            prepared => {
                let robot = on_slope(&self.robot, request);
                let program = program_of(&robot, request, settings.clone())?;
                *prepared = Some(Prepared { slope_rad: request.slope_rad, settings: settings.clone(), robot, program });
            }
        }
        Ok(self.prepared.as_mut().expect("there is one now"))
    }
}
