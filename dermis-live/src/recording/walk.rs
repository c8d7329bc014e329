//! Reads the records of an MCAP file, complete, truncated or damaged: <https://mcap.dev/spec>.
//!
//! Every record begins with its length. A damaged record is reported and skipped; a record that extends past the end of
//! the file marks the truncation. Files that were joined are read one after the other, truncated ones too. No stated
//! length causes an allocation larger than the file.

use crate::recording::source::{Next, PREFIX_BYTES, Source};
use dermis::text::counted;
use mcap::MAGIC;
use mcap::records::{AttachmentHeader, Channel, Header, MessageHeader, Metadata, SchemaHeader, op};
use std::collections::BTreeMap;
use std::io::{Read, Seek, SeekFrom};

/// An item of the file.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Item {
    /// Another recording was joined to the last one, and begins here.
    Another,
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
    /// Complete, and followed by bytes that are no recording.
    Followed { at: u64, bytes: u64 },
    /// Truncated: the bytes after the last complete record, which cannot be read.
    Cut { at: u64, bytes: u64 },
}

/// Longest accepted record; a chunk of a recording has about one megabyte.
const LONGEST_RECORD: u64 = 256 << 20;
/// Why the end of a recording was skipped that another one was joined to.
const UNFINISHED: &str = "a recording ends here unfinished, and another one begins";

/// Why bytes were skipped up to the next chunk.
const DAMAGED: &str = "a record is damaged; reading goes on with the next chunk";

/// A reader of the records of a file.
pub(super) struct Walk<R> {
    source: Source<R>,
    /// Records of the current chunk, what is left of them, and their position.
    chunk: Vec<u8>,
    in_chunk: usize,
    chunk_at: u64,
    /// Whether the data section has ended and only the summary is left.
    summary: bool,
    /// Whether another recording begins at this position.
    begins: bool,
    end: Option<End>,
    /// The records of the file's index, until a damaged part is found.
    index: Vec<u8>,
}

impl<R: Read> Walk<R> {
    /// For a file of a given length.
    ///
    /// # Errors
    /// What the file is instead of a recording; a system error.
    pub(super) fn new(input: R, length: u64) -> std::io::Result<Result<Self, String>> {
        let mut walk = Walk {
            source: Source::new(input, length),
            chunk: Vec::new(),
            in_chunk: 0,
            chunk_at: 0,
            summary: false,
            begins: false,
            end: None,
            index: Vec::new(),
        };
        let start = walk.source.take(MAGIC.len() as u64)?;
        Ok(match start {
            start if start == MAGIC => Ok(walk),
            start if start.is_empty() => Err("the file is empty".into()),
            start if MAGIC.starts_with(&start) => Err(format!("it ends after {}", counted(start.len(), "byte"))),
            start => Err(format!("it begins with {start:02x?}")),
        })
    }

    /// With the [`index`] of the file, whose schemas and channels replace those that are lost in damaged parts.
    pub(super) fn with_index(self, index: Vec<u8>) -> Self {
        Walk { index, ..self }
    }

    /// Position of the record that contains the last item.
    pub(super) fn record_at(&self) -> u64 {
        self.chunk_at
    }

    /// The part of the file before the last item.
    pub(super) fn part_read(&self) -> f64 {
        // Of a chunk, as far as its records are read.
        let in_chunk = self.in_chunk as f64 / self.chunk.len().max(1) as f64;
        let size = self.source.at().saturating_sub(self.chunk_at) as f64;
        (self.chunk_at as f64 + in_chunk * size) / (self.source.at() + self.source.left()).max(1) as f64
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
        let item = self.next_item()?;
        if matches!(item, Some(Item::Damaged { .. })) && !self.index.is_empty() {
            // Its records are read next, before those that are left of the chunk.
            let left = self.chunk.split_off(self.in_chunk);
            self.chunk = [std::mem::take(&mut self.index), left].concat();
            self.in_chunk = 0;
        }
        Ok(item)
    }

    fn next_item(&mut self) -> std::io::Result<Option<Item>> {
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
        if std::mem::take(&mut self.begins) {
            return Ok(Some(Item::Another));
        }
        let start = self.source.at();
        self.chunk_at = start;
        let prefix = self.source.take(PREFIX_BYTES as u64)?;
        let length = match <&[u8; PREFIX_BYTES]>::try_from(prefix.as_slice()) {
            Ok(&[_, ref length @ ..]) => u64::from_le_bytes(*length),
            Err(_) => u64::MAX,
        };
        if length > self.source.left() || length > LONGEST_RECORD {
            self.source.put_back(prefix);
            return self.rest_of_recording();
        }
        let (kind, body) = (prefix[0], self.source.take(length)?);
        if body.len() as u64 != length {
            self.end = Some(End::Cut { at: start, bytes: self.source.at() - start });
            return Ok(None);
        }
        let chunk = (kind == op::CHUNK).then(|| chunk(&body));
        // A checksum proves that a chunk is complete; any other record may be the last one of a truncated recording.
        if !matches!(chunk, Some(Ok((_, IsChecked(true))))) && self.source.contains_start(&body)? {
            self.source.put_back(body);
            self.source.put_back(prefix);
            return self.rest_of_recording();
        }
        // After a record whose own length is damaged no other follows.
        let is_doubtful = matches!(chunk, Some(Err(_))) || !(op::HEADER..=op::DATA_END).contains(&kind);
        if is_doubtful && !self.summary && !self.source.continues()? {
            self.source.put_back(body);
            self.source.put_back(prefix);
            return self.rest_of_recording();
        }
        self.record(kind, &body, chunk, start)
    }

    fn record(
        &mut self,
        kind: u8,
        body: &[u8],
        chunk: Option<Result<(Vec<u8>, IsChecked), String>>,
        start: u64,
    ) -> std::io::Result<Option<Item>> {
        let damaged = |why: String| Some(Item::Damaged { at: start, bytes: (PREFIX_BYTES + body.len()) as u64, why });
        Ok(match (kind, chunk) {
            (op::DATA_END, _) => {
                self.summary = true;
                None
            }
            (op::FOOTER, _) => return self.footer(start),
            _ if self.summary => None,
            (_, Some(Ok((records, _)))) => {
                self.chunk = records;
                None
            }
            (_, Some(Err(why))) => damaged(why),
            _ => parse(kind, body).unwrap_or_else(|why| damaged(why.into())),
        })
    }

    /// The end of a recording: of the file, if no other was joined to it.
    fn footer(&mut self, start: u64) -> std::io::Result<Option<Item>> {
        let begins = self.source.begins()?;
        let magic = self.source.take(MAGIC.len() as u64)?;
        let is_whole = self.summary && magic == MAGIC && !begins;
        if !is_whole {
            self.source.put_back(magic);
        } else if self.source.left() == 0 {
            self.end = Some(End::Whole);
            return Ok(None);
        }
        let at = if is_whole { self.source.at() } else { start };
        let skipped = self.source.skip_to_start(0, false)?;
        let bytes = skipped.bytes + if is_whole { 0 } else { self.source.at() - skipped.bytes - start };
        if skipped.found.is_none() {
            self.end = Some(if is_whole { End::Followed { at, bytes } } else { End::Cut { at, bytes } });
            return Ok(None);
        }
        self.begin_another()?;
        let why = if is_whole { "no record, between two recordings" } else { UNFINISHED };
        Ok((bytes > 0 || !is_whole).then(|| Item::Damaged { at, bytes, why: why.into() }))
    }

    /// Skips the truncated end of a recording or a damaged record, up to the next chunk, the start of another recording or the end
    /// of the file. The records in the chunk where it was truncated are read. Their checksum cannot be verified; the records that a killed program
    /// had written are valid.
    fn rest_of_recording(&mut self) -> std::io::Result<Option<Item>> {
        let at = self.source.at();
        let is_chunk = self.source.next_byte()? == Some(op::CHUNK) && !self.summary;
        let skipped = self.source.skip_to_start(if is_chunk { LONGEST_RECORD } else { 0 }, !self.summary)?;
        if is_chunk && let Some((header, records)) = skipped.first.get(PREFIX_BYTES..).and_then(chunk_header) {
            self.chunk = unpacked(&header, records).0;
        }
        let why = match skipped.found {
            None => {
                self.end = Some(End::Cut { at, bytes: skipped.bytes });
                return Ok(None);
            }
            Some(Next::Chunk) => DAMAGED,
            Some(Next::Recording) => {
                self.begin_another()?;
                UNFINISHED
            }
        };
        Ok(Some(Item::Damaged { at, bytes: skipped.bytes, why: why.into() }))
    }

    /// Begins to read a recording that was joined to the last one.
    fn begin_another(&mut self) -> std::io::Result<()> {
        (self.summary, self.begins) = (false, true);
        self.source.take(MAGIC.len() as u64).map(drop)
    }
}

/// The records of the index at the end of a file, which its checksum proves; none without one. The input is at its start again.
///
/// # Errors
/// A system error.
pub(super) fn index(input: &mut (impl Read + Seek), length: u64) -> std::io::Result<Vec<u8>> {
    /// The body of a footer, and what of it the checksum leaves out.
    const FOOTER_BYTES: u64 = 20;
    const CRC_BYTES: usize = 4;
    let end_bytes = PREFIX_BYTES as u64 + FOOTER_BYTES + MAGIC.len() as u64;
    let Some(footer_at) = length.checked_sub(end_bytes) else { return Ok(Vec::new()) };
    let mut part = |from: u64, bytes: u64| {
        let mut part = Vec::new();
        input.seek(SeekFrom::Start(from))?;
        input.take(bytes).read_to_end(&mut part).map(|_| part)
    };
    let footer = part(footer_at, PREFIX_BYTES as u64 + FOOTER_BYTES)?;
    let start =
        record_at(&footer, 0).filter(|(kind, ..)| *kind == op::FOOTER).and_then(|(_, body, _)| Fields(body).u64());
    // 0: there is no index.
    let bytes = start.filter(|start| *start > 0).and_then(|start| footer_at.checked_sub(start)).unwrap_or(0);
    let records = part(footer_at - bytes, bytes.min(LONGEST_RECORD))?;
    input.seek(SeekFrom::Start(0))?;
    let is_proved = footer
        .split_last_chunk::<CRC_BYTES>()
        .is_some_and(|(proved, crc)| crc32fast::hash(&[&records, proved].concat()) == u32::from_le_bytes(*crc));
    Ok(if is_proved { records } else { Vec::new() })
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

/// Whether a checksum was verified.
struct IsChecked(bool);

/// The records of a chunk.
fn chunk(body: &[u8]) -> Result<(Vec<u8>, IsChecked), String> {
    let (header, records) = chunk_header(body).ok_or("a chunk is too short")?;
    let (records, outcome) = unpacked(&header, records);
    outcome?;
    let is_checked = header.crc != 0;
    if is_checked && crc32fast::hash(&records) != header.crc {
        return Err("the checksum of a chunk is wrong".into());
    }
    Ok((records, IsChecked(is_checked)))
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
        #[cfg(feature = "convert")]
        "lz4" => lz4_flex::frame::FrameDecoder::new(records)
            .take(header.unpacked_bytes.min(LONGEST_RECORD))
            .read_to_end(&mut all)
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
