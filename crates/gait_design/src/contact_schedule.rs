//! Contact schedules: which legs stand, in what order and for how long.

use crate::request::{GaitRequest, RequestError, SCHEDULES};
use gait::LEGS;
use serde::{Deserialize, Serialize};

/// A gait's contact schedule. Durations are shares of the request's T, which is a step's duration: in the crawl one
/// leg's, else two legs'.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum ContactSchedule {
    /// The legs of a diagonal swing together; then all four stand for a share of T.
    Trot {
        /// Share of T.
        four_leg_share: f64,
    },
    /// One leg swings at a time, in lateral sequence: rear left, front left, rear right, front right. Before each
    /// all four stand for a share of T.
    Crawl {
        /// Share of T.
        four_leg_share: f64,
    },
    /// The legs of a side swing together.
    Pace,
    /// The front legs swing together, and the rear legs.
    Bound,
}

/// A part of a schedule with the same legs on the ground.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Phase {
    pub stands: [bool; LEGS],
    /// Duration over T.
    pub share: f64,
}

/// Longest share of T in which all four legs stand: what is left has to be long enough to swing in.
const MOST_FOUR_LEG_SHARE: f64 = 0.6;
/// Shortest such phase that is one, and no gait has a domain that is shorter than [`gait::SHORTEST_DOMAIN_S`].
const LEAST_FOUR_LEG_SHARE: f64 = 0.05;

impl ContactSchedule {
    /// The names of the schedules, as [`Self::named`] takes them.
    pub const NAMES: [&str; 4] = SCHEDULES;

    /// The schedule of a name, with a phase of `four_leg_share` of T on four legs, 0 for none.
    ///
    /// # Errors
    ///
    /// If there is none of that name, or it has no phase on four legs and a share is given.
    pub fn named(name: &str, four_leg_share: f64) -> Result<Self, RequestError> {
        let schedule = match name {
            "trot" => Self::Trot { four_leg_share },
            "crawl" => Self::Crawl { four_leg_share },
            "pace" => Self::Pace,
            "bound" => Self::Bound,
            _ => return Err(RequestError::UnknownSchedule { name: name.to_owned() }),
        };
        if matches!(schedule, Self::Pace | Self::Bound) && four_leg_share != 0.0 {
            return Err(RequestError::NoFourLegPhase { schedule: schedule.name(), four_leg_share });
        }
        Ok(schedule)
    }

    /// Its name.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Trot { .. } => "trot",
            Self::Crawl { .. } => "crawl",
            Self::Pace => "pace",
            Self::Bound => "bound",
        }
    }

    /// Refuses shares that leave no time to swing, and phases too short to be walked, where a step takes T.
    ///
    /// # Errors
    ///
    /// If a share is neither 0 nor in its range.
    pub fn validate(&self, step_duration_s: f64) -> Result<(), RequestError> {
        let value = self.four_leg_share();
        // T itself may come out a little longer.
        let longest_s = step_duration_s * (1.0 + GaitRequest::STEP_DURATION_TOLERANCE);
        let least = LEAST_FOUR_LEG_SHARE.max((1e3 * gait::SHORTEST_DOMAIN_S / longest_s).ceil() * 1e-3);
        if value == 0.0 || (least..=MOST_FOUR_LEG_SHARE).contains(&value) {
            return Ok(());
        }
        let (field, unit) = ("four_leg_share", "of the step duration, or 0");
        Err(RequestError::OutOfRange { field, value, lower: least, upper: MOST_FOUR_LEG_SHARE, unit })
    }

    fn four_leg_share(&self) -> f64 {
        match *self {
            Self::Trot { four_leg_share } | Self::Crawl { four_leg_share } => four_leg_share,
            Self::Pace | Self::Bound => 0.0,
        }
    }

    /// Whether the second half of the stride is the mirror image of the first.
    pub(crate) fn is_mirrored(&self) -> bool {
        !matches!(self, Self::Bound)
    }

    /// The phases of the first half of a stride, or of all of it where the second half is no mirror image.
    pub(crate) fn phases(&self) -> Vec<Phase> {
        let swings: &[&[usize]] = match self {
            Self::Trot { .. } => &[&[0, 3]],
            Self::Crawl { .. } => &[&[1], &[0]],
            Self::Pace => &[&[2, 3]],
            Self::Bound => &[&[1, 3], &[0, 2]],
        };
        let four = self.four_leg_share();
        let swing =
            |legs: &&[usize]| Phase { stands: std::array::from_fn(|leg| !legs.contains(&leg)), share: 1.0 - four };
        let all = (four > 0.0).then_some(Phase { stands: [true; LEGS], share: four });
        swings.iter().flat_map(|legs| std::iter::once(swing(legs)).chain(all)).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shares_that_leave_no_time_to_swing_are_refused() {
        for four_leg_share in [0.7, -0.1, 0.01, f64::NAN] {
            let error = ContactSchedule::Crawl { four_leg_share }.validate(0.5).unwrap_err().to_string();
            assert!(error.contains("four_leg_share is") && error.contains("0.05 to 0.6"), "{error}");
        }
        for four_leg_share in [0.0, 0.05, 0.25, 0.6] {
            ContactSchedule::Trot { four_leg_share }.validate(0.5).unwrap();
        }
        let error = ContactSchedule::Trot { four_leg_share: 0.1 }.validate(0.19).unwrap_err().to_string();
        assert!(error.contains("four_leg_share is 0.1, expected 0.105 to 0.6"), "{error}");
    }

    #[test]
    fn a_schedule_has_the_name_that_it_is_found_by() {
        for name in ContactSchedule::NAMES {
            assert_eq!(ContactSchedule::named(name, 0.0).unwrap().name(), name);
        }
        assert_eq!(ContactSchedule::named("crawl", 0.2).unwrap(), ContactSchedule::Crawl { four_leg_share: 0.2 });
        for (name, share, expected) in [
            ("gallop", 0.0, "schedule \"gallop\" is unknown: expected one of trot, crawl, pace, bound"),
            ("bound", 0.2, "four_leg_share is 0.2, and a bound has no phase on four legs: expected 0"),
        ] {
            assert_eq!(ContactSchedule::named(name, share).unwrap_err().to_string(), expected);
        }
    }

    /// Over a stride every leg swings once, and the legs that stand are those that the schedule's name says.
    #[test]
    fn every_leg_swings_once_a_stride() {
        let mirror = [2, 3, 0, 1];
        for (schedule, fewest) in [
            (ContactSchedule::Trot { four_leg_share: 0.25 }, 2),
            (ContactSchedule::Crawl { four_leg_share: 0.0 }, 3),
            (ContactSchedule::Crawl { four_leg_share: 0.3 }, 3),
            (ContactSchedule::Pace, 2),
            (ContactSchedule::Bound, 2),
        ] {
            let mut swings = [0; LEGS];
            for phase in schedule.phases() {
                assert!(phase.stands.iter().filter(|stands| **stands).count() >= fewest, "{schedule:?}");
                for leg in (0..LEGS).filter(|leg| !phase.stands[*leg]) {
                    swings[leg] += 1;
                    if schedule.is_mirrored() {
                        swings[mirror[leg]] += 1;
                    }
                }
            }
            assert_eq!(swings, [1; LEGS], "{schedule:?}");
        }
    }
}
