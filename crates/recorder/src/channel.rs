//! A topic of a bag's file, with everything that the file says about it.

use std::collections::BTreeMap;

/// The key under which rosbag2 keeps what publishers offered.
pub const OFFERED: &str = "offered_qos_profiles";
/// The key under which rosbag2 keeps the hash of a type's description.
pub const TYPE_HASH: &str = "topic_type_hash";

/// A topic of a file, with everything that the file says about it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Channel {
    /// Topic name.
    pub topic: String,
    /// Message type; empty if the file does not say.
    pub type_name: String,
    /// What its messages look like, if the file says so.
    pub schema: Option<Schema>,
    /// How the messages are serialised.
    pub message_encoding: String,
    /// Whatever else the recorder wrote down, by key.
    pub about: BTreeMap<String, String>,
    /// How many messages.
    pub messages: u64,
}

impl Channel {
    /// The `ros2msg` text, if the schema is in that encoding.
    pub fn definition(&self) -> Option<String> {
        let schema = self.schema.as_ref().filter(|schema| schema.encoding == "ros2msg")?;
        String::from_utf8(schema.data.clone()).ok()
    }
}

/// What messages of a type look like, in a language that `encoding` names.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Schema {
    /// The type.
    pub name: String,
    /// The language.
    pub encoding: String,
    /// The text.
    pub data: Vec<u8>,
}
