//! `metadata.yaml`: what a rosbag2 folder says about itself.

use std::fs;
use std::io::Write;
use std::path::Path;

use serde::Serialize;

use crate::BagError;
use crate::qos::QosYaml;
use crate::shared::TopicShared;

/// The name of the file in a bag's folder.
pub const FILE_NAME: &str = "metadata.yaml";

/// One topic, its type and how many of its messages are in the bag.
#[derive(Clone, Debug)]
pub(crate) struct TopicCount {
    pub(crate) name: String,
    pub(crate) type_name: String,
    /// How the messages are serialised.
    pub(crate) encoding: String,
    /// What the publishers offered: rosbag2's list of profiles.
    pub(crate) offered: serde_yaml_ng::Value,
    /// rosbag2's hash of the type's description; empty if it is not known.
    pub(crate) type_hash: String,
    pub(crate) messages: u64,
}

impl TopicCount {
    /// Of a topic recorded here.
    pub(crate) fn recorded(topic: &TopicShared, messages: u64) -> TopicCount {
        TopicCount {
            name: topic.name.clone(),
            type_name: topic.type_name.clone(),
            encoding: "cdr".to_owned(),
            offered: serde_yaml_ng::to_value([QosYaml::from(topic.qos)]).expect("a plain structure is always YAML"),
            type_hash: topic.type_hash.clone(),
            messages,
        }
    }
}

/// One MCAP file of a bag.
#[derive(Clone, Debug)]
pub struct FilePart {
    /// Name inside the bag's folder.
    pub name: String,
    /// How many messages.
    pub messages: u64,
    /// First and last stamp, if there is any message.
    pub span_ns: Option<(u64, u64)>,
}

#[derive(Serialize)]
struct Document<'a> {
    rosbag2_bagfile_information: Information<'a>,
}

#[derive(Serialize)]
struct Information<'a> {
    version: u32,
    storage_identifier: &'static str,
    duration: Nanoseconds,
    starting_time: SinceEpoch,
    message_count: u64,
    topics_with_message_count: Vec<TopicEntry<'a>>,
    compression_format: &'static str,
    compression_mode: &'static str,
    relative_file_paths: Vec<&'a str>,
    files: Vec<FileEntry<'a>>,
    custom_data: Option<()>,
    ros_distro: &'static str,
}

#[derive(Serialize)]
struct Nanoseconds {
    nanoseconds: u64,
}

#[derive(Serialize)]
struct SinceEpoch {
    nanoseconds_since_epoch: u64,
}

#[derive(Serialize)]
struct TopicEntry<'a> {
    topic_metadata: TopicMetadata<'a>,
    message_count: u64,
}

#[derive(Serialize)]
struct TopicMetadata<'a> {
    name: &'a str,
    #[serde(rename = "type")]
    type_name: &'a str,
    serialization_format: &'a str,
    offered_qos_profiles: &'a serde_yaml_ng::Value,
    type_description_hash: &'a str,
}

#[derive(Serialize)]
struct FileEntry<'a> {
    path: &'a str,
    starting_time: SinceEpoch,
    duration: Nanoseconds,
    message_count: u64,
}

fn span(span_ns: Option<(u64, u64)>) -> (SinceEpoch, Nanoseconds) {
    let (start, end) = span_ns.unwrap_or((0, 0));
    (SinceEpoch { nanoseconds_since_epoch: start }, Nanoseconds { nanoseconds: end - start })
}

/// The whole document. Version 9 is what ROS 2 Jazzy and later write.
pub(crate) fn to_yaml(topics: &[TopicCount], files: &[FilePart]) -> String {
    serde_yaml_ng::to_string(&Document { rosbag2_bagfile_information: information(topics, files) })
        .expect("a plain structure is always YAML")
}

/// The part that rosbag2 also keeps inside the MCAP file.
pub(crate) fn information_yaml(topics: &[TopicCount], files: &[FilePart]) -> String {
    serde_yaml_ng::to_string(&information(topics, files)).expect("a plain structure is always YAML")
}

fn information<'a>(topics: &'a [TopicCount], files: &'a [FilePart]) -> Information<'a> {
    let spans = files.iter().filter_map(|file| file.span_ns);
    let whole = spans.reduce(|a, b| (a.0.min(b.0), a.1.max(b.1)));
    let (starting_time, duration) = span(whole);
    Information {
        version: 9,
        storage_identifier: "mcap",
        duration,
        starting_time,
        message_count: topics.iter().map(|topic| topic.messages).sum(),
        topics_with_message_count: topics
            .iter()
            .map(|topic| TopicEntry {
                topic_metadata: TopicMetadata {
                    name: &topic.name,
                    type_name: &topic.type_name,
                    serialization_format: &topic.encoding,
                    offered_qos_profiles: &topic.offered,
                    type_description_hash: &topic.type_hash,
                },
                message_count: topic.messages,
            })
            .collect(),
        // MCAP compresses inside its chunks; these two are for rosbag2's own compression of whole files or messages.
        compression_format: "",
        compression_mode: "",
        relative_file_paths: files.iter().map(|file| file.name.as_str()).collect(),
        files: files
            .iter()
            .map(|file| {
                let (starting_time, duration) = span(file.span_ns);
                FileEntry { path: &file.name, starting_time, duration, message_count: file.messages }
            })
            .collect(),
        custom_data: None,
        ros_distro: "kilted",
    }
}

/// Writes the document so that a reader sees either the old one or the whole new one.
pub(crate) fn write(folder: &Path, text: &str) -> Result<(), BagError> {
    let path = folder.join(FILE_NAME);
    let temporary = folder.join("metadata.yaml.new");
    let mut file = fs::File::create(&temporary).map_err(BagError::io(&temporary, "create"))?;
    file.write_all(text.as_bytes()).map_err(BagError::io(&temporary, "write"))?;
    file.sync_all().map_err(BagError::io(&temporary, "synchronise to disk"))?;
    fs::rename(&temporary, &path).map_err(BagError::io(&path, "put in place"))
}
