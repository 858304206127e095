//! `tandem plan --from-rest` and `--to-rest`: the two steps between standing and a planned gait.

use anyhow::{Context, Result};
use gait_design::{Transition, TransitionError, TransitionOptions, TransitionRequest, plan_transition};
use serde_json::json;
use std::ops::ControlFlow;
use std::time::Instant;

/// Two planned steps between standing and a gait.
pub struct FromOrToRest {
    what: &'static str,
    /// They lead from standing to the gait.
    leads: bool,
    transition: Transition,
    time_s: f64,
}

/// The steps that are asked for, in the order in which they are walked.
pub fn of_rest(robot: &robot::Robot, gait: &gait::Gait, from: bool, to: bool) -> Result<Vec<FromOrToRest>> {
    type Asked = fn(&robot::Robot, &gait::Gait) -> Result<TransitionRequest, gait_design::PlanError>;
    let asked: [(bool, &'static str, bool, Asked); 2] =
        [(from, "from rest", true, TransitionRequest::from_rest), (to, "to rest", false, TransitionRequest::to_rest)];
    let wanted = asked.into_iter().filter(|(wanted, ..)| *wanted);
    let plan = |(_, what, leads, request): (bool, &'static str, bool, Asked)| {
        let start = Instant::now();
        let transition = request(robot, gait)
            .map_err(TransitionError::from)
            .and_then(|request| {
                plan_transition(robot, &request, &TransitionOptions::default(), |_| ControlFlow::Continue(()))
            })
            .with_context(|| format!("cannot plan the steps {what} for {}", gait.name))?;
        Ok(FromOrToRest { what, leads, transition, time_s: start.elapsed().as_secs_f64() })
    };
    wanted.map(plan).collect()
}

/// Gives a gait the steps from standing as its lead, where they are among those planned.
pub fn lead(gait: &mut gait::Gait, planned: &[FromOrToRest]) -> Result<()> {
    if let Some(from_rest) = planned.iter().find(|steps| steps.leads) {
        gait.lead = from_rest.transition.steps.to_vec();
        gait.validate().context("the planned steps from standing do not lead into the gait")?;
    }
    Ok(())
}

impl FromOrToRest {
    /// A line for a person.
    pub fn text(&self) -> String {
        let t = &self.transition;
        format!(
            "         two steps {}: T {:.4} s, {} iterations, {:.3} s; largest torque {:.1} N m; of its end {} is missed most, by {:+.1e} {}\n",
            self.what,
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
            "what": self.what, "iterations": t.solver.iterations, "solve_time_s": self.time_s,
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
