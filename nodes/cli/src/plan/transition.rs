//! `tandem plan --from-rest`, `--from` and `--to-rest`: the two steps between a planned gait and standing or another
//! gait.

use crate::{output, robots};
use anyhow::{Context, Result};
use gait::Gait;
use gait_design::{PlanError, Transition, TransitionError, TransitionOptions, TransitionRequest, plan_transition};
use robot::Robot;
use serde_json::json;
use std::ops::ControlFlow;
use std::path::Path;
use std::time::Instant;

/// What two steps are planned between.
pub enum Between {
    /// From standing to the gait.
    FromRest,
    /// From another gait to the gait.
    From(Box<Gait>),
    /// From the gait to standing.
    ToRest,
}

/// Two planned steps to or from a gait.
pub struct TwoSteps {
    between: &'static str,
    /// They lead to the gait.
    leads: bool,
    transition: Transition,
    time_s: f64,
}

/// The steps that are asked for, in the order in which they are walked.
pub fn planned(robot: &Robot, gait: &Gait, asked: &[Between]) -> Result<Vec<TwoSteps>> {
    asked.iter().map(|between| between.plan(robot, gait)).collect()
}

/// Gives a gait the steps that lead to it, where they are among those planned.
pub fn lead(gait: &mut Gait, planned: &[TwoSteps]) -> Result<()> {
    if let Some(steps) = planned.iter().find(|steps| steps.leads) {
        gait.lead = steps.transition.steps.to_vec();
        gait.validate().with_context(|| format!("the planned steps {} do not lead into the gait", steps.between))?;
    }
    Ok(())
}

impl Between {
    /// From the gait in a file, which has to be one of this robot's.
    pub fn from_file(file: &Path, robot: &Robot) -> Result<Self> {
        let text = std::fs::read_to_string(robots::file(file))
            .with_context(|| format!("cannot read {}", output::shown(file)))?;
        let gait = Gait::from_json(&text).with_context(|| output::shown(file))?;
        gait.check_robot(&robot.name, &robot.joint_names()).with_context(|| output::shown(file))?;
        Ok(Self::From(Box::new(gait)))
    }

    fn plan(&self, robot: &Robot, gait: &Gait) -> Result<TwoSteps> {
        let start = Instant::now();
        let transition = self
            .request(robot, gait)
            .map_err(TransitionError::from)
            .and_then(|request| {
                plan_transition(robot, &request, &TransitionOptions::default(), |_| ControlFlow::Continue(()))
            })
            .with_context(|| format!("cannot plan the steps {} for {}", self.text(), gait.name))?;
        let (between, leads) = (self.text(), !matches!(self, Self::ToRest));
        Ok(TwoSteps { between, leads, transition, time_s: start.elapsed().as_secs_f64() })
    }

    fn request(&self, robot: &Robot, gait: &Gait) -> Result<TransitionRequest, PlanError> {
        match self {
            Self::FromRest => TransitionRequest::from_rest(robot, gait),
            Self::From(other) => TransitionRequest::between(robot, other, gait),
            Self::ToRest => TransitionRequest::to_rest(robot, gait),
        }
    }

    fn text(&self) -> &'static str {
        match self {
            Self::FromRest => "from rest",
            Self::From(_) => "from the other gait",
            Self::ToRest => "to rest",
        }
    }
}

impl TwoSteps {
    /// A line for a person.
    pub fn text(&self) -> String {
        let t = &self.transition;
        format!(
            "         two steps {}: T {:.4} s, {} iterations, {:.3} s; largest torque {:.1} N m; of its end {} is missed most, by {:+.1e} {}\n",
            self.between,
            t.steps[0].duration_s,
            t.solver.iterations,
            self.time_s,
            self.largest_torque_nm(),
            t.missed.what,
            t.missed.amount,
            t.missed.unit
        )
    }

    /// The same for a program, with the steps themselves: what the joints do and what the tracking law is to follow.
    pub fn json(&self) -> serde_json::Value {
        let t = &self.transition;
        let steps = t.steps.iter().map(|step| {
            json!({
                "stands": step.stands, "duration_s": step.duration_s, "planned_rad": step.planned_rad,
                "reference_rad": step.reference_rad,
            })
        });
        json!({
            "what": self.between, "iterations": t.solver.iterations, "solve_time_s": self.time_s,
            "cost": t.solver.objective, "violation": t.solver.max_violation,
            "largest_torque_nm": self.largest_torque_nm(),
            "missed": { "what": t.missed.what, "amount": t.missed.amount, "unit": t.missed.unit },
            "steps": steps.collect::<Vec<_>>(),
        })
    }

    fn largest_torque_nm(&self) -> f64 {
        let torques = self.transition.points.iter().flatten().flat_map(|point| point.torque_nm);
        torques.fold(0.0, |most, torque| torque.abs().max(most))
    }
}
