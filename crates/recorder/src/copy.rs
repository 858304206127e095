//! A bag written from the records of others, byte for byte: whatever they are serialised in and whatever describes
//! their types.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use crate::channel::{Channel, OFFERED, TYPE_HASH};
use crate::message::Message;
use crate::metadata::{self, FilePart, TopicCount};
use crate::writer::{OpenFile, mcap_error};
use crate::{BagError, RecorderOptions};

/// A bag that is written from the records of others.
pub struct BagCopy {
    folder: PathBuf,
    file: OpenFile,
    /// What metadata.yaml says of each topic, and the channels of the file with the index of their topic.
    topics: Vec<TopicCount>,
    channels: BTreeMap<u16, usize>,
}

impl BagCopy {
    /// Begins a bag in a folder that is empty or not there.
    ///
    /// # Errors
    /// [`BagError::Exists`] if something is in the folder, [`BagError::Io`] if it cannot be written.
    pub fn open(folder: &Path) -> Result<BagCopy, BagError> {
        fs::create_dir_all(folder).map_err(BagError::io(folder, "create"))?;
        if fs::read_dir(folder).map_err(BagError::io(folder, "list"))?.next().is_some() {
            return Err(BagError::Exists { path: folder.to_owned() });
        }
        let name = folder.canonicalize().map_err(BagError::io(folder, "resolve"))?;
        let stem = name.file_name().map_or("bag".into(), |name| name.to_string_lossy().into_owned());
        let file = OpenFile::create(folder, &stem, 0, &RecorderOptions::default())?;
        Ok(BagCopy { folder: folder.to_owned(), file, topics: Vec::new(), channels: BTreeMap::new() })
    }

    /// The channel of the new file for one of another's; the same for one that says the same.
    ///
    /// # Errors
    /// [`BagError::Io`], [`BagError::BadFile`] if it cannot be written.
    pub fn topic(&mut self, channel: &Channel) -> Result<u16, BagError> {
        let wrap = |error| mcap_error(&self.file.path, error);
        let mcap = &mut self.file.mcap;
        // sqlite3 bags before Iron describe no types: ours are as good where the type is known.
        let known = || crate::full_definition(&channel.type_name).ok().filter(|_| channel.message_encoding == "cdr");
        let schema = match (&channel.schema, known()) {
            (Some(schema), _) => mcap.add_schema(&schema.name, &schema.encoding, &schema.data).map_err(wrap)?,
            (None, Some(text)) => mcap.add_schema(&channel.type_name, "ros2msg", text.as_bytes()).map_err(wrap)?,
            (None, None) if channel.type_name.is_empty() => 0,
            (None, None) => mcap.add_schema(&channel.type_name, "", &[]).map_err(wrap)?,
        };
        let id = mcap.add_channel(schema, &channel.topic, &channel.message_encoding, &channel.about).map_err(wrap)?;
        let same = |topic: &TopicCount| {
            topic.name == channel.topic
                && topic.type_name == channel.type_name
                && topic.encoding == channel.message_encoding
        };
        let index = self.topics.iter().position(same).unwrap_or(self.topics.len());
        if index == self.topics.len() {
            let offered = channel.about.get(OFFERED).and_then(|text| serde_yaml_ng::from_str(text).ok());
            self.topics.push(TopicCount {
                name: channel.topic.clone(),
                type_name: channel.type_name.clone(),
                encoding: channel.message_encoding.clone(),
                offered: offered.filter(serde_yaml_ng::Value::is_sequence).unwrap_or_else(|| Vec::<u32>::new().into()),
                type_hash: channel.about.get(TYPE_HASH).cloned().unwrap_or_default(),
                messages: 0,
            });
        }
        self.channels.insert(id, index);
        Ok(id)
    }

    /// Writes a message on a channel that [`BagCopy::topic`] gave.
    ///
    /// # Errors
    /// As [`BagCopy::topic`].
    pub fn write(&mut self, channel_id: u16, message: &Message) -> Result<(), BagError> {
        let header = mcap::records::MessageHeader {
            channel_id,
            sequence: message.sequence,
            log_time: message.stamp_ns,
            publish_time: message.publish_ns,
        };
        let written = self.file.mcap.write_to_known_channel(&header, &message.data);
        written.map_err(|error| mcap_error(&self.file.path, error))?;
        self.topics[self.channels[&channel_id]].messages += 1;
        self.file.messages += 1;
        let (start, end) = self.file.span_ns.unwrap_or((message.stamp_ns, message.stamp_ns));
        self.file.span_ns = Some((start.min(message.stamp_ns), end.max(message.stamp_ns)));
        Ok(())
    }

    /// Closes the file and writes `metadata.yaml`.
    ///
    /// # Errors
    /// As [`BagCopy::topic`].
    pub fn finish(mut self) -> Result<FilePart, BagError> {
        self.file.finish(&self.topics, &[])?;
        let part = self.file.part();
        metadata::write(&self.folder, &metadata::to_yaml(&self.topics, std::slice::from_ref(&part)))?;
        Ok(part)
    }
}
