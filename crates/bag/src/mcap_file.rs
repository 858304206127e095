//! Reading one MCAP file: a strict, bounded scan of its records, and its messages in the order of time.
//!
//! The scan reads the data section only and trusts no index, so that a file with a damaged or missing summary gives the
//! same messages as a whole one. Record layout: the MCAP specification, version 0.

use std::collections::BTreeMap;
use std::fs::File;
use std::os::unix::fs::FileExt;
use std::path::PathBuf;

use recorder::{Channel, Message, Schema};

use crate::BagError;
use crate::cursor::Cursor;
use crate::data_file::DataFile;
use crate::records::{LARGEST_RECORD, channel, decompress_chunk, for_each_record, message, message_head, op, schema};

const MAGIC: &[u8; 8] = b"\x89MCAP0\r\n";

/// Messages outside chunks are grouped into blocks of about this size.
const LOOSE_BLOCK: u64 = 1 << 20;

/// A stretch of the file whose messages are read together.
#[derive(Clone, Copy, Debug)]
struct Block {
    offset: u64,
    length: u64,
    chunk: bool,
    first_ns: u64,
}

/// What is wrong with a file and where.
#[derive(Clone, Debug)]
pub(crate) struct Damage {
    pub(crate) offset: u64,
    pub(crate) reason: String,
}

/// A scanned file.
#[derive(Debug)]
pub(crate) struct McapFile {
    path: PathBuf,
    file: File,
    blocks: Vec<Block>,
    pub(crate) channels: BTreeMap<u16, Channel>,
    pub(crate) span_ns: Option<(u64, u64)>,
    /// In the order of the file; empty for a whole one.
    pub(crate) damage: Vec<Damage>,
    pub(crate) size: u64,
}

/// Scanning state apart from the file.
#[derive(Default)]
struct Found {
    schemas: BTreeMap<u16, Schema>,
    channels: BTreeMap<u16, Channel>,
    span_ns: Option<(u64, u64)>,
}

impl McapFile {
    /// Reads the whole data section once and checks every chunk.
    ///
    /// Damage is listed, not an error: the caller decides.
    ///
    /// # Errors
    /// [`BagError::Io`]; [`BagError::BadFile`] if this is not an MCAP file at all.
    pub(crate) fn scan(data: &DataFile) -> Result<McapFile, BagError> {
        let path = data.shown.as_path();
        let file = data.file()?;
        let size = file.metadata().map_err(BagError::io(path, "look at"))?.len();
        let mut magic = [0; 8];
        if size == 0 {
            return Err(BagError::bad_file(path, "the file is empty; expected an MCAP recording"));
        }
        if size < 8 || file.read_exact_at(&mut magic, 0).is_err() || &magic != MAGIC {
            return Err(BagError::bad_file(
                path,
                "this is not an MCAP file: its first 8 bytes are not MCAP's mark; expected a recording in MCAP, version 0",
            ));
        }
        let mut scanned = McapFile {
            path: path.to_owned(),
            file,
            blocks: Vec::new(),
            channels: BTreeMap::new(),
            span_ns: None,
            damage: Vec::new(),
            size,
        };
        let mut found = Found::default();
        let mut offset = 8;
        let mut complete = false;
        while offset < size {
            let Some((code, length)) = scanned.record_head(offset)? else {
                let reason = "the file ends inside a record";
                scanned.damage.push(Damage { offset, reason: reason.into() });
                break;
            };
            let body = offset + 9;
            if code == 0 {
                scanned.damage.push(Damage { offset, reason: "what stands here is no record".into() });
                break;
            }
            if length > size - body {
                scanned.damage.push(Damage { offset, reason: "the file ends inside a record".into() });
                break;
            }
            if code == op::DATA_END {
                complete = true;
                break;
            }
            if let Err(reason) = scanned.take_record(&mut found, code, body, length)? {
                scanned.damage.push(Damage { offset, reason });
            }
            offset = body + length;
        }
        if !complete && scanned.damage.is_empty() {
            scanned.damage.push(Damage { offset: size, reason: "the recording was not finished".into() });
        }
        scanned.channels = found.channels;
        scanned.span_ns = found.span_ns;
        // Stable, so that blocks that begin at the same time stay in the order of the file.
        scanned.blocks.sort_by_key(|block| block.first_ns);
        Ok(scanned)
    }

    fn record_head(&self, offset: u64) -> Result<Option<(u8, u64)>, BagError> {
        if self.size - offset < 9 {
            return Ok(None);
        }
        let head = self.bytes(offset, 9)?;
        let mut cursor = Cursor::new(&head);
        Ok(cursor.u8().zip(cursor.u64()))
    }

    fn bytes(&self, offset: u64, length: u64) -> Result<Vec<u8>, BagError> {
        let mut bytes = vec![0; length as usize];
        self.file.read_exact_at(&mut bytes, offset).map_err(BagError::io(&self.path, "read"))?;
        Ok(bytes)
    }

    /// The inner result is the file's fault.
    fn take_record(
        &mut self,
        found: &mut Found,
        code: u8,
        body: u64,
        length: u64,
    ) -> Result<Result<(), String>, BagError> {
        let wanted = matches!(code, op::HEADER | op::SCHEMA | op::CHANNEL | op::MESSAGE | op::CHUNK);
        if !wanted {
            return Ok(Ok(())); // indexes, attachments, metadata, and what later versions may add
        }
        if length > LARGEST_RECORD {
            return Ok(Err(format!("a record of {length} bytes; expected at most {LARGEST_RECORD}")));
        }
        let bytes = self.bytes(body, length)?;
        Ok(match code {
            op::CHUNK => self.take_chunk(found, body, &bytes),
            op::MESSAGE => found.record(code, &bytes).map(|first_ns| {
                let first_ns = first_ns.unwrap_or(0);
                let start = body - 9;
                match self.blocks.last_mut() {
                    Some(block)
                        if !block.chunk && block.offset + block.length == start && block.length < LOOSE_BLOCK =>
                    {
                        block.length += length + 9;
                        block.first_ns = block.first_ns.min(first_ns);
                    }
                    _ => self.blocks.push(Block { offset: start, length: length + 9, chunk: false, first_ns }),
                }
            }),
            _ => found.record(code, &bytes).map(|_| ()),
        })
    }

    /// A chunk counts only as a whole: if any record in it is wrong, nothing of it is taken.
    fn take_chunk(&mut self, found: &mut Found, body: u64, bytes: &[u8]) -> Result<(), String> {
        let records = decompress_chunk(bytes)?;
        let mut trial = Found { schemas: BTreeMap::new(), channels: found.channels.clone(), span_ns: None };
        // Schemas are few and only added to, so they may stay even if the chunk is refused.
        std::mem::swap(&mut trial.schemas, &mut found.schemas);
        let result = for_each_record(&records, |code, record| trial.record(code, record).map(|_| ()));
        std::mem::swap(&mut trial.schemas, &mut found.schemas);
        result?;
        found.channels = trial.channels;
        if let Some((start, end)) = trial.span_ns {
            found.extend_span(start);
            found.extend_span(end);
            self.blocks.push(Block { offset: body, length: bytes.len() as u64, chunk: true, first_ns: start });
        }
        Ok(())
    }

    /// The messages of block number `index` with their channel, in the order of their stamps.
    fn load(&self, index: usize) -> Result<Vec<(u16, Message)>, BagError> {
        let block = self.blocks[index];
        let mut bytes = self.bytes(block.offset, block.length)?;
        let changed = |reason: String| BagError::bad_file(&self.path, format!("changed while it was read: {reason}"));
        if block.chunk {
            bytes = decompress_chunk(&bytes).map_err(changed)?;
        }
        let mut messages = Vec::new();
        for_each_record(&bytes, |code, record| {
            if code == op::MESSAGE {
                messages.push(message(record).ok_or("a message is cut short")?);
            }
            Ok(())
        })
        .map_err(changed)?;
        messages.sort_by_key(|(_, message)| message.stamp_ns);
        Ok(messages)
    }

    /// All messages in the order of time.
    pub(crate) fn ordered(self: &std::sync::Arc<McapFile>) -> Ordered {
        Ordered { file: self.clone(), next_block: 0, open: Vec::new() }
    }
}

impl Found {
    fn extend_span(&mut self, stamp_ns: u64) {
        let (start, end) = self.span_ns.unwrap_or((stamp_ns, stamp_ns));
        self.span_ns = Some((start.min(stamp_ns), end.max(stamp_ns)));
    }

    /// Takes one record; gives the stamp if it was a message.
    fn record(&mut self, code: u8, bytes: &[u8]) -> Result<Option<u64>, String> {
        match code {
            op::SCHEMA => {
                let (id, schema) = schema(bytes).ok_or("a schema record is cut short")?;
                self.schemas.insert(id, schema);
                Ok(None)
            }
            op::CHANNEL => {
                let (id, channel) = channel(bytes, &self.schemas)?;
                match self.channels.get(&id) {
                    Some(known) if known.topic != channel.topic || known.type_name != channel.type_name => {
                        return Err(format!("channel {id} is '{}' and later '{}'", known.topic, channel.topic));
                    }
                    Some(_) => {}
                    None => {
                        self.channels.insert(id, channel);
                    }
                }
                Ok(None)
            }
            op::MESSAGE => {
                let (id, stamp_ns) = message_head(bytes).ok_or("a message is cut short")?;
                let channel = self
                    .channels
                    .get_mut(&id)
                    .ok_or_else(|| format!("a message on channel {id}, which is not declared"))?;
                channel.messages += 1;
                self.extend_span(stamp_ns);
                Ok(Some(stamp_ns))
            }
            _ => Ok(None),
        }
    }
}

/// The messages of a file in the order of their stamps. Blocks whose times overlap are open at the same time.
#[derive(Debug)]
pub(crate) struct Ordered {
    file: std::sync::Arc<McapFile>,
    next_block: usize,
    /// Open blocks, each with the messages that are left.
    open: Vec<std::iter::Peekable<std::vec::IntoIter<(u16, Message)>>>,
}

impl Ordered {
    /// The next message with its channel; `Ok(None)` at the end.
    pub(crate) fn next_message(&mut self) -> Result<Option<(u16, Message)>, BagError> {
        loop {
            self.open.retain_mut(|block| block.peek().is_some());
            let earliest = self
                .open
                .iter_mut()
                .enumerate()
                .filter_map(|(index, block)| Some((block.peek()?.1.stamp_ns, index)))
                .min();
            let waiting = self.file.blocks.get(self.next_block);
            match (earliest, waiting) {
                (Some((stamp_ns, index)), waiting) if waiting.is_none_or(|block| block.first_ns > stamp_ns) => {
                    return Ok(self.open[index].next());
                }
                (_, Some(_)) => {
                    let messages = self.file.load(self.next_block)?;
                    self.next_block += 1;
                    self.open.push(messages.into_iter().peekable());
                }
                (_, None) => return Ok(None),
            }
        }
    }
}
