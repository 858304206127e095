//! Which legs stand in a step, and how far each is in its turn of standing or swinging.

use crate::PreparedGait;
use crate::step::Step;
use gait::LEGS;
use nalgebra::Vector3;

/// The legs that stand in a step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Stance {
    stands: [bool; LEGS],
}

impl Stance {
    pub fn of(gait: &PreparedGait, step: Step) -> Self {
        Self { stands: gait.stands(step) }
    }

    /// By number, in ascending order.
    pub fn legs(self) -> impl DoubleEndedIterator<Item = usize> {
        (0..LEGS).filter(move |leg| self.stands[*leg])
    }

    /// How many: at least two, or one where a recording is damaged.
    pub fn count(self) -> usize {
        self.legs().count().max(1)
    }

    /// Which legs swing.
    pub fn swings(self) -> [bool; LEGS] {
        self.stands.map(|stands| !stands)
    }

    /// From the first leg that stands to the last; zero where fewer than two do.
    pub fn line(self, toes: &[Vector3<f64>; LEGS]) -> Vector3<f64> {
        match (self.legs().next(), self.legs().next_back()) {
            (Some(first), Some(last)) => toes[last] - toes[first],
            _ => Vector3::zeros(),
        }
    }

    /// The sum of the toes that stand.
    pub fn sum(self, toes: &[Vector3<f64>; LEGS]) -> Vector3<f64> {
        self.legs().map(|leg| toes[leg]).reduce(|sum, toe| sum + toe).unwrap_or_default()
    }
}

/// How far each leg is in its turn: it stands or swings over one step or several, and then the other way.
#[derive(Clone, Copy, Debug)]
pub(super) struct Turns([Turn; LEGS]);

/// A leg's turn, in durations of the present step.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Turn {
    stands: bool,
    /// Of the turn, before the present step.
    before: f64,
    /// The whole turn, and the one after it.
    present: f64,
    next: f64,
}

impl Turns {
    pub fn of(gait: &PreparedGait, step: Step) -> Self {
        let stance = Stance::of(gait, step);
        Self(std::array::from_fn(|leg| match step {
            Step::Cycle(index) if gait.has_cycle() => Turn::of(gait, index, leg),
            // The trot's steps are all turns.
            _ => Turn { stands: stance.stands[leg], before: 0.0, present: 1.0, next: 1.0 },
        }))
    }

    /// Where the leg's toe is at phase `s` of the present step on the way that it stands for, from −½ of that turn to
    /// ½ while it stands and back while it swings, in durations of the present step. At both ends a toe that swings
    /// has the rate of one that stands.
    pub fn progress(&self, leg: usize, s: f64) -> f64 {
        let Turn { stands, before, present, next } = self.0[leg];
        if stands {
            return before + s - 0.5 * present;
        }
        let (x, both) = ((before + s) / present, present + next);
        0.5 * next + x * (present + x * (2.0 * both * x - 3.0 * both))
    }
}

impl Turn {
    /// Of a leg in domain `index` of the cycle.
    fn of(gait: &PreparedGait, index: usize, leg: usize) -> Self {
        let count = gait.stride_steps();
        let step = |away: usize| Step::Cycle((index + away) % count);
        let duration = |away: usize| gait.duration_s(step(away)) / gait.duration_s(step(0));
        let stands = gait.stands(step(0))[leg];
        let same = |away: &usize| gait.stands(step(*away))[leg] == stands;
        let sum = |from: usize, until: usize| (from..until).map(duration).sum::<f64>();
        // Steps behind the present one count from the stride's end.
        let begins = (1..count).rev().take_while(same).last().unwrap_or(count);
        let ends = (1..count).find(|away| !same(away)).unwrap_or(count);
        let before = sum(begins, count);
        let next_ends = (ends..count).find(same).unwrap_or(count);
        Self { stands, before, present: before + sum(0, ends), next: sum(ends, next_ends) }
    }
}
