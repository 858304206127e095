//! Messages to and from the planner's own types: the one place where the two meet.

use gait_design::{
    ContactSchedule, GaitRequest, Nearest, Open, PlanError, ProgramSettings, Reference, RequestError, TransitionError,
    step_duration_from_step_frequency, step_duration_from_stride_frequency,
};
use robot::Robot;
use tandem_msgs::{Gait, GenerateGaitFeedback, GenerateGaitRequest, GenerateGaitResponse, Optional, SolverReport};

/// `status` of an answer to an invalid request.
pub const INVALID_REQUEST: &str = "invalid_request";
/// `status` of an answer to a request that came while too many others waited.
pub const BUSY: &str = "busy";
/// `status` of an answer to a request that came while the node was not active.
pub const INACTIVE: &str = "inactive";

/// The names of what the tracking law may follow; empty means the first.
const REFERENCES: [(&str, Reference); 3] = [
    ("compensated", Reference::Compensated),
    ("planned_joints", Reference::PlannedJoints),
    ("in_program", Reference::InProgram),
];

/// What a message asks for.
#[derive(Clone, Debug, PartialEq)]
pub struct Asked {
    /// The complete request.
    pub request: GaitRequest,
    /// What the tracking law is to follow.
    pub reference: Reference,
    /// Points of the program.
    pub points: usize,
    /// What is left to the planner, where it is to choose.
    pub open: Option<Open>,
    /// The contact schedule, where it is another than the two steps of a trot.
    pub contacts: Option<ContactSchedule>,
    /// The two steps from standing to the gait are to be planned as well.
    pub from_rest: bool,
}

/// What a message asks for: the behaviour's and the robot's own values where it gives none.
///
/// # Errors
/// One sentence for people that names the field, its value and what was expected.
pub fn request(message: &GenerateGaitRequest, robot: &Robot) -> Result<Asked, String> {
    let mut request = GaitRequest::named(&message.behaviour, robot).map_err(|error| error.to_string())?;
    let given = |field: &str, value: &Optional<f64>| value.value().map_err(|error| format!("{field}: {error}"));
    let rates = [
        ("step_duration_s", given("step_duration_s", &message.step_duration_s)?),
        ("step_frequency_hz", given("step_frequency_hz", &message.step_frequency_hz)?),
        ("stride_frequency_hz", given("stride_frequency_hz", &message.stride_frequency_hz)?),
    ];
    let named: Vec<&str> = rates.iter().filter(|(_, value)| value.is_some()).map(|(field, _)| *field).collect();
    if named.len() > 1 {
        return Err(format!("{} are given: expected at most one of them", named.join(" and ")));
    }
    for (field, value) in rates {
        let Some(value) = value else { continue };
        // A frequency of 0 would become an infinite duration, which would be refused under another name.
        if !(value > 0.0 && value.is_finite()) {
            return Err(format!("{field} is {value}, expected a number above 0"));
        }
        request.step_duration_s = match field {
            "step_frequency_hz" => step_duration_from_step_frequency(value),
            "stride_frequency_hz" => step_duration_from_stride_frequency(value),
            _ => value,
        };
    }
    for (field, value, target) in [
        ("clearance_m", &message.clearance_m, &mut request.clearance_m),
        ("speed_m_s", &message.speed_m_s, &mut request.speed_m_s),
        ("height_m", &message.height_m, &mut request.height_m),
        ("half_width_m", &message.half_width_m, &mut request.half_width_m),
        ("slope_rad", &message.slope_rad, &mut request.slope_rad),
        ("sideways_slope_rad", &message.sideways_slope_rad, &mut request.sideways_slope_rad),
        ("torso_pitch_rad", &message.torso_pitch_rad, &mut request.torso_pitch_rad),
        ("torso_roll_rad", &message.torso_roll_rad, &mut request.torso_roll_rad),
        ("friction", &message.friction, &mut request.friction),
    ] {
        if let Some(value) = given(field, value)? {
            *target = value;
        }
    }
    // 0, of a message without them too, is a behaviour's own.
    request.lateral_speed_m_s = message.lateral_speed_m_s;
    request.yaw_rate_rad_s = message.yaw_rate_rad_s;
    match message.torque_limit_nm.as_slice() {
        [] => {}
        &[roll, pitch, knee] => request.torque_limit_nm = [roll, pitch, knee],
        others => {
            return Err(format!(
                "torque_limit_nm has {} entries, expected 3 (hip roll, hip pitch, knee) or none",
                others.len()
            ));
        }
    }
    let open = Open { step_duration: named.is_empty(), half_width: message.half_width_m.0.is_empty() };
    let contacts = contacts(message)?;
    if let Some(contacts) = contacts {
        request.behaviour = format!("{}_{}", request.behaviour, contacts.name());
    }
    Ok(Asked {
        request,
        contacts,
        from_rest: message.from_rest,
        reference: reference(&message.reference)?,
        points: match message.points {
            0 => ProgramSettings::default().points,
            points => points as usize,
        },
        open: message.stable.then_some(open),
    })
}

/// The contact schedule that a message names. What the program for schedules does not do is refused beside it.
fn contacts(message: &GenerateGaitRequest) -> Result<Option<ContactSchedule>, String> {
    let (name, share) = (message.schedule.as_str(), message.four_leg_share);
    if name.is_empty() {
        return if share == 0.0 {
            Ok(None)
        } else {
            Err(format!("four_leg_share is {share} without a schedule: expected 0, or schedule trot or crawl"))
        };
    }
    for (field, is_given) in
        [("stable", message.stable), ("reference", !message.reference.is_empty()), ("from_rest", message.from_rest)]
    {
        if is_given {
            return Err(format!("{field} is given beside schedule \"{name}\": expected one of the two"));
        }
    }
    ContactSchedule::named(name, share).map(Some).map_err(|error| error.to_string())
}

fn reference(name: &str) -> Result<Reference, String> {
    if name.is_empty() {
        return Ok(Reference::default());
    }
    REFERENCES.iter().find(|(known, _)| *known == name).map(|(_, reference)| *reference).ok_or_else(|| {
        let known: Vec<&str> = REFERENCES.iter().map(|(known, _)| *known).collect();
        format!("reference \"{name}\" is unknown: expected one of {}, or nothing", known.join(", "))
    })
}

/// The answer that goes with a gait; its stamp is set when the gait is published.
#[must_use]
pub fn success(gait: &Gait) -> GenerateGaitResponse {
    let stable = if gait.stable { ", stable by itself" } else { "" };
    let certificate = match gait.points {
        0 => String::new(),
        points => format!(", {points} points, largest multiplier {:.3}{stable}", gait.largest_multiplier),
    };
    GenerateGaitResponse {
        success: true,
        status: gait.solver.status.clone(),
        message: format!(
            "{}: {} iterations in {:.3} s{}{}",
            gait.name,
            gait.solver.iterations,
            gait.solver.solve_time_s,
            certificate,
            if gait.lead.is_empty() { "" } else { ", with a lead from standing" }
        ),
        gait: gait.name.clone(),
        step_duration_s: gait.step_duration_s,
        step_length_m: gait.step_length_m,
        solver: gait.solver.clone(),
        points: gait.points,
        largest_multiplier: gait.largest_multiplier,
        landing_run_m: gait.landing_run_m,
        stable: gait.stable,
        ..Default::default()
    }
}

/// The answer without a gait.
#[must_use]
pub fn failure(status: &str, message: String) -> GenerateGaitResponse {
    GenerateGaitResponse { success: false, status: status.to_string(), message, ..Default::default() }
}

/// The answer to a request that was not planned, with the solver's report where the solver ran.
#[must_use]
pub fn plan_error(error: &PlanError, solve_time_s: f64) -> GenerateGaitResponse {
    let status = match error {
        PlanError::Request(_) => INVALID_REQUEST.to_string(),
        PlanError::Unreachable(_) => "unreachable".to_string(),
        PlanError::NotConverged { status, .. } => status.to_string(),
        PlanError::Unverified(_) => "unverified".to_string(),
        PlanError::Gait(_) => "unwalkable".to_string(),
        // The robot's description or the program itself is at fault, not the request.
        PlanError::Robot(_) | PlanError::Problem(_) | PlanError::Settings(_) | PlanError::Certificate(_) => {
            "internal_error".to_string()
        }
    };
    let mut response = failure(&status, error.to_string());
    if let PlanError::Request(RequestError::OutOfRange { field, .. }) = error {
        response.binding_constraints = vec![(*field).to_string()];
    }
    if let PlanError::NotConverged { iterations, worst, log, .. } = error {
        response.binding_constraints = vec![worst.clone()];
        let last = log.last();
        response.solver = SolverReport {
            status,
            iterations: *iterations,
            solve_time_s,
            max_violation: last.map_or(0.0, |iteration| iteration.max_violation),
            objective: last.map_or(0.0, |iteration| iteration.objective),
            worst_constraint: worst.clone(),
        };
    }
    response
}

/// The answer to a request whose gait was planned, and not the steps that lead to it.
#[must_use]
pub fn lead_error(error: &TransitionError, solve_time_s: f64) -> GenerateGaitResponse {
    let mut response = match error {
        TransitionError::Plan(error) => plan_error(error, solve_time_s),
        TransitionError::Start(_) | TransitionError::Missed(_) => failure("infeasible", error.to_string()),
    };
    response.message = format!("the two steps from standing to the gait: {}", response.message);
    response
}

/// Puts the nearest request that can be planned into an answer without a gait.
pub fn add_nearest(response: &mut GenerateGaitResponse, nearest: &Nearest) {
    response.message += &format!("; the nearest request that can be planned: {nearest}");
    // A value out of its range is what stands in the way, whatever the gait at the range's end has reached.
    if response.status != INVALID_REQUEST && !nearest.binding.is_empty() {
        response.binding_constraints.clone_from(&nearest.binding);
    }
    response.nearest_fields = nearest.changed.iter().map(|changed| changed.field.to_string()).collect();
    response.nearest_values = nearest.changed.iter().map(|changed| changed.works).collect();
}

/// The last iteration of a solve that found a gait, for those who watch.
#[must_use]
pub fn last_feedback(report: &SolverReport) -> GenerateGaitFeedback {
    GenerateGaitFeedback {
        iteration: report.iterations,
        objective: report.objective,
        max_violation: report.max_violation,
        elapsed_s: report.solve_time_s,
    }
}

/// One iteration of the solver, for those who watch.
#[must_use]
pub fn feedback(iteration: &nlp::Iteration, elapsed: std::time::Duration) -> GenerateGaitFeedback {
    GenerateGaitFeedback {
        iteration: iteration.number,
        objective: iteration.objective,
        max_violation: iteration.max_violation,
        elapsed_s: elapsed.as_secs_f64(),
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;

    fn robot() -> Robot {
        Robot::load(&Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config/robots/vision60"))
            .expect("the robot loads")
    }

    fn message(behaviour: &str) -> GenerateGaitRequest {
        GenerateGaitRequest { behaviour: behaviour.to_string(), ..Default::default() }
    }

    #[test]
    fn an_empty_request_is_the_behaviours_own() {
        let robot = robot();
        let amble = request(&message("amble"), &robot).unwrap();
        let own = GaitRequest::named("amble", &robot).unwrap();
        let expected = Asked {
            request: own,
            reference: Reference::Compensated,
            points: 11,
            open: None,
            contacts: None,
            from_rest: false,
        };
        assert_eq!(amble, expected);
    }

    #[test]
    fn given_values_replace_the_behaviours() {
        let mut m = message("gait1");
        m.step_frequency_hz = Some(2.5).into();
        m.clearance_m = Some(0.08).into();
        m.speed_m_s = Some(0.1).into();
        m.height_m = Some(0.52).into();
        m.half_width_m = Some(0.24).into();
        m.slope_rad = Some(0.03).into();
        m.sideways_slope_rad = Some(-0.04).into();
        m.torso_pitch_rad = Some(0.05).into();
        m.torso_roll_rad = Some(-0.06).into();
        m.friction = Some(0.5).into();
        m.torque_limit_nm = vec![41.0, 42.0, 43.0];
        m.reference = "in_program".into();
        m.points = 21;
        m.stable = true;
        m.lateral_speed_m_s = -0.1;
        m.yaw_rate_rad_s = 0.2;
        m.from_rest = true;
        // Every field by name: a new one is noticed here.
        let expected = GaitRequest {
            behaviour: "gait1".into(),
            step_duration_s: 0.4,
            clearance_m: 0.08,
            speed_m_s: 0.1,
            lateral_speed_m_s: -0.1,
            yaw_rate_rad_s: 0.2,
            height_m: 0.52,
            half_width_m: 0.24,
            slope_rad: 0.03,
            sideways_slope_rad: -0.04,
            torso_pitch_rad: 0.05,
            torso_roll_rad: -0.06,
            friction: 0.5,
            torque_limit_nm: [41.0, 42.0, 43.0],
        };
        let given = Open { step_duration: false, half_width: false };
        let expected = Asked {
            request: expected,
            reference: Reference::InProgram,
            points: 21,
            open: Some(given),
            contacts: None,
            from_rest: true,
        };
        assert_eq!(request(&m, &robot()).unwrap(), expected);
        m.half_width_m = None.into();
        assert_eq!(request(&m, &robot()).unwrap().open, Some(Open { step_duration: false, half_width: true }));
        let mut m = message("gait1");
        m.stride_frequency_hz = Some(2.5).into();
        assert_eq!(request(&m, &robot()).unwrap().request.step_duration_s, 0.2);
        m.schedule = "crawl".into();
        m.four_leg_share = 0.2;
        let crawl = request(&m, &robot()).unwrap();
        assert_eq!(crawl.contacts, Some(ContactSchedule::Crawl { four_leg_share: 0.2 }));
        assert_eq!(crawl.request.behaviour, "gait1_crawl");
    }

    #[test]
    fn wrong_requests_get_one_clear_sentence() {
        let robot = robot();
        type Change = fn(&mut GenerateGaitRequest);
        let cases: [(&str, Change); 14] = [
            ("behaviour \"moonwalk\" is unknown", |m| m.behaviour = "moonwalk".into()),
            ("step_duration_s and stride_frequency_hz are given: expected at most one", |m| {
                m.step_duration_s = Some(0.3).into();
                m.stride_frequency_hz = Some(2.0).into();
            }),
            ("step_frequency_hz is NaN, expected a number above 0", |m| m.step_frequency_hz = Some(f64::NAN).into()),
            ("stride_frequency_hz is 0, expected", |m| m.stride_frequency_hz = Some(0.0).into()),
            ("step_duration_s is inf, expected", |m| m.step_duration_s = Some(f64::INFINITY).into()),
            ("clearance_m: at most one value expected, got 2", |m| m.clearance_m = Optional(vec![0.1, 0.2])),
            ("torso_roll_rad: at most one value expected, got 2", |m| m.torso_roll_rad = Optional(vec![0.1, 0.2])),
            ("torque_limit_nm has 1 entries, expected 3 (hip roll, hip pitch, knee) or none", |m| {
                m.torque_limit_nm = vec![50.0];
            }),
            ("reference \"planned\" is unknown: expected one of compensated, planned_joints, in_program", |m| {
                m.reference = "planned".into();
            }),
            ("schedule \"gallop\" is unknown: expected one of trot, crawl, pace, bound", |m| {
                m.schedule = "gallop".into();
            }),
            ("four_leg_share is 0.2 without a schedule", |m| m.four_leg_share = 0.2),
            ("four_leg_share is 0.2, and a pace has no phase on four legs", |m| {
                (m.schedule, m.four_leg_share) = ("pace".into(), 0.2);
            }),
            ("stable is given beside schedule \"crawl\": expected one of the two", |m| {
                (m.schedule, m.stable) = ("crawl".into(), true);
            }),
            ("from_rest is given beside schedule \"trot\"", |m| {
                (m.schedule, m.from_rest) = ("trot".into(), true);
            }),
        ];
        for (expected, change) in cases {
            let mut m = message("amble");
            change(&mut m);
            let error = request(&m, &robot).expect_err(expected);
            assert!(error.contains(expected), "{error:?} must say {expected:?}");
        }
    }
}
