//! Which gait files this software writes and reads.

/// `format` of every gait file.
pub const FILE_FORMAT: &str = "tandem-gait";
/// Version of a file whose second step mirrors the first.
pub const FILE_VERSION: u64 = 1;
/// Version of a file with a second step of its own.
pub const FILE_VERSION_TWO_STEPS: u64 = 2;
/// Version of a file with domains: of a lead, which is walked once, or of a cycle, which takes the two steps' place.
pub const FILE_VERSION_DOMAINS: u64 = 3;
/// Every version that this software reads.
pub(crate) const FILE_VERSIONS: [u64; 3] = [FILE_VERSION, FILE_VERSION_TWO_STEPS, FILE_VERSION_DOMAINS];

/// A longer text is refused before it is read. A gait of version 2 is about 30 kB, and each domain of version 3 takes
/// about 8 kB.
pub const MAX_FILE_BYTES: usize = 1 << 20;
