//! The balanced law in the controller's step: the base's estimate, when the law is walked, and when it cannot go on.

use crate::balanced::{BalanceConfig, Balanced, Cycle, Trouble};
use crate::law::Law;
use crate::memory::Snapshot;
use crate::motion::Expected;
use crate::watch::Found;
use crate::{Config, Fault, Input};
use estimator::{Estimator, Health, Inertial};
use std::time::Duration;

impl Snapshot {
    /// Follows the base for `dt_s` more. Where no step is walked all four toes stand.
    pub(crate) fn estimate_base(&mut self, config: &Config, input: &Input, now: Duration, dt_s: f64) {
        let (Some(balance), Some(joints)) = (&config.balance, &self.watch.joints) else { return };
        let walked = self.motion.walked();
        let legs =
            walked.map_or([false; gait::LEGS], |(gait, clock)| gait.stands(clock.step(gait)).map(|stands| !stands));
        let phase = walked.map(|_| self.motion.step_phase);
        let inertial = input.inertial.and_then(|unit| Inertial::of(&unit, now));
        let joints = (&joints.position_rad, &joints.velocity_rad_s);
        balance.estimate(&mut self.estimate, joints, inertial, legs, phase, dt_s);
    }

    /// Whether a walk may begin.
    pub(crate) fn estimate_is_usable(&self, config: &Config) -> bool {
        config.balance.is_none() || matches!(self.estimate.health(), Health::Good | Health::Waiting)
    }

    /// The base is tilted further than allowed, by its estimate.
    pub(crate) fn watch_estimate(&self, config: &Config, found: &mut Found) {
        if config.balance.is_none() || !self.day.mode.drives_on() || self.estimate.health() != Health::Good {
            return;
        }
        for angle in self.estimate.roll_pitch_rad() {
            // Written so that NaN is a tilt too.
            if !(-config.tilt_limit_rad..=config.tilt_limit_rad).contains(&angle) {
                found.add(Fault::Tilt, None, angle, config.tilt_limit_rad);
            }
        }
    }

    /// A walk begins: in balance where that is asked for and inertial data was ever received. `moving`: the robot
    /// already moves as the gait does.
    pub(crate) fn begin_law(&mut self, config: &Config, now: Duration, moving: bool) {
        let waits = self.estimate.health() == Health::Waiting;
        let cycle = self.law_cycle(config, now, 0.0).filter(|_| !waits);
        self.law = cycle.map_or(Law::Paper, |cycle| Law::Balanced(Balanced::start(&cycle, moving)));
    }

    /// One cycle of the balanced law, where it is walked.
    pub(crate) fn walk_in_balance(&mut self, config: &Config, now: Duration, dt_s: f64) {
        let Law::Balanced(mut balanced) = self.law else { return };
        let (Some(cycle), Some((_, clock))) = (self.law_cycle(config, now, dt_s), self.motion.walked()) else { return };
        let place = clock.place(cycle.gait, config, now);
        balanced.step(&cycle, &place, clock.base_index, clock.step_index());
        self.law = Law::Balanced(balanced);
    }

    /// What velocity is to be walked; the law's own where nobody ever asked for one.
    pub(crate) fn ask_velocity(&mut self, config: &Config, input: &Input, now: Duration) {
        if let (Law::Balanced(balanced), Some(BalanceConfig { command_timeout_s, .. })) =
            (&mut self.law, &config.balance)
        {
            balanced.ask(input.velocity.map(|command| command.at(now, *command_timeout_s)));
        }
    }

    /// Whether the balanced law cannot go on.
    pub(crate) fn watch_balance(&self, config: &Config, found: &mut Found) {
        let (Law::Balanced(balanced), Some(balance)) = (&self.law, &config.balance) else { return };
        match balanced.trouble(balance, self.estimate.health()) {
            None => {}
            Some(Trouble::EstimateLost { for_s }) => {
                found.add(Fault::EstimateLost, None, for_s, balance.estimate_patience_s);
            }
            Some(Trouble::AtLimits { for_s }) => {
                found.add(Fault::BalanceLost, None, for_s, balance.limited_patience_s);
            }
        }
    }

    fn law_cycle<'a>(&'a self, config: &'a Config, now: Duration, dt_s: f64) -> Option<Cycle<'a>> {
        let (gait, clock) = self.motion.walked()?;
        Some(Cycle {
            config: config.balance.as_ref()?,
            gait,
            position_rad: &self.watch.joints.as_ref()?.position_rad,
            velocity_limit_rad_s: &config.velocity_limit_rad_s,
            estimate: &self.estimate,
            share: clock.growth(config, now).share,
            dt_s,
        })
    }

    /// What is expected of the joints. Under the balanced law the ground may hold a foot of a step that is caught:
    /// there a joint that stands still is no sign of one that is stuck, and `tracking_error`, whose bound is wider
    /// there, is what notices.
    pub(crate) fn expected(&self, config: &Config, now: Duration) -> Expected {
        let expected = self.motion.expected(config, now);
        match (&self.law, self.motion.walked()) {
            (Law::Balanced(balanced), Some((_, clock))) if balanced.catches(clock.period_s) => {
                Expected { walks: false, caught: true, ..expected }
            }
            _ => expected,
        }
    }

    /// The share below the velocity limits over which torque fades out: the paper's law has none, to the bit.
    pub(crate) fn speed_fade_share(&self, config: &Config) -> f64 {
        match (&self.law, &config.balance) {
            (Law::Balanced(_), Some(balance)) => balance.speed_fade_share,
            _ => 0.0,
        }
    }

    /// What the balance reports of itself.
    pub(crate) fn balance_output(
        &self,
        config: &Config,
    ) -> (Option<Estimator>, Option<crate::balanced::BalanceReport>) {
        let report = match &self.law {
            Law::Balanced(balanced) => Some(*balanced.report()),
            Law::Paper => None,
        };
        (config.balance.as_ref().map(|_| self.estimate), report)
    }
}
