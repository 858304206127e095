//! What can go wrong in making a picture.

use std::path::PathBuf;

/// An error of a report.
#[derive(Debug, thiserror::Error)]
pub enum ReportError {
    /// There is not enough in the run for a picture.
    #[error("run '{run}': {problem}")]
    TooLittle {
        /// The gait's name.
        run: String,
        /// What is missing, what was expected.
        problem: String,
    },
    /// A sample that cannot be drawn.
    #[error("run '{run}': sample at {time_s} s: {problem}")]
    BadSample {
        /// The gait's name.
        run: String,
        /// When.
        time_s: f64,
        /// What is wrong with it.
        problem: String,
    },
    /// An image whose size does not fit its bytes, or images of different sizes in one strip.
    #[error("picture: {0}")]
    BadImage(String),
    /// A file that cannot be written.
    #[error("{}: cannot write: {source}", path.display())]
    Io {
        /// The file or folder.
        path: PathBuf,
        /// The system's reason.
        source: std::io::Error,
    },
    /// The drawing library refused; a fault of this program.
    #[error("drawing failed: {0}")]
    Drawing(String),
}
