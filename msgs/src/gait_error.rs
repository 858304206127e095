//! Which gait messages this software sends and reads, and why one is refused.

use gait::bezier::DEGREE;

/// Version of the gait message's schema, that of the gait file: 1, 2 with a second step of its own, or 3 with a lead or
/// a cycle.
pub const GAIT_VERSION: u32 = gait::FILE_VERSION as u32;
const GAIT_VERSION_TWO_STEPS: u32 = gait::FILE_VERSION_TWO_STEPS as u32;
const GAIT_VERSION_DOMAINS: u32 = gait::FILE_VERSION_DOMAINS as u32;
/// The versions that the message carries.
pub(crate) const GAIT_VERSIONS: [u32; 3] = [GAIT_VERSION, GAIT_VERSION_TWO_STEPS, GAIT_VERSION_DOMAINS];

/// Why a gait message was refused.
#[derive(Debug, thiserror::Error)]
pub enum GaitMessageError {
    /// Another version.
    #[error(
        "gait message: version is {found}, expected {GAIT_VERSION}, {GAIT_VERSION_TWO_STEPS} or {GAIT_VERSION_DOMAINS}: run planner and controller of one release"
    )]
    Version {
        /// What the message reports.
        found: u32,
    },
    /// Another polynomial degree.
    #[error("gait message \"{gait}\": bezier_degree is {found}, expected {DEGREE}")]
    Degree {
        /// The gait's name.
        gait: String,
        /// What the message reports.
        found: u8,
    },
    /// Parts that the version does not have, or lacks.
    #[error(
        "gait message \"{gait}\": version is {version}, expected {expected}: {GAIT_VERSION} has neither a second step nor domains, {GAIT_VERSION_TWO_STEPS} a second step, {GAIT_VERSION_DOMAINS} a lead or a cycle"
    )]
    Parts {
        /// The gait's name.
        gait: String,
        /// What the message reports.
        version: u32,
        /// What its parts make it.
        expected: u32,
    },
    /// A leg that there is not, or that is named twice.
    #[error("gait message \"{gait}\": {field} names leg {found}, expected some of 0 to 3, each once")]
    StanceLegs {
        /// The gait's name.
        gait: String,
        /// Which field.
        field: String,
        /// Which leg.
        found: u8,
    },
    /// An array of another length.
    #[error("gait message \"{gait}\": {field} has {found} entries, expected {expected}")]
    Length {
        /// The gait's name.
        gait: String,
        /// Which field.
        field: String,
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
