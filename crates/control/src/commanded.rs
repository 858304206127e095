//! Walking because a velocity is asked for, where the configuration wants that, and standing again when none is.
//!
//! Whatever an operator asks for holds until the velocity has been at rest, zero or silent, as long as the robot steps
//! in place before it stands: a robot that was stopped does not walk on because somebody still holds a key.

use crate::day::Heed;
use crate::memory::Snapshot;
use crate::{Config, Event, Input, Mode};
use estimator::Health;
use std::time::Duration;

impl Snapshot {
    /// An operator asked for something: that holds.
    pub(crate) fn operator_asked(&mut self) {
        self.day.heed = Heed { asked: self.day.heed.asked, ..Heed::NOT_YET };
    }

    /// Looks at the velocity that is asked for; what that means for the mode, if anything.
    pub(crate) fn heed_velocity(&mut self, config: &Config, input: &Input, now: Duration) -> Option<Event> {
        let balance = config.balance.as_ref()?;
        let stand_after_s = balance.stand_after_s?;
        let ever = input.velocity.is_some();
        let velocity = input.velocity.map(|command| command.at(now, balance.command_timeout_s));
        let heed = &mut self.day.heed;
        heed.asked = velocity.is_some_and(|velocity| !velocity.is_rest());
        if heed.asked {
            heed.rests_since = None;
            // Refused once, it does not begin a walk later, when nobody expects it.
            heed.may_begin &= self.estimate.health() == Health::Good;
            // Out of standing a walk begins when its posture is reached: `Motion::progress`.
            return (self.day.mode == Mode::Stopping).then_some(Event::VelocityAsked);
        }
        let rested = now.saturating_sub(*heed.rests_since.get_or_insert(now));
        if rested.as_secs_f64() < stand_after_s {
            return None;
        }
        heed.may_begin = true;
        // A walk that was begun by a request is not ended by a client that never was.
        let ends = ever && matches!(self.day.mode, Mode::Starting | Mode::Walking);
        if ends {
            self.day.walk_wanted = false;
        }
        ends.then_some(Event::VelocityRests)
    }

    /// A velocity may begin a walk.
    pub(crate) fn velocity_heeded(&self, config: &Config) -> bool {
        // Where no inertial data is received the paper's law would be walked, which obeys no velocity.
        let wanted = config.balance.as_ref().is_some_and(|balance| balance.stand_after_s.is_some());
        wanted && self.day.heed.may_begin && self.estimate.health() == Health::Good
    }

    /// What begins a walk out of standing, if anything does.
    pub(crate) fn walk_begun_by(&self, config: &Config) -> Option<Event> {
        if self.day.walk_wanted {
            Some(Event::Walk)
        } else {
            (self.day.heed.asked && self.velocity_heeded(config)).then_some(Event::VelocityAsked)
        }
    }
}
