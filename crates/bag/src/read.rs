//! Reading bags: folders written by rosbag2 or by us, and single `.mcap` and `.db3` files.

use std::cmp::Reverse;
use std::collections::{BTreeMap, BinaryHeap};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use recorder::{Channel, metadata};
use serde::Deserialize;
use serde::de::DeserializeOwned;

use crate::data_file::{DataFile, absent, data_files, inner_name, listed_file, unpack_message};
use crate::mcap_file::{McapFile, Ordered};
use crate::records::offers;
use crate::sqlite_file::SqliteFile;
use crate::{BagError, Definition, Message, Offer, Qos, full_definition};

/// A topic of a bag.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct BagTopic {
    /// Topic name.
    pub name: String,
    /// Message type, `package/msg/Type`; empty if the bag does not say.
    pub type_name: String,
    /// The complete `ros2msg` text: the one in the bag, or ours if the bag has none.
    pub definition: Option<String>,
    /// How the messages are serialised; `cdr` in every ROS 2 bag.
    pub encoding: String,
    /// The quality of service that serves everyone whom its publishers served, if the bag says what those offered.
    pub qos: Option<Qos>,
    /// What its publishers offered, one after the other; empty if the bag does not say.
    pub offers: Vec<Offer>,
    /// How many messages.
    pub messages: u64,
    /// As it stands in the first file that has it.
    pub(crate) channel: Channel,
}

impl BagTopic {
    /// The definition, parsed.
    ///
    /// # Errors
    /// [`BagError::BadDefinition`] if there is none or it cannot be parsed.
    pub fn parsed_definition(&self) -> Result<Definition, BagError> {
        let bad = |reason: String| BagError::BadDefinition { name: self.type_name.clone(), reason };
        if self.encoding != "cdr" {
            return Err(bad(format!("topic '{}' is serialised as '{}'; expected cdr", self.name, self.encoding)));
        }
        let text = self.definition.as_deref().ok_or_else(|| {
            bad(format!("topic '{}': the bag holds no ros2msg text of it and it is not known here", self.name))
        })?;
        Definition::parse(&self.type_name, text)
    }
}

/// How the messages of a bag are compressed one by one, by rosbag2 itself.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum MessageCompression {
    None,
    Zstd,
}

#[derive(Debug)]
enum Storage {
    Mcap(Arc<McapFile>),
    Sqlite(DataFile),
}

/// A bag that was read through once and found whole.
#[derive(Debug)]
pub struct Bag {
    path: PathBuf,
    storage: Vec<Storage>,
    compression: MessageCompression,
    topics: Vec<BagTopic>,
    span_ns: Option<(u64, u64)>,
    bytes: u64,
    notes: Vec<String>,
}

#[derive(Deserialize)]
struct MetadataDocument {
    rosbag2_bagfile_information: MetadataInformation,
}

/// What matters here of `metadata.yaml`; the counts in it are not trusted, the files are read.
#[derive(Deserialize)]
struct MetadataInformation {
    version: u32,
    storage_identifier: String,
    relative_file_paths: Vec<String>,
    #[serde(default)]
    compression_format: String,
    #[serde(default)]
    compression_mode: String,
    #[serde(default)]
    topics_with_message_count: Vec<MetadataTopic>,
}

#[derive(Deserialize)]
struct MetadataTopic {
    topic_metadata: MetadataTopicInformation,
}

#[derive(Deserialize)]
struct MetadataTopicInformation {
    name: String,
    #[serde(default)]
    offered_qos_profiles: serde_yaml_ng::Value,
}

impl Bag {
    /// Opens a bag's folder, or one `.mcap` or `.db3` file, and reads it through once: every chunk's checksum is verified.
    ///
    /// # Errors
    /// One error that names the file and what to do: not a bag, empty, cut off (`tandem bag recover` makes it whole), damaged,
    /// compressed in a way that is not known.
    pub fn open(path: impl AsRef<Path>) -> Result<Bag, BagError> {
        let path = path.as_ref();
        let attributes = std::fs::metadata(path).map_err(BagError::io(path, "open"))?;
        if attributes.is_dir() { Bag::open_folder(path) } else { Bag::open_files(path, &[path.to_owned()], None) }
    }

    /// sqlite3 files are whole after a crash, so what is there is the bag; MCAP files must be looked at by recover.
    fn open_without_metadata(folder: &Path) -> Result<Bag, BagError> {
        let files = data_files(folder)?;
        if files.is_empty() {
            let hint = "there is no metadata.yaml and no .mcap or .db3 file in this folder; expected a bag";
            return Err(BagError::bad_file(folder, hint));
        }
        if !files.iter().all(|file| inner_name(file).extension().is_some_and(|extension| extension == "db3")) {
            let hint = "there is no metadata.yaml in this folder: its recording was not finished; run 'tandem bag recover' on it";
            return Err(BagError::bad_file(folder, hint));
        }
        let mut bag = Bag::open_files(folder, &files, None)?;
        let count = files.len();
        bag.notes.push(format!("there is no metadata.yaml; read what is there: {count} .db3 file(s)"));
        Ok(bag)
    }

    fn open_folder(folder: &Path) -> Result<Bag, BagError> {
        let yaml = folder.join(metadata::FILE_NAME);
        if !yaml.exists() {
            return Bag::open_without_metadata(folder);
        }
        let text = std::fs::read_to_string(&yaml).map_err(BagError::io(&yaml, "read"))?;
        let document: MetadataDocument = serde_yaml_ng::from_str(&text)
            .map_err(|error| BagError::bad_file(&yaml, format!("is not rosbag2's metadata: {error}")))?;
        let information = document.rosbag2_bagfile_information;
        if !(1..=9).contains(&information.version) {
            let reason = format!("metadata of version {}; expected 1 to 9", information.version);
            return Err(BagError::bad_file(&yaml, reason));
        }
        // 'ros2 bag reindex' leaves the identifier empty; the files say what they are.
        if !matches!(information.storage_identifier.as_str(), "" | "mcap" | "sqlite3") {
            let reason = format!("storage '{}'; expected mcap or sqlite3", information.storage_identifier);
            return Err(BagError::bad_file(&yaml, reason));
        }
        let mut files = Vec::new();
        for name in &information.relative_file_paths {
            // Older rosbag2 wrote the folder's name in front.
            let direct = folder.join(name);
            let file = if direct.exists() { direct } else { listed_file(folder, name) };
            if !file.starts_with(folder) || Path::new(name).components().any(|part| part.as_os_str() == "..") {
                return Err(BagError::bad_file(
                    &yaml,
                    format!("lists the file '{name}', which is outside the bag's folder"),
                ));
            }
            files.push(file);
        }
        if files.is_empty() {
            return Err(BagError::bad_file(&yaml, "lists no file; expected at least one"));
        }
        Bag::open_files(folder, &files, Some(information))
    }

    fn open_files(path: &Path, files: &[PathBuf], information: Option<MetadataInformation>) -> Result<Bag, BagError> {
        let mut bag = Bag {
            path: path.to_owned(),
            storage: Vec::new(),
            compression: MessageCompression::None,
            topics: Vec::new(),
            span_ns: None,
            bytes: 0,
            notes: Vec::new(),
        };
        if let Some(information) = &information {
            let format = information.compression_format.as_str();
            bag.compression = match information.compression_mode.to_ascii_lowercase().as_str() {
                "message" if format == "zstd" => MessageCompression::Zstd,
                // A file that is compressed as a whole is known by its first bytes.
                "file" if format == "zstd" => MessageCompression::None,
                "" | "none" | "storage" => MessageCompression::None,
                other => {
                    let reason =
                        format!("compression '{other}' with '{format}'; expected zstd of files or messages, or none");
                    return Err(BagError::bad_file(path, reason));
                }
            };
        }
        let split = files.len() > 1;
        for file in files {
            match absent(file).filter(|_| split) {
                Some(what) => bag.notes.push(format!("{}: {what}; read the other parts", file.display())),
                None => bag.add_file(file)?,
            }
        }
        if bag.storage.is_empty() {
            return Err(BagError::bad_file(path, "every part of this bag is missing or empty"));
        }
        for topic in &mut bag.topics {
            if topic.definition.is_none() && topic.encoding == "cdr" {
                topic.definition = full_definition(&topic.type_name).ok();
            }
            let listed = information.iter().flat_map(|information| &information.topics_with_message_count);
            for entry in listed.filter(|entry| entry.topic_metadata.name == topic.name) {
                if topic.offers.is_empty() {
                    topic.offers = Offer::list_from_yaml_value(&entry.topic_metadata.offered_qos_profiles);
                }
            }
            topic.qos = Offer::for_all(&topic.offers).map(Qos::from);
        }
        Ok(bag)
    }

    fn add_file(&mut self, path: &Path) -> Result<(), BagError> {
        self.bytes += std::fs::metadata(path).map_err(BagError::io(path, "open"))?.len();
        let data = DataFile::open(path)?;
        let (storage, channels, span_ns) = if data.sqlite.is_some() {
            let file = SqliteFile::open(&data)?;
            (Storage::Sqlite(data), file.channels, file.span_ns)
        } else {
            let file = McapFile::scan(&data)?;
            if let Some(damage) = file.damage.first() {
                let more = file.damage.len() - 1;
                let more = if more > 0 { format!(" (and {more} more)") } else { String::new() };
                return Err(BagError::bad_file(
                    path,
                    format!(
                        "damaged or cut off at byte {} of {}: {}{more}; run 'tandem bag recover' to save what is whole",
                        damage.offset, file.size, damage.reason
                    ),
                ));
            }
            let (channels, span_ns) = (file.channels.clone(), file.span_ns);
            (Storage::Mcap(Arc::new(file)), channels, span_ns)
        };
        for channel in channels.values() {
            self.add_channel(channel);
        }
        if let Some((start, end)) = span_ns {
            let (first, last) = self.span_ns.unwrap_or((start, end));
            self.span_ns = Some((start.min(first), end.max(last)));
        }
        self.storage.push(storage);
        Ok(())
    }

    fn add_channel(&mut self, channel: &Channel) {
        match self.topic_of(channel) {
            Some(index) => {
                let topic = &mut self.topics[index];
                topic.messages += channel.messages;
                for offer in offers(channel) {
                    // A later part of a split bag says the same again.
                    if topic.offers.iter().filter(|known| **known == offer).count()
                        < offers(channel).iter().filter(|known| **known == offer).count()
                    {
                        topic.offers.push(offer);
                    }
                }
                topic.definition = topic.definition.take().or_else(|| channel.definition());
            }
            None => self.topics.push(BagTopic {
                name: channel.topic.clone(),
                type_name: channel.type_name.clone(),
                definition: channel.definition(),
                encoding: channel.message_encoding.clone(),
                qos: None,
                offers: offers(channel),
                messages: channel.messages,
                channel: channel.clone(),
            }),
        }
    }

    fn topic_of(&self, channel: &Channel) -> Option<usize> {
        self.topics.iter().position(|topic| {
            topic.name == channel.topic
                && topic.type_name == channel.type_name
                && topic.encoding == channel.message_encoding
        })
    }

    /// The path that was opened.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// One line for each thing that the bag should have and has not, though it was read: metadata, a part.
    pub fn notes(&self) -> &[String] {
        &self.notes
    }

    /// All topics, also those without a message.
    pub fn topics(&self) -> &[BagTopic] {
        &self.topics
    }

    /// The topic of that name, with its index.
    pub fn topic(&self, name: &str) -> Option<(usize, &BagTopic)> {
        self.topics.iter().enumerate().find(|(_, topic)| topic.name == name)
    }

    /// Stamps of the first and the last message, ns; `None` for a bag without messages.
    pub fn span_ns(&self) -> Option<(u64, u64)> {
        self.span_ns
    }

    /// How many messages, over all topics.
    pub fn message_count(&self) -> u64 {
        self.topics.iter().map(|topic| topic.messages).sum()
    }

    /// Size of the bag's data files, bytes.
    pub fn bytes(&self) -> u64 {
        self.bytes
    }

    /// How many data files.
    pub fn files(&self) -> usize {
        self.storage.len()
    }

    /// How the data is stored: `mcap` or `sqlite3`.
    pub fn storage(&self) -> &'static str {
        match self.storage.first() {
            Some(Storage::Sqlite(_)) => "sqlite3",
            _ => "mcap",
        }
    }

    /// All messages in the order of their stamps.
    ///
    /// # Errors
    /// If a file can no longer be read.
    pub fn messages(&self) -> Result<Messages, BagError> {
        let mut sources = Vec::new();
        for storage in &self.storage {
            let (source, channels) = match storage {
                Storage::Mcap(file) => (Source::Mcap(file.ordered()), file.channels.clone()),
                Storage::Sqlite(data) => {
                    let file = SqliteFile::open(data)?;
                    let channels = file.channels.clone();
                    (Source::Sqlite(Box::new(file)), channels)
                }
            };
            let topics = channels
                .iter()
                .map(|(id, channel)| {
                    let index = self
                        .topic_of(channel)
                        .ok_or_else(|| BagError::bad_file(&self.path, "changed while it was read"))?;
                    Ok((*id, index))
                })
                .collect::<Result<_, BagError>>()?;
            sources.push((source, topics));
        }
        let mut messages = Messages {
            path: self.path.clone(),
            compression: self.compression,
            heads: BinaryHeap::new(),
            waiting: sources.iter().map(|_| None).collect(),
            sources,
        };
        for index in 0..messages.sources.len() {
            messages.advance(index)?;
        }
        Ok(messages)
    }
}

#[derive(Debug)]
enum Source {
    Mcap(Ordered),
    Sqlite(Box<SqliteFile>),
}

/// The messages of a bag in the order of their stamps, read as they are asked for.
#[derive(Debug)]
pub struct Messages {
    path: PathBuf,
    compression: MessageCompression,
    sources: Vec<(Source, BTreeMap<u16, usize>)>,
    /// The next message of each source, and the sources by its stamp.
    waiting: Vec<Option<Message>>,
    heads: BinaryHeap<Reverse<(u64, usize)>>,
}

impl Messages {
    fn advance(&mut self, index: usize) -> Result<(), BagError> {
        let (source, topics) = &mut self.sources[index];
        let next = match source {
            Source::Mcap(ordered) => ordered.next_message()?,
            Source::Sqlite(file) => file.next_message()?,
        };
        if let Some((channel, mut message)) = next {
            message.topic =
                *topics.get(&channel).ok_or_else(|| BagError::bad_file(&self.path, "changed while it was read"))?;
            self.heads.push(Reverse((message.stamp_ns, index)));
            self.waiting[index] = Some(message);
        }
        Ok(())
    }

    fn take(&mut self) -> Result<Option<Message>, BagError> {
        let Some(Reverse((_, index))) = self.heads.pop() else { return Ok(None) };
        let Some(mut message) = self.waiting[index].take() else { return Ok(None) };
        self.advance(index)?;
        if self.compression == MessageCompression::Zstd {
            message.data = unpack_message(&message.data).map_err(|reason| {
                BagError::bad_file(&self.path, format!("the message at {} ns: {reason}", message.stamp_ns))
            })?;
        }
        Ok(Some(message))
    }
}

impl Iterator for Messages {
    type Item = Result<Message, BagError>;

    fn next(&mut self) -> Option<Self::Item> {
        let result = self.take();
        if result.is_err() {
            self.heads.clear(); // nothing sensible follows an error
        }
        result.transpose()
    }
}

/// Reads a message of a known Rust type. `name` is only used in the error.
///
/// # Errors
/// [`BagError::Cdr`] if the bytes are not such a message.
pub fn from_cdr<T: DeserializeOwned>(name: &str, cdr: &[u8]) -> Result<T, BagError> {
    let bad = |reason: String| BagError::Cdr { name: name.to_owned(), action: "read from", reason };
    let (header, body) =
        cdr.split_at_checked(4).ok_or_else(|| bad(format!("{} bytes; expected at least 4", cdr.len())))?;
    let result = match header[..2] {
        [0, 0] => cdr_encoding::from_bytes::<T, byteorder::BigEndian>(body),
        [0, 1] => cdr_encoding::from_bytes::<T, byteorder::LittleEndian>(body),
        _ => {
            return Err(bad(format!(
                "encapsulation {:02x}{:02x}; expected plain CDR, 0000 or 0001",
                header[0], header[1]
            )));
        }
    };
    result.map(|(message, _)| message).map_err(|error| bad(error.to_string()))
}
