//! Why a gait is refused.

use crate::version::{FILE_FORMAT, FILE_VERSION, FILE_VERSION_DOMAINS, FILE_VERSION_TWO_STEPS, MAX_FILE_BYTES};

/// Why a gait was refused.
#[derive(Debug, thiserror::Error)]
pub enum GaitError {
    /// The text is not JSON, or lacks a field, or has one too many.
    #[error("gait file: not readable: {0}. Is it whole? Plan it again with `tandem plan`")]
    Syntax(String),
    /// Longer than any gait.
    #[error("gait file: {found} bytes long, at most {MAX_FILE_BYTES} are read: this is not a gait file")]
    Size {
        /// Its length.
        found: usize,
    },
    /// Another kind of file.
    #[error("gait file: format is \"{found}\", expected \"{FILE_FORMAT}\": this is not a gait file")]
    Format {
        /// What the file reports.
        found: String,
    },
    /// A version this software does not read.
    #[error(
        "gait file: version is {found}, expected {FILE_VERSION}, {FILE_VERSION_TWO_STEPS} or {FILE_VERSION_DOMAINS}: plan the gait again with this version's `tandem plan`"
    )]
    Version {
        /// What the file reports.
        found: u64,
    },
    /// A value that no gait can have.
    #[error("gait \"{gait}\": {field} {problem}")]
    Value {
        /// The gait's name.
        gait: String,
        /// Which field.
        field: String,
        /// What is wrong and what was expected.
        problem: String,
    },
    /// Planned for another robot.
    #[error("gait \"{gait}\" was planned for robot \"{found}\", this robot is \"{expected}\": plan it for this robot")]
    Robot {
        /// The gait's name.
        gait: String,
        /// Robot named in the gait.
        found: String,
        /// The robot here.
        expected: String,
    },
}

impl From<serde_json::Error> for GaitError {
    fn from(e: serde_json::Error) -> Self {
        Self::Syntax(e.to_string())
    }
}
