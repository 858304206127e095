//! Making a whole bag of what is left of one.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use crate::data_file::{DataFile, inner_name};
use crate::mcap_file::McapFile;
use crate::read::data_files;
use crate::recorder::{Shared, Writer};
use crate::{BagError, Qos, RecorderOptions, full_definition};

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

/// Copies every message that is provably whole (its chunk is there to the end and its checksum is right) into a new bag in
/// `target`. The source, a bag's folder or one `.mcap` file, is only read.
///
/// # Errors
/// [`BagError::Exists`] if something is in `target`; [`BagError::BadFile`] if the source holds no MCAP file or a file in it is
/// none (a file too short to hold even MCAP's mark counts as damage if others are there); [`BagError::Io`].
pub fn recover(source: impl AsRef<Path>, target: impl AsRef<Path>) -> Result<Recovery, BagError> {
    let (source, target) = (source.as_ref(), target.as_ref());
    let attributes = std::fs::metadata(source).map_err(BagError::io(source, "open"))?;
    let files: Vec<PathBuf> = if attributes.is_dir() { data_files(source)? } else { vec![source.to_owned()] };
    if files.is_empty() {
        return Err(BagError::bad_file(
            source,
            "there is no .mcap file in this folder; expected what is left of a bag",
        ));
    }
    if let Some(file) =
        files.iter().find(|file| inner_name(file).extension().is_some_and(|extension| extension == "db3"))
    {
        return Err(BagError::bad_file(
            file,
            "only MCAP is recovered; sqlite3 has a '.recover' of its own for its files",
        ));
    }
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
    let shared = Arc::new(Shared::default());
    let mut writer = Writer::open(target.to_owned(), RecorderOptions::default(), shared.clone())?;
    let mut messages = 0;
    for file in scanned {
        let mut topics = std::collections::BTreeMap::new();
        for (id, channel) in &file.channels {
            let known = || full_definition(&channel.type_name);
            let definition = channel.definition.clone().map_or_else(known, Ok);
            match definition {
                Ok(definition) if channel.message_encoding == "cdr" => {
                    let qos = channel.qos.unwrap_or(Qos::reliable(10));
                    topics.insert(*id, shared.declare(&channel.topic, &channel.type_name, &definition, qos)?);
                }
                _ => damage.push(format!(
                    "topic '{}' of type '{}' is left out: it is not CDR with a ros2msg definition",
                    channel.topic, channel.type_name
                )),
            }
        }
        let mut ordered = file.ordered();
        while let Some((channel, message)) = ordered.next_message()? {
            if let Some(topic) = topics.get(&channel) {
                writer.write(topic, message.stamp_ns, &message.data)?;
                messages += 1;
            }
        }
    }
    let files = writer.finish()?;
    let span_ns = files.iter().filter_map(|file| file.span_ns).reduce(|a, b| (a.0.min(b.0), a.1.max(b.1)));
    Ok(Recovery { folder: target.to_owned(), messages, span_ns, damage })
}
