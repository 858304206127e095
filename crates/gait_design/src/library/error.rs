//! What can be wrong with a library.

use crate::PlanError;
use crate::request::RequestError;

/// What is wrong with a library or with a question to it.
#[derive(Debug, thiserror::Error)]
pub enum LibraryError {
    /// The grid is invalid.
    #[error("the grid {0}")]
    Grid(String),
    /// A base request or a grid's end that is invalid.
    #[error(transparent)]
    Request(#[from] RequestError),
    /// Not a library, or not of this version.
    #[error("line {line} of the library: {problem}")]
    File {
        /// Line number, from 1.
        line: usize,
        /// What is wrong with it and what was expected.
        problem: String,
    },
    /// Made for another robot, or for another description of it.
    #[error(
        "the library was solved for robot \"{library}\" as it was described then (crc {library_crc32:08x}), not for \"{robot}\" as it is now ({robot_crc32:08x}): solve it again"
    )]
    Robot {
        /// The library's robot.
        library: String,
        /// The crc of its description.
        library_crc32: u32,
        /// The robot at hand.
        robot: String,
        /// The crc of its description.
        robot_crc32: u32,
    },
    /// Points of the grid are missing.
    #[error("{missing} of the library's {all} gaits are not solved yet: resume `tandem library solve` on it")]
    Incomplete {
        /// How many are missing.
        missing: usize,
        /// How many there are to be.
        all: usize,
    },
    /// A request outside the grid, or that differs from it in a field that is no axis.
    #[error("{field} is {value}; the library has {expected}")]
    Outside {
        /// Which field.
        field: &'static str,
        /// Its value.
        value: f64,
        /// What the library offers.
        expected: String,
    },
    /// A neighbour has no gait.
    #[error("there is no gait beside the request, at {at}: {why}")]
    Hole {
        /// The grid's point.
        at: String,
        /// Why it has none.
        why: String,
    },
    /// The gait could not be put together.
    #[error(transparent)]
    Plan(#[from] PlanError),
}
