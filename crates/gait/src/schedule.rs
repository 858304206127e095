//! The contact schedule: which legs stand when. A stride is a sequence of domains, phases in which the same legs stand:
//! the gait's cycle, or the trot's, two steps on the legs of one diagonal each.

use joints::{JOINTS, LEGS};

use crate::bezier::Coefficients;
use crate::domain::Domain;
use crate::types::Gait;

/// Which legs stand in the first step and in the second.
const STANCE: [[bool; LEGS]; 2] = [[false, true, true, false], [true, false, false, true]];

/// Which of the two steps of a stride.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StepSide {
    /// Legs 1 and 2 stand: the step that the gait's coefficients describe.
    First,
    /// Legs 0 and 3 stand: the left–right mirror of the first, or the gait's own second step.
    Mirrored,
}

impl StepSide {
    /// Both, in the order of the stride.
    pub const BOTH: [Self; 2] = [Self::First, Self::Mirrored];

    /// The side of step number `index`, counted from 0.
    pub fn of_step(index: u64) -> Self {
        if index.is_multiple_of(2) { Self::First } else { Self::Mirrored }
    }

    /// The side of the next step.
    pub fn other(self) -> Self {
        match self {
            Self::First => Self::Mirrored,
            Self::Mirrored => Self::First,
        }
    }

    /// Which legs stand in a step of this side; the others swing.
    pub fn stands(self) -> [bool; LEGS] {
        STANCE[self as usize]
    }

    /// The legs that stand, in ascending order.
    pub fn stance_legs(self) -> [usize; 2] {
        Self::legs_where(self.stands())
    }

    /// The legs that swing, in ascending order.
    pub fn swing_legs(self) -> [usize; 2] {
        Self::legs_where(self.other().stands())
    }

    fn legs_where(stands: [bool; LEGS]) -> [usize; 2] {
        let mut legs = (0..LEGS).filter(|leg| stands[*leg]);
        std::array::from_fn(|_| legs.next().expect("two legs of four stand"))
    }
}

impl Gait {
    /// The stride's domains, in order, which are walked over and over: the cycle, or the two steps. The lead comes
    /// before them.
    pub fn schedule(&self) -> Vec<Domain> {
        if !self.cycle.is_empty() {
            return self.cycle.clone();
        }
        self.steps().to_vec()
    }

    /// The trot's two steps as domains.
    pub fn steps(&self) -> [Domain; 2] {
        StepSide::BOTH.map(|side| Domain {
            stands: side.stands(),
            duration_s: self.step_duration_s,
            planned_rad: self.planned_coefficients(side),
            reference_rad: self.reference_coefficients(side),
        })
    }

    /// What is walked in step `index` of a walk out of standing, counted from 0: the lead's domains first.
    pub fn domain_of_step(&self, index: u64) -> Domain {
        let lead = self.lead.len() as u64;
        if index < lead {
            return self.lead[index as usize].clone();
        }
        let mut stride = self.schedule();
        stride.swap_remove(((index - lead) % stride.len() as u64) as usize)
    }

    /// How long the stride takes, s.
    pub fn stride_duration_s(&self) -> f64 {
        match &self.cycle[..] {
            [] => 2.0 * self.step_duration_s,
            cycle => cycle.iter().map(|domain| domain.duration_s).sum(),
        }
    }

    /// The planned joints' polynomials in the step of `side`, rad. Does not allocate.
    pub fn planned_coefficients(&self, side: StepSide) -> [Coefficients; JOINTS] {
        let second = self.second_step.as_ref().map(|second| &second.coefficients_rad);
        self.coefficients(&self.coefficients_rad, second, side)
    }

    /// What the tracking law follows in the step of `side`, rad. Does not allocate.
    pub fn reference_coefficients(&self, side: StepSide) -> [Coefficients; JOINTS] {
        let second = self.second_step.as_ref().map(|second| &second.reference_coefficients_rad);
        self.coefficients(&self.reference_coefficients_rad, second, side)
    }

    fn coefficients(
        &self,
        first: &[Coefficients; JOINTS],
        second: Option<&[Coefficients; JOINTS]>,
        side: StepSide,
    ) -> [Coefficients; JOINTS] {
        match (side, second) {
            (StepSide::First, _) => *first,
            (StepSide::Mirrored, Some(second)) => *second,
            (StepSide::Mirrored, None) => std::array::from_fn(|row| {
                let (from, sign) = self.mirror.source(row);
                first[from].map(|c| sign * c)
            }),
        }
    }
}
