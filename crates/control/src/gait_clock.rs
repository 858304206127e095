//! Time within a gait: it owns T and how fast the phase runs.

use crate::prepared_gait::Instant;
use crate::step::{LEAD_STEPS, Step};
use crate::{Config, JOINTS, PreparedGait};
use std::time::Duration;

/// Rounding in now − start must not put a switch one cycle late.
const SWITCH_TOLERANCE: f64 = 1e-9;

/// Time within the gait. Switches lie at `start` + `base_s` + k T, so that a step that is no multiple of the control
/// period carries its remainder over exactly, for any number of steps. Where T changes, `base_s` makes up for it.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct GaitClock {
    pub start: Duration,
    /// T of the step now walked, s.
    pub period_s: f64,
    /// From `start` to the first instant of the gait now walked, s, as if all of its steps so far had taken `period_s`.
    pub base_s: f64,
    /// What the phase gained by running faster than 1 / T, in seconds of the gait's own time.
    pub gained_s: f64,
    /// Steps walked before that instant.
    pub base_index: u64,
    /// Steps of the gait now walked that have ended.
    pub steps: u64,
    /// What continuity at a change of gait, or at a switch of a lead, asks for: old minus new plan at the switch.
    pub offset: Option<Offset>,
    /// It began out of standing: the motion grows to the whole gait's ([`GaitClock::growth`]).
    pub grows: bool,
    /// It began with the gait's lead, out of standing or out of another gait.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub leads: bool,
    /// Steps walked before that lead.
    #[serde(default, skip_serializing_if = "is_none")]
    pub before_lead: u64,
}

/// Whether a walk had no steps before its lead, as out of standing.
pub(crate) fn is_none(steps: &u64) -> bool {
    *steps == 0
}

/// A jump of the plan.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Offset {
    pub position_rad: [f64; JOINTS],
    pub velocity_rad_s: [f64; JOINTS],
}

impl Offset {
    /// Where `new` takes over from `old` at the beginning of a step.
    pub fn between(old: &PreparedGait, new: &PreparedGait, step: Step) -> Self {
        Self::of(&old.at_step(step, 0.0), &new.at_step(step, 0.0))
    }

    /// Where the lead of `new` takes over from `old`, at the beginning of its stride.
    pub fn into_lead(old: &PreparedGait, new: &PreparedGait) -> Self {
        Self::of(&old.at_step(Step::Cycle(0), 0.0), &new.at_step(Step::Lead(0), 0.0))
    }

    fn of(a: &Instant, b: &Instant) -> Self {
        Self {
            position_rad: std::array::from_fn(|j| a.position_rad[j] - b.position_rad[j]),
            velocity_rad_s: std::array::from_fn(|j| a.velocity_rad_s[j] - b.velocity_rad_s[j]),
        }
    }

    /// Whether it can be smoothed out while the robot walks on.
    pub fn is_small(&self, config: &Config) -> bool {
        let within = |d: &[f64; JOINTS], limit: f64| d.iter().all(|d| d.abs() <= limit);
        within(&self.position_rad, config.gait_change_position_rad)
            && within(&self.velocity_rad_s, config.gait_change_velocity_rad_s)
    }
}

/// Whether a walk of `old` goes over to `new` at any switch; else it stops, stands, and begins again with it.
pub fn may_follow(old: &PreparedGait, new: &PreparedGait, config: &Config) -> bool {
    let is_small = |index| Offset::between(old, new, Step::Cycle(index)).is_small(config);
    leads_out_of(old, new, config) || (old.has_schedule_of(new) && (0..old.stride_steps()).all(is_small))
}

/// Whether the lead of `new` begins where a stride of `old` does.
pub(crate) fn leads_out_of(old: &PreparedGait, new: &PreparedGait, config: &Config) -> bool {
    new.has_lead()
        && !new.leads_out_of_standing()
        && new.stands(Step::Lead(0)) == old.stands(Step::Cycle(0))
        && Offset::into_lead(old, new).is_small(config)
}

/// How much of the gait's motion about its middle posture is walked, and the rate of that.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Growth {
    /// From [`Config::start_share`] to 1.
    pub share: f64,
    /// 1/s.
    pub rate: f64,
}

impl Growth {
    /// The whole gait.
    pub const WHOLE: Self = Self { share: 1.0, rate: 0.0 };

    pub fn is_whole(self) -> bool {
        self.share >= 1.0
    }
}

/// Where in a step the gait is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Place {
    pub step: Step,
    /// Since the last switch, in the gait's own time, s.
    pub t_s: f64,
    /// t / T.
    pub phase: f64,
    /// T, s.
    pub period_s: f64,
    pub growth: Growth,
    /// What a change of gait left, to be smoothed out over this step.
    pub offset: Option<Offset>,
}

impl GaitClock {
    /// At the gait's first instant.
    pub fn new(start: Duration, gait: &PreparedGait, grows: bool) -> Self {
        let period_s = gait.duration_s(Step::Cycle(0));
        Self {
            start,
            period_s,
            base_s: 0.0,
            gained_s: 0.0,
            base_index: 0,
            steps: 0,
            offset: None,
            grows,
            leads: false,
            before_lead: 0,
        }
    }

    /// At the first instant of the gait's lead, or where it has none, of the gait, grown from a share of it.
    pub fn out_of_standing(start: Duration, gait: &PreparedGait) -> Self {
        let leads = gait.leads_out_of_standing();
        let period_s = gait.duration_s(Step::number(0, leads, gait.stride_steps()));
        Self { period_s, leads, ..Self::new(start, gait, !leads) }
    }

    fn elapsed_s(&self, now: Duration) -> f64 {
        now.saturating_sub(self.start).as_secs_f64() - self.base_s + self.gained_s
    }

    /// The present step of `gait`, which is walked. Steps go on in turn over a change of gait.
    pub fn step(&self, gait: &PreparedGait) -> Step {
        Step::number(self.since_lead(), self.leads, gait.stride_steps())
    }

    /// Whether the present step is one of the lead's.
    pub fn is_leading(&self) -> bool {
        self.leads && self.since_lead() < LEAD_STEPS as u64
    }

    /// Steps since the lead began, or without one, since walking began. A recording may say anything.
    fn since_lead(&self) -> u64 {
        self.step_index().saturating_sub(self.before_lead)
    }

    /// Steps since walking began.
    pub fn step_index(&self) -> u64 {
        self.base_index + self.steps
    }

    /// A robot that stands has no speed and its feet side by side; asked for the whole gait at once, its drives would
    /// have to make up for both.
    pub fn growth(&self, config: &Config, now: Duration) -> Growth {
        let (first, duration_s) = (config.start_share, config.start_growth_s);
        let x = now.saturating_sub(self.start).as_secs_f64() / duration_s;
        if !self.grows || x >= 1.0 {
            return Growth::WHOLE;
        }
        let left = 1.0 - first;
        Growth { share: first + left * x * x * (3.0 - 2.0 * x), rate: left * 6.0 * x * (1.0 - x) / duration_s }
    }

    pub fn place(&self, gait: &PreparedGait, config: &Config, now: Duration) -> Place {
        let period_s = self.period_s;
        let t_s = (self.elapsed_s(now) - self.steps as f64 * period_s).clamp(0.0, period_s);
        Place {
            step: self.step(gait),
            t_s,
            phase: t_s / period_s,
            period_s,
            growth: self.growth(config, now),
            offset: self.offset,
        }
    }

    /// t / T as it is published.
    pub fn phase(&self, now: Duration) -> f64 {
        ((self.elapsed_s(now) - self.steps as f64 * self.period_s) / self.period_s).clamp(0.0, 1.0)
    }

    /// In the last `dt_s` the phase ran `rate` times as fast as 1 / T.
    pub fn run(&mut self, rate: f64, dt_s: f64) {
        self.gained_s += (rate - 1.0) * dt_s;
    }

    /// Follows time over switches of `gait`; whether there was one.
    pub fn follow(&mut self, gait: &PreparedGait, now: Duration) -> bool {
        let steps = (self.elapsed_s(now) / self.period_s + SWITCH_TOLERANCE).floor().max(0.0) as u64;
        // Steps that may differ in duration end one by one.
        if self.is_leading() || gait.has_cycle() {
            let switched = steps > self.steps;
            if switched {
                self.end_step(gait);
            }
            return switched;
        }
        let switched = steps != self.steps;
        if switched {
            self.steps = steps;
            self.offset = None;
        }
        switched
    }

    /// To the next step, which may take another time than the one that ended.
    fn end_step(&mut self, gait: &PreparedGait) {
        let ended = self.step(gait);
        self.steps += 1;
        let next = self.step(gait);
        let period_s = gait.duration_s(next);
        self.base_s += self.steps as f64 * (self.period_s - period_s);
        self.period_s = period_s;
        self.offset = ended.is_lead().then(|| Offset::of(&gait.at_step(ended, 1.0), &gait.at_step(next, 0.0)));
    }

    /// Whether another gait may be taken at the switch that was reached: not within a lead or what it left.
    pub fn may_change(&self, config: &Config, now: Duration) -> bool {
        self.growth(config, now).is_whole() && !self.is_leading() && self.offset.is_none()
    }

    /// At a switch: the lead of another gait from here on, whose plan lies `offset` from the old gait's.
    pub fn change_by_lead(&mut self, new: &PreparedGait, offset: Offset) {
        (self.leads, self.before_lead) = (true, self.step_index());
        self.change(new, offset);
    }

    /// At a switch: another gait from here on, whose plan lies `offset` from the old one's.
    pub fn change(&mut self, new: &PreparedGait, offset: Offset) {
        self.base_s += self.steps as f64 * self.period_s;
        self.base_index += self.steps;
        self.steps = 0;
        self.period_s = new.duration_s(self.step(new));
        self.offset = Some(offset);
    }
}
