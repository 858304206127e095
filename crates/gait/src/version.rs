//! Which gait files this software writes and reads.

/// `format` of every gait file.
pub const FILE_FORMAT: &str = "tandem-gait";
/// Version of a file whose second step mirrors the first.
pub const FILE_VERSION: u64 = 1;
/// Version of a file with a second step of its own.
pub const FILE_VERSION_TWO_STEPS: u64 = 2;
/// Version of a file with a lead: domains that are walked once, before the first step.
pub const FILE_VERSION_LEAD: u64 = 3;
/// Every version that this software reads.
pub(crate) const FILE_VERSIONS: [u64; 3] = [FILE_VERSION, FILE_VERSION_TWO_STEPS, FILE_VERSION_LEAD];

/// A longer text is refused before it is read. A gait of version 2 is about 30 kB, of version 3 with
/// two domains in its lead 45 kB.
pub const MAX_FILE_BYTES: usize = 1 << 20;
