//! Reads recordings for a replay.

use crate::recording::walk::{End, Item, Walk, index};
use crate::recording::{Event, RecordError, Session};
use crate::sinks::ros2::{self as ros, Topic};
use dermis::pipeline::Timestamp;
use mcap::records::MessageHeader;
use std::collections::HashMap;
use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

/// The source of a recording.
pub(super) type Input = Box<dyn Read + Send>;

/// The items of a recording that a replay needs, in recorded order.
#[derive(Debug, Clone, PartialEq)]
pub enum Recorded {
    /// A frame.
    Frame {
        /// Time of measurement.
        measured_at: Timestamp,
        /// Time of its contacts.
        output_at: Timestamp,
        /// The message of the device.
        message: Vec<u8>,
    },
    /// An event other than a frame.
    Event {
        /// Time of the event.
        at: Timestamp,
        /// The event.
        event: Event,
    },
    /// Another recording that was joined to this one begins here, with its own session.
    Session(Box<Session>),
}

/// A recording, complete or truncated. An iterator over its frames and events; a damaged part is returned as an error,
/// and the iterator continues after it.
pub struct Recording {
    /// The data of the session.
    pub(crate) session: Session,
    messages: Messages,
    /// The first message, which was read after the session.
    first: Option<ReadItem>,
    /// The session of the last recording in the file.
    joined: Session,
}

impl Recording {
    /// Opens a recording and reads the data of its session.
    ///
    /// # Errors
    /// A file that is not a recording of Dermis.
    pub fn open(path: &Path) -> Result<Self, RecordError> {
        Self::new(Messages::open(path)?)
    }

    /// Reads a recording of `length` bytes from any source; errors refer to it as `path`.
    ///
    /// # Errors
    /// The same as [`open`](Self::open).
    pub fn from_reader(input: Box<dyn Read + Send>, length: u64, path: &Path) -> Result<Self, RecordError> {
        Self::new(Messages::new(walk(input, length, path)?, path))
    }

    fn new(mut messages: Messages) -> Result<Self, RecordError> {
        let mut session = Session::default();
        let first = loop {
            match messages.next_item(&mut session)? {
                Some(ReadItem::Session) => {}
                other => break other,
            }
        };
        if session.version.is_empty() {
            return Err(RecordError::lacks(
                &messages.path,
                "an MCAP file, but no recording of `dermis live`: it has no metadata record `dermis`",
            ));
        }
        Ok(Recording { joined: session.clone(), session, messages, first })
    }

    /// The part of the file that has been read.
    pub(super) fn part_read(&self) -> f64 {
        self.messages.walk.part_read()
    }

    /// Whether the file is complete; known after all of it was read.
    pub fn is_whole(&self) -> bool {
        matches!(self.messages.walk.end(), Some(End::Whole | End::Followed { .. }))
    }
}

impl Iterator for Recording {
    type Item = Result<Recorded, RecordError>;

    fn next(&mut self) -> Option<Self::Item> {
        loop {
            let item = match self.first.take() {
                Some(first) => first,
                None => match self.messages.next_item(&mut self.joined) {
                    Ok(item) => item?,
                    Err(error) => return Some(Err(error)),
                },
            };
            let result = match item {
                ReadItem::Message { topic: Some(Topic::Wire), header, data } => frame(&header, &data),
                ReadItem::Message { topic: Some(Topic::Events), header, data } => event(&header, &data),
                ReadItem::Message { .. } => continue,
                ReadItem::Session => Ok(Recorded::Session(Box::new(self.joined.clone()))),
                ReadItem::Damaged { at, why } => return Some(Err(self.messages.damaged(at, why))),
            };
            return Some(result.map_err(|why| self.messages.damaged(self.messages.walk.record_at(), why)));
        }
    }
}

fn frame(header: &MessageHeader, data: &[u8]) -> Result<Recorded, String> {
    let wire: ros::UInt8MultiArray = ros::decode(data).map_err(|error| error.to_string())?;
    Ok(Recorded::Frame {
        measured_at: Timestamp { unix_ns: header.log_time },
        output_at: Timestamp { unix_ns: header.publish_time },
        message: wire.data,
    })
}

fn event(header: &MessageHeader, data: &[u8]) -> Result<Recorded, String> {
    let text: ros::Text = ros::decode(data).map_err(|error| error.to_string())?;
    let event = serde_json::from_str(&text.data).map_err(|error| format!("an event: {error}"))?;
    Ok(Recorded::Event { at: Timestamp { unix_ns: header.log_time }, event })
}

/// A message, a damaged part, or a session that is complete.
pub(super) enum ReadItem {
    Message { topic: Option<Topic>, header: MessageHeader, data: Vec<u8> },
    Session,
    Damaged { at: u64, why: String },
}

/// The messages of a recording with their topics.
pub(super) struct Messages {
    path: PathBuf,
    pub walk: Walk<Input>,
    topics: HashMap<u16, Option<Topic>>,
}

impl Messages {
    pub(super) fn open(path: &Path) -> Result<Self, RecordError> {
        Ok(Self::new(open(path)?, path))
    }

    fn new(walk: Walk<Input>, path: &Path) -> Self {
        Messages { path: path.to_path_buf(), walk, topics: HashMap::new() }
    }

    /// The next message; other items before it are added to the session.
    pub(super) fn next_item(&mut self, session: &mut Session) -> Result<Option<ReadItem>, RecordError> {
        while let Some(item) = self.walk.next().map_err(|source| RecordError::io(&self.path, source))? {
            match item {
                // Its channels and attachments are its own.
                Item::Another => {
                    self.topics.clear();
                    *session = Session::default();
                }
                _ if session.take(&item) => return Ok(Some(ReadItem::Session)),
                Item::Channel(channel) => {
                    let found = Topic::all().find(|topic| topic.absolute("") == channel.topic);
                    self.topics.insert(channel.id, found);
                }
                Item::Message { header, data } => {
                    let topic = self.topics.get(&header.channel_id).copied().flatten();
                    return Ok(Some(ReadItem::Message { topic, header, data }));
                }
                Item::Damaged { at, why, .. } => return Ok(Some(ReadItem::Damaged { at, why })),
                _ => {}
            }
        }
        Ok(None)
    }

    pub(super) fn damaged(&self, at: u64, why: String) -> RecordError {
        RecordError::Damaged { path: self.path.clone(), at, why }
    }
}

/// Starts to read the records of a file.
pub(super) fn open(path: &Path) -> Result<Walk<Input>, RecordError> {
    let opened = File::open(path).and_then(|mut file| {
        let length = file.metadata()?.len();
        Ok((length, index(&mut file, length)?, file))
    });
    let (length, index, file) = opened.map_err(|source| RecordError::io(path, source))?;
    Ok(walk(Box::new(file) as Input, length, path)?.with_index(index))
}

/// Starts to read the records.
pub(super) fn walk<R: Read>(input: R, length: u64, path: &Path) -> Result<Walk<R>, RecordError> {
    let walk = Walk::new(input, length).map_err(|source| RecordError::io(path, source))?;
    walk.map_err(|why| RecordError::NoRecording { path: path.to_path_buf(), why })
}
