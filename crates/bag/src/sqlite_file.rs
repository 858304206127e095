//! Reading one sqlite3 file (`.db3`), the storage of rosbag2 before MCAP.

use std::collections::{BTreeMap, VecDeque};
use std::path::{Path, PathBuf};

use recorder::{Channel, Message, OFFERED, Schema};
use rusqlite::{Connection, OpenFlags};

use crate::BagError;
use crate::data_file::{DataFile, SqliteMode};

/// Rows fetched at a time.
const PAGE: i64 = 512;

/// The topic rows' ids, which may be any number, to the keys of the channels.
type TopicKeys = BTreeMap<i64, u16>;

#[derive(Debug)]
pub(crate) struct SqliteFile {
    path: PathBuf,
    connection: Connection,
    pub(crate) channels: BTreeMap<u16, Channel>,
    pub(crate) span_ns: Option<(u64, u64)>,
    ids: TopicKeys,
    page: VecDeque<(u16, Message)>,
    /// Stamp and row of the last message given out.
    after: (i64, i64),
}

impl SqliteFile {
    pub(crate) fn open(file: &DataFile) -> Result<SqliteFile, BagError> {
        let path = file.shown.as_path();
        let wrap = |error: rusqlite::Error| bad(path, &error);
        let connection = connect(file).map_err(wrap)?;
        let columns = columns(&connection, "topics").map_err(wrap)?;
        if columns.is_empty() {
            return Err(BagError::bad_file(
                path,
                "this sqlite3 file has no table 'topics'; expected a rosbag2 recording",
            ));
        }
        let qos_column =
            if columns.iter().any(|name| name == "offered_qos_profiles") { "offered_qos_profiles" } else { "''" };
        let (mut channels, ids) = read_topics(path, &connection, qos_column)?;
        if !self::columns(&connection, "message_definitions").map_err(wrap)?.is_empty() {
            read_definitions(&connection, &mut channels).map_err(wrap)?;
        }
        let span_ns = read_counts(path, &connection, &mut channels, &ids)?;
        Ok(SqliteFile {
            path: path.to_owned(),
            connection,
            channels,
            span_ns,
            ids,
            page: VecDeque::new(),
            after: (i64::MIN, i64::MIN),
        })
    }

    /// The next message in the order of time with its channel; `Ok(None)` at the end.
    pub(crate) fn next_message(&mut self) -> Result<Option<(u16, Message)>, BagError> {
        if self.page.is_empty() {
            let wrap = |error: rusqlite::Error| bad(&self.path, &error);
            let query = "SELECT id, topic_id, timestamp, data FROM messages WHERE timestamp > ?1 OR (timestamp = ?1 AND id > ?2) \
                         ORDER BY timestamp, id LIMIT ?3";
            let mut statement = self.connection.prepare_cached(query).map_err(wrap)?;
            let mut rows = statement.query((self.after.0, self.after.1, PAGE)).map_err(wrap)?;
            while let Some(row) = rows.next().map_err(wrap)? {
                let id: i64 = row.get(0).map_err(wrap)?;
                let timestamp: i64 = row.get(2).map_err(wrap)?;
                let topic: i64 = row.get(1).map_err(wrap)?;
                let key = *self.ids.get(&topic).ok_or_else(|| {
                    BagError::bad_file(
                        &self.path,
                        format!("a message of topic {topic}, which the table 'topics' does not list"),
                    )
                })?;
                let data: Vec<u8> = row.get(3).map_err(wrap)?;
                self.after = (timestamp, id);
                let stamp_ns = stamp(&self.path, timestamp)?;
                self.page.push_back((key, Message { topic: 0, stamp_ns, publish_ns: stamp_ns, sequence: 0, data }));
            }
        }
        Ok(self.page.pop_front())
    }
}

/// The recording's topics, and their rows' ids.
fn read_topics(
    path: &Path,
    connection: &Connection,
    qos_column: &str,
) -> Result<(BTreeMap<u16, Channel>, TopicKeys), BagError> {
    let wrap = |error: rusqlite::Error| bad(path, &error);
    let (mut channels, mut ids) = (BTreeMap::new(), BTreeMap::new());
    let query = format!("SELECT id, name, type, serialization_format, {qos_column} FROM topics ORDER BY id");
    let mut statement = connection.prepare(&query).map_err(wrap)?;
    let mut rows = statement.query([]).map_err(wrap)?;
    while let Some(row) = rows.next().map_err(wrap)? {
        let id: i64 = row.get(0).map_err(wrap)?;
        let key = u16::try_from(channels.len())
            .map_err(|_| BagError::bad_file(path, "more than 65535 topics; expected fewer"))?;
        let qos: String = row.get(4).map_err(wrap)?;
        ids.insert(id, key);
        channels.insert(
            key,
            Channel {
                topic: row.get(1).map_err(wrap)?,
                type_name: row.get(2).map_err(wrap)?,
                schema: None,
                message_encoding: row.get(3).map_err(wrap)?,
                about: BTreeMap::from([(OFFERED.to_owned(), qos)]),
                messages: 0,
            },
        );
    }
    Ok((channels, ids))
}

/// What the recording reports of its topics' types.
fn read_definitions(connection: &Connection, channels: &mut BTreeMap<u16, Channel>) -> rusqlite::Result<()> {
    let query = "SELECT topic_type, encoding, encoded_message_definition FROM message_definitions";
    let mut statement = connection.prepare(query)?;
    let mut rows = statement.query([])?;
    while let Some(row) = rows.next()? {
        let type_name: String = row.get(0)?;
        let encoding: String = row.get(1)?;
        let text: String = row.get(2)?;
        for channel in channels.values_mut().filter(|channel| channel.type_name == type_name) {
            let (name, encoding, data) = (type_name.clone(), encoding.clone(), text.clone().into_bytes());
            channel.schema = Some(Schema { name, encoding, data });
        }
    }
    Ok(())
}

/// Counts each topic's messages; returns the first and the last stamp, ns.
fn read_counts(
    path: &Path,
    connection: &Connection,
    channels: &mut BTreeMap<u16, Channel>,
    ids: &TopicKeys,
) -> Result<Option<(u64, u64)>, BagError> {
    let wrap = |error: rusqlite::Error| bad(path, &error);
    let mut span_ns = None;
    let query = "SELECT topic_id, count(*), min(timestamp), max(timestamp) FROM messages GROUP BY topic_id";
    let mut statement = connection.prepare(query).map_err(wrap)?;
    let mut rows = statement.query([]).map_err(wrap)?;
    while let Some(row) = rows.next().map_err(wrap)? {
        let id: i64 = row.get(0).map_err(wrap)?;
        let channel = ids.get(&id).and_then(|key| channels.get_mut(key)).ok_or_else(|| {
            BagError::bad_file(path, format!("messages of topic {id}, which the table 'topics' does not list"))
        })?;
        channel.messages = row.get::<_, i64>(1).map_err(wrap)? as u64;
        let start = stamp(path, row.get(2).map_err(wrap)?)?;
        let end = stamp(path, row.get(3).map_err(wrap)?)?;
        let (first, last) = span_ns.unwrap_or((start, end));
        span_ns = Some((start.min(first), end.max(last)));
    }
    Ok(span_ns)
}

fn connect(file: &DataFile) -> rusqlite::Result<Connection> {
    let read = OpenFlags::SQLITE_OPEN_READ_ONLY | OpenFlags::SQLITE_OPEN_NO_MUTEX;
    match file.sqlite {
        Some(SqliteMode::PrivateCopy) => {
            let write = OpenFlags::SQLITE_OPEN_READ_WRITE | OpenFlags::SQLITE_OPEN_NO_MUTEX;
            Connection::open_with_flags(&file.readable, write)
        }
        Some(SqliteMode::Immutable) => {
            Connection::open_with_flags(immutable_uri(&file.readable), read | OpenFlags::SQLITE_OPEN_URI)
        }
        Some(SqliteMode::ReadOnly) | None => Connection::open_with_flags(&file.readable, read),
    }
}

/// Every byte that could mean something in a URI is escaped.
fn immutable_uri(path: &Path) -> String {
    use std::fmt::Write;
    use std::os::unix::ffi::OsStrExt;
    let absolute = std::path::absolute(path).unwrap_or_else(|_| path.to_owned());
    let mut uri = String::from("file:");
    for byte in absolute.as_os_str().as_bytes() {
        if byte.is_ascii_alphanumeric() || b"/._-".contains(byte) {
            uri.push(char::from(*byte));
        } else {
            write!(uri, "%{byte:02X}").expect("writing to a string cannot fail");
        }
    }
    uri + "?immutable=1"
}

fn columns(connection: &Connection, table: &str) -> rusqlite::Result<Vec<String>> {
    let mut statement = connection.prepare("SELECT name FROM pragma_table_info(?1)")?;
    let names = statement.query_map([table], |row| row.get(0))?;
    names.collect()
}

fn stamp(path: &Path, timestamp: i64) -> Result<u64, BagError> {
    u64::try_from(timestamp)
        .map_err(|_| BagError::bad_file(path, format!("a message's time stamp is {timestamp} ns; expected 0 or more")))
}

fn bad(path: &Path, error: &rusqlite::Error) -> BagError {
    BagError::bad_file(path, format!("cannot be read as a sqlite3 bag: {error}"))
}
