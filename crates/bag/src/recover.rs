//! Making a whole bag of what is left of one.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use recorder::BagCopy;

use crate::BagError;
use crate::data_file::{DataFile, ZSTD_MARK, data_files, inner_name, unpack_message};
use crate::mcap_file::McapFile;

/// What was saved, and what was wrong.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Recovery {
    /// The new bag's folder.
    pub folder: PathBuf,
    /// Messages in it.
    pub messages: u64,
    /// First and last stamp, ns, if there is any message.
    pub span_ns: Option<(u64, u64)>,
    /// One line for each damaged place: file, byte, what is wrong there. Empty if the bag was whole.
    pub damage: Vec<String>,
}

/// Copies every message that is provably whole (its chunk is there to the end and its checksum is right) into a new bag
/// in `target`, byte for byte, with its type's schema in whatever language that is. The source, a bag's folder or one
/// `.mcap` file, is only read.
///
/// # Errors
/// [`BagError::Exists`] if something is in `target`; [`BagError::BadFile`] if the source holds no MCAP file or a file
/// in it is none (a file too short to hold even MCAP's mark counts as damage if others are there); [`BagError::Io`].
pub fn recover(source: impl AsRef<Path>, target: impl AsRef<Path>) -> Result<Recovery, BagError> {
    let (source, target) = (source.as_ref(), target.as_ref());
    let files = sources(source)?;
    let mut damage = Vec::new();
    let mut scanned = Vec::new();
    let mut refused = None;
    for path in &files {
        match DataFile::open(path).and_then(|file| McapFile::scan(&file)) {
            Ok(file) => {
                damage.extend(
                    file.damage
                        .iter()
                        .map(|found| format!("{}: byte {}: {}", path.display(), found.offset, found.reason)),
                );
                scanned.push(Arc::new(file));
            }
            Err(error @ BagError::BadFile { .. }) => {
                damage.push(error.to_string());
                refused = Some(error);
            }
            Err(error) => return Err(error),
        }
    }
    if let (Some(error), true) = (refused, scanned.is_empty()) {
        return Err(error);
    }
    let mut copy = BagCopy::open(target)?;
    let mut messages = 0;
    for file in scanned {
        let mut topics = BTreeMap::new();
        for (id, channel) in &file.channels {
            topics.insert(*id, copy.topic(channel)?);
        }
        let mut ordered = file.ordered();
        while let Some((channel, mut message)) = ordered.next_message()? {
            let Some(topic) = topics.get(&channel) else { continue };
            // rosbag2's own compression of each message stands in metadata.yaml, which may be lost: no CDR begins so.
            if message.data.starts_with(ZSTD_MARK) && file.channels[&channel].message_encoding == "cdr" {
                match unpack_message(&message.data) {
                    Ok(data) => message.data = data,
                    Err(reason) => {
                        damage.push(format!("{}: the message at {} ns {reason}", target.display(), message.stamp_ns));
                        continue;
                    }
                }
            }
            copy.write(*topic, &message)?;
            messages += 1;
        }
    }
    let file = copy.finish()?;
    Ok(Recovery { folder: target.to_owned(), messages, span_ns: file.span_ns, damage })
}

/// The files of a bag's folder, or the one that was given; MCAP all of them.
fn sources(source: &Path) -> Result<Vec<PathBuf>, BagError> {
    let attributes = std::fs::metadata(source).map_err(BagError::io(source, "open"))?;
    let files: Vec<PathBuf> = if attributes.is_dir() { data_files(source)? } else { vec![source.to_owned()] };
    if files.is_empty() {
        let reason = "there is no .mcap file in this folder; expected what is left of a bag";
        return Err(BagError::bad_file(source, reason));
    }
    let sqlite = |file: &&PathBuf| inner_name(file).extension().is_some_and(|extension| extension == "db3");
    match files.iter().find(sqlite) {
        Some(file) => {
            let reason = "only MCAP is recovered; sqlite3 has a '.recover' of its own for its files";
            Err(BagError::bad_file(file, reason))
        }
        None => Ok(files),
    }
}
