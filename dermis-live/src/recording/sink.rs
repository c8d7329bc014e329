//! The thread that records a skin being read. It never blocks the pipeline.

use crate::LiveError;
use crate::clock;
use crate::recording::parts::{Parts, free_space};
use crate::recording::{self as record, RecordError, RecordingLimits, Session, Written};
use crate::runtime::{Event, LiveHandle};
use crate::runtime::{Mailbox, Popped};
use crate::sinks::ros2::Reference;
use dermis::pipeline::{Command, Notice, Severity, State};
use serde_json::Value;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::Duration;

/// Events that can wait for the disk: half a minute at 120 frames per second.
const WAITING_FOR_DISK: usize = 4096;
/// The recorder flushes after this time without an event.
const PAUSE: Duration = Duration::from_millis(400);

/// A recording in progress.
pub struct RecordingSink {
    path: PathBuf,
    shared: Arc<LiveHandle>,
    mailbox: Arc<Mailbox<Event>>,
    status: Arc<Mutex<RecordingStatus>>,
    thread: JoinHandle<()>,
}

/// Status of a recording.
#[derive(Debug, Clone, Default)]
pub struct RecordingStatus {
    /// What was written so far, into parts that were deleted too.
    pub written: Written,
    /// Parts so far.
    pub parts: u64,
    /// Parts that were deleted.
    pub deleted: u64,
    /// Size of the other parts, bytes.
    pub bytes: u64,
    /// Why it ended early.
    pub problem: Option<String>,
}

impl std::fmt::Debug for RecordingSink {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        formatter.debug_struct("RecordingSink").field("path", &self.path).finish_non_exhaustive()
    }
}

impl RecordingSink {
    /// Records from the next frame on; `twin_toml` is the twin that an emulator plays.
    ///
    /// # Errors
    /// A file that exists already or cannot be written.
    pub fn start(
        shared: &Arc<LiveHandle>,
        path: &Path,
        twin_toml: Option<&str>,
        limits: RecordingLimits,
    ) -> Result<Self, LiveError> {
        if let Err(RecordError::Exists { path }) = limits.check_new(path) {
            let message =
                format!("{} is there already: give another name, recordings are not overwritten", path.display());
            return Err(LiveError::Given(message));
        }
        let mailbox = shared.subscribe_as("the recording", WAITING_FOR_DISK);
        shared.request_state();
        let status = Arc::new(Mutex::new(RecordingStatus::default()));
        let recorder = RecorderThread {
            shared: Arc::clone(shared),
            mailbox: Arc::clone(&mailbox),
            status: Arc::clone(&status),
            path: path.into(),
            twin_toml: twin_toml.map(str::to_string),
            limits,
        };
        let thread = std::thread::Builder::new().name("dermis-record".into()).spawn(move || recorder.run());
        let thread = thread.map_err(|source| LiveError::Io { path: path.into(), source })?;
        Ok(RecordingSink { path: path.into(), shared: Arc::clone(shared), mailbox, status, thread })
    }

    /// The file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Its status.
    pub fn status(&self) -> RecordingStatus {
        self.status.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// Ends the recording: all events so far are written, and the file is closed.
    pub fn stop(self) -> RecordingStatus {
        self.shared.unsubscribe(&self.mailbox);
        // A thread that panicked has printed its message already.
        let _ = self.thread.join();
        self.status.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }
}

/// The recording thread.
struct RecorderThread {
    shared: Arc<LiveHandle>,
    mailbox: Arc<Mailbox<Event>>,
    status: Arc<Mutex<RecordingStatus>>,
    path: PathBuf,
    twin_toml: Option<String>,
    limits: RecordingLimits,
}

impl RecorderThread {
    fn run(self) {
        if let Err(error) = self.record() {
            let text = format!("the recording has ended: {error}; contacts go on");
            self.status.lock().unwrap_or_else(PoisonError::into_inner).problem = Some(error.to_string());
            self.shared.publish(&Event::Notice(Notice { level: Severity::Error, text, at: clock::now() }));
            self.shared.unsubscribe(&self.mailbox);
        }
    }

    fn record(&self) -> Result<(), RecordError> {
        let Some(session) = self.await_session() else { return Ok(()) };
        let skin = self.shared.skin();
        let reference = Reference::of(skin, skin.design().frame_id());
        let mut parts = Parts::create(&self.path, self.limits, reference, &session, free_space)?;
        let recorded = self.record_into(&mut parts, session);
        self.report(&parts);
        // What was recorded before an error is completed, if that is possible.
        let finished = parts.finish();
        recorded.and(finished)
    }

    /// Records until the end of the events.
    fn record_into(&self, parts: &mut Parts, mut session: Session) -> Result<(), RecordError> {
        let mut reported = self.mailbox.dropped();
        let mut is_due = false;
        loop {
            match self.mailbox.take(PAUSE) {
                Popped::Item(Event::Frame(frame)) => parts.frame(&frame)?,
                Popped::Item(Event::Done(command)) => {
                    parts.event(clock::now(), &record::Event::Command(command_value(&command)))?;
                }
                Popped::Item(Event::Notice(notice)) => {
                    parts.event(notice.at, &record::Event::Notice(notice.clone()))?;
                }
                Popped::Item(Event::Connected(facts)) => {
                    session.hello = facts.hello.clone();
                    parts.event(clock::now(), &record::Event::Hello(facts.hello.clone()))?;
                }
                // The next part begins with the state between two frames.
                Popped::Item(Event::State(state)) if std::mem::take(&mut is_due) => {
                    session = self.session(&state, session.hello);
                    parts.split(&session)?;
                }
                Popped::Item(Event::Lost(_) | Event::State(_)) => {}
                Popped::Item(Event::Stale(_)) | Popped::TimedOut => parts.flush()?,
                Popped::Closed => return Ok(()),
            }
            if parts.check()? && !is_due {
                is_due = true;
                self.shared.request_state();
            }
            self.report(parts);
            // Reports dropped events at this place of the recording, because a replay differs from here on.
            let dropped = self.mailbox.dropped();
            if dropped > reported {
                let text = format!("the disk is too slow: frames or events missing here: {}", dropped - reported);
                let notice = Notice { level: Severity::Warning, text, at: clock::now() };
                parts.event(notice.at, &record::Event::Notice(notice.clone()))?;
                reported = dropped;
            }
        }
    }

    fn report(&self, parts: &Parts) {
        let [count, deleted, bytes] = parts.sizes();
        let mut status = self.status.lock().unwrap_or_else(PoisonError::into_inner);
        *status = RecordingStatus { written: parts.written(), parts: count, deleted, bytes, problem: None };
    }

    /// The session of the recording; `None` if the recording ends before one starts.
    fn await_session(&self) -> Option<Session> {
        // The state, if neither a frame nor a command came after it.
        let mut before = None;
        loop {
            match self.mailbox.take(PAUSE) {
                // Messages of a device cannot be read without its hello: wait until a device is connected.
                Popped::Item(Event::State(state)) => match self.shared.facts() {
                    Some(facts) => return Some(self.session(&state, facts.hello.clone())),
                    None => before = Some(state),
                },
                Popped::Item(Event::Connected(facts)) => match before {
                    Some(state) => return Some(self.session(&state, facts.hello.clone())),
                    None => self.shared.request_state(),
                },
                Popped::Item(Event::Frame(_) | Event::Done(_)) => before = None,
                Popped::Item(_) | Popped::TimedOut => {}
                Popped::Closed => return None,
            }
        }
    }

    /// The session that begins with a state.
    fn session(&self, state: &State, hello: Vec<u8>) -> Session {
        let method = self.shared.methods().method(&state.settings.method);
        Session {
            version: String::new(),
            design_toml: self.shared.skin().design_text().unwrap_or_default().into(),
            twin_toml: self.twin_toml.clone(),
            model_card_json: method.ok().and_then(|method| method.card()).map(str::to_string),
            hello,
            options: serde_json::to_value(&state.settings).unwrap_or(Value::Null),
            state: serde_json::to_value(state).unwrap_or(Value::Null),
        }
    }
}

fn command_value(command: &Command) -> Value {
    serde_json::to_value(command).unwrap_or(Value::Null)
}
