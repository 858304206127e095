//! Plans requests: no middleware, no files.

use std::ops::ControlFlow;
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

use gait_design::{
    ContactSchedule, GaitRequest, PlanError, PlanOptions, ScheduleOptions, TransitionError, TransitionOptions,
    TransitionRequest,
};
use nlp::Iteration;
use robot::Robot;
use tandem_msgs::{Gait, GenerateGaitRequest, GenerateGaitResponse};

use crate::ports;

/// Plans gaits for one robot.
///
/// Every solve starts from the same guess, never from the gait planned before it: the same request gives the same gait,
/// to the bit, whatever was asked before ([`gait_design::Planner::with_memory`] would be quicker, and its gaits differ
/// in the last digits with what was asked before). What is kept between requests is storage and the program's
/// structure.
pub struct Planner {
    robot: Robot,
    /// Those that no request uses at present; as many come to be as requests are planned at once.
    idle: Mutex<Vec<gait_design::Planner>>,
    time_limit: Duration,
    /// Whether a request that cannot be planned is answered with the nearest one that can.
    find_nearest: bool,
}

impl Planner {
    /// `time_limit` bounds one solve.
    #[must_use]
    pub fn new(robot: Robot, time_limit: Duration, find_nearest: bool) -> Self {
        Planner { robot, idle: Mutex::default(), time_limit, find_nearest }
    }

    /// Plans, or says why not, in the answer's own fields; the gait, where there is one, comes beside it. `progress`
    /// sees every iteration of the first solve, with the time since its start, and may stop it. The search for the
    /// nearest request goes on while `go_on`.
    pub fn generate(
        &self,
        message: &GenerateGaitRequest,
        go_on: impl Fn() -> bool,
        mut progress: impl FnMut(&Iteration, Duration) -> ControlFlow<()>,
    ) -> (GenerateGaitResponse, Option<Gait>) {
        let ports::Asked { request, reference, points, open, contacts, from_rest } =
            match ports::request(message, &self.robot) {
                Ok(asked) => asked,
                Err(problem) => return (ports::failure(ports::INVALID_REQUEST, problem), None),
            };
        let mut options = PlanOptions { reference, ..PlanOptions::default() };
        options.program.points = points;
        let start = Instant::now();
        let request = match open.and_then(|open| self.choose(&request, open, &options, &go_on)) {
            Some(chosen) => chosen,
            None => request,
        };
        let mut stopped = false;
        let progress = self.limited(|iteration| {
            let flow = progress(iteration, start.elapsed());
            stopped |= flow.is_break();
            flow
        });
        let planned = match &contacts {
            Some(contacts) => self.plan_schedule(&request, contacts, points, progress),
            None => self.plan(&request, &options, progress),
        };
        let mut gait = match planned {
            Ok(gait) => gait,
            Err(error) => {
                let spent = start.elapsed();
                let mut response = ports::plan_error(&error, spent.as_secs_f64());
                if !stopped && spent >= self.time_limit {
                    response.status = "time limit".to_string();
                    response.message = format!("no gait within {:?}: {}", self.time_limit, response.message);
                } else if !stopped
                    && self.find_nearest
                    && contacts.is_none()
                    && let Some(nearest) = self.nearest(&request, &options, go_on)
                {
                    ports::add_nearest(&mut response, &nearest);
                }
                return (response, None);
            }
        };
        gait.solver.solve_time_s = start.elapsed().as_secs_f64();
        if from_rest {
            match self.with_lead(gait, go_on) {
                Ok(with_lead) => gait = with_lead,
                Err(error) => return (ports::lead_error(&error, start.elapsed().as_secs_f64()), None),
            }
        }
        let gait = Gait::from_gait(&gait);
        (ports::success(&gait), Some(gait))
    }

    /// `progress`, within the time limit from now on.
    fn limited(
        &self,
        mut progress: impl FnMut(&Iteration) -> ControlFlow<()>,
    ) -> impl FnMut(&Iteration) -> ControlFlow<()> {
        let (start, limit) = (Instant::now(), self.time_limit);
        move |iteration| if start.elapsed() >= limit { ControlFlow::Break(()) } else { progress(iteration) }
    }

    fn plan(
        &self,
        request: &GaitRequest,
        options: &PlanOptions,
        progress: impl FnMut(&Iteration) -> ControlFlow<()>,
    ) -> Result<gait::Gait, PlanError> {
        // Nothing can fail while the list is held.
        let idle = || self.idle.lock().unwrap_or_else(PoisonError::into_inner);
        let kept = idle().pop();
        let mut planner = kept.unwrap_or_else(|| gait_design::Planner::new(&self.robot));
        let planned = planner.plan(request, options, progress);
        idle().push(planner);
        Ok(planned?.gait)
    }

    fn plan_schedule(
        &self,
        request: &GaitRequest,
        contacts: &ContactSchedule,
        points: usize,
        progress: impl FnMut(&Iteration) -> ControlFlow<()>,
    ) -> Result<gait::Gait, PlanError> {
        let mut options = ScheduleOptions::default();
        options.program.points = points;
        Ok(gait_design::plan_schedule(&self.robot, request, contacts, &options, progress)?.gait)
    }

    /// A gait with the two steps from standing to it.
    fn with_lead(&self, mut gait: gait::Gait, go_on: impl Fn() -> bool) -> Result<gait::Gait, TransitionError> {
        let request = TransitionRequest::from_rest(&self.robot, &gait)?;
        let progress = |_: &Iteration| if go_on() { ControlFlow::Continue(()) } else { ControlFlow::Break(()) };
        let options = TransitionOptions::default();
        let lead = gait_design::plan_transition(&self.robot, &request, &options, self.limited(progress))?;
        gait.lead = lead.steps.to_vec();
        gait.validate().map_err(PlanError::from)?;
        Ok(gait)
    }

    /// The request with its open values chosen, the best of those tried within half the time limit, or nothing where
    /// none can be planned.
    fn choose(
        &self,
        request: &GaitRequest,
        open: gait_design::Open,
        options: &PlanOptions,
        go_on: impl Fn() -> bool,
    ) -> Option<GaitRequest> {
        let start = Instant::now();
        let within = |_: &Iteration| {
            if go_on() && start.elapsed() < self.time_limit / 2 {
                ControlFlow::Continue(())
            } else {
                ControlFlow::Break(())
            }
        };
        gait_design::choose(&self.robot, request, open, options, within)
    }

    /// The nearest request that can be planned. The search may take as long as a solve.
    fn nearest(
        &self,
        asked: &GaitRequest,
        options: &PlanOptions,
        go_on: impl Fn() -> bool,
    ) -> Option<gait_design::Nearest> {
        let start = Instant::now();
        gait_design::nearest(&self.robot, asked, options, || go_on() && start.elapsed() < self.time_limit)
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;

    fn planner() -> Planner {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config/robots/vision60");
        Planner::new(Robot::load(&folder).expect("the robot loads"), Duration::from_secs(60), true)
    }

    fn ask(change: impl FnOnce(&mut GenerateGaitRequest)) -> (GenerateGaitResponse, Option<Gait>) {
        let mut message = GenerateGaitRequest { behaviour: "amble".to_string(), ..Default::default() };
        change(&mut message);
        planner().generate(&message, || true, |_, _| ControlFlow::Continue(()))
    }

    #[test]
    fn amble_is_planned_and_its_message_is_a_gait() {
        let (response, gait) = ask(|_| {});
        assert!(response.success, "{}", response.message);
        assert_eq!(response.status, "converged");
        let gait = gait.expect("a gait").to_gait().expect("the message holds a gait");
        assert!((gait.speed_m_s() - 0.35).abs() < 1e-6, "{}", gait.speed_m_s());
        assert!(gait.solver.solve_time_s > 0.0 && gait.solver.iterations > 0);
    }

    #[test]
    fn what_cannot_be_planned_is_answered_with_the_reason() {
        let (out_of_range, none) = ask(|m| m.speed_m_s = Some(5.0).into());
        assert!(!out_of_range.success && none.is_none());
        assert_eq!(out_of_range.status, ports::INVALID_REQUEST);
        assert!(out_of_range.message.contains("speed_m_s is 5"), "{}", out_of_range.message);
        assert!(
            out_of_range.message.contains("nearest request that can be planned: speed_m_s 2 m/s"),
            "{}",
            out_of_range.message
        );
        assert_eq!(out_of_range.binding_constraints, ["speed_m_s"]);
        assert_eq!(out_of_range.nearest_fields, ["speed_m_s"]);
        let [speed] = out_of_range.nearest_values[..] else { panic!("{:?}", out_of_range.nearest_values) };
        assert!(speed > 0.35 && speed < 5.0, "{speed}");
        let (as_proposed, gait) = ask(|m| m.speed_m_s = Some(speed).into());
        assert!(as_proposed.success && gait.is_some(), "the proposal is planned: {}", as_proposed.message);
        assert!(as_proposed.binding_constraints.is_empty() && as_proposed.nearest_fields.is_empty());

        let (not_a_number, _) = ask(|m| m.height_m = Some(f64::NAN).into());
        assert_eq!(not_a_number.status, ports::INVALID_REQUEST);
        assert!(not_a_number.message.contains("height_m is NaN"), "{}", not_a_number.message);

        let (unknown, _) = ask(|m| m.behaviour = "moonwalk".to_string());
        assert_eq!(unknown.status, ports::INVALID_REQUEST);
        assert!(unknown.message.contains("gait1"), "the known names: {}", unknown.message);
    }

    #[test]
    fn an_answer_does_not_depend_on_what_was_asked_before() {
        let planner = planner();
        let go_on = |_: &Iteration, _| ControlFlow::Continue(());
        let ask = |planner: &Planner, message: &GenerateGaitRequest| {
            let (response, gait) = planner.generate(message, || true, go_on);
            let mut gait = gait.unwrap_or_else(|| panic!("{}", response.message));
            gait.solver.solve_time_s = 0.0;
            gait
        };
        let named = |name: &str| GenerateGaitRequest { behaviour: name.to_string(), ..Default::default() };
        let uphill = GenerateGaitRequest { slope_rad: Some(0.08).into(), ..named("amble") };
        let refused = GenerateGaitRequest { half_width_m: Some(0.5).into(), ..named("amble") };
        let fresh = [named("gait3"), uphill.clone(), named("amble")].map(|message| ask(&self::planner(), &message));
        assert!(planner.generate(&refused, || false, go_on).1.is_none());
        let used = [named("gait3"), uphill, named("amble")].map(|message| ask(&planner, &message));
        assert_eq!(used, fresh);
        assert_eq!(ask(&planner, &named("gait3")), fresh[0]);
        assert_eq!(planner.idle.lock().unwrap().len(), 1, "one planner was enough");
    }

    #[test]
    fn slopes_lean_and_reference_reach_the_plan() {
        let (uphill, gait) = ask(|m| {
            m.slope_rad = Some(0.1).into();
            m.friction = Some(0.5).into();
            m.torque_limit_nm = vec![48.0, 49.0, 47.0];
        });
        assert!(uphill.success, "{}", uphill.message);
        let gait = gait.expect("a gait").to_gait().expect("the message holds a gait");
        assert_eq!(gait.request["slope_rad"], 0.1);
        assert_eq!(gait.request["friction"], 0.5);
        assert_eq!(gait.request["torque_limit_nm"], serde_json::json!([48.0, 49.0, 47.0]));
        let (_, sagging) = ask(|m| m.reference = "planned_joints".into());
        let sagging = sagging.expect("a gait").to_gait().expect("the message holds a gait");
        assert_eq!(sagging.reference_coefficients_rad, sagging.coefficients_rad);
        let (out_of_range, _) = ask(|m| m.torque_limit_nm = vec![50.0, 50.0, 2000.0]);
        assert_eq!(out_of_range.status, ports::INVALID_REQUEST);
        assert_eq!(out_of_range.binding_constraints, ["torque_limit_nm[knee]"]);
    }

    #[test]
    fn a_stable_gait_is_chosen_where_width_and_duration_are_open() {
        let certificate =
            |gait: Option<Gait>| gait.expect("a gait").to_gait().unwrap().certificate.expect("is certified");
        let (own, gait) = ask(|_| {});
        let before = certificate(gait);
        assert!(own.stable && own.points == 11 && own.largest_multiplier == before.largest_multiplier);
        let (stable, gait) = ask(|m| m.stable = true);
        let after = certificate(gait);
        assert!(stable.stable && after.stable && stable.message.contains("stable by itself"), "{}", stable.message);
        assert!(stable.largest_multiplier < 0.9 && stable.largest_multiplier < before.largest_multiplier);
        let (fine, gait) = ask(|m| m.points = 21);
        assert_eq!((fine.points, certificate(gait).points), (21, 21));
        let (refused, _) = ask(|m| m.points = 12);
        assert!(refused.message.contains("points is 12, expected an odd number"), "{}", refused.message);
    }

    #[test]
    fn a_contact_schedule_and_a_lead_are_in_the_gait_that_is_published() {
        let (crawls, gait) = ask(|m| {
            m.schedule = "crawl".into();
            m.step_duration_s = Some(0.4).into();
            m.speed_m_s = Some(0.1).into();
            m.clearance_m = Some(0.08).into();
        });
        assert!(crawls.success && crawls.gait == "amble_crawl", "{}", crawls.message);
        let gait = gait.expect("a gait").to_gait().expect("the message holds a gait");
        assert_eq!(gait.cycle.len(), 4, "one leg after another");
        assert!(gait.cycle.iter().all(|domain| domain.stands.iter().filter(|stands| **stands).count() == 3));
        let (leads, gait) = ask(|m| m.from_rest = true);
        assert!(leads.success && leads.stable && leads.message.contains("a lead from standing"), "{}", leads.message);
        let gait = gait.expect("a gait").to_gait().expect("the message holds a gait");
        assert_eq!((gait.lead.len(), gait.cycle.len()), (2, 0));
        let (too_fast, none) = ask(|m| {
            m.schedule = "crawl".into();
            m.speed_m_s = Some(2.0).into();
        });
        assert!(!too_fast.success && none.is_none() && !too_fast.message.is_empty(), "{too_fast:?}");
        println!("{too_fast:?}");
    }

    #[test]
    fn a_caller_can_stop_the_solver() {
        let message = GenerateGaitRequest { behaviour: "amble".to_string(), ..Default::default() };
        let mut seen = 0;
        let (response, _) = planner().generate(
            &message,
            || true,
            |_, _| {
                seen += 1;
                if seen == 2 { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
            },
        );
        assert!(!response.success);
        assert_eq!((response.status.as_str(), seen), ("cancelled", 2));
    }
}
