//! What a motion comes to by itself.

use crate::Event;

/// What time brought.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Progress {
    /// Nothing more in this cycle.
    Nothing,
    /// Another motion: it is to be followed too.
    GoesOn,
    /// The posture of the mode is reached.
    PostureReached,
    /// It stands, and this event begins a walk.
    MayWalk(Event),
    /// A step ended that was the last one.
    SwitchReached,
    /// A step ended, and the gait that waits cannot be taken there.
    GaitIsFar,
}
