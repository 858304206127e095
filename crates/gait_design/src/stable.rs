//! The step duration and stance width at which a request's gait stands best by itself.

use crate::request::GaitRequest;
use crate::{Plan, PlanError, PlanOptions, Planner, WarmStart, hip_distance_m};
use nlp::Iteration;
use robot::Robot;
use std::ops::ControlFlow;

/// What a request leaves to the planner.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Open {
    /// T.
    pub step_duration: bool,
    /// The lateral distance of the stance toes.
    pub half_width: bool,
}

/// Step durations tried first, in units of √(height / g), in which an inverted pendulum falls by e; on the Vision 60
/// 0.19 to 0.28 s.
const DURATIONS: [f64; 4] = [0.8, 0.93, 1.06, 1.19];
/// Half-widths tried first, as shares of half the wheelbase, at which the stance is square; on the Vision 60 0.24 to
/// 0.34 m.
const WIDTHS: [f64; 4] = [0.7, 0.8, 0.9, 1.0];
/// The best of those is improved by halving the distance to its neighbours so often.
const HALVINGS: u32 = 2;
/// A try that takes so many iterations is given up: neighbours of a good gait take four to eight.
const MOST_ITERATIONS: u32 = 20;

/// The plan of a request whose open values are chosen for the smallest largest multiplier among gaits that are called
/// stable, or, where none is, among all that can be planned. Everything else of the request is kept. The plan is the
/// same as of the chosen request asked for by itself. With nothing open it is [`crate::plan`].
///
/// # Errors
///
/// Where nothing can be planned, that of the request as it stands.
pub fn plan_stable(
    robot: &Robot,
    request: &GaitRequest,
    open: Open,
    options: &PlanOptions,
    mut progress: impl FnMut(&Iteration) -> ControlFlow<()>,
) -> Result<Plan, PlanError> {
    let Some(chosen) = choose(robot, request, open, options, &mut progress) else {
        return crate::plan(robot, request, options, progress);
    };
    crate::plan(robot, &chosen, options, progress)
}

/// The request with its open values chosen, or `None` where none of those tried can be planned. A search that
/// `progress` stops ends with the best of what it has tried.
pub fn choose(
    robot: &Robot,
    request: &GaitRequest,
    open: Open,
    options: &PlanOptions,
    progress: impl FnMut(&Iteration) -> ControlFlow<()>,
) -> Option<GaitRequest> {
    let mut search = Search::new(robot, options, progress);
    let hips = hip_distance_m(robot) / 2.0;
    let unit_s = (request.height_m / robot.model.gravity.norm()).sqrt();
    let mut durations =
        if open.step_duration { DURATIONS.map(|t| t * unit_s).to_vec() } else { vec![request.step_duration_s] };
    let widths = if open.half_width { WIDTHS.map(|w| w * hips).to_vec() } else { vec![request.half_width_m] };
    for half_width_m in widths {
        for &step_duration_s in &durations {
            search.rate(GaitRequest { step_duration_s, half_width_m, ..request.clone() });
        }
        // Back and forth, so that each try is a neighbour of the one before.
        durations.reverse();
    }
    let mut steps = [DURATIONS[1] - DURATIONS[0], WIDTHS[1] - WIDTHS[0]];
    for _ in 0..HALVINGS {
        steps = steps.map(|step| step / 2.0);
        let Some((_, centre)) = search.best.clone() else { break };
        for (is_open, t, w) in [
            (open.step_duration, -1.0, 0.0),
            (open.step_duration, 1.0, 0.0),
            (open.half_width, 0.0, -1.0),
            (open.half_width, 0.0, 1.0),
        ] {
            if is_open {
                search.rate(GaitRequest {
                    step_duration_s: centre.step_duration_s + t * steps[0] * unit_s,
                    half_width_m: centre.half_width_m + w * steps[1] * hips,
                    ..centre.clone()
                });
            }
        }
    }
    search.best.map(|(_, request)| request)
}

/// A request and how it stands: not called stable, then the largest multiplier.
type Rated = ((bool, f64), GaitRequest);

/// Rates one request after the other.
struct Search<P> {
    planner: Planner,
    options: PlanOptions,
    progress: P,
    stopped: bool,
    best: Option<Rated>,
    /// The last gait's solution.
    warm: Option<WarmStart>,
}

impl<P: FnMut(&Iteration) -> ControlFlow<()>> Search<P> {
    fn new(robot: &Robot, options: &PlanOptions, progress: P) -> Self {
        let mut options = options.clone();
        options.solver.max_iterations = options.solver.max_iterations.min(MOST_ITERATIONS);
        Self { planner: Planner::new(robot), options, progress, stopped: false, best: None, warm: None }
    }

    fn rate(&mut self, request: GaitRequest) {
        // From the gait before, and where that leads nowhere from a guess.
        let warm = self.warm.clone().and_then(|start| self.attempt(&request, Some(start)));
        let Some(plan) = warm.or_else(|| self.attempt(&request, None)) else { return };
        if let Some(certificate) = &plan.gait.certificate {
            let rating = (!certificate.stable, certificate.largest_multiplier);
            if self.best.as_ref().is_none_or(|(known, _)| rating < *known) {
                self.best = Some((rating, request));
            }
        }
        self.warm = Some(plan.warm_start);
    }

    fn attempt(&mut self, request: &GaitRequest, warm_start: Option<WarmStart>) -> Option<Plan> {
        if self.stopped {
            return None;
        }
        let options = PlanOptions { warm_start, ..self.options.clone() };
        let planned = self.planner.plan(request, &options, |iteration| {
            if iteration.elastic {
                return ControlFlow::Break(());
            }
            let flow = (self.progress)(iteration);
            self.stopped |= flow.is_break();
            flow
        });
        planned.ok()
    }
}
