//! Repair of truncated or damaged recordings.

use crate::recording::walk::{End, Item, Walk};
use crate::recording::write::{CHUNK_TIME, Output, options, output};
use crate::recording::{RecordError, read};
use crate::sinks::ros2::Topic;
use dermis::pipeline::Timestamp;
use dermis::text::counted;
use mcap::records::{AttachmentHeader, Channel, Header, MessageHeader, SchemaHeader};
use mcap::{Attachment, McapError, McapResult, Writer};
use serde::Serialize;
use std::collections::{HashMap, HashSet};
use std::io::{Read, Write};
use std::path::Path;

/// Summary of a repair.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub struct RecoveryReport {
    /// Messages on all topics.
    pub messages: u64,
    /// Frames: the device's own messages.
    pub frames: u64,
    /// From the first message to the last, s.
    pub seconds: f64,
    /// Recordings in the file: more than one where files were joined.
    pub recordings: u64,
    /// Whether the file was whole, and nothing in it damaged.
    pub was_whole: bool,
    /// Whether the last recording in it was finished.
    pub was_finished: bool,
    /// Bytes at the end that could not be read.
    pub cut_bytes: u64,
    /// Damaged parts that were skipped, and unfinished recordings before others, with their positions.
    pub damaged: Vec<String>,
    /// Messages without a topic, because its declaration was lost; they are skipped.
    pub without_topic: u64,
}

/// Writes the readable contents of a recording to a new, complete file.
///
/// Recorded data and their order do not change; repairing a repaired file gives the same bytes.
///
/// # Errors
/// A file that is not a recording; an output that exists; a system error.
pub fn recover(from: &Path, to: &Path) -> Result<RecoveryReport, RecordError> {
    // Check the input before anything is written.
    let walk = read::open(from)?;
    if to.exists() {
        return Err(RecordError::Exists { path: to.to_path_buf() });
    }
    let mut done = None;
    let written = dermis::frame::write_whole(to, |output| {
        let copied = done.insert(copy(walk, output));
        // The error itself is in `done`.
        if copied.is_ok() { Ok(()) } else { Err(std::io::ErrorKind::Other.into()) }
    });
    match (done, written) {
        (Some(Err(failed)), _) => Err(failed.into_error(from, to)),
        (Some(Ok(recovered)), Ok(())) => Ok(recovered),
        (_, Err(dermis::frame::TableError::Io { source, .. })) => Err(RecordError::io(to, source)),
        (_, Err(other)) => Err(RecordError::io(to, std::io::Error::other(other))),
        (None, Ok(())) => unreachable!("a file that was written was filled"),
    }
}

/// As [`recover`], from any source of `length` bytes to any output; errors refer to the source as `path`.
///
/// # Errors
/// The same as [`recover`].
pub fn recover_into(
    input: impl Read,
    length: u64,
    path: &Path,
    output: &mut dyn Write,
) -> Result<RecoveryReport, RecordError> {
    copy(read::walk(input, length, path)?, output).map_err(|failed| failed.into_error(path, path))
}

enum Failed {
    Reading(std::io::Error),
    Writing(McapError),
}

impl Failed {
    fn into_error(self, from: &Path, to: &Path) -> RecordError {
        match self {
            Failed::Reading(source) => RecordError::io(from, source),
            Failed::Writing(error) => RecordError::mcap(to, error),
        }
    }
}

fn copy(mut walk: Walk<impl Read>, file: &mut dyn Write) -> Result<RecoveryReport, Failed> {
    let mut recovered = RecoveryReport { recordings: 1, ..RecoveryReport::default() };
    // Nothing can be written before the header.
    let mut header = Header { profile: "ros2".into(), library: String::new() };
    let mut pending = None;
    while let Some(item) = walk.next().map_err(Failed::Reading)? {
        match item {
            Item::Header(found) => header = found,
            other => {
                pending = Some(other);
                break;
            }
        }
    }
    let mut copy = Copy::new(&header, file).map_err(Failed::Writing)?;
    while let Some(item) = pending {
        copy.item(item, &mut recovered).map_err(Failed::Writing)?;
        pending = walk.next().map_err(Failed::Reading)?;
    }
    copy.writer.finish().map_err(Failed::Writing)?;
    recovered.seconds =
        copy.times.map_or(0.0, |(first, last)| Timestamp { unix_ns: last }.seconds_since(Timestamp { unix_ns: first }));
    match walk.end() {
        Some(End::Cut { bytes, .. } | End::Followed { bytes, .. }) => recovered.cut_bytes = bytes,
        _ => recovered.was_finished = true,
    }
    recovered.was_whole = recovered.was_finished && recovered.damaged.is_empty() && recovered.without_topic == 0;
    Ok(recovered)
}

/// The state of a copy from one file to the other.
struct Copy<'a> {
    writer: Writer<Output<&'a mut dyn Write>>,
    /// Schemas and channels of the current recording, and the numbers of the channels in the output.
    schemas: HashMap<u16, u16>,
    channels: HashMap<u16, u16>,
    /// Channels of the output with the device's own messages.
    wire: HashSet<u16>,
    /// Time of the first message of the current chunk.
    chunk_from: Option<u64>,
    /// First and last time of all messages.
    times: Option<(u64, u64)>,
}

impl<'a> Copy<'a> {
    fn new(header: &Header, file: &'a mut dyn Write) -> McapResult<Self> {
        let writer = options(&header.profile, &header.library).create(output(file))?;
        Ok(Copy {
            writer,
            schemas: HashMap::new(),
            channels: HashMap::new(),
            wire: HashSet::new(),
            chunk_from: None,
            times: None,
        })
    }

    fn item(&mut self, item: Item, recovered: &mut RecoveryReport) -> McapResult<()> {
        let copied = match item {
            // Only the first header counts.
            Item::Header(_) => Ok(()),
            // It has its own numbers of channels.
            Item::Another => {
                recovered.recordings += 1;
                self.schemas.clear();
                self.channels.clear();
                Ok(())
            }
            Item::Schema { header, data } => self.schema(&header, &data, recovered.recordings == 1),
            Item::Channel(channel) => self.channel(&channel, recovered.recordings == 1),
            Item::Message { header, data } => self.message(&header, &data, recovered),
            Item::Attachment { header, data } => self.attachment(header, data),
            Item::Metadata(metadata) => self.writer.write_metadata(&metadata),
            Item::Damaged { at, bytes, why } => {
                recovered.damaged.push(format!("byte {at}: {why} ({})", counted(bytes, "byte")));
                Ok(())
            }
        };
        match copied {
            Err(
                error @ (McapError::ConflictingSchemas(_)
                | McapError::ConflictingChannels(_)
                | McapError::UnknownSchema(..)
                | McapError::TooManySchemas
                | McapError::TooManyChannels),
            ) => {
                recovered.damaged.push(error.to_string());
                Ok(())
            }
            other => other,
        }
    }

    /// The first recording keeps its numbers.
    fn schema(&mut self, header: &SchemaHeader, data: &[u8], is_first: bool) -> McapResult<()> {
        let SchemaHeader { id, name, encoding } = header;
        let written = match is_first {
            true => self.writer.add_schema_with_id(*id, name, encoding, data).map(|_| *id)?,
            false => self.writer.add_schema(name, encoding, data)?,
        };
        self.schemas.insert(*id, written);
        Ok(())
    }

    fn channel(&mut self, channel: &Channel, is_first: bool) -> McapResult<()> {
        let Channel { id, schema_id, topic, message_encoding, metadata } = channel;
        let written = match is_first {
            true => self.writer.add_channel_with_id(*id, *schema_id, topic, message_encoding, metadata).map(|_| *id)?,
            false => {
                let unknown = || McapError::UnknownSchema(topic.clone(), *schema_id);
                let schema = if *schema_id == 0 { 0 } else { *self.schemas.get(schema_id).ok_or_else(unknown)? };
                self.writer.add_channel(schema, topic, message_encoding, metadata)?
            }
        };
        self.channels.insert(*id, written);
        if *topic == Topic::Wire.absolute("") {
            self.wire.insert(written);
        }
        Ok(())
    }

    fn message(&mut self, header: &MessageHeader, data: &[u8], recovered: &mut RecoveryReport) -> McapResult<()> {
        let Some(&channel_id) = self.channels.get(&header.channel_id) else {
            recovered.without_topic += 1;
            return Ok(());
        };
        let from = *self.chunk_from.get_or_insert(header.log_time);
        if header.log_time.abs_diff(from) >= CHUNK_TIME.as_nanos() as u64 {
            self.writer.flush()?;
            self.chunk_from = Some(header.log_time);
        }
        self.writer.write_to_known_channel(&MessageHeader { channel_id, ..*header }, data)?;
        recovered.messages += 1;
        recovered.frames += u64::from(self.wire.contains(&channel_id));
        let (first, last) = self.times.unwrap_or((header.log_time, header.log_time));
        self.times = Some((first.min(header.log_time), last.max(header.log_time)));
        Ok(())
    }

    fn attachment(&mut self, header: AttachmentHeader, data: Vec<u8>) -> McapResult<()> {
        let AttachmentHeader { log_time, create_time, name, media_type } = header;
        self.writer.attach(&Attachment { log_time, create_time, name, media_type, data: data.into() })
    }
}
