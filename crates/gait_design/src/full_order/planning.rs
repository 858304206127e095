//! Plans of the full-order program, with what one request leaves for the next.

use super::plan::{plan_of, program_and_start};
use super::refine::finer;
use super::schedule::{Schedule, Steps};
use super::{FullOrderProgram, order};
use crate::decomposed::DecomposedPlanner;
use crate::memory::Memory;
use crate::refine::finer_grid;
use crate::request::{GaitRequest, check_points};
use crate::{
    Plan, PlanError, PlanOptions, Reference, Solved, SubproblemSolver, WarmStart, leg_length_m, not_converged, on_slope,
};
use nlp::{Iteration, NullSpace, Ordered, ProblemError, Solution, SqpSolver, Status, Workspace};
use std::ops::ControlFlow;

/// Plans gaits of the full-order program, with or without memory of the gaits before. The robot is the decomposed
/// planner's, whose straight gaits solves start from.
pub(crate) struct FullOrderPlanner {
    prescribed: Eliminations<{ order::INPUTS }, { order::FREE }>,
    of_the_law: Eliminations<{ order::INPUTS_OF_THE_LAW }, { order::FREE_OF_THE_LAW }>,
    workspace: Workspace,
    /// Gaits of each program, where the planner remembers.
    memories: Vec<(Program, Memory)>,
    remembers: bool,
}

/// How equalities are eliminated, for the programs that were solved last.
struct Eliminations<const INPUTS: usize, const FREE: usize>(Vec<Ordered<INPUTS, FREE>>);

/// What a vector of unknowns belongs to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Program {
    steps: usize,
    /// Of all steps.
    points: usize,
    reference: Reference,
}

impl Program {
    /// Of both steps of a stride with `points` each.
    pub fn of_stride(points: usize, reference: Reference) -> Self {
        Self { steps: 2, points: 2 * points, reference }
    }

    pub(super) fn of(schedule: &Schedule, reference: Reference) -> Self {
        Self { steps: schedule.domains.len(), points: schedule.places().len(), reference }
    }
}

/// Eliminations kept: of a grid and the next finer one.
const MOST_KEPT: usize = 2;

/// A solution on a grid, and whether it keeps its limits between the points.
struct Planned {
    plan: Plan,
    kept: Result<(), PlanError>,
    schedule: Schedule,
    x: Vec<f64>,
}

impl FullOrderPlanner {
    /// `remembers`: a request starts from the gaits before it.
    pub fn new(remembers: bool) -> Self {
        Self {
            prescribed: Eliminations(Vec::new()),
            of_the_law: Eliminations(Vec::new()),
            workspace: Workspace::default(),
            memories: Vec::new(),
            remembers,
        }
    }

    /// [`super::plan_full_order`].
    pub fn plan(
        &mut self,
        decomposed: &mut DecomposedPlanner,
        request: &GaitRequest,
        options: &PlanOptions,
        mut progress: impl FnMut(&Iteration) -> ControlFlow<()>,
    ) -> Result<Plan, PlanError> {
        request.validate(leg_length_m(decomposed.robot()))?;
        check_points(options.program.points)?;
        let coarse = self.plan_on_grid(decomposed, request, options, None, &mut progress)?;
        // Once: a grid four times as fine takes long.
        let Some(points) = finer_grid(options.program.points).filter(|_| coarse.kept.is_err()) else {
            return coarse.kept.map(|()| coarse.plan);
        };
        let mut options = options.clone();
        options.program.points = points;
        let iterations = coarse.plan.gait.solver.iterations;
        let fine = self.plan_on_grid(decomposed, request, &options, Some(&coarse), progress)?;
        fine.kept?;
        let mut plan = fine.plan;
        plan.gait.solver.iterations += iterations;
        Ok(plan)
    }

    /// A converged solution over both steps of a stride, also where the second is the first one's mirror image.
    pub fn solve_stride(
        &mut self,
        decomposed: &mut DecomposedPlanner,
        request: &GaitRequest,
        options: &PlanOptions,
        progress: impl FnMut(&Iteration) -> ControlFlow<()>,
    ) -> Result<Solution, PlanError> {
        request.validate(leg_length_m(decomposed.robot()))?;
        check_points(options.program.points)?;
        let (mut program, start, _) = program_and_start(decomposed, request, Steps::Both, options)?;
        let known = given(&program, options);
        self.converged(&mut program, known, &start, options, progress)
    }

    /// A plan on the grid asked for, from its solution on the next coarser one where there is one.
    fn plan_on_grid(
        &mut self,
        decomposed: &mut DecomposedPlanner,
        request: &GaitRequest,
        options: &PlanOptions,
        coarse: Option<&Planned>,
        progress: impl FnMut(&Iteration) -> ControlFlow<()>,
    ) -> Result<Planned, PlanError> {
        let (mut program, start, alike) = program_and_start(decomposed, request, Steps::of(request), options)?;
        let leg_length_m = leg_length_m(decomposed.robot());
        let of = Program::of(&program.schedule, options.reference);
        let known = match coarse {
            Some(coarse) => Some(finer(&coarse.schedule, &coarse.x, &program.schedule)),
            None => {
                let remembered = || self.memories.iter().find(|memory| memory.0 == of);
                given(&program, options).or_else(|| remembered()?.1.start(request, leg_length_m))
            }
        };
        let solution = self.converged(&mut program, known, &start, options, progress)?;
        let robot = &on_slope(decomposed.robot(), request);
        let (plan, kept) = plan_of(robot, request, options, &program, &solution, alike)?;
        if self.remembers {
            self.memory(of).keep(request, leg_length_m, &solution.x);
        }
        Ok(Planned { plan, kept, schedule: program.schedule, x: solution.x })
    }

    /// The program's solution from what is known of it, or else from a start of its own.
    fn converged(
        &mut self,
        program: &mut FullOrderProgram,
        known: Option<Vec<f64>>,
        start: &[f64],
        options: &PlanOptions,
        mut progress: impl FnMut(&Iteration) -> ControlFlow<()>,
    ) -> Result<Solution, PlanError> {
        // What was known may be of no use; a request is refused on a start of its own only.
        let from_known = known.map(|x| self.solve(program, &x, options, &mut progress)).transpose()?;
        let solution = match from_known {
            Some(solution) if solution.status.is_solution() || solution.status == Status::Cancelled => solution,
            _ => self.solve(program, start, options, &mut progress)?,
        };
        if solution.status.is_solution() { Ok(solution) } else { Err(not_converged(solution)) }
    }

    fn memory(&mut self, of: Program) -> &mut Memory {
        let place = self.memories.iter().position(|memory| memory.0 == of).unwrap_or_else(|| {
            self.memories.push((of, Memory::default()));
            self.memories.len() - 1
        });
        &mut self.memories[place].1
    }

    /// The program's solution from a start, whatever its status.
    fn solve(
        &mut self,
        program: &mut FullOrderProgram,
        start: &[f64],
        options: &PlanOptions,
        mut progress: impl FnMut(&Iteration) -> ControlFlow<()>,
    ) -> Result<Solution, PlanError> {
        /// Room for the unknowns that meet once the equalities are eliminated: 92 of a stride with 11 points, …
        const SHARED: usize = 96;
        /// … and 112 with 21.
        const SHARED_FINE: usize = 128;
        let solver = SqpSolver::new(options.solver.clone())?;
        let scale = options.solver.objective_scale;
        if options.subproblem == SubproblemSolver::Sparse {
            return Ok(solver.solve(program, start, progress)?);
        }
        let workspace = &mut self.workspace;
        if options.subproblem == SubproblemSolver::Condensed {
            let found = if program.joints_prescribed {
                self.prescribed.solve(&solver, program, scale, start, workspace, &mut progress)
            } else {
                self.of_the_law.solve(&solver, program, scale, start, workspace, &mut progress)
            };
            if let Some(solution) = found {
                return Ok(solution?);
            }
        }
        Ok(if options.program.points <= 11 {
            solver.solve_with(program, &mut NullSpace::<SHARED>::new(scale), start, workspace, progress)?
        } else {
            solver.solve_with(program, &mut NullSpace::<SHARED_FINE>::new(scale), start, workspace, progress)?
        })
    }
}

/// The start that the options give, where it is of this program.
fn given(program: &FullOrderProgram, options: &PlanOptions) -> Option<Vec<f64>> {
    match &options.warm_start {
        Some(WarmStart(Solved::FullOrder(of, x))) => {
            (*of == Program::of(&program.schedule, options.reference)).then(|| x.clone())
        }
        _ => None,
    }
}

impl<const INPUTS: usize, const FREE: usize> Eliminations<INPUTS, FREE> {
    /// A program's solution from a start; none where its equalities have no order of their own.
    fn solve(
        &mut self,
        solver: &SqpSolver,
        program: &mut FullOrderProgram,
        scale: f64,
        start: &[f64],
        workspace: &mut Workspace,
        progress: impl FnMut(&Iteration) -> ControlFlow<()>,
    ) -> Option<Result<Solution, ProblemError>> {
        let mut elimination = self.take(program, scale)?;
        let solution = solver.solve_with(program, &mut elimination, start, workspace, progress);
        self.0.push(elimination);
        Some(solution)
    }

    /// As last time, if that fits.
    fn take(&mut self, program: &FullOrderProgram, scale: f64) -> Option<Ordered<INPUTS, FREE>> {
        let order = program.order()?;
        if let Some(place) = self.0.iter().position(|elimination| elimination.fits(program, &order)) {
            let mut elimination = self.0.remove(place);
            elimination.forget();
            return Some(elimination);
        }
        if self.0.len() == MOST_KEPT {
            self.0.remove(0);
        }
        Ordered::new(program, &order, scale)
    }
}
