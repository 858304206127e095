//! `tandem plan --schedule`: gaits of other contact schedules than the trot's two steps.

use super::Arguments;
use crate::output;
use crate::progress::Progress;
use anyhow::{Context, Result, bail};
use gait_design::{ContactSchedule, GaitRequest, ScheduleOptions, SchedulePlan, plan_schedule};
use std::ops::ControlFlow;
use std::path::Path;
use std::time::Instant;

/// The contact schedule, where another than the trot of two steps is asked for.
#[derive(clap::Args)]
pub struct ScheduleArguments {
    /// Which legs swing together: those of a diagonal (trot), of a side (pace) or of an end (bound), or one at a time,
    /// rear left, front left, rear right, front right (crawl). The gait file has the stride's phases as its cycle,
    /// named BEHAVIOUR_SCHEDULE. T is a step's duration: one leg's in the crawl, else two legs'. The full-order
    /// program: a tenth of a second to some
    #[arg(
        long,
        value_parser = clap::builder::PossibleValuesParser::new(ContactSchedule::NAMES),
        conflicts_with_all = ["table", "stable", "from_rest", "from", "to_rest", "stability", "reference"]
    )]
    schedule: Option<String>,
    /// With --schedule trot or crawl: share of T in which all four legs stand, after each step, 0.05 to 0.6
    #[arg(long, value_name = "SHARE", requires = "schedule", allow_negative_numbers = true)]
    four_leg_share: Option<f64>,
    /// With --schedule crawl: up stairs of this rise and depth, m, one a stride, every toe in the middle of its tread:
    /// they give the slope and the speed. Takes ten seconds or more; `tandem simulate FILE --staircase` walks it, and
    /// nothing sees the stairs: sooner or later a toe misses one
    #[arg(
        long,
        value_names = ["RISE", "RUN"],
        num_args = 2,
        requires = "schedule",
        conflicts_with_all = ["slope", "speed"],
        allow_negative_numbers = true
    )]
    stairs: Option<Vec<f64>>,
}

impl ScheduleArguments {
    /// The schedule that is asked for, if one is.
    pub fn contacts(&self) -> Result<Option<ContactSchedule>> {
        let named = |name: &String| ContactSchedule::named(name, self.four_leg_share.unwrap_or(0.0));
        Ok(self.schedule.as_ref().map(named).transpose()?)
    }
}

/// Plans one gait of a contact schedule, writes it and reports it.
pub fn one(
    arguments: &Arguments,
    robot: &robot::Robot,
    request: GaitRequest,
    contacts: ContactSchedule,
    file: Option<&Path>,
) -> Result<()> {
    if arguments.verify {
        bail!(
            "--verify simulates the trot's step: every plan with --schedule is looked at between the program's points, \
             and `tandem simulate FILE` walks it"
        );
    }
    let mut request = GaitRequest { behaviour: format!("{}_{}", request.behaviour, contacts.name()), ..request };
    let mut options = ScheduleOptions::default();
    options.program.points = arguments.points;
    if let Some(stairs) = arguments.schedule.stairs.as_deref() {
        up_stairs(&mut request, &contacts, stairs)?;
        options.treads = true;
    }
    let plan = planned(arguments, robot, &request, &contacts, &options)?;
    if let Some(file) = file {
        output::write_file(file, plan.gait.to_json().as_bytes())?;
    }
    let points: usize = plan.points.iter().map(Vec::len).sum();
    if arguments.json {
        let mut reported = super::reported(&plan.gait, &request, points, file);
        reported["contact_schedule"] = plan.gait.request["contact_schedule"].clone();
        output::json(&reported)?;
        Ok(())
    } else {
        super::say_row(&plan.gait, points, file)
    }
}

/// The slope and the speed at which each leg climbs a stair a stride.
fn up_stairs(request: &mut GaitRequest, contacts: &ContactSchedule, stairs: &[f64]) -> Result<()> {
    let ContactSchedule::Crawl { .. } = contacts else {
        bail!("--stairs is for the crawl: expected --schedule crawl");
    };
    let &[rise_m, run_m] = stairs else { bail!("--stairs has {} numbers, expected RISE RUN", stairs.len()) };
    for (name, value_m, most_m) in [("rise", rise_m, 0.3), ("depth", run_m, 1.0)] {
        if !(value_m > 0.0 && value_m <= most_m) {
            bail!("--stairs: the {name} is {value_m} m, expected above 0, to {most_m} m");
        }
    }
    request.slope_rad = rise_m.atan2(run_m);
    // Four steps a stride.
    request.speed_m_s = rise_m.hypot(run_m) / (4.0 * request.step_duration_s);
    Ok(())
}

/// Plans and states the wall time.
fn planned(
    arguments: &Arguments,
    robot: &robot::Robot,
    request: &GaitRequest,
    contacts: &ContactSchedule,
    options: &ScheduleOptions,
) -> Result<SchedulePlan> {
    let start = Instant::now();
    let progress = Progress::begin(&format!("planning {}", request.behaviour));
    let mut unwritable = None;
    let report = |i: &nlp::Iteration| {
        unwritable = super::say_iteration(&progress, i, arguments.verbose).err();
        if unwritable.is_none() { ControlFlow::Continue(()) } else { ControlFlow::Break(()) }
    };
    let planned = plan_schedule(robot, request, contacts, options, report);
    if let Some(unwritable) = unwritable {
        return Err(unwritable.into());
    }
    let mut plan = planned.with_context(|| format!("cannot plan {}", request.behaviour))?;
    plan.gait.solver.solve_time_s = start.elapsed().as_secs_f64();
    Ok(plan)
}
