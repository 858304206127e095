//! Which step of a walk is walked: the lead's come first, then those of the gait's stride, over and over. A step is a
//! domain: while it lasts the same legs stand.

/// Steps of a lead.
pub(crate) const LEAD_STEPS: usize = 2;

/// Which step of a walk.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Step {
    /// One of the lead's, counted from 0; walked once.
    Lead(usize),
    /// One of the stride's, counted from 0: of the trot's two, or a domain of the gait's cycle.
    Cycle(usize),
}

impl Step {
    /// Step number `index`, counted from 0, of what is walked with its gait's lead or without, over strides of
    /// `stride_steps` steps, at least one.
    pub fn number(index: u64, leads: bool, stride_steps: usize) -> Self {
        let lead_steps = if leads { LEAD_STEPS as u64 } else { 0 };
        match index.checked_sub(lead_steps) {
            Some(walked) => Self::Cycle((walked % stride_steps as u64) as usize),
            None => Self::Lead(index as usize),
        }
    }

    /// Whether it is one of the lead's.
    pub fn is_lead(self) -> bool {
        matches!(self, Self::Lead(_))
    }
}
