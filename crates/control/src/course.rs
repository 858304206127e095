//! Which motion is under way: a ramp and what follows it, or the gait.

use crate::gait_clock::GaitClock;
use crate::lift::Lift;
use crate::ramp::Ramp;
use std::time::Duration;

/// Which motion.
// The cycle must not allocate, so the large variant is not boxed.
#[allow(clippy::large_enum_variant)]
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub(crate) enum Course {
    /// None: off or damping.
    None,
    /// A ramp, then its end is held. `then` follows it.
    Ramp { ramp: Ramp, start: Duration, then: Then },
    /// The same over feet that stay where they are.
    Lift { lift: Lift, start: Duration, then: Then },
    /// The gait.
    Gait(GaitClock),
}

/// What follows a ramp.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub(crate) enum Then {
    /// Rise from the folded posture.
    Rise,
    /// Sit down: asked for while the robot was still coming to rest.
    Sit,
    /// Draw the feet in, which carry nothing any more, to the sitting posture.
    Fold,
    /// Let go.
    LetGo,
    /// Start to walk, as soon as the body is back in the posture.
    Start,
    /// The mode's posture is reached.
    Done,
}
