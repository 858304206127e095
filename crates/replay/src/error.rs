//! What can go wrong in replaying a run.

use std::path::PathBuf;

/// An error of replaying a run.
#[derive(Debug, thiserror::Error)]
pub enum ReplayError {
    /// The bag cannot be written or read.
    #[error(transparent)]
    Bag(#[from] bag::BagError),
    /// The bag holds no such run.
    #[error("{}: {problem}", path.display())]
    NoRun {
        /// The bag.
        path: PathBuf,
        /// What is missing, what was expected, what to do.
        problem: String,
    },
    /// A recorded message that cannot be what was recorded.
    #[error("{}: {topic} at {time_s:.6} s: {problem}", path.display())]
    BadMessage {
        /// The bag.
        path: PathBuf,
        /// The topic.
        topic: String,
        /// When, s.
        time_s: f64,
        /// What is wrong.
        problem: String,
    },
}
