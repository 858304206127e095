//! The balanced law: the paper's law on a reference that is reshaped by what is measured (docs/balance.md).
//!
//! The reference is the plan of the gait with its stance toes moved so that the body goes where it is commanded, its
//! swing toes placed where the body will be caught, and its step hurried where it could not be caught in time.
//! Below it the paper's law is unchanged: τ = kp (θ′ − q) + kd (dθ′/dt − q̇) + the plan's compensating torque.

mod drive;
mod ground;
mod reference;
mod report;
mod stance;
mod walk;

pub use crate::balance_config::{BalanceConfig, VelocityLimit};
pub use drive::{Velocity, VelocityCommand};
pub use report::BalanceReport;
pub(crate) use walk::{Balanced, Trouble};

use crate::gait_clock::is_none;
use crate::prepared_gait::Instant;
use crate::step::{LEAD_STEPS, Step};
use crate::{JOINTS, PreparedGait, of_leg};
use drive::{Drive, wrapped};
use estimator::Estimator;
use ground::Ground;
use nalgebra::{Vector2, Vector3};
use reference::{Planned, Shape, smooth};
use stance::{Stance, Turns};

/// The reference's rate is its change over this phase.
const STEP: f64 = 1e-3;
/// What a switch would make jump is faded out by this phase.
const FADED: f64 = 0.6;
/// A hurried step leaves this share of the joints' velocity limits.
const VELOCITY_SHARE: f64 = 0.9;

/// The balanced law's memory while it walks.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Balance {
    /// Hips over toes in the gait, m.
    height_m: f64,
    own_velocity: [f64; 2],
    /// Turning of the gait by itself, rad/s. Recordings that are older know of none.
    #[serde(default)]
    own_yaw_rad_s: f64,
    middle_rad: [f64; JOINTS],
    drive: Drive,
    ground: Ground,
    /// Steps that have ended.
    steps: u64,
    /// It began with the gait's lead, out of standing or out of another gait.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    leads: bool,
    /// Steps that had ended before that lead.
    #[serde(default, skip_serializing_if = "is_none")]
    before_lead: u64,
    phase: f64,
    /// dphase/dt, 1/s, and the most that the joints' velocities allow.
    rate_s: f64,
    fastest_s: f64,
    offsets_m: [[f64; 2]; 4],
    /// Joints at the end of the step before, until the new step has begun from them.
    ended_rad: Option<[f64; JOINTS]>,
    fade_rad: [f64; JOINTS],
    report: BalanceReport,
}

/// What one cycle sees.
#[derive(Clone, Copy, Debug)]
pub struct Cycle<'a> {
    /// The law's constants.
    pub config: &'a BalanceConfig,
    /// The gait that is walked.
    pub gait: &'a PreparedGait,
    /// Measured joints, rad.
    pub position_rad: &'a [f64; JOINTS],
    /// Their velocity limits, rad/s.
    pub velocity_limit_rad_s: &'a [f64; JOINTS],
    /// The base.
    pub estimate: &'a Estimator,
    /// Share of the gait's motion about its middle posture that is walked, from 0 to 1.
    pub share: f64,
    /// Since the last cycle, s.
    pub dt_s: f64,
}

impl Balance {
    /// The law at the beginning of a walk, on the ground that the toes stand on. `moving`: the robot already moves
    /// as the gait does (a simulator put it there), and stands on the ground as the law would have it.
    pub fn start(cycle: &Cycle, moving: bool) -> Self {
        let mut balance = Self {
            height_m: 1.0,
            own_velocity: [0.0; 2],
            own_yaw_rad_s: 0.0,
            middle_rad: [0.0; JOINTS],
            drive: Drive::new(&Velocity::default(), cycle.estimate),
            ground: Ground::default(),
            steps: 0,
            leads: !moving && cycle.gait.leads_out_of_standing(),
            before_lead: 0,
            phase: 0.0,
            rate_s: 0.0,
            fastest_s: f64::MAX,
            offsets_m: [[0.0; 2]; 4],
            ended_rad: None,
            fade_rad: [0.0; JOINTS],
            report: BalanceReport { pace: 1.0, ..BalanceReport::default() },
        };
        balance.adopt(cycle);
        if moving {
            balance.drive = Drive::new(&balance.own_velocity(), cycle.estimate);
        }
        let frames = balance.ground.frames(cycle.estimate);
        balance.ground.fit(cycle.config, &toes_m(cycle), &frames, 1.0);
        balance.ground.shift_at_once(cycle.config, balance.height_m, cycle.gait.rise());
        balance
    }

    /// Takes over what follows from a gait, or from its lead: at the start, and at a switch to another.
    pub fn adopt(&mut self, cycle: &Cycle) {
        let (config, gait) = (cycle.config, cycle.gait);
        let toe =
            |step: Step, s: f64, leg: usize| config.legs[leg].toe_m(&of_leg(&gait.at_step(step, s).position_rad, leg));
        let present = self.present_step(gait);
        let (step, count): (fn(usize) -> Step, _) =
            if present.is_lead() { (Step::Lead, LEAD_STEPS) } else { (Step::Cycle, gait.stride_steps()) };
        self.height_m = (0..4).map(|leg| config.legs[leg].hip_m().z - toe(step(0), 0.0, leg).z).sum::<f64>() / 4.0;
        // Stance toes go back as the body goes ahead, and turn the other way; a stride's steps undo their sway.
        let (mut moved, mut turned_rad, mut stride_s) = (Vector3::zeros(), 0.0, 0.0);
        for step in (0..count).map(step) {
            let stance = Stance::of(gait, step);
            let [begins, ends] = [0.0, 1.0].map(|s| std::array::from_fn(|leg| toe(step, s, leg)));
            let back = stance.legs().fold(stance.sum(&ends), |sum, leg| sum - begins[leg]);
            moved += back / stance.count() as f64;
            let [begun_rad, ended_rad] =
                [begins, ends].map(|toes| -stance.line(&toes)).map(|line| line.y.atan2(line.x));
            turned_rad -= wrapped(ended_rad - begun_rad);
            stride_s += gait.duration_s(step);
        }
        self.own_velocity = (-moved.xy() / stride_s).into();
        self.own_yaw_rad_s = turned_rad / stride_s;
        self.middle_rad = gait.middle_rad(present.is_lead());
        self.rate_s = 1.0 / gait.duration_s(present);
        self.fastest_s = f64::MAX;
    }

    /// Steps that have ended since the start.
    pub fn steps(&self) -> u64 {
        self.steps
    }

    /// Phase of the step, from 0 to 1.
    pub fn phase(&self) -> f64 {
        self.phase
    }

    /// The step of `gait` that is walked.
    pub fn present_step(&self, gait: &PreparedGait) -> Step {
        Step::number(self.steps.saturating_sub(self.before_lead), self.leads, gait.stride_steps())
    }

    /// The gait's own velocity, m/s: what is walked where nothing else is asked for.
    pub fn own_velocity(&self) -> Velocity {
        let [forward_m_s, left_m_s] = self.own_velocity;
        Velocity { forward_m_s, left_m_s, yaw_rad_s: self.own_yaw_rad_s }
    }

    /// Which legs are planned to swing.
    pub fn swings(&self, gait: &PreparedGait) -> [bool; 4] {
        Stance::of(gait, self.present_step(gait)).swings()
    }

    /// What the last cycle did.
    pub fn report(&self) -> &BalanceReport {
        &self.report
    }

    /// Hips over toes in the gait, m.
    pub fn height_m(&self) -> f64 {
        self.height_m
    }

    /// Moves the phase on; true at a switch, where the legs change roles.
    pub fn advance(&mut self, cycle: &Cycle) -> bool {
        self.phase += self.rate_s * cycle.dt_s;
        if self.phase < 1.0 {
            return false;
        }
        // Less than a cycle is carried over.
        self.phase = (self.phase - 1.0).min(self.rate_s * cycle.dt_s);
        let ended_rad = self.ended_rad(cycle);
        self.switch(cycle, ended_rad);
        self.count(cycle, self.steps + 1);
        true
    }

    /// Follows a clock that owns the phase and counts the steps; true at a switch.
    pub fn follow(&mut self, cycle: &Cycle, steps: u64, phase: f64) -> bool {
        self.phase = phase;
        let switched = steps != self.steps;
        if switched {
            let ended_rad = self.ended_rad(cycle);
            self.switch(cycle, ended_rad);
            self.count(cycle, steps);
        }
        switched
    }

    /// So many steps have ended: the last of them may have been the lead's.
    fn count(&mut self, cycle: &Cycle, steps: u64) {
        let led = self.present_step(cycle.gait).is_lead();
        self.steps = steps;
        if led && !self.present_step(cycle.gait).is_lead() {
            self.adopt_as_planned(cycle);
        }
    }

    /// Follows it over a switch at which another gait, the cycle's, was taken up, by its lead or at once: `ended_rad`
    /// was asked for before.
    pub fn change(&mut self, cycle: &Cycle, steps: u64, by_lead: bool, phase: f64, ended_rad: [f64; JOINTS]) {
        self.phase = phase;
        self.switch(cycle, ended_rad);
        self.steps = steps;
        if by_lead {
            (self.leads, self.before_lead) = (true, steps);
            self.adopt_as_planned(cycle);
        } else {
            self.adopt(cycle);
        }
    }

    /// Takes over what a lead leads from or to, whose own velocity changes by a plan that the drive is not to undo.
    fn adopt_as_planned(&mut self, cycle: &Cycle) {
        let before = self.own_velocity();
        self.adopt(cycle);
        self.drive.go_over(&before, &self.own_velocity());
    }

    /// Joints at the very end of the present step.
    fn ended_rad(&self, cycle: &Cycle) -> [f64; JOINTS] {
        let shape = self.shape(cycle);
        let placement = Vector2::from(self.report.placement_m);
        shape.placed(1.0, &shape.planned(1.0), placement).joints_rad
    }

    /// The present step has ended, at these joints.
    fn switch(&mut self, cycle: &Cycle, ended_rad: [f64; JOINTS]) {
        self.ended_rad = Some(ended_rad);
        let swings = self.swings(cycle.gait);
        for leg in 0..4 {
            if swings[leg] {
                self.offsets_m[leg] = self.report.placement_m;
            }
        }
        let frames = self.ground.frames(cycle.estimate);
        self.ground.fit(cycle.config, &toes_m(cycle), &frames, cycle.config.ground_gain);
    }

    /// The reference of this cycle, towards `asked`.
    pub fn step(&mut self, cycle: &Cycle, asked: &Velocity) -> Instant {
        self.drive.step(cycle.config, asked, cycle.estimate, cycle.dt_s);
        self.ground.follow(cycle.config, self.height_m, cycle.gait.rise(), cycle.dt_s);
        let shape = self.shape(cycle);
        if let Some(ended) = self.ended_rad.take() {
            let begun = shape.placed(0.0, &shape.planned(0.0), Vector2::zeros()).joints_rad;
            self.fade_rad = std::array::from_fn(|j| ended[j] - begun[j]);
        }
        let s = self.phase;
        let (now, next) = (shape.planned(s), shape.planned(s + STEP));
        let error = self.error(cycle, &shape, &now, &next);
        let placement = self.place(cycle, &error);
        let (at, after) = (shape.placed(s, &now, placement), shape.placed(s + STEP, &next, placement));
        let (fade, fade_after) = (1.0 - smooth(s / FADED), 1.0 - smooth((s + STEP) / FADED));
        let change: [f64; JOINTS] = std::array::from_fn(|j| {
            (after.joints_rad[j] - at.joints_rad[j] + (fade_after - fade) * self.fade_rad[j]) / STEP
        });
        // It is in the reference as kp⁻¹ times itself, and so its rate is in the law, as the plan's own torque has it.
        let (carried, carried_after) = (shape.carried_nm(&now, &at), shape.carried_nm(&next, &after));
        let step = self.present_step(cycle.gait);
        let (kp, kd) = (cycle.gait.kp(step), cycle.gait.kd(step));
        let lead: [f64; JOINTS] = std::array::from_fn(|j| kd[j] / kp[j] * self.rate_s / STEP);
        self.fastest_s = (0..JOINTS).fold(f64::MAX, |least, j| {
            least.min(VELOCITY_SHARE * cycle.velocity_limit_rad_s[j] / change[j].abs().max(1e-9))
        });
        self.report.placement_limited |= at.limited;
        self.report.rise = self.ground.rise;
        Instant {
            position_rad: std::array::from_fn(|j| at.joints_rad[j] + fade * self.fade_rad[j]),
            velocity_rad_s: change.map(|change| change * self.rate_s),
            torque_nm: std::array::from_fn(|j| {
                now.torque_nm[j] + carried[j] + lead[j] * (carried_after[j] - carried[j])
            }),
        }
    }

    fn shape<'a>(&self, cycle: &Cycle<'a>) -> Shape<'a> {
        let step = self.present_step(cycle.gait);
        Shape {
            config: cycle.config,
            gait: cycle.gait,
            step,
            stance: Stance::of(cycle.gait, step),
            turns: Turns::of(cycle.gait, step),
            driven: self.drive.driven(cycle.config),
            own_velocity: Vector2::from(self.own_velocity) * cycle.share,
            own_yaw_rad_s: self.own_yaw_rad_s * cycle.share,
            middle_rad: self.middle_rad,
            share: cycle.share,
            ground: self.ground,
            frames: self.ground.frames(cycle.estimate),
            offsets_m: self.offsets_m,
        }
    }

    /// How far the body is from where the plan has it, with its velocity as 1/λ of it, along the stance line and
    /// across.
    fn error(&self, cycle: &Cycle, shape: &Shape, now: &Planned, next: &Planned) -> Error {
        let lambda = self.lambda_s(cycle);
        let stance = shape.stance;
        let measured = toes_m(cycle).map(|toe| shape.frames.heading * toe);
        let mean = |toes: &[Vector3<f64>; 4]| (-stance.sum(toes) / stance.count() as f64).xy();
        let center = mean(&measured);
        let planned = mean(&now.toes_m);
        let rate = (mean(&next.toes_m) - planned) / (STEP * cycle.gait.duration_s(shape.step));
        let turning = shape.driven.yaw_rad_s;
        let planned_velocity = rate + turning * Vector2::new(-planned.y, planned.x);
        let rotation = cycle.estimate.rotation();
        let in_heading = shape.frames.heading * (rotation.transpose() * Vector3::from(cycle.estimate.velocity_m_s()));
        let whole = center - planned + (in_heading.xy() - planned_velocity) / lambda;
        // Toes on one point have no line between them.
        let along = stance.line(&measured).xy().try_normalize(1e-6).unwrap_or_else(Vector2::x);
        Error { whole, falls: stance.count() == 2, along, across: Vector2::new(-along.y, along.x) }
    }

    /// λ = √(g/z0): how fast a body over its toes falls away from them.
    fn lambda_s(&self, cycle: &Cycle) -> f64 {
        (cycle.config.estimator.gravity_m_s2 / self.height_m).sqrt()
    }

    /// Sets the pace; says where the swing toes go beyond the plan.
    fn place(&mut self, cycle: &Cycle, error: &Error) -> Vector2<f64> {
        let config = cycle.config;
        let lambda = self.lambda_s(cycle);
        let period_s = cycle.gait.duration_s(self.present_step(cycle.gait));
        let (across, along) = (error.whole.dot(&error.across), error.whole.dot(&error.along));
        let left = 1.0 - self.phase;
        let own_s = 1.0 / period_s;
        let shortest_s = config.hurry_rest_share / lambda;
        let caught_s = (config.hurry_share * self.height_m / across.abs().max(1e-9)).ln() / lambda;
        let rest_s = caught_s.max(shortest_s);
        self.rate_s = own_s;
        let mut hurry_limited = false;
        if error.falls && rest_s < left * period_s {
            let wanted = left / rest_s;
            let most = (config.hurry_limit * own_s).min(self.fastest_s.max(own_s));
            self.rate_s = wanted.min(most);
            hurry_limited = caught_s < shortest_s || wanted > most;
        }
        let grown = (lambda * left / self.rate_s).exp();
        let gain = if error.falls { config.placement_gain } else { 0.0 };
        let mut placement = gain * (across * grown * error.across + along * error.along);
        let limit = config.placement_limit_share * self.height_m;
        let length = placement.norm();
        let placement_limited = length > limit;
        if placement_limited {
            placement *= limit / length;
        }
        self.report = BalanceReport {
            error_m: error.whole.into(),
            placement_m: placement.into(),
            pace: self.rate_s * period_s,
            placement_limited,
            hurry_limited,
            rise: self.ground.rise,
        };
        placement
    }
}

struct Error {
    whole: Vector2<f64>,
    /// Whether the body falls away from its stance line: not over three legs and four.
    falls: bool,
    /// Unit vectors along the measured stance line and across it.
    along: Vector2<f64>,
    across: Vector2<f64>,
}

/// The measured toes from the body, m.
fn toes_m(cycle: &Cycle) -> [Vector3<f64>; 4] {
    std::array::from_fn(|leg| cycle.config.legs[leg].toe_m(&of_leg(cycle.position_rad, leg)))
}
