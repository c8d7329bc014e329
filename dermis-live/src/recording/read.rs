//! Reads recordings for a replay.

use crate::recording::walk::{End, Item, Walk};
use crate::recording::{Event, RecordError, Session};
use crate::sinks::ros2::{self as ros, Topic};
use dermis::pipeline::Timestamp;
use mcap::records::MessageHeader;
use std::collections::HashMap;
use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

/// What a replay needs of a recording, in the order in which it was recorded.
#[derive(Debug, Clone, PartialEq)]
pub enum Recorded {
    /// A frame came.
    Frame {
        /// When it was measured.
        measured_at: Timestamp,
        /// When its contacts were known.
        output_at: Timestamp,
        /// The device's message.
        message: Vec<u8>,
    },
    /// Something happened beside the frames.
    Event {
        /// When.
        at: Timestamp,
        /// What.
        event: Event,
    },
}

/// A recording, finished or cut. An iterator over its frames and events; what is damaged comes as an error, and the
/// iterator goes on behind it.
pub struct Recording {
    /// What it says of itself.
    pub session: Session,
    messages: Messages,
    /// The first message, which was met when the session had been read.
    first: Option<Told>,
}

impl Recording {
    /// Opens a recording and reads what it says of itself.
    ///
    /// # Errors
    /// A file that is no recording, or none of Dermis.
    pub fn open(path: &Path) -> Result<Self, RecordError> {
        let (file, length) = open(path)?;
        Self::from_reader(Box::new(file), length, path)
    }

    /// Reads a recording of so many bytes that is no file; `path` is what errors call it.
    ///
    /// # Errors
    /// As [`open`](Self::open).
    pub fn from_reader(input: Box<dyn Read + Send>, length: u64, path: &Path) -> Result<Self, RecordError> {
        let mut messages = Messages::new(input, length, path)?;
        let mut session = Session::default();
        let first = messages.next_told(&mut session)?;
        if session.version.is_empty() {
            return Err(RecordError::lacks(
                path,
                "an MCAP file, but no recording of `dermis live`: it has no metadata record `dermis`",
            ));
        }
        Ok(Recording { session, messages, first })
    }

    /// Whether the file ends as it should; known once all is read.
    pub fn is_whole(&self) -> bool {
        self.messages.walk.end() == Some(End::Whole)
    }
}

impl Iterator for Recording {
    type Item = Result<Recorded, RecordError>;

    fn next(&mut self) -> Option<Self::Item> {
        loop {
            let told = match self.first.take() {
                Some(first) => first,
                None => match self.messages.next_told(&mut Session::default()) {
                    Ok(told) => told?,
                    Err(error) => return Some(Err(error)),
                },
            };
            let result = match told {
                Told::Message { topic: Some(Topic::Wire), header, data } => frame(&header, &data),
                Told::Message { topic: Some(Topic::Events), header, data } => event(&header, &data),
                Told::Message { .. } => continue,
                Told::Damaged { at, why } => return Some(Err(self.messages.damaged(at, why))),
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

/// A message, or that something is damaged.
pub(super) enum Told {
    Message { topic: Option<Topic>, header: MessageHeader, data: Vec<u8> },
    Damaged { at: u64, why: String },
}

/// The messages of a recording with the topics that they are on.
pub(super) struct Messages {
    path: PathBuf,
    pub walk: Walk<Box<dyn Read + Send>>,
    topics: HashMap<u16, Option<Topic>>,
}

impl Messages {
    pub fn open(path: &Path) -> Result<Self, RecordError> {
        let (file, length) = open(path)?;
        Self::new(Box::new(file), length, path)
    }

    pub fn new(input: Box<dyn Read + Send>, length: u64, path: &Path) -> Result<Self, RecordError> {
        Ok(Messages { path: path.to_path_buf(), walk: walk(input, length, path)?, topics: HashMap::new() })
    }

    /// The next message; what comes before it is taken into the session.
    pub fn next_told(&mut self, session: &mut Session) -> Result<Option<Told>, RecordError> {
        while let Some(item) = self.walk.next().map_err(|source| RecordError::io(&self.path, source))? {
            session.take(&item);
            match item {
                Item::Channel(channel) => {
                    let found = Topic::ALL.into_iter().find(|topic| topic.absolute("") == channel.topic);
                    self.topics.insert(channel.id, found);
                }
                Item::Message { header, data } => {
                    let topic = self.topics.get(&header.channel_id).copied().flatten();
                    return Ok(Some(Told::Message { topic, header, data }));
                }
                Item::Damaged { at, why, .. } => return Ok(Some(Told::Damaged { at, why })),
                _ => {}
            }
        }
        Ok(None)
    }

    pub fn damaged(&self, at: u64, why: String) -> RecordError {
        RecordError::Damaged { path: self.path.clone(), at, why }
    }
}

/// A file and its length.
pub(super) fn open(path: &Path) -> Result<(File, u64), RecordError> {
    let file = File::open(path).and_then(|file| Ok((file.metadata()?.len(), file)));
    file.map(|(length, file)| (file, length)).map_err(|source| RecordError::io(path, source))
}

/// Begins to walk.
pub(super) fn walk<R: Read>(input: R, length: u64, path: &Path) -> Result<Walk<R>, RecordError> {
    let walk = Walk::new(input, length).map_err(|source| RecordError::io(path, source))?;
    walk.map_err(|why| RecordError::NoRecording { path: path.to_path_buf(), why })
}
