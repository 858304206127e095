//! What to ask instead: the request nearest to one that cannot be planned, on the straight way from the behaviour's own
//! values to the asked ones.

use crate::refine::points_of;
use crate::request::GaitRequest;
use crate::{
    Plan, PlanError, PlanOptions, ProgramSettings, Solved, WarmStart, leg_length_m, on_slope, plan, program_of,
};
use nlp::{Iteration, Problem};
use robot::Robot;
use std::collections::BTreeSet;
use std::ops::ControlFlow;

/// How often the way between what works and what does not is halved: what is found is within 1/128 of the way of the
/// limit.
const HALVINGS: u32 = 7;
/// A search's solves that have not converged by then will not, or not to a gait worth proposing.
const MAX_ITERATIONS: u32 = 40;
/// Nor those that had to relax so many subproblems. A relaxed one takes a hundred times as long as another, and a
/// request far from what can be planned relaxes nearly all: its search took a minute.
const MAX_RELAXED: usize = 4;

/// One number of a request that has to change.
#[derive(Clone, Debug, PartialEq)]
pub struct Changed {
    /// Its name in the request.
    pub field: &'static str,
    /// What was asked.
    pub asked: f64,
    /// What works.
    pub works: f64,
    /// Unit of both.
    pub unit: &'static str,
}

/// The nearest request found that can be planned.
#[derive(Clone, Debug, PartialEq)]
pub struct Nearest {
    /// The whole request.
    pub request: GaitRequest,
    /// The numbers in which it differs from the asked one.
    pub changed: Vec<Changed>,
    /// The limits that its gait has reached and that the behaviour's own gait has not: what stands in the way of more.
    pub binding: Vec<String>,
    /// Why a little more could not be planned.
    pub beyond: Option<String>,
}

impl std::fmt::Display for Nearest {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        for (index, c) in self.changed.iter().enumerate() {
            let (comma, space) = (if index > 0 { ", " } else { "" }, if c.unit.is_empty() { "" } else { " " });
            write!(f, "{comma}{} {}{space}{}", c.field, (c.works * 1e4).round() / 1e4, c.unit)?;
        }
        if !self.binding.is_empty() {
            write!(f, "; it has reached the limits of {}", self.binding.join(", "))?;
        }
        if let Some(beyond) = &self.beyond {
            write!(f, "; a little beyond: {beyond}")?;
        }
        Ok(())
    }
}

/// A request that was not planned, and what to ask instead.
#[derive(Debug, thiserror::Error)]
#[error(
    "{error}{}",
    nearest.as_ref().map_or_else(String::new, |n| format!("; nearest request that can be planned: {n}"))
)]
pub struct Refusal {
    /// Why.
    pub error: Box<PlanError>,
    /// What to ask instead, where something was found.
    pub nearest: Option<Box<Nearest>>,
}

/// [`plan`], and if there is no gait, [`nearest`]. `progress` sees the first solve, `go_on` is asked before and during
/// the search's.
pub fn plan_or_nearest(
    robot: &Robot,
    request: &GaitRequest,
    options: &PlanOptions,
    progress: impl FnMut(&Iteration) -> ControlFlow<()>,
    go_on: impl FnMut() -> bool,
) -> Result<Plan, Refusal> {
    plan(robot, request, options, progress).map_err(|error| {
        let asking = matches!(&error, PlanError::NotConverged { status: nlp::Status::Cancelled, .. });
        let nearest = if asking { None } else { nearest(robot, request, options, go_on) };
        Refusal { error: Box::new(error), nearest: nearest.map(Box::new) }
    })
}

/// Looks for the last request that can be planned on the straight way from the behaviour's own values (Table I's, the
/// robot's) to the asked ones. A number that is not finite is replaced by the behaviour's own, one out of its range by
/// the range's end. None if the behaviour is unknown, its own request has no gait, or `go_on` ends the search at once.
pub fn nearest(
    robot: &Robot,
    asked: &GaitRequest,
    options: &PlanOptions,
    mut go_on: impl FnMut() -> bool,
) -> Option<Nearest> {
    let own = GaitRequest::named(&asked.behaviour, robot).ok()?;
    let leg_length = leg_length_m(robot);
    let own_numbers = own.ranges(leg_length).map(|r| r.1);
    let end = within_ranges(asked, &own_numbers, leg_length);
    let end_numbers = end.ranges(leg_length).map(|r| r.1);
    let between = |share: f64| {
        let mut request = end.clone();
        for (number, (own, end)) in request.numbers_mut().into_iter().zip(own_numbers.into_iter().zip(end_numbers)) {
            *number = if own == end || share == 1.0 { end } else { own + share * (end - own) };
        }
        request
    };
    let mut options = options.clone();
    options.solver.max_iterations = options.solver.max_iterations.min(MAX_ITERATIONS);
    // Each from a guess, as the caller's next request will be.
    options.warm_start = None;
    let mut attempt = |request: &GaitRequest| -> Result<_, PlanError> {
        let mut relaxed = 0;
        let flow = |iteration: &Iteration| {
            relaxed += usize::from(iteration.elastic);
            if relaxed < MAX_RELAXED && go_on() { ControlFlow::Continue(()) } else { ControlFlow::Break(()) }
        };
        let planned = plan(robot, request, &options, flow);
        let Plan { warm_start, .. } = planned.map_err(|error| given_up(error, relaxed))?;
        match warm_start {
            WarmStart(Solved::Decomposed(x)) => limits_reached(robot, request, &options, &x),
            // The limits of a full-order plan are not looked at.
            WarmStart(Solved::FullOrder(..)) => Ok(BTreeSet::new()),
        }
    };

    let usual = attempt(&own).ok()?;
    let (mut low, mut reached, mut beyond) = (0.0, usual.clone(), None);
    // What was asked is known to have no gait, unless a number of it had to be moved into its range.
    let (mut high, mut share) = (1.0, if end == *asked { 0.5 } else { 1.0 });
    for _ in 0..=HALVINGS {
        match attempt(&between(share)) {
            Ok(limits) => (low, reached) = (share, limits),
            Err(PlanError::NotConverged { status: nlp::Status::Cancelled, .. }) => {
                beyond = Some("not looked at, the search's time was over".into());
                break;
            }
            Err(error) => (high, beyond) = (share, Some(error.to_string())),
        }
        if low == high {
            break;
        }
        share = 0.5 * (low + high);
    }
    let request = between(low);
    let changed = asked
        .ranges(leg_length)
        .into_iter()
        .zip(request.ranges(leg_length))
        .filter(|(asked, works)| asked.1 != works.1)
        .map(|(asked, works)| Changed { field: asked.0, asked: asked.1, works: works.1, unit: asked.4 })
        .collect();
    let binding = reached.difference(&usual).cloned().collect();
    Some(Nearest { request, changed, binding, beyond })
}

/// The request with each number that is not finite replaced by the behaviour's own, and each out of its range by the
/// range's end.
fn within_ranges(asked: &GaitRequest, own_numbers: &[f64; GaitRequest::FIELDS], leg_length: f64) -> GaitRequest {
    let mut end = asked.clone();
    for (number, own) in end.numbers_mut().into_iter().zip(*own_numbers) {
        if !number.is_finite() {
            *number = own;
        }
    }
    // Twice, because one range depends on another's value.
    for _ in 0..2 {
        let ranges = end.ranges(leg_length);
        for (number, (_, value, lower, upper, _)) in end.numbers_mut().into_iter().zip(ranges) {
            *number = value.clamp(lower, upper);
        }
    }
    end
}

/// The error of a solve that the search, and not the caller, has stopped.
fn given_up(error: PlanError, relaxed: usize) -> PlanError {
    match error {
        PlanError::NotConverged { status: nlp::Status::Cancelled, iterations, worst, log }
            if relaxed >= MAX_RELAXED =>
        {
            PlanError::NotConverged { status: nlp::Status::IterationLimit, iterations, worst, log }
        }
        other => other,
    }
}

/// The inequalities that hold with equality at `x`, by name, without their points.
fn limits_reached(
    robot: &Robot,
    request: &GaitRequest,
    options: &PlanOptions,
    x: &[f64],
) -> Result<BTreeSet<String>, PlanError> {
    /// How near counts as reached, as a share of the bound.
    const NEAR: f64 = 1e-3;
    // A plan on a finer grid than asked for has more unknowns.
    let points = points_of(x.len()).unwrap_or(options.program.points);
    let settings = ProgramSettings { points, ..options.program.clone() };
    let mut program = program_of(&on_slope(robot, request), request, settings)?;
    let mut values = vec![0.0; program.bounds().constraint_lower.len()];
    program.values(x, &mut values);
    let bounds = program.bounds();
    let mut reached = BTreeSet::new();
    let mut look = |value: f64, lower: f64, upper: f64, name: &dyn Fn() -> String| {
        let near = |bound: f64| bound.is_finite() && (value - bound).abs() <= NEAR * bound.abs().max(0.1);
        if lower < upper && (near(lower) || near(upper)) {
            let name = name();
            reached.insert(name.split(", point ").next().unwrap_or(&name).to_string());
        }
    };
    for i in 0..x.len() {
        look(x[i], bounds.variable_lower[i], bounds.variable_upper[i], &|| program.variable_name(i));
    }
    for i in 0..values.len() {
        look(values[i], bounds.constraint_lower[i], bounds.constraint_upper[i], &|| program.constraint_name(i));
    }
    Ok(reached)
}
