//! The same program without the decomposition: the whole robot's 18 coordinates at every point, a polynomial for each
//! of its twelve joints, the full-order dynamics (paper eq. 1), the same cost, limits and points. It is there to be
//! compared with ([`plan_full_order`]). The rear legs are not tied to the front ones by a pairing, so its optimum can
//! only be lower; for the Vision 60's gaits it costs about half.
//!
//! Robots whose rear legs cannot do as the front ones across do ([`Robot::rear_offset_rad`]), with knees that point
//! apart for example, need it, and four kinds of request. On a sideways slope, with a torso that leans to a side, and
//! in gaits that turn or step aside, a step's mirror image is no step: two steps are planned, each with its own
//! polynomials and stance toes, joined by q and q̇ at the first switch and closed over the stride. And the reference
//! may be planned inside the program ([`Reference::InProgram`]): the polynomials are then what the tracking law
//! follows, its torque stands in place of y = 0, and the joints are where that leads them.
//!
//! The program is domains × terms: a domain ([`schedule`]) is a part of the gait with the same legs on the ground, a
//! term ([`terms`]) one constraint with its bounds, values, derivatives and names. Redundant rows are left out as in
//! [`crate::DecomposedProgram`]; without the pairing all six rows of a soft touchdown count.

mod contact_plan;
mod costs;
mod footfalls;
mod goal;
mod order;
mod plan;
mod planning;
mod point;
mod refine;
mod schedule;
mod start;
mod state;
mod stride;
mod terms;
mod transition;
mod variables;

pub use contact_plan::{ScheduleOptions, SchedulePlan, plan_schedule};
pub use plan::{plan_full_order, stride_start};
pub(crate) use planning::{FullOrderPlanner, Program};
pub(crate) use schedule::Steps;
pub use state::{State, StateError};
pub(crate) use stride::{interpolated_stride, mirrored_stride, unknowns as stride_unknowns};
pub use transition::{Missed, Transition, TransitionError, TransitionOptions, TransitionRequest, plan_transition};

use crate::Reference;
use crate::limits::{Limits, ProgramSettings};
use crate::planar::PlanarMotion;
use crate::program::three;
use crate::recompose::PlanPoint;
use crate::request::GaitRequest;
use crate::terms::{At, Names, Terms};
use costs::Square;
use nlp::{Bounds, Evaluation, Pattern, Problem};
use point::Point;
use rigid_body::Data;
use robot::Robot;
use schedule::{DOF, Schedule, at};
use terms::Asked;

/// The full-order program of one request on one robot.
pub struct FullOrderProgram {
    robot: Robot,
    names: Names,
    schedule: Schedule,
    joints_prescribed: bool,
    terms: Terms,
    cost: Vec<Square>,
    data: Data,
    points: Vec<Point>,
    bounds: Bounds,
    jacobian: Pattern,
    hessian: Pattern,
}

impl FullOrderProgram {
    /// Builds the program of a step and its mirror image, or of a stride. `robot` is [`crate::on_slope`]'s; the request
    /// has been validated; `limits` are the decomposed program's.
    pub(crate) fn new(
        robot: &Robot,
        request: &GaitRequest,
        steps: Steps,
        settings: &ProgramSettings,
        limits: &Limits,
        reference: Reference,
    ) -> Self {
        let schedule = Schedule::of(robot, steps, settings.points);
        Self::over(schedule, robot, request, settings, limits, reference)
    }

    /// The same over any domains.
    fn over(
        schedule: Schedule,
        robot: &Robot,
        request: &GaitRequest,
        settings: &ProgramSettings,
        limits: &Limits,
        reference: Reference,
    ) -> Self {
        let joints_prescribed = reference != Reference::InProgram;
        let (motion, nominal_t_s) = (PlanarMotion::of(request), request.step_duration_s);
        let terms = terms::of(&Asked { robot, schedule: &schedule, limits, request, joints_prescribed });
        let [variable_lower, variable_upper] = variables::bounds(robot, request, &schedule, limits, joints_prescribed);
        let mut cost = Vec::new();
        for place in schedule.places() {
            cost.extend(costs::base_velocity(place, motion, nominal_t_s));
            cost.extend(costs::effort(place, settings));
        }
        cost.extend(costs::tilt(&schedule, request));
        cost.extend(costs::missed(&schedule));
        let mut program = Self {
            robot: robot.clone(),
            names: Names::of(robot),
            joints_prescribed,
            hessian: hessian(&cost),
            cost,
            data: Data::new(&robot.model),
            points: vec![Point::default(); schedule.places().len()],
            bounds: Bounds {
                variable_lower,
                variable_upper,
                constraint_lower: terms.bounds(0).collect(),
                constraint_upper: terms.bounds(1).collect(),
            },
            jacobian: Pattern::default(),
            terms,
            schedule,
        };
        let x = vec![0.0; program.schedule.unknowns];
        program.jacobian = program.terms.pattern(&program.at(&x));
        program
    }

    fn at<'a>(&'a self, x: &'a [f64]) -> At<'a> {
        At { x, t_column: self.schedule.t(), bodies: &self.points }
    }

    fn evaluate_points(&mut self, x: &[f64], derivatives: bool) {
        for place in self.schedule.places() {
            let (unknowns, stance) = (&x[self.schedule.columns(place)], &self.schedule.domains[place.domain].stance);
            self.points[place.index].evaluate(&self.robot, &mut self.data, unknowns, stance, derivatives);
        }
    }

    fn objective(&self, x: &[f64]) -> f64 {
        self.cost.iter().map(|s| s.weight * (x[s.column] - s.centre).powi(2)).sum()
    }

    /// The order in which its equalities are solved, where it has one of its own.
    fn order(&self) -> Option<nlp::Order> {
        order::of(&self.schedule, self.terms.ties(), self.joints_prescribed)
    }

    /// Adds the cost of moving the joints otherwise than in `x`, and of holding them elsewhere.
    fn stay_near(&mut self, x: &[f64]) {
        self.cost.extend(costs::near(&self.schedule, x));
        self.hessian = hessian(&self.cost);
    }

    /// The robot at every point of a domain.
    fn plan_points(&self, x: &[f64], domain: usize) -> Vec<PlanPoint> {
        let stance = &self.schedule.domains[domain].stance;
        let point = |place: &schedule::Place| {
            let p = &x[self.schedule.columns(place)];
            let eighteen = |start: usize| -> [f64; DOF] { p[start..start + DOF].try_into().expect("eighteen entries") };
            let mut ground_force_n = [[0.0; 3]; 4];
            for (k, &leg) in stance.iter().enumerate() {
                ground_force_n[leg] = three(p, at::LAMBDA + 3 * k).into();
            }
            PlanPoint {
                phase: place.phase,
                q: eighteen(at::Q),
                v: eighteen(at::V),
                a: eighteen(at::A),
                torque_nm: p[at::U..at::LAMBDA].try_into().expect("twelve entries"),
                ground_force_n,
            }
        };
        self.schedule.places_of(domain).iter().map(point).collect()
    }
}

fn hessian(cost: &[Square]) -> Pattern {
    Pattern(cost.iter().map(|s| (s.column, s.column)).collect())
}

impl Problem for FullOrderProgram {
    fn bounds(&self) -> &Bounds {
        &self.bounds
    }

    fn jacobian_pattern(&self) -> &Pattern {
        &self.jacobian
    }

    fn hessian_pattern(&self) -> &Pattern {
        &self.hessian
    }

    fn evaluate(&mut self, x: &[f64], evaluation: &mut Evaluation) {
        self.evaluate_points(x, true);
        self.terms.values(&self.at(x), &mut evaluation.constraints);
        self.terms.jacobian(&self.at(x), &mut evaluation.jacobian);
        evaluation.objective = self.objective(x);
        evaluation.gradient.fill(0.0);
        for (k, s) in self.cost.iter().enumerate() {
            evaluation.gradient[s.column] += 2.0 * s.weight * (x[s.column] - s.centre);
            evaluation.hessian[k] = 2.0 * s.weight;
        }
    }

    fn values(&mut self, x: &[f64], constraints: &mut [f64]) -> f64 {
        self.evaluate_points(x, false);
        self.terms.values(&self.at(x), constraints);
        self.objective(x)
    }

    fn constraint_name(&self, row: usize) -> String {
        self.terms.name(row, &self.names)
    }

    fn variable_name(&self, column: usize) -> String {
        variables::name(&self.schedule, &self.names, column)
    }
}

#[cfg(test)]
mod tests;
