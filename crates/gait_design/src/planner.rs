//! Planning many gaits for one robot: by the decomposed program where it knows the request, else by the full-order one.

use crate::decomposed::DecomposedPlanner;
use crate::full_order::FullOrderPlanner;
use crate::request::GaitRequest;
use crate::{Plan, PlanError, PlanOptions, Reference};
use nlp::{Iteration, Solution};
use robot::Robot;
use std::ops::ControlFlow;

/// Plans gaits for one robot, with ([`Planner::with_memory`]) or without memory of the gaits before ([`Planner::new`]).
pub struct Planner {
    decomposed: DecomposedPlanner,
    full_order: FullOrderPlanner,
}

impl Planner {
    /// A planner for a robot that forgets: what a request gives does not depend on the requests before it.
    pub fn new(robot: &Robot) -> Self {
        Self::of(robot, false)
    }

    /// A planner that starts a request from the gaits before it, which takes half the iterations. Its gaits are those
    /// of [`Planner::new`] to within the solver's tolerances, but not to the bit: they depend on what was planned
    /// before.
    pub fn with_memory(robot: &Robot) -> Self {
        Self::of(robot, true)
    }

    fn of(robot: &Robot, remembers: bool) -> Self {
        Self { decomposed: DecomposedPlanner::new(robot, remembers), full_order: FullOrderPlanner::new(remembers) }
    }

    /// [`crate::plan`].
    ///
    /// # Errors
    ///
    /// If the request is invalid or has no gait.
    pub fn plan(
        &mut self,
        request: &GaitRequest,
        options: &PlanOptions,
        progress: impl FnMut(&Iteration) -> ControlFlow<()>,
    ) -> Result<Plan, PlanError> {
        if !self.decomposed.rear_follows() || !request.is_decomposable() || options.reference == Reference::InProgram {
            return self.full_order.plan(&mut self.decomposed, request, options, progress);
        }
        self.decomposed.plan(request, options, progress)
    }

    /// The decomposed program's converged solution.
    pub(crate) fn solve(
        &mut self,
        request: &GaitRequest,
        options: &PlanOptions,
        progress: impl FnMut(&Iteration) -> ControlFlow<()>,
    ) -> Result<Solution, PlanError> {
        self.decomposed.solve(request, options, progress)
    }

    /// The full-order program's over both steps of a stride, also where one and its mirror image would do.
    pub(crate) fn solve_stride(
        &mut self,
        request: &GaitRequest,
        options: &PlanOptions,
        progress: impl FnMut(&Iteration) -> ControlFlow<()>,
    ) -> Result<Solution, PlanError> {
        self.full_order.solve_stride(&mut self.decomposed, request, options, progress)
    }
}
