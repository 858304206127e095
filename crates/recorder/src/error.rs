//! What can go wrong with a bag, in words that name the thing, what was expected and what to do.

use std::path::{Path, PathBuf};

/// An error of recording or reading a bag.
#[derive(Debug, thiserror::Error)]
pub enum BagError {
    /// The operating system refused a file operation.
    #[error("{}: cannot {action}: {source}", path.display())]
    Io {
        /// The file or folder.
        path: PathBuf,
        /// What was attempted, as a verb phrase.
        action: &'static str,
        /// The system's reason.
        source: std::io::Error,
    },
    /// The folder of a new recording already holds something.
    #[error(
        "{}: already exists and is not an empty folder; nothing was written; \
         choose another folder for the recording",
        path.display()
    )]
    Exists {
        /// The folder.
        path: PathBuf,
    },
    /// A message type without a known definition.
    #[error(
        "message type '{name}' is not known here; expected package/msg/Type, one of Tandem's own or a common standard message; give its definition with Recorder::topic_with_definition"
    )]
    UnknownType {
        /// The type's name as given.
        name: String,
    },
    /// A message definition that cannot be parsed.
    #[error("definition of '{name}': {reason}")]
    BadDefinition {
        /// The message type.
        name: String,
        /// What is wrong in it.
        reason: String,
    },
    /// A topic declared twice with different types.
    #[error("topic '{topic}' is already recorded as {first}; it cannot also be {second}")]
    TopicConflict {
        /// The topic.
        topic: String,
        /// Its type so far.
        first: String,
        /// The type now asked for.
        second: String,
    },
    /// The recorder has stopped by itself, because of the disk.
    #[error("the recording stopped: {reason}")]
    Stopped {
        /// Why.
        reason: String,
    },
    /// A message that cannot be written as, or read from, CDR.
    #[error("message of type '{name}' cannot be {action} CDR: {reason}")]
    Cdr {
        /// The message type.
        name: String,
        /// `"written as"` or `"read from"`.
        action: &'static str,
        /// What is wrong.
        reason: String,
    },
    /// A file that is not what it should be.
    #[error("{}: {reason}", path.display())]
    BadFile {
        /// The file.
        path: PathBuf,
        /// What was found, what was expected, what to do.
        reason: String,
    },
    /// A settings value out of range.
    #[error("recorder option {name} is {value}; expected {expected}")]
    BadOption {
        /// The option.
        name: &'static str,
        /// Its value.
        value: String,
        /// What it should be.
        expected: &'static str,
    },
}

impl BagError {
    /// Makes the error of a file operation that the system refused.
    pub fn io(path: &Path, action: &'static str) -> impl FnOnce(std::io::Error) -> BagError {
        let path = path.to_owned();
        move |source| BagError::Io { path, action, source }
    }

    /// A file that is not what it should be.
    pub fn bad_file(path: &Path, reason: impl Into<String>) -> BagError {
        BagError::BadFile { path: path.to_owned(), reason: reason.into() }
    }
}
