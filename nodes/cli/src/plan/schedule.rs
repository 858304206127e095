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
    /// Which legs swing together; the gait file has the stride's phases as its cycle, named BEHAVIOUR_SCHEDULE. T is
    /// a step's duration: one leg's in the crawl, else two legs'. The full-order program: a tenth of a second to some
    #[arg(
        long,
        value_enum,
        conflicts_with_all = ["table", "stable", "from_rest", "to_rest", "stability", "reference"]
    )]
    schedule: Option<ScheduleArgument>,
    /// With --schedule trot or crawl: share of T in which all four legs stand, after each step, 0.05 to 0.6
    #[arg(long, value_name = "SHARE", requires = "schedule", allow_negative_numbers = true)]
    four_leg_share: Option<f64>,
}

#[derive(Clone, Copy, clap::ValueEnum)]
enum ScheduleArgument {
    /// The legs of a diagonal
    Trot,
    /// One leg at a time: rear left, front left, rear right, front right
    Crawl,
    /// The legs of a side
    Pace,
    /// The legs of an end
    Bound,
}

impl ScheduleArgument {
    fn name(self) -> &'static str {
        match self {
            Self::Trot => "trot",
            Self::Crawl => "crawl",
            Self::Pace => "pace",
            Self::Bound => "bound",
        }
    }
}

impl ScheduleArguments {
    /// The schedule that is asked for and its name, if one is.
    pub fn contacts(&self) -> Result<Option<(ContactSchedule, &'static str)>> {
        let Some(schedule) = self.schedule else { return Ok(None) };
        let four_leg_share = self.four_leg_share.unwrap_or(0.0);
        let contacts = match schedule {
            ScheduleArgument::Trot => ContactSchedule::Trot { four_leg_share },
            ScheduleArgument::Crawl => ContactSchedule::Crawl { four_leg_share },
            ScheduleArgument::Pace => ContactSchedule::Pace,
            ScheduleArgument::Bound => ContactSchedule::Bound,
        };
        if self.four_leg_share.is_some() && matches!(contacts, ContactSchedule::Pace | ContactSchedule::Bound) {
            bail!("--four-leg-share is for the trot and the crawl: the {} has no phase on four legs", schedule.name());
        }
        Ok(Some((contacts, schedule.name())))
    }
}

/// Plans one gait of a contact schedule, writes it and reports it.
pub fn one(
    arguments: &Arguments,
    robot: &robot::Robot,
    request: GaitRequest,
    (contacts, schedule): (ContactSchedule, &str),
    file: Option<&Path>,
) -> Result<()> {
    if arguments.verify {
        bail!(
            "--verify simulates the trot's step: every plan with --schedule is looked at between the program's points, \
             and `tandem simulate FILE` walks it"
        );
    }
    let request = GaitRequest { behaviour: format!("{}_{schedule}", request.behaviour), ..request };
    let plan = planned(arguments, robot, &request, &contacts)?;
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

/// Plans and states the wall time.
fn planned(
    arguments: &Arguments,
    robot: &robot::Robot,
    request: &GaitRequest,
    contacts: &ContactSchedule,
) -> Result<SchedulePlan> {
    let start = Instant::now();
    let progress = Progress::begin(&format!("planning {}", request.behaviour));
    let mut options = ScheduleOptions::default();
    options.program.points = arguments.points;
    let mut unwritable = None;
    let report = |i: &nlp::Iteration| {
        unwritable = super::say_iteration(&progress, i, arguments.verbose).err();
        if unwritable.is_none() { ControlFlow::Continue(()) } else { ControlFlow::Break(()) }
    };
    let planned = plan_schedule(robot, request, contacts, &options, report);
    if let Some(unwritable) = unwritable {
        return Err(unwritable.into());
    }
    let mut plan = planned.with_context(|| format!("cannot plan {}", request.behaviour))?;
    plan.gait.solver.solve_time_s = start.elapsed().as_secs_f64();
    Ok(plan)
}
