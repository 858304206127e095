//! Which gait messages this software sends and reads, and why one is refused.

use gait::bezier::DEGREE;

/// Version of the gait message's schema, that of the gait file: 1, or 2 with a second step of its own.
pub const GAIT_VERSION: u32 = gait::FILE_VERSION as u32;
pub(crate) const GAIT_VERSION_TWO_STEPS: u32 = gait::FILE_VERSION_TWO_STEPS as u32;

pub(crate) const GAIT_VERSION_DOMAINS: u32 = gait::FILE_VERSION_DOMAINS as u32;
/// The versions that the message carries.
pub(crate) const GAIT_VERSIONS: [u32; 2] = [GAIT_VERSION, GAIT_VERSION_TWO_STEPS];

/// Why a gait message was refused.
#[derive(Debug, thiserror::Error)]
pub enum GaitMessageError {
    /// Another version.
    #[error(
        "gait message: version is {found}, expected {GAIT_VERSION} or {GAIT_VERSION_TWO_STEPS}: run planner and controller of one release"
    )]
    Version {
        /// What the message reports.
        found: u32,
    },
    /// A lead or a cycle, for which the message has no field.
    #[error("gait message: \"{gait}\" has a lead or a cycle, which no message carries: load the gait's file")]
    Domains {
        /// The gait's name.
        gait: String,
    },
    /// Another polynomial degree.
    #[error("gait message \"{gait}\": bezier_degree is {found}, expected {DEGREE}")]
    Degree {
        /// The gait's name.
        gait: String,
        /// What the message reports.
        found: u8,
    },
    /// A second step in a version that has none, or none in one that has.
    #[error(
        "gait message \"{gait}\": version {version} with {found} second coefficients: version {GAIT_VERSION} has none, version {GAIT_VERSION_TWO_STEPS} a second step"
    )]
    SecondStep {
        /// The gait's name.
        gait: String,
        /// What the message reports.
        version: u32,
        /// How many coefficients there are.
        found: usize,
    },
    /// An array of another length.
    #[error("gait message \"{gait}\": {field} has {found} entries, expected {expected}")]
    Length {
        /// The gait's name.
        gait: String,
        /// Which field.
        field: &'static str,
        /// How many there are.
        found: usize,
        /// How many there must be.
        expected: usize,
    },
    /// The request is not JSON.
    #[error("gait message \"{gait}\": request_json is not JSON: {reason}")]
    Request {
        /// The gait's name.
        gait: String,
        /// The parser's reason.
        reason: String,
    },
    /// The values are none of a gait that can be walked.
    #[error(transparent)]
    Gait(#[from] gait::GaitError),
}
