//! What is held or moved to: ramps from posture to posture, and the gait.

use crate::body_pose::Body;
use crate::course::{Course, Then};
use crate::gait_clock::{GaitClock, Growth, Offset, leads_out_of};
use crate::law::{Law, grown};
use crate::lift::Lift;
use crate::postures::{folded, posture, posture_duration_s};
use crate::progress::Progress;
use crate::ramp::Ramp;
use crate::step::Step;
use crate::{Config, Event, JOINTS, JointCommand, JointState, Mode, PreparedGait};
use std::time::Duration;

/// From nearer to the standing posture than this (each joint, rad), it is gone to directly; else by way of sitting.
const NEAR_STAND_RAD: f64 = 0.4;

/// The motion, and the gaits that it is made of.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Motion {
    pub course: Course,
    pub gait: Option<PreparedGait>,
    /// A gait that waits for a switch or for standing.
    pub pending: Option<PreparedGait>,
    pub step_index: u64,
    pub step_phase: f64,
    /// Moved while it stands; else neutral.
    #[serde(default)]
    pub body: Body,
}

/// What the motion expects of the joints.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Expected {
    /// Joints with so much of their gains that they follow (in torque mode the command itself has none).
    pub held: [bool; JOINTS],
    /// Whether a whole walk is walked.
    pub walks: bool,
    /// Whether a step is caught: the ground holds feet, and the body is thrown off its standing legs.
    pub caught: bool,
}

impl Motion {
    /// No motion and no gait.
    pub const NONE: Self =
        Self { course: Course::None, gait: None, pending: None, step_index: 0, step_phase: 0.0, body: Body::NEUTRAL };

    /// The gait that is walked next.
    pub fn loaded(&self) -> Option<&PreparedGait> {
        self.pending.as_ref().or(self.gait.as_ref())
    }

    /// Nothing is held any more.
    pub fn let_go(&mut self) {
        self.course = Course::None;
        self.step_phase = 0.0;
        self.body = Body::NEUTRAL;
    }

    /// What the motion asks for at `now`, before limits.
    pub fn setpoint(&self, law: &Law, config: &Config, now: Duration) -> JointCommand {
        match (&self.course, &self.gait) {
            (Course::Ramp { ramp, start, .. }, _) => {
                self.body.over(config, ramp.at(now.saturating_sub(*start).as_secs_f64()))
            }
            (Course::Lift { lift, start, .. }, _) => {
                self.body.over(config, lift.at(config, now.saturating_sub(*start).as_secs_f64()))
            }
            (Course::Gait(clock), Some(gait)) => law.reference(gait, &clock.place(gait, config, now)),
            (Course::None, _) | (Course::Gait(_), None) => JointCommand::LIMP,
        }
    }

    /// The gait that is walked, and its clock.
    pub fn walked(&self) -> Option<(&PreparedGait, &GaitClock)> {
        match (&self.course, &self.gait) {
            (Course::Gait(clock), Some(gait)) => Some((gait, clock)),
            _ => None,
        }
    }

    /// What is expected of the joints at `now`.
    pub fn expected(&self, config: &Config, now: Duration) -> Expected {
        match &self.course {
            Course::None => Expected::default(),
            Course::Gait(clock) => Expected {
                held: [true; JOINTS],
                walks: clock.growth(config, now).is_whole() && !clock.is_leading(),
                caught: false,
            },
            Course::Ramp { ramp, start, .. } | Course::Lift { lift: Lift { ramp, .. }, start, .. } => {
                let kp = ramp.at(now.saturating_sub(*start).as_secs_f64()).kp;
                Expected { held: std::array::from_fn(|j| kp[j] >= 0.5 * config.posture_kp[j]), ..Expected::default() }
            }
        }
    }

    // ── from posture to posture ─────────────────────────────────────────────────────────────────────────────────────

    fn ramp(
        &mut self,
        config: &Config,
        from: JointCommand,
        to: JointCommand,
        duration_s: f64,
        then: Then,
        now: Duration,
    ) {
        let gain_s = if from.kp.contains(&0.0) { config.gain_ramp_s.min(duration_s) } else { duration_s };
        self.course = Course::Ramp { ramp: Ramp { from, to, duration_s, gain_s }, start: now, then };
    }

    /// Over the feet to the height of the posture `to`; joint by joint where the legs' kinematics are not known.
    fn lift(
        &mut self,
        config: &Config,
        from: JointCommand,
        commanded_rad: &[f64; JOINTS],
        to: JointCommand,
        then: Then,
        now: Duration,
    ) {
        let duration_s = |to_rad: &_| posture_duration_s(config, commanded_rad, to_rad);
        let Some(legs) = &config.legs else {
            let then = if then == Then::Fold { Then::LetGo } else { then };
            return self.ramp(config, from, to, duration_s(&to.position_rad), then, now);
        };
        let gain_s = from.kp.contains(&0.0).then_some(config.gain_ramp_s);
        self.course = Course::Lift { lift: Lift::new(legs, from, to, duration_s, gain_s), start: now, then };
    }

    /// To the standing posture out of `from`, what is asked for now.
    pub fn stand(&mut self, config: &Config, from: JointCommand, now: Duration) {
        self.ramp(config, from, posture(config, &config.stand), config.stop_blend_s, Then::Done, now);
    }

    /// To standing out of sitting down, `from` what is asked for now: over the feet as long as they carry the robot.
    pub fn stand_again(&mut self, config: &Config, from: JointCommand, commanded_rad: &[f64; JOINTS], now: Duration) {
        if let Course::Ramp { then: then @ Then::Sit, .. } = &mut self.course {
            *then = Then::Done;
            return;
        }
        if config.legs.is_some() && !matches!(self.course, Course::Lift { .. }) {
            let to = folded(config);
            let duration_s = posture_duration_s(config, commanded_rad, &to.position_rad);
            return self.ramp(config, from, to, duration_s, Then::Rise, now);
        }
        self.lift(config, from, commanded_rad, posture(config, &config.stand), Then::Done, now);
    }

    /// From wherever the joints are, gains from zero: to standing directly if that is near, else by way of sitting with
    /// the hips already as wide as they will stand, because loaded feet do not slide.
    pub fn stand_up(&mut self, config: &Config, state: &JointState, now: Duration) {
        let from = JointCommand { position_rad: state.position_rad, kd: config.damping_kd, ..JointCommand::LIMP };
        let stand = posture(config, &config.stand);
        let near = (0..JOINTS).all(|j| (state.position_rad[j] - stand.position_rad[j]).abs() < NEAR_STAND_RAD);
        let (to, then) = if near { (stand, Then::Done) } else { (folded(config), Then::Rise) };
        let duration_s = posture_duration_s(config, &from.position_rad, &to.position_rad);
        self.ramp(config, from, to, duration_s, then, now);
    }

    /// To the sitting posture, `from` what is asked for now, once the way to standing has come to its end: a body that
    /// goes on over its feet is not lowered yet.
    pub fn sit_from_standing(
        &mut self,
        config: &Config,
        from: JointCommand,
        commanded_rad: &[f64; JOINTS],
        now: Duration,
    ) {
        match &mut self.course {
            Course::Ramp { ramp, start, then } if !ramp.is_over(now.saturating_sub(*start)) => *then = Then::Sit,
            _ => self.sit_down(config, from, commanded_rad, now),
        }
    }

    /// To the sitting posture, `from` what is asked for now: down over the feet, which then are drawn in.
    pub fn sit_down(&mut self, config: &Config, from: JointCommand, commanded_rad: &[f64; JOINTS], now: Duration) {
        self.lift(config, from, commanded_rad, posture(config, &config.sit), Then::Fold, now);
    }

    fn fold(&mut self, config: &Config, from: JointCommand, now: Duration) {
        let to = posture(config, &config.sit);
        let duration_s = posture_duration_s(config, &from.position_rad, &to.position_rad);
        self.ramp(config, from, to, duration_s, Then::LetGo, now);
    }

    fn rise(&mut self, config: &Config, from: JointCommand, now: Duration) {
        let to = posture(config, &config.stand);
        let duration_s = posture_duration_s(config, &from.position_rad, &to.position_rad);
        self.ramp(config, from, to, duration_s, Then::Done, now);
    }

    fn release(&mut self, config: &Config, held: JointCommand, now: Duration) {
        let from = JointCommand { velocity_rad_s: [0.0; JOINTS], ..held };
        let to = JointCommand { kp: [0.0; JOINTS], kd: config.damping_kd, torque_nm: [0.0; JOINTS], ..held };
        self.ramp(config, from, to, config.gain_ramp_s, Then::Done, now);
    }

    // ── the gait ────────────────────────────────────────────────────────────────────────────────────────────────────

    fn adopt_pending(&mut self) {
        if let Some(gait) = self.pending.take() {
            self.gait = Some(gait);
        }
    }

    /// To the first posture of the walk on four feet, moving at its end as the walk moves at its start. `from`: what is
    /// asked for now.
    pub fn start(&mut self, config: &Config, from: JointCommand, now: Duration) {
        self.adopt_pending();
        let Some(gait) = self.gait else { return };
        let leads = gait.leads_out_of_standing();
        let step = Step::number(0, leads, gait.stride_steps());
        let growth = if leads { Growth::WHOLE } else { Growth { share: config.start_share, rate: 0.0 } };
        let first = grown(&gait, gait.at_step(step, 0.0), growth);
        let to = JointCommand {
            position_rad: first.position_rad,
            velocity_rad_s: first.velocity_rad_s,
            kp: gait.kp(step),
            kd: gait.kd(step),
            // Four feet carry the robot until the gait's first instant.
            torque_nm: config.stand.support_torque_nm,
        };
        self.ramp(config, from, to, config.start_blend_s, Then::Done, now);
    }

    /// The gait's first instant is the ramp's end, not the cycle that noticed it.
    pub fn walk_out_of_standing(&mut self, now: Duration) {
        let late = match self.course {
            Course::Ramp { ramp, start, .. } => {
                now.saturating_sub(start).saturating_sub(Duration::from_secs_f64(ramp.duration_s))
            }
            _ => Duration::ZERO,
        };
        self.walk(now.saturating_sub(late), GaitClock::out_of_standing);
    }

    /// On the gait at its first instant.
    pub fn walk_at_once(&mut self, now: Duration) {
        self.walk(now, |start, gait| GaitClock::new(start, gait, false));
    }

    fn walk(&mut self, start: Duration, clock: impl Fn(Duration, &PreparedGait) -> GaitClock) {
        self.adopt_pending();
        self.step_index = 0;
        let Some(gait) = &self.gait else { return };
        self.course = Course::Gait(clock(start, gait));
    }

    /// At a switch: all four feet are on the ground where they are to stay, so the posture of the switch is kept and
    /// only its motion runs out, over a third of the way that it would go in that time.
    pub fn come_to_rest(&mut self, law: &Law, config: &Config, now: Duration) {
        let (Some(gait), Course::Gait(clock)) = (self.gait, self.course) else {
            return;
        };
        let step = clock.step(&gait);
        let (position_rad, velocity_rad_s) = law.at_switch(&gait, &clock.place(&gait, config, now));
        let mut from = posture(config, &config.stand);
        from.position_rad = position_rad;
        from.velocity_rad_s = velocity_rad_s;
        let mut to = from;
        to.velocity_rad_s = [0.0; JOINTS];
        let duration_s = config.stop_blend_s;
        for j in 0..JOINTS {
            to.position_rad[j] += velocity_rad_s[j] * duration_s / 3.0;
        }
        from.kp = gait.kp(step);
        from.kd = gait.kd(step);
        self.ramp(config, from, to, duration_s, Then::Done, now);
    }

    // ── time ────────────────────────────────────────────────────────────────────────────────────────────────────────

    /// Whether a posture is held that has been reached.
    pub fn holds_posture(&self, now: Duration) -> bool {
        matches!(&self.course, Course::Ramp { ramp, start, then: Then::Done } if ramp.is_over(now.saturating_sub(*start)))
    }

    /// In the last `dt_s` the gait's phase ran `rate` times as fast as 1 / T.
    pub fn run(&mut self, config: &Config, rate: f64, dt_s: f64) {
        self.body.follow(config, dt_s);
        if let Course::Gait(clock) = &mut self.course {
            clock.run(rate, dt_s);
        }
    }

    /// Follows time: ends of ramps, switches of steps, changes of gait. At most one of them; more may be due.
    pub fn progress(
        &mut self,
        law: &Law,
        config: &Config,
        mode: Mode,
        begun_by: Option<Event>,
        now: Duration,
    ) -> Progress {
        match self.course {
            Course::None => {
                self.adopt_pending();
                Progress::Nothing
            }
            Course::Ramp { ramp, start, then } | Course::Lift { lift: Lift { ramp, .. }, start, then } => {
                if self.pending.is_some() && mode != Mode::Starting {
                    self.adopt_pending();
                }
                if !ramp.is_over(now.saturating_sub(start)) {
                    return Progress::Nothing;
                }
                match (then, mode) {
                    (Then::Rise, _) => self.rise(config, ramp.to, now),
                    (Then::Sit, _) => self.sit_down(config, ramp.to, &ramp.to.position_rad, now),
                    (Then::Fold, _) => self.fold(config, ramp.to, now),
                    (Then::LetGo, _) => self.release(config, ramp.to, now),
                    (Then::Start, _) if self.body.is_neutral() => self.start(config, ramp.to, now),
                    (Then::Start, _) => return Progress::Nothing,
                    // A gait that came meanwhile: blend on to its first posture.
                    (Then::Done, Mode::Starting) if self.pending.is_some() => {
                        self.start(config, self.setpoint(law, config, now), now);
                    }
                    (Then::Done, Mode::Standing) => return begun_by.map_or(Progress::Nothing, Progress::MayWalk),
                    (Then::Done, _) => return Progress::PostureReached,
                }
                Progress::GoesOn
            }
            Course::Gait(clock) => self.progress_gait(clock, config, mode, now),
        }
    }

    fn progress_gait(&mut self, mut clock: GaitClock, config: &Config, mode: Mode, now: Duration) -> Progress {
        let Some(gait) = &self.gait else { return Progress::Nothing };
        if clock.follow(gait, now) {
            self.course = Course::Gait(clock);
            if mode == Mode::Stopping {
                return Progress::SwitchReached;
            }
            // What is still growing grows up first.
            if let Some(new) = self.pending
                && clock.may_change(config, now)
            {
                let old = *gait;
                match self.change_gait(clock, &old, &new, config) {
                    Progress::Nothing => {}
                    changed => return changed,
                }
            }
        }
        self.step_index = clock.step_index();
        self.step_phase = clock.phase(now);
        Progress::Nothing
    }

    /// At a switch: takes the new gait by its lead, at the beginning of a stride, or where it starts near where the old
    /// one ends.
    fn change_gait(
        &mut self,
        mut clock: GaitClock,
        old: &PreparedGait,
        new: &PreparedGait,
        config: &Config,
    ) -> Progress {
        if leads_out_of(old, new, config) {
            if clock.step(old) != Step::Cycle(0) {
                return Progress::Nothing;
            }
            clock.change_by_lead(new, Offset::into_lead(old, new));
        } else {
            let offset = Offset::between(old, new, clock.step(old));
            if !old.has_schedule_of(new) || !offset.is_small(config) {
                return Progress::GaitIsFar;
            }
            clock.change(new, offset);
        }
        self.adopt_pending();
        self.course = Course::Gait(clock);
        Progress::GoesOn
    }
}
