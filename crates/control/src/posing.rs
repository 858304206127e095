//! The body's pose in the controller's step: when one is heeded, and that a walk waits until it is undone.

use crate::body_pose::{BodyPose, BodyPoseAnswer};
use crate::course::{Course, Then};
use crate::lift::Lift;
use crate::memory::Snapshot;
use crate::motion::Motion;
use crate::{Config, JOINTS, Mode};
use std::time::Duration;

impl Snapshot {
    /// A pose was asked for: heeded where the robot stands in a posture.
    pub(crate) fn ask_body_pose(&mut self, config: &Config, pose: &BodyPose, now: Duration) -> BodyPoseAnswer {
        let held_rad = self.motion.held_rad(now).copied().filter(|_| self.day.mode == Mode::Standing);
        held_rad.map_or(BodyPoseAnswer::NotStanding, |held_rad| self.motion.body.ask(config, &held_rad, pose))
    }
}

impl Motion {
    /// The posture that is held, its ramp over and nothing to follow.
    pub fn held_rad(&self, now: Duration) -> Option<&[f64; JOINTS]> {
        match &self.course {
            Course::Ramp { ramp, start, then: Then::Done }
            | Course::Lift { lift: Lift { ramp, .. }, start, then: Then::Done }
                if now.saturating_sub(*start) >= Duration::from_secs_f64(ramp.duration_s) =>
            {
                Some(&ramp.to.position_rad)
            }
            _ => None,
        }
    }

    /// Starts as soon as the body is back in the posture.
    pub fn start_from_posture(&mut self) {
        self.body.go_back();
        self.follow_with(Then::Start);
    }

    /// Stands on where it waits to start; whether it did.
    pub fn stand_on(&mut self) -> bool {
        let waits =
            matches!(self.course, Course::Ramp { then: Then::Start, .. } | Course::Lift { then: Then::Start, .. });
        if waits {
            self.follow_with(Then::Done);
        }
        waits
    }

    fn follow_with(&mut self, next: Then) {
        if let Course::Ramp { then, .. } | Course::Lift { then, .. } = &mut self.course {
            *then = next;
        }
    }
}
