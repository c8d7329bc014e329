//! Writes recordings.

use crate::LiveFrame;
use crate::clock;
use crate::recording::{Event, RecordError, Session};
use crate::sinks::ros2::{self as ros, Due, Message, Reference, Topic};
use dermis::pipeline::Timestamp;
use mcap::records::MessageHeader;
use mcap::{Attachment, Compression, WriteOptions};
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// Longest time that frames wait for their chunk to be finished; a finished chunk survives a crash.
pub(super) const CHUNK_TIME: Duration = Duration::from_millis(400);
/// A chunk of this size is finished, so that readers need little memory.
const CHUNK_BYTES: u64 = 1 << 20;

/// The output of a recording: the writer never seeks back, so that the file is always a prefix of a complete one.
pub(super) type Output<W> = mcap::write::NoSeek<BufWriter<W>>;

/// Contents of a recording.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Written {
    /// Frames.
    pub frames: u64,
    /// Messages on all topics.
    pub messages: u64,
    /// From the measurement of the first frame to that of the last, s.
    pub seconds: f64,
}

/// Writes frames and events to a file as they arrive. If the program is killed, at most the last 0.4 s are lost, and
/// [`recover`](crate::recording::recover) repairs the file.
pub struct Recorder {
    path: PathBuf,
    writer: mcap::Writer<Output<Box<dyn Write + Send>>>,
    channels: [u16; Topic::COUNT],
    reference: Reference,
    due: Due,
    chunk: ChunkClock,
    buffer: Vec<u8>,
    written: Written,
    begun: Option<Timestamp>,
    events: u32,
}

impl Recorder {
    /// Creates a file, which must not exist.
    ///
    /// # Errors
    /// A file of that name; a folder that is missing or not writable; a full disk.
    pub fn create(path: &Path, reference: Reference, session: &Session) -> Result<Self, RecordError> {
        let file = File::options().write(true).create_new(true).open(path);
        let file = file.map_err(|source| RecordError::io(path, source))?;
        Self::begin(path, Box::new(file), reference, session).map_err(|error| RecordError::mcap(path, error))
    }

    pub(super) fn begin(
        path: &Path,
        output: Box<dyn Write + Send>,
        reference: Reference,
        session: &Session,
    ) -> mcap::McapResult<Self> {
        let version = env!("CARGO_PKG_VERSION");
        let mut writer = options("ros2", &format!("dermis {version}")).create(self::output(output))?;
        let session = Session { version: version.into(), ..session.clone() };
        let now = clock::now().unix_ns;
        for (name, media_type, text) in session.attachments() {
            let (name, media_type) = (name.into(), media_type.into());
            writer.attach(&Attachment {
                log_time: now,
                create_time: now,
                name,
                media_type,
                data: text.as_bytes().into(),
            })?;
        }
        writer.write_metadata(&session.metadata())?;
        let channels = channels(&mut writer)?;
        writer.flush()?;
        Ok(Recorder {
            path: path.to_path_buf(),
            writer,
            channels,
            reference,
            due: Due::default(),
            chunk: ChunkClock::default(),
            buffer: Vec::new(),
            written: Written::default(),
            begun: None,
            events: 0,
        })
    }

    /// The file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// What was written so far.
    pub fn written(&self) -> Written {
        self.written
    }

    /// Writes a frame.
    ///
    /// # Errors
    /// A full disk, above all. Nothing can be written after that; the contents of the file are kept.
    pub fn frame(&mut self, frame: &LiveFrame) -> Result<(), RecordError> {
        self.write_frame(frame).map_err(|error| RecordError::mcap(&self.path, error))
    }

    fn write_frame(&mut self, frame: &LiveFrame) -> mcap::McapResult<()> {
        self.finish_chunk_if_due(frame.result.measured_at)?;
        let wire = ros::UInt8MultiArray { data: frame.message.clone(), ..Default::default() };
        self.message(Topic::Wire, frame, &wire)?;
        self.message(Topic::Frame, frame, &ros::frame(&self.reference, frame))?;
        self.message(Topic::Image, frame, &ros::image(&self.reference, frame))?;
        self.message(Topic::Contacts, frame, &ros::contacts(&self.reference, frame))?;
        self.message(Topic::Wrench, frame, &ros::wrench(&self.reference, frame))?;
        if self.due.markers(frame) {
            self.message(Topic::Markers, frame, &ros::markers(&self.reference, frame))?;
        }
        if self.due.validity(frame) {
            self.message(Topic::Validity, frame, &ros::validity(frame))?;
        }
        if self.due.diagnostics(frame) {
            self.message(Topic::Diagnostics, frame, &ros::diagnostics(&self.reference, frame))?;
        }
        let begun = *self.begun.get_or_insert(frame.result.measured_at);
        self.written.frames += 1;
        self.written.seconds = frame.result.measured_at.seconds_since(begun);
        Ok(())
    }

    fn message<M: Message>(&mut self, topic: Topic, frame: &LiveFrame, message: &M) -> mcap::McapResult<()> {
        let times = [frame.result.measured_at, frame.output_at];
        self.put(topic, frame.result.sequence as u32, times, message)
    }

    fn put<M: Message>(
        &mut self,
        topic: Topic,
        sequence: u32,
        [log, publish]: [Timestamp; 2],
        message: &M,
    ) -> mcap::McapResult<()> {
        ros::encode_into(message, &mut self.buffer);
        let channel_id = self.channels[topic as usize];
        let header = MessageHeader { channel_id, sequence, log_time: log.unix_ns, publish_time: publish.unix_ns };
        self.writer.write_to_known_channel(&header, &self.buffer)?;
        self.written.messages += 1;
        Ok(())
    }

    /// Writes an event; a replay processes it between the same two frames.
    ///
    /// # Errors
    /// The same as [`frame`](Self::frame).
    pub fn event(&mut self, at: Timestamp, event: &Event) -> Result<(), RecordError> {
        // An event always has string keys and finite numbers.
        let text = ros::Text { data: serde_json::to_string(event).expect("an event is JSON") };
        self.events = self.events.wrapping_add(1);
        self.put(Topic::Events, self.events, [at; 2], &text)
            .and_then(|()| self.finish_chunk_if_due(at))
            .map_err(|error| RecordError::mcap(&self.path, error))
    }

    /// Writes all buffered data to the file. Call this when no frame has arrived for a while.
    ///
    /// # Errors
    /// The same as [`frame`](Self::frame).
    pub fn flush(&mut self) -> Result<(), RecordError> {
        self.chunk = ChunkClock::default();
        self.writer.flush().map_err(|error| RecordError::mcap(&self.path, error))
    }

    fn finish_chunk_if_due(&mut self, now: Timestamp) -> mcap::McapResult<()> {
        if self.chunk.is_due(now) { self.writer.flush() } else { Ok(()) }
    }

    /// Completes the file, and waits until the system has written it to the disk.
    ///
    /// # Errors
    /// The same as [`frame`](Self::frame).
    pub fn finish(self) -> Result<Written, RecordError> {
        let path = self.path.clone();
        let written = self.close()?;
        Self::sync(&path)?;
        Ok(written)
    }

    /// Completes the file.
    pub(super) fn close(mut self) -> Result<Written, RecordError> {
        let finished = self.writer.finish().and_then(|_| Ok(self.writer.into_inner().into_inner().flush()?));
        finished.map_err(|error| RecordError::mcap(&self.path, error))?;
        Ok(self.written)
    }

    /// Waits until the system has written a file to the disk.
    pub(super) fn sync(path: &Path) -> Result<(), RecordError> {
        match File::options().write(true).open(path).and_then(|file| file.sync_all()) {
            // It was moved away.
            Err(source) if source.kind() == std::io::ErrorKind::NotFound => Ok(()),
            synced => synced.map_err(|source| RecordError::io(path, source)),
        }
    }
}

/// When the current chunk must be finished: [`CHUNK_TIME`] after its first message, on the device clock or on the host
/// clock.
#[derive(Default)]
struct ChunkClock {
    begun: Option<(Timestamp, Instant)>,
}

impl ChunkClock {
    fn is_due(&mut self, now: Timestamp) -> bool {
        let (measured, instant) = *self.begun.get_or_insert_with(|| (now, Instant::now()));
        let span_s = now.seconds_since(measured).abs();
        let due = span_s >= CHUNK_TIME.as_secs_f64() || instant.elapsed() >= CHUNK_TIME;
        if due {
            self.begun = Some((now, Instant::now()));
        }
        due
    }
}

/// Options of the MCAP writer. Zstandard at its fastest level: live frames of a twin of `cylinder30` took 57 % of the
/// bytes at about 30 us per frame; LZ4 78 % at 19 us, the default level 53 % at 57 us. Compression runs on this thread,
/// because the pipeline needs the others.
pub(super) fn options(profile: &str, library: &str) -> WriteOptions {
    WriteOptions::new()
        .profile(profile)
        .library(library)
        .compression(Some(Compression::Zstd))
        .compression_level(1)
        .compression_threads(0)
        .chunk_size(Some(CHUNK_BYTES))
        .disable_seeking(true)
}

pub(super) fn output<W: Write>(output: W) -> Output<W> {
    mcap::write::NoSeek::new(BufWriter::new(output))
}

/// The channels of all topics.
fn channels(writer: &mut mcap::Writer<Output<Box<dyn Write + Send>>>) -> mcap::McapResult<[u16; Topic::COUNT]> {
    let mut channels = [0; Topic::COUNT];
    for topic in Topic::all() {
        let type_name = topic.type_name();
        let schema = writer.add_schema(type_name, "ros2msg", ros::definition(type_name).as_bytes())?;
        channels[topic as usize] = writer.add_channel(schema, &topic.absolute(""), "cdr", &BTreeMap::new())?;
    }
    Ok(channels)
}
