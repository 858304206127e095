//! The records of an MCAP file, each read from bytes that may be anything. Layout: the MCAP specification, version 0.

use std::collections::BTreeMap;
use std::io::Read;

use recorder::{Channel, Message, OFFERED, Schema};

use crate::Offer;
use crate::cursor::Cursor;

/// More than any sensible chunk or record; a larger size in a file is damage, and is not allocated.
pub(crate) const LARGEST_RECORD: u64 = 1 << 30;

pub(crate) mod op {
    pub(crate) const HEADER: u8 = 1;
    pub(crate) const SCHEMA: u8 = 3;
    pub(crate) const CHANNEL: u8 = 4;
    pub(crate) const MESSAGE: u8 = 5;
    pub(crate) const CHUNK: u8 = 6;
    pub(crate) const DATA_END: u8 = 15;
}

/// What the channel's publishers offered; none if the file does not say.
pub(crate) fn offers(channel: &Channel) -> Vec<Offer> {
    channel.about.get(OFFERED).map_or(Vec::new(), |text| Offer::list_from_yaml(text))
}

pub(crate) fn schema(bytes: &[u8]) -> Option<(u16, Schema)> {
    let mut cursor = Cursor::new(bytes);
    let id = cursor.u16()?;
    let name = cursor.text()?.to_owned();
    let encoding = cursor.text()?.to_owned();
    let length = cursor.u32()?;
    Some((id, Schema { name, encoding, data: cursor.take(length as usize)?.to_vec() }))
}

/// A channel with its number. Its schema must stand before it.
pub(crate) fn channel(bytes: &[u8], schemas: &BTreeMap<u16, Schema>) -> Result<(u16, Channel), String> {
    let short = "a channel record is cut short or not text";
    let mut cursor = Cursor::new(bytes);
    let id = cursor.u16().ok_or(short)?;
    let schema_id = cursor.u16().ok_or(short)?;
    let topic = cursor.text().ok_or(short)?.to_owned();
    let message_encoding = cursor.text().ok_or(short)?.to_owned();
    let length = cursor.u32().ok_or(short)?;
    let mut entries = Cursor::new(cursor.take(length as usize).ok_or(short)?);
    let mut about = BTreeMap::new();
    while !entries.is_empty() {
        let key = entries.text().ok_or(short)?.to_owned();
        about.insert(key, entries.text().ok_or(short)?.to_owned());
    }
    let schema = schemas.get(&schema_id).cloned();
    if schema_id != 0 && schema.is_none() {
        return Err(format!("channel '{topic}' uses schema {schema_id}, which is not declared"));
    }
    let type_name = schema.as_ref().map_or(String::new(), |schema| schema.name.clone());
    Ok((id, Channel { topic, type_name, schema, message_encoding, about, messages: 0 }))
}

/// Channel and stamp of a message record.
pub(crate) fn message_head(bytes: &[u8]) -> Option<(u16, u64)> {
    let mut cursor = Cursor::new(bytes);
    let channel = cursor.u16()?;
    let _sequence = cursor.u32()?;
    let log_time = cursor.u64()?;
    cursor.u64()?;
    Some((channel, log_time))
}

/// A message with its channel.
pub(crate) fn message(bytes: &[u8]) -> Option<(u16, Message)> {
    let mut cursor = Cursor::new(bytes);
    let channel = cursor.u16()?;
    let sequence = cursor.u32()?;
    let stamp_ns = cursor.u64()?;
    let publish_ns = cursor.u64()?;
    Some((channel, Message { topic: 0, stamp_ns, publish_ns, sequence, data: cursor.rest().to_vec() }))
}

pub(crate) fn for_each_record(
    mut bytes: &[u8],
    mut take: impl FnMut(u8, &[u8]) -> Result<(), String>,
) -> Result<(), String> {
    while !bytes.is_empty() {
        let mut cursor = Cursor::new(bytes);
        let head = cursor.u8().zip(cursor.u64());
        let (code, length) = head.ok_or("a chunk ends inside a record")?;
        let length = usize::try_from(length).map_err(|_| "a chunk ends inside a record")?;
        let record = cursor.take(length).ok_or("a chunk ends inside a record")?;
        take(code, record)?;
        bytes = cursor.rest();
    }
    Ok(())
}

/// The records in a chunk, its length and checksum verified.
pub(crate) fn decompress_chunk(bytes: &[u8]) -> Result<Vec<u8>, String> {
    let short = "a chunk's head is cut short";
    let mut cursor = Cursor::new(bytes);
    let _start = cursor.u64().ok_or(short)?;
    let _end = cursor.u64().ok_or(short)?;
    let size = cursor.u64().ok_or(short)?;
    let checksum = cursor.u32().ok_or(short)?;
    let compression = cursor.text().ok_or(short)?;
    let length = cursor.u64().ok_or(short)?;
    let packed = usize::try_from(length).ok().and_then(|length| cursor.take(length)).ok_or(short)?;
    if size > LARGEST_RECORD {
        return Err(format!("a chunk of {size} bytes; expected at most {LARGEST_RECORD}"));
    }
    let mut records = Vec::new();
    // One byte more than announced is enough to see that there is too much.
    let unpacked = match compression {
        "" => packed.take(size + 1).read_to_end(&mut records),
        "zstd" => zstd::stream::read::Decoder::with_buffer(packed)
            .and_then(|decoder| decoder.take(size + 1).read_to_end(&mut records)),
        "lz4" => lz4_flex::frame::FrameDecoder::new(packed).take(size + 1).read_to_end(&mut records),
        other => return Err(format!("a chunk compressed with '{other}'; expected zstd, lz4 or none")),
    };
    unpacked.map_err(|error| format!("a chunk cannot be unpacked: {error}"))?;
    if records.len() as u64 != size {
        return Err(format!("a chunk unpacks to {} bytes or more; expected {size}", records.len()));
    }
    // Zero means that no checksum was made.
    if checksum != 0 {
        let found = crc32fast::hash(&records);
        if found != checksum {
            return Err(format!("a chunk's checksum is {found:08x}; expected {checksum:08x}"));
        }
    }
    Ok(records)
}
