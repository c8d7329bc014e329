//! Reads the records of an MCAP file, complete, truncated or damaged: <https://mcap.dev/spec>.
//!
//! Every record begins with its length. A damaged record is reported and skipped; a record that extends past the end of
//! the file marks the truncation. No stated length causes an allocation larger than the file.

use dermis::text::counted;
use mcap::MAGIC;
use mcap::records::{AttachmentHeader, Channel, Header, MessageHeader, Metadata, SchemaHeader, op};
use std::collections::BTreeMap;
use std::io::{BufReader, Read};

/// An item of the file.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Item {
    Header(Header),
    Schema {
        header: SchemaHeader,
        data: Vec<u8>,
    },
    Channel(Channel),
    Message {
        header: MessageHeader,
        data: Vec<u8>,
    },
    Attachment {
        header: AttachmentHeader,
        data: Vec<u8>,
    },
    Metadata(Metadata),
    /// Skipped bytes: position, number, reason.
    Damaged {
        at: u64,
        bytes: u64,
        why: String,
    },
}

/// The end of the file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum End {
    /// Complete.
    Whole,
    /// Truncated: the bytes after the last complete record, which cannot be read.
    Cut { at: u64, bytes: u64 },
}

/// Length of the prefix of a record: its opcode and its length.
const PREFIX_BYTES: usize = 9;
/// Longest accepted record; a chunk of a recording has about one megabyte.
const LONGEST_RECORD: u64 = 256 << 20;

/// A reader of the records of a file.
pub(super) struct Walk<R> {
    input: BufReader<R>,
    /// Length of the file, bytes.
    length: u64,
    /// Number of bytes read.
    at: u64,
    /// Records of the current chunk, what is left of them, and their position.
    chunk: Vec<u8>,
    in_chunk: usize,
    chunk_at: u64,
    /// Whether the data section has ended and only the summary is left.
    summary: bool,
    end: Option<End>,
}

impl<R: Read> Walk<R> {
    /// For a file of a given length.
    ///
    /// # Errors
    /// What the file is instead of a recording; a system error.
    pub(super) fn new(input: R, length: u64) -> std::io::Result<Result<Self, String>> {
        let mut walk = Walk {
            input: BufReader::with_capacity(1 << 16, input),
            length,
            at: 0,
            chunk: Vec::new(),
            in_chunk: 0,
            chunk_at: 0,
            summary: false,
            end: None,
        };
        let start = walk.take(MAGIC.len() as u64)?;
        Ok(match start {
            start if start == MAGIC => Ok(walk),
            start if start.is_empty() => Err("the file is empty".into()),
            start if MAGIC.starts_with(&start) => Err(format!("it ends after {}", counted(start.len(), "byte"))),
            start => Err(format!("it begins with {start:02x?}")),
        })
    }

    /// Position of the record that contains the last item.
    pub(super) fn record_at(&self) -> u64 {
        self.chunk_at
    }

    /// How the file ended, after the last item.
    pub(super) fn end(&self) -> Option<End> {
        self.end
    }

    /// The next item; `None` at the end.
    ///
    /// # Errors
    /// A system error.
    pub(super) fn next(&mut self) -> std::io::Result<Option<Item>> {
        while self.end.is_none() {
            if let Some(item) = self.next_in_chunk() {
                return Ok(Some(item));
            }
            if let Some(item) = self.next_record()? {
                return Ok(Some(item));
            }
        }
        // Items of a truncated chunk.
        Ok(self.next_in_chunk())
    }

    fn next_in_chunk(&mut self) -> Option<Item> {
        while let Some((kind, body, next)) = record_at(&self.chunk, self.in_chunk) {
            let start = std::mem::replace(&mut self.in_chunk, next);
            match parse(kind, body) {
                Ok(Some(item)) => return Some(item),
                Ok(None) => {}
                Err(why) => {
                    return Some(Item::Damaged { at: self.chunk_at, bytes: (next - start) as u64, why: why.into() });
                }
            }
        }
        self.chunk.clear();
        self.in_chunk = 0;
        None
    }

    /// The next record of the file itself; `None` for a chunk, an index, or the end.
    fn next_record(&mut self) -> std::io::Result<Option<Item>> {
        let start = self.at;
        self.chunk_at = start;
        let prefix = self.take(PREFIX_BYTES as u64)?;
        let Ok(&[kind, ref length @ ..]) = <&[u8; PREFIX_BYTES]>::try_from(prefix.as_slice()) else {
            self.finish(start, false);
            return Ok(None);
        };
        let length = u64::from_le_bytes(*length);
        if length > self.length - self.at || length > LONGEST_RECORD {
            if kind == op::CHUNK {
                let rest = self.take(LONGEST_RECORD)?;
                self.take_what_is_left_of_chunk(&rest);
            }
            self.finish(start, false);
            return Ok(None);
        }
        let body = self.take(length)?;
        if body.len() as u64 != length {
            self.finish(start, false);
            return Ok(None);
        }
        Ok(self.record(kind, &body, start))
    }

    fn record(&mut self, kind: u8, body: &[u8], start: u64) -> Option<Item> {
        let damaged = |why: String| Some(Item::Damaged { at: start, bytes: (PREFIX_BYTES + body.len()) as u64, why });
        match kind {
            op::DATA_END => self.summary = true,
            op::FOOTER => {
                let magic = self.take(MAGIC.len() as u64).unwrap_or_default();
                self.finish(start, self.summary && magic == MAGIC);
            }
            _ if self.summary => {}
            op::CHUNK => match chunk(body) {
                Ok(records) => self.chunk = records,
                Err(why) => return damaged(why),
            },
            _ => match parse(kind, body) {
                Ok(item) => return item,
                Err(why) => return damaged(why.into()),
            },
        }
        None
    }

    /// Reads the records of a truncated chunk. Its checksum cannot be verified; the records that a killed program had
    /// written are valid.
    fn take_what_is_left_of_chunk(&mut self, body: &[u8]) {
        if let Some((header, records)) = chunk_header(body) {
            self.chunk = unpacked(&header, records).0;
        }
    }

    fn finish(&mut self, start: u64, whole: bool) {
        self.end =
            Some(if whole { End::Whole } else { End::Cut { at: start, bytes: self.length.saturating_sub(start) } });
    }

    /// The next bytes; fewer at the end of the file.
    fn take(&mut self, count: u64) -> std::io::Result<Vec<u8>> {
        let count = count.min(self.length.saturating_sub(self.at));
        let mut bytes = Vec::with_capacity(count as usize);
        (&mut self.input).take(count).read_to_end(&mut bytes)?;
        self.at += bytes.len() as u64;
        Ok(bytes)
    }
}

/// Opcode and body of the record at a position, and the position after it; `None` without a complete record.
fn record_at(bytes: &[u8], at: usize) -> Option<(u8, &[u8], usize)> {
    let (&[kind, ref length @ ..], rest) = bytes.get(at..)?.split_first_chunk::<PREFIX_BYTES>()?;
    let length = usize::try_from(u64::from_le_bytes(*length)).ok()?;
    Some((kind, rest.get(..length)?, at + PREFIX_BYTES + length))
}

struct ChunkHeader {
    unpacked_bytes: u64,
    crc: u32,
    compression: String,
}

/// The header of a chunk and its records, as far as the file contains them.
fn chunk_header(body: &[u8]) -> Option<(ChunkHeader, &[u8])> {
    let mut fields = Fields(body);
    // Start and end time.
    fields.bytes(16)?;
    let header = ChunkHeader { unpacked_bytes: fields.u64()?, crc: fields.u32()?, compression: fields.text()? };
    let length = fields.u64()?;
    let records = &fields.0[..fields.0.len().min(usize::try_from(length).unwrap_or(usize::MAX))];
    Some((header, records))
}

/// The records of a chunk.
fn chunk(body: &[u8]) -> Result<Vec<u8>, String> {
    let (header, records) = chunk_header(body).ok_or("a chunk is too short")?;
    let (records, outcome) = unpacked(&header, records);
    outcome?;
    if header.crc != 0 && crc32fast::hash(&records) != header.crc {
        return Err("the checksum of a chunk is wrong".into());
    }
    Ok(records)
}

/// The records of a chunk that can be decompressed, and whether these are all.
fn unpacked(header: &ChunkHeader, records: &[u8]) -> (Vec<u8>, Result<(), String>) {
    /// Largest window of a compressed chunk, as a power of two: no chunk is longer.
    const WINDOW_BITS: u32 = 24;
    let mut all = Vec::new();
    let outcome = match header.compression.as_str() {
        "" => {
            all.extend_from_slice(records);
            Ok(())
        }
        "zstd" => zstd::stream::read::Decoder::with_buffer(records)
            .and_then(|mut decoder| {
                decoder.window_log_max(WINDOW_BITS)?;
                decoder.take(header.unpacked_bytes.min(LONGEST_RECORD)).read_to_end(&mut all)
            })
            .map(drop)
            .map_err(|error| format!("a chunk cannot be unpacked ({error})")),
        other => Err(format!(
            "a chunk is compressed with {other}: have another tool write it with zstd or without compression"
        )),
    };
    (all, outcome)
}

/// The item of a record; `None` for records that only repeat or index others.
fn parse(kind: u8, body: &[u8]) -> Result<Option<Item>, &'static str> {
    let mut fields = Fields(body);
    Ok(Some(match kind {
        op::HEADER => Item::Header(header(&mut fields).ok_or("the header is damaged")?),
        op::SCHEMA => schema(&mut fields).ok_or("a schema is damaged")?,
        op::CHANNEL => Item::Channel(channel(&mut fields).ok_or("a channel is damaged")?),
        op::MESSAGE => message(&mut fields).ok_or("a message is damaged")?,
        op::ATTACHMENT => attachment(body).ok_or("an attachment is damaged")?,
        op::METADATA => Item::Metadata(metadata(&mut fields).ok_or("a metadata record is damaged")?),
        _ => return Ok(None),
    }))
}

fn header(fields: &mut Fields<'_>) -> Option<Header> {
    Some(Header { profile: fields.text()?, library: fields.text()? })
}

fn schema(fields: &mut Fields<'_>) -> Option<Item> {
    // 0 means no schema.
    let id = fields.u16().filter(|&id| id != 0)?;
    let header = SchemaHeader { id, name: fields.text()?, encoding: fields.text()? };
    let length = fields.u32()?;
    Some(Item::Schema { header, data: fields.bytes(length as usize)?.to_vec() })
}

fn channel(fields: &mut Fields<'_>) -> Option<Channel> {
    Some(Channel {
        id: fields.u16()?,
        schema_id: fields.u16()?,
        topic: fields.text()?,
        message_encoding: fields.text()?,
        metadata: fields.map()?,
    })
}

fn message(fields: &mut Fields<'_>) -> Option<Item> {
    let header = MessageHeader {
        channel_id: fields.u16()?,
        sequence: fields.u32()?,
        log_time: fields.u64()?,
        publish_time: fields.u64()?,
    };
    Some(Item::Message { header, data: fields.0.to_vec() })
}

fn attachment(body: &[u8]) -> Option<Item> {
    let (signed, crc) = body.split_last_chunk::<4>()?;
    let mut fields = Fields(signed);
    let header = AttachmentHeader {
        log_time: fields.u64()?,
        create_time: fields.u64()?,
        name: fields.text()?,
        media_type: fields.text()?,
    };
    let length = fields.u64()?;
    let data = fields.bytes(usize::try_from(length).ok()?)?.to_vec();
    let crc = u32::from_le_bytes(*crc);
    (crc == 0 || crc32fast::hash(signed) == crc).then_some(Item::Attachment { header, data })
}

fn metadata(fields: &mut Fields<'_>) -> Option<Metadata> {
    Some(Metadata { name: fields.text()?, metadata: fields.map()? })
}

/// Reads the fields of a record in order.
struct Fields<'a>(&'a [u8]);

impl<'a> Fields<'a> {
    fn bytes(&mut self, count: usize) -> Option<&'a [u8]> {
        let (taken, rest) = self.0.split_at_checked(count)?;
        self.0 = rest;
        Some(taken)
    }

    fn array<const N: usize>(&mut self) -> Option<[u8; N]> {
        self.bytes(N)?.try_into().ok()
    }

    fn u16(&mut self) -> Option<u16> {
        self.array().map(u16::from_le_bytes)
    }

    fn u32(&mut self) -> Option<u32> {
        self.array().map(u32::from_le_bytes)
    }

    fn u64(&mut self) -> Option<u64> {
        self.array().map(u64::from_le_bytes)
    }

    fn text(&mut self) -> Option<String> {
        let length = self.u32()?;
        String::from_utf8(self.bytes(length as usize)?.to_vec()).ok()
    }

    fn map(&mut self) -> Option<BTreeMap<String, String>> {
        let length = self.u32()?;
        let mut fields = Fields(self.bytes(length as usize)?);
        let mut map = BTreeMap::new();
        while !fields.0.is_empty() {
            map.insert(fields.text()?, fields.text()?);
        }
        Some(map)
    }
}
