//! Plans of the decomposed program, with the memory and the program's structure kept from one to the next.

use crate::certificate::certificate;
use crate::condensed::Condensed;
use crate::memory::Memory;
use crate::program::DecomposedProgram;
use crate::refine::{REFINEMENTS, finer_grid, on_grid};
use crate::request::{GaitRequest, check_points};
use crate::verification::BetweenPoints;
use crate::{
    Plan, PlanError, PlanOptions, ProgramSettings, Reference, Solved, SubproblemSolver, Tolerances, WarmStart,
    between_points, guess, leg_length_m, not_converged, on_slope, program, program_with_offset, recompose, summary,
};
use nlp::{Iteration, NullSpace, Solution, SqpSolver, Status};
use robot::{Robot, RobotError};
use std::ops::ControlFlow;

/// Plans gaits of the decomposed program for one robot, with or without memory of the gaits before.
pub(crate) struct DecomposedPlanner {
    robot: Robot,
    leg_length_m: f64,
    /// Found once: it compares the legs' postures and motions.
    rear_offset_rad: Result<[f64; 6], RobotError>,
    /// The last one used is the last.
    prepared: Vec<Prepared>,
    condensed: Condensed,
    workspace: nlp::Workspace,
    remembers: bool,
}

/// The stance legs' hip rolls, which the toes' fixed distance determines.
const STANCE_ROLLS: [usize; 2] = [3, 6];
/// Programs kept: one for each grid that a request may be refined on.
const MOST_PREPARED: usize = REFINEMENTS as usize + 1;
/// Room for what the equalities leave free at 11 points, 14 and an internal force a point, up to 17 points; beyond,
/// Clarabel solves.
const SHARED: usize = 32;

/// The program of the last request and what it was built for; another request on the same slope only changes its
/// bounds.
struct Prepared {
    slope_rad: f64,
    settings: ProgramSettings,
    /// As on the slope.
    robot: Robot,
    program: DecomposedProgram,
    /// Gaits of this program, where the planner remembers.
    memory: Memory,
}

impl DecomposedPlanner {
    /// `remembers`: a request starts from the gaits before it.
    pub fn new(robot: &Robot, remembers: bool) -> Self {
        Self {
            robot: robot.clone(),
            leg_length_m: leg_length_m(robot),
            rear_offset_rad: robot.rear_offset_rad(),
            prepared: Vec::new(),
            condensed: Condensed::default(),
            workspace: nlp::Workspace::default(),
            remembers,
        }
    }

    /// The robot, on level ground.
    pub fn robot(&self) -> &Robot {
        &self.robot
    }

    /// By how much the rear legs' joints are off those of the front ones across; none where they cannot follow them.
    pub fn rear_offset_rad(&self) -> Option<[f64; 6]> {
        self.rear_offset_rad.as_ref().ok().copied()
    }

    /// Whether the rear legs can do as the front ones across do: the decomposed program has them so.
    pub fn rear_follows(&self) -> bool {
        self.rear_offset_rad.is_ok()
    }

    /// The plan of a request that the decomposed program knows, on as fine a grid as it needs.
    pub fn plan(
        &mut self,
        request: &GaitRequest,
        options: &PlanOptions,
        mut progress: impl FnMut(&Iteration) -> ControlFlow<()>,
    ) -> Result<Plan, PlanError> {
        let mut options = options.clone();
        let (mut refinements, mut iterations, mut log) = (0..REFINEMENTS, 0, Vec::new());
        loop {
            let (plan, between) = self.plan_on_grid(request, &options, &mut progress)?;
            let kept = between.check(plan.points.len());
            let finer = finer_grid(options.program.points).filter(|_| kept.is_err() && refinements.next().is_some());
            if let Some(points) = finer {
                options.program.points = points;
                options.warm_start = Some(plan.warm_start);
                iterations += plan.gait.solver.iterations;
                log.extend(plan.log);
                continue;
            }
            kept?;
            log.extend(plan.log);
            let mut plan = Plan { log, ..plan };
            plan.gait.solver.iterations += iterations;
            if options.reference == Reference::PlannedJoints {
                plan.gait.reference_coefficients_rad = plan.gait.coefficients_rad;
            }
            let robot = &self.prepared.last().expect("solving prepares").robot;
            plan.gait.certificate = certificate(robot, &plan.gait, options.reference, [&plan.points, &[]])?;
            return Ok(plan);
        }
    }

    /// A plan on the grid asked for, whatever it does between its points.
    fn plan_on_grid(
        &mut self,
        request: &GaitRequest,
        options: &PlanOptions,
        progress: impl FnMut(&Iteration) -> ControlFlow<()>,
    ) -> Result<(Plan, BetweenPoints), PlanError> {
        let solution = self.solve(request, options, progress)?;
        let Prepared { robot, program, .. } = self.prepared.last().expect("solving prepares");
        let points = recompose::points(robot, program, &solution.x, recompose::BALANCE_TOLERANCE)?;
        let summary = summary(&solution);
        let (t, mut coefficients) = (solution.x[program::layout::T], recompose::coefficients(program, &solution.x));
        let tolerance_rad = Tolerances::of(robot, request.torque_limit_nm).angle_rad;
        // One that is off where the step ends jumps at the switch, and is no gait.
        if recompose::departs_at_the_end_rad(&coefficients, &points) > tolerance_rad {
            recompose::fit_stance_rolls(&mut coefficients, &STANCE_ROLLS, &points, t);
        }
        let mut gait = recompose::gait(robot, coefficients, t, request, &points, summary, None)?;
        let mut between = between_points(robot, request, &gait, &points);
        if between.polynomial_rad > tolerance_rad {
            recompose::fit_stance_rolls(&mut gait.coefficients_rad, &STANCE_ROLLS, &points, t);
            between = between_points(robot, request, &gait, &points);
        }
        let warm_start = WarmStart(Solved::Decomposed(solution.x));
        Ok((Plan { gait, points, second_points: Vec::new(), warm_start, log: solution.log }, between))
    }

    /// The program's converged solution. The decomposed program knows no sideways slope;
    /// [`Planner::plan`](crate::Planner::plan) and a library's grid keep such requests from it.
    pub fn solve(
        &mut self,
        request: &GaitRequest,
        options: &PlanOptions,
        mut progress: impl FnMut(&Iteration) -> ControlFlow<()>,
    ) -> Result<Solution, PlanError> {
        request.validate(self.leg_length_m)?;
        check_points(options.program.points)?;
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
            Some(solution) if solution.status.is_solution() || solution.status == Status::Cancelled => solution,
            _ => {
                let Prepared { robot, program, .. } = self.prepared.last_mut().expect("just prepared");
                let fitting = match &options.warm_start {
                    Some(WarmStart(Solved::Decomposed(x))) => on_grid(x.clone(), program.points()),
                    _ => None,
                };
                let start = match fitting {
                    Some(x) => x,
                    None => guess::nominal(robot, program, request)?,
                };
                self.solve_from(&start, options, &mut progress)?
            }
        };
        if !solution.status.is_solution() {
            return Err(not_converged(solution));
        }
        if remembers {
            self.prepared.last_mut().expect("just prepared").memory.keep(request, leg_length_m, &solution.x);
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
        let Prepared { program, .. } = self.prepared.last_mut().expect("the caller has prepared");
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
        let fits = |p: &Prepared| p.slope_rad == request.slope_rad && p.settings == *settings;
        let found = match self.prepared.iter().position(fits) {
            Some(index) => {
                let mut prepared = self.prepared.remove(index);
                prepared.program.ask(&prepared.robot, request);
                prepared
            }
            None => {
                let robot = on_slope(&self.robot, request);
                let program = program_with_offset(&robot, request, settings.clone(), self.rear_offset_rad.clone()?)?;
                if self.prepared.len() == MOST_PREPARED {
                    self.prepared.remove(0);
                }
                Prepared {
                    slope_rad: request.slope_rad,
                    settings: settings.clone(),
                    robot,
                    program,
                    memory: Memory::default(),
                }
            }
        };
        self.prepared.push(found);
        Ok(self.prepared.last_mut().expect("there is one now"))
    }
}
