//! Replay of recordings: the same frames and commands give the same contacts.
//!
//! [`Replay`] runs at full speed; a [`Player`] replaces the device of a [`Live`](crate::Live).

use crate::LiveError;
use crate::clock;
use crate::device::{DeviceFacts, IncomingFrame, RowMessage, Stream};
use crate::recording::{Event, Playback, RecordError, Recorded, Recording, Session};
use crate::runtime::LiveFrame;
use crate::runtime::{Event as LiveEvent, LiveHandle, WorkItem, process};
use dermis::design::SkinDesign;
use dermis::method::{Method, MethodSet, Methods};
use dermis::pipeline::{Command, Notice, Pipeline, Severity, State, Timestamp};
use dermis::skin::Skin;
use dermis_wire::ToHost;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// The items of a recording for a pipeline, in their order.
struct RecordingReader {
    path: PathBuf,
    recording: Recording,
    stream: Stream,
    methods: Arc<MethodSet>,
}

/// One item.
enum RecordedItem {
    Frame(Box<IncomingFrame>),
    Command(Command),
    /// The device was reconnected.
    Found(DeviceFacts),
    /// Another recording of the skin, which was joined to this one, begins: its device and its initial state.
    Another(DeviceFacts, Box<State>),
}

impl RecordingReader {
    /// For a recording of the skin: also returns the facts of the device and the initial state of the pipeline.
    fn new(
        path: &Path,
        recording: Recording,
        methods: Arc<MethodSet>,
    ) -> Result<(Self, DeviceFacts, State), LiveError> {
        let session = recording.session.clone();
        let mut reader =
            RecordingReader { path: path.into(), recording, stream: Stream::new(methods.skin())?, methods };
        let (facts, state) = reader.begin(&session)?;
        Ok((reader, facts, state))
    }

    /// The facts of the device and the state at the start of a session.
    fn begin(&mut self, session: &Session) -> Result<(DeviceFacts, State), LiveError> {
        let mut state: State = serde_json::from_value(session.state.clone())
            .map_err(|error| unreadable(&self.path, "its state", error))?;
        state.settings.method = network(&self.path, session, &self.methods, &state.settings.method)?;
        Ok((self.greet(session.hello.clone())?, state))
    }

    /// The same for a recording that was joined to the first.
    fn begin_another(&mut self, session: &Session) -> Result<RecordedItem, LiveError> {
        let design = SkinDesign::parse(&session.design_toml, "design.toml").map_err(dermis::Error::from)?;
        if design.sha256() != self.methods.skin().design().sha256() {
            return Err(LiveError::Given(format!(
                "{}: a recording of another skin (`{}`) was joined to it, which cannot be replayed with it; the frames \
                 before are complete",
                self.path.display(),
                design.name
            )));
        }
        self.stream = Stream::new(self.methods.skin())?;
        let (facts, state) = self.begin(session)?;
        Ok(RecordedItem::Another(facts, Box::new(state)))
    }

    fn greet(&mut self, hello: Vec<u8>) -> Result<DeviceFacts, LiveError> {
        if hello == RowMessage::HELLO {
            return Ok(RowMessage::facts(None));
        }
        match ToHost::parse(&hello) {
            Ok(ToHost::Hello(_)) => Ok(self.stream.connect(hello, None)),
            Ok(_) => Err(unreadable(&self.path, "a hello", "it is another message")),
            Err(error) => Err(unreadable(&self.path, "a hello", error)),
        }
    }

    /// The next item; `None` at the end.
    fn next(&mut self) -> Result<Option<RecordedItem>, LiveError> {
        loop {
            let Some(recorded) = self.recording.next().transpose()? else { return Ok(None) };
            match recorded {
                Recorded::Frame { measured_at, message, .. } => {
                    if let Some(incoming) = self.frame(measured_at, &message)? {
                        return Ok(Some(RecordedItem::Frame(Box::new(incoming))));
                    }
                }
                Recorded::Event { event: Event::Command(value), .. } => {
                    let command = serde_json::from_value(value);
                    let command = command.map_err(|error| unreadable(&self.path, "a command", error))?;
                    return Ok(Some(RecordedItem::Command(self.here(command)?)));
                }
                Recorded::Event { event: Event::Hello(hello), .. } => {
                    return Ok(Some(RecordedItem::Found(self.greet(hello)?)));
                }
                Recorded::Event { .. } => {}
                Recorded::Session(session) => return self.begin_another(&session).map(Some),
            }
        }
    }

    /// A command with the names of this run: a network that is not shipped may be in another folder.
    fn here(&self, command: Command) -> Result<Command, LiveError> {
        let Command::Method { name } = &command else { return Ok(command) };
        match (self.methods.method(name), self.methods.extra()) {
            (Ok(_), _) => Ok(command),
            (Err(_), Some(own)) => Ok(Command::Method { name: own.name().into() }),
            (Err(_), None) => Err(LiveError::Given(without_its_network(&self.path, name))),
        }
    }

    fn frame(&mut self, measured_at: Timestamp, message: &[u8]) -> Result<Option<IncomingFrame>, LiveError> {
        if let Some(row) = RowMessage::parse(message) {
            return Ok(self.stream.row(row, measured_at, measured_at));
        }
        let Ok(ToHost::Frame(frame)) = ToHost::parse(message) else {
            return Err(unreadable(&self.path, "a frame", "its message is none"));
        };
        let mut incoming = self.stream.frame(&frame, message, measured_at);
        // The time on the host clock is the recorded one.
        incoming.iter_mut().for_each(|incoming| incoming.input.measured_at = measured_at);
        Ok(incoming)
    }
}

fn unreadable(path: &Path, what: &str, why: impl std::fmt::Display) -> LiveError {
    LiveError::Given(format!("{}: {what} cannot be read: {why}", path.display()))
}

/// The name in this run of a network that the recording refers to by `name`, identified by its card.
fn network(path: &Path, session: &Session, methods: &MethodSet, name: &str) -> Result<String, LiveError> {
    let Some(recorded) = &session.model_card_json else { return Ok(name.into()) };
    // As values: the text of a number or the order of fields is no difference; nor is another name of the same network.
    let value = |card: &str| -> Option<serde_json::Value> {
        let mut card: serde_json::Value = serde_json::from_str(card).ok()?;
        card.as_object_mut()?.remove("name");
        Some(card)
    };
    let card = value(recorded);
    let is_it = |method: &Method| card.is_some() && method.card().and_then(value) == card;
    if methods.method(name).is_ok_and(|method| method.name() == name && is_it(method)) {
        return Ok(name.into());
    }
    let others = methods.names().filter(|other| *other != Methods::REFINED);
    if let Some(renamed) = others.flat_map(|other| methods.method(other)).find(|method| is_it(method)) {
        return Ok(renamed.name().into());
    }
    match methods.extra() {
        Some(own) if is_it(own) => Ok(own.name().into()),
        Some(own) => Err(LiveError::Given(format!(
            "{}; {} is another one: the card in the recording differs from its own",
            without_its_network(path, name),
            own.name()
        ))),
        None => Err(LiveError::Given(without_its_network(path, name))),
    }
}

fn without_its_network(path: &Path, name: &str) -> String {
    format!(
        "{} was recorded with `{name}`, which is no method of this version: give the folder of its network or calibration, --method \
         FOLDER",
        path.display()
    )
}

/// A replay, frame by frame.
pub struct Replay {
    reader: RecordingReader,
    pipeline: Pipeline,
}

impl std::fmt::Debug for Replay {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        formatter.debug_struct("Replay").field("path", &self.reader.path).finish_non_exhaustive()
    }
}

/// The result of one step of a replay.
#[derive(Debug)]
pub enum Replayed {
    /// A frame and its recomputed contacts.
    Frame(Box<LiveFrame>),
    /// A command that was carried out.
    Command(Command),
}

impl Replay {
    /// Opens a recording and prepares its skin with a registry of methods. `model` is the folder of the network of the
    /// recording, unless it is one of the registry's own.
    ///
    /// # Errors
    /// A file that is not a recording; a design or a state that this version cannot read; a network that the registry
    /// lacks, or that differs from that of the recording.
    pub fn open(path: &Path, methods: &Methods, model: Option<&str>) -> Result<Self, LiveError> {
        let recording = Recording::open(path)?;
        let skin = Skin::parse(&recording.session.design_toml, "design.toml")?;
        Self::of(path, recording, &Arc::new(MethodSet::new(methods, skin, model)?))
    }

    /// The same of a skin whose methods are prepared.
    ///
    /// # Errors
    /// As there; a recording of another skin.
    pub(crate) fn with(path: &Path, methods: &Arc<MethodSet>) -> Result<Self, LiveError> {
        let recording = Recording::open(path)?;
        let skin = Skin::parse(&recording.session.design_toml, "design.toml")?;
        if skin.design().sha256() != methods.skin().design().sha256() {
            let message = "was recorded with another body, other electrodes or channels than its design has now: put the design back";
            return Err(LiveError::Given(format!("{} {message}", path.display())));
        }
        Self::of(path, recording, methods)
    }

    fn of(path: &Path, recording: Recording, methods: &Arc<MethodSet>) -> Result<Self, LiveError> {
        let (reader, _, state) = RecordingReader::new(path, recording, Arc::clone(methods))?;
        Ok(Replay { reader, pipeline: Pipeline::resume(Arc::clone(methods), state)? })
    }

    /// The skin.
    pub fn skin(&self) -> &Skin {
        self.pipeline.skin()
    }

    /// The data of the session.
    pub fn session(&self) -> &Session {
        &self.reader.recording.session
    }

    /// Whether the file is complete; known after all of it was read.
    pub fn is_whole(&self) -> bool {
        self.reader.recording.is_whole()
    }

    /// The next frame or command; `None` at the end.
    ///
    /// # Errors
    /// A damaged part of the file; the next call continues after it.
    pub fn step(&mut self) -> Result<Option<Replayed>, LiveError> {
        loop {
            match self.reader.next()? {
                None => return Ok(None),
                Some(RecordedItem::Found(_)) => {}
                Some(RecordedItem::Another(_, state)) => {
                    self.pipeline = Pipeline::resume(Arc::clone(&self.reader.methods), *state)?;
                }
                Some(RecordedItem::Command(command)) => {
                    self.pipeline.command(&command)?;
                    return Ok(Some(Replayed::Command(command)));
                }
                Some(RecordedItem::Frame(incoming)) => {
                    let frame = process(&mut self.pipeline, *incoming)?;
                    self.pipeline.take_notices();
                    return Ok(Some(Replayed::Frame(Box::new(frame))));
                }
            }
        }
    }
}

/// Plays a recording in place of a device, in real time or at a multiple of it.
pub struct Player {
    reader: RecordingReader,
    facts: DeviceFacts,
    state: State,
    speed: f64,
    playback: Arc<Playback>,
    /// The place up to which the frames are played without pauses.
    until: Option<f64>,
}

impl std::fmt::Debug for Player {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        formatter.debug_struct("Player").field("path", &self.reader.path).finish_non_exhaustive()
    }
}

/// Longest sleep of a player before it checks what is requested.
const LONGEST_SLEEP: Duration = Duration::from_millis(20);

impl Player {
    /// Opens a recording of a skin; `speed` is a multiple of real time.
    ///
    /// # Errors
    /// A file that is not a recording, or one of another skin; a state that this version cannot read; a network that
    /// was not prepared for the skin.
    pub fn open(path: &Path, methods: &Arc<MethodSet>, speed: f64) -> Result<Self, LiveError> {
        if !(speed > 0.0 && speed.is_finite()) {
            return Err(LiveError::Given(format!("the speed is {speed}: it must be positive")));
        }
        let recording = Recording::open(path)?;
        let design = SkinDesign::parse(&recording.session.design_toml, "design.toml").map_err(dermis::Error::from)?;
        let own = methods.skin().design();
        if design.sha256() != own.sha256() {
            let announced = |design: &SkinDesign| {
                format!("{} electrodes, {} channels", design.electrodes.len(), design.protocol.channel_count())
            };
            return Err(LiveError::Given(format!(
                "{} is a recording of another skin ({}) than `{}` ({}): give the design that it was made with (`dermis replay` \
                 needs none)",
                path.display(),
                announced(&design),
                own.name,
                announced(own)
            )));
        }
        let (reader, facts, state) = RecordingReader::new(path, recording, Arc::clone(methods))?;
        Ok(Player { reader, facts, state, speed, playback: Arc::default(), until: None })
    }

    /// The state of the pipeline at the start of the recording.
    pub fn state(&self) -> &State {
        &self.state
    }

    /// The facts of the device.
    pub fn facts(&self) -> &DeviceFacts {
        &self.facts
    }

    /// Its place in the recording.
    pub(crate) fn playback(&self) -> &Arc<Playback> {
        &self.playback
    }

    /// Reads the recording from its start again, with its state.
    fn begin_again(&mut self, shared: &LiveHandle) -> Result<(), LiveError> {
        let (path, methods) = (&self.reader.path, Arc::clone(&self.reader.methods));
        let (reader, facts, state) = RecordingReader::new(path, Recording::open(path)?, methods)?;
        self.reader = reader;
        shared.connected(facts);
        shared.await_room();
        shared.queue(WorkItem::Restart(Box::new(state)));
        Ok(())
    }

    /// Goes to a place that is requested: the frames before it are played without pauses.
    fn seek(&mut self, pace: &mut Pace, shared: &LiveHandle) -> Result<(), LiveError> {
        if let Some(part) = self.playback.take_wanted() {
            // A recording is read forwards only.
            if part < self.reader.recording.part_read() {
                self.begin_again(shared)?;
            }
            self.until = Some(part);
            pace.begun = None;
        }
        let here = self.reader.recording.part_read();
        self.until.take_if(|part| here >= *part);
        Ok(())
    }

    /// Plays until the end, or until it is stopped.
    pub(crate) fn play(mut self, shared: &LiveHandle) {
        let mut pace = Pace { speed: self.speed, begun: None };
        while !shared.is_stopped() {
            let next = match self.seek(&mut pace, shared) {
                Ok(()) if self.until.is_none() && self.playback.is_paused() => {
                    std::thread::sleep(LONGEST_SLEEP);
                    pace.begun = None;
                    continue;
                }
                Ok(()) => self.reader.next(),
                Err(error) => Err(error),
            };
            let text = match next {
                Ok(Some(item)) => {
                    if let RecordedItem::Frame(frame) = &item {
                        self.playback.at(frame.input.measured_at, self.reader.recording.part_read());
                    }
                    let pace = Some(&mut pace).filter(|_| self.until.is_none());
                    feed(item, pace, shared);
                    continue;
                }
                // The recording is over when it is played on.
                Ok(None) if self.playback.is_paused() => {
                    self.until = None;
                    continue;
                }
                Ok(None) => None,
                Err(error @ LiveError::Record(RecordError::Io { .. })) => Some((error.to_string(), true)),
                Err(error) => Some((error.to_string(), false)),
            };
            let (level, text, is_end) = match text {
                None => (Severity::Info, format!("{} is at its end", self.reader.path.display()), true),
                Some((text, is_end)) => (Severity::Warning, text, is_end),
            };
            shared.publish(&LiveEvent::Notice(Notice { level, text, at: clock::now() }));
            if is_end {
                return;
            }
        }
    }
}

/// Passes an item to the pipeline when it is due, or at once without a pace.
fn feed(item: RecordedItem, pace: Option<&mut Pace>, shared: &LiveHandle) {
    match item {
        RecordedItem::Command(command) => {
            shared.await_room();
            shared.queue(WorkItem::Command(command));
        }
        RecordedItem::Found(facts) => shared.connected(facts),
        RecordedItem::Another(facts, _) => {
            let text = "another recording begins, which was joined to the first: its own baseline is not used";
            shared.publish(&LiveEvent::Notice(Notice {
                level: Severity::Warning,
                text: text.into(),
                at: clock::now(),
            }));
            shared.connected(facts);
        }
        RecordedItem::Frame(mut incoming) => {
            if let Some(pace) = pace {
                pace.wait(incoming.input.measured_at, shared);
            }
            // Unlike a device, a file can wait: no frame is dropped.
            shared.await_room();
            incoming.received_at = clock::now();
            shared.queue(WorkItem::Frame(incoming));
        }
    }
}

/// Schedules frames by their times of measurement.
struct Pace {
    speed: f64,
    begun: Option<(Timestamp, Instant)>,
}

impl Pace {
    fn wait(&mut self, measured_at: Timestamp, shared: &LiveHandle) {
        let (first, begun) = *self.begun.get_or_insert_with(|| (measured_at, Instant::now()));
        let since_s = (measured_at.seconds_since(first) / self.speed).max(0.0);
        let due = begun + Duration::try_from_secs_f64(since_s).unwrap_or_default();
        let is_asked = || shared.playback().is_some_and(Playback::is_asked);
        while !shared.is_stopped() && !is_asked() {
            let left = due.saturating_duration_since(Instant::now());
            if left.is_zero() {
                return;
            }
            std::thread::sleep(left.min(LONGEST_SLEEP));
        }
    }
}
