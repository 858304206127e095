//! Which step of a walk is walked: the lead's come first, then the gait's own two in turn.

use gait::StepSide;

/// Steps of a lead.
pub(crate) const LEAD_STEPS: usize = 2;

/// Which step of a walk.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Step {
    /// One of the lead's, counted from 0; walked once.
    Lead(usize),
    /// One of the gait's own two.
    Cycle(StepSide),
}

impl Step {
    /// Step number `index` of a walk, counted from 0, that began with a lead or without.
    pub fn of_walk(index: u64, leads: bool) -> Self {
        match usize::try_from(index) {
            Ok(index) if leads && index < LEAD_STEPS => Self::Lead(index),
            _ => Self::Cycle(StepSide::of_step(index)),
        }
    }

    /// Which legs stand and which swing.
    pub fn side(self) -> StepSide {
        match self {
            Self::Lead(index) => StepSide::of_step(index as u64),
            Self::Cycle(side) => side,
        }
    }

    /// Whether it is one of the lead's.
    pub fn is_lead(self) -> bool {
        matches!(self, Self::Lead(_))
    }
}
