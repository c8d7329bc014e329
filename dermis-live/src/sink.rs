//! Threads that record and publish what a live skin tells. None of them can delay a contact.

use crate::LiveError;
use crate::clock;
use crate::live::{Event, LiveHandle};
use crate::mailbox::{Mailbox, Taken};
use crate::record::{self, RecordError, Recorder, Session, Written};
use crate::ros::Reference;
use dermis::pipeline::{Command, Notice, Severity};
use serde_json::Value;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::Duration;

/// Events that may wait for the disk: half a minute at 120 frames a second.
const WAITING_FOR_DISK: usize = 4096;
/// Events that may wait for the network.
#[cfg(feature = "ros2")]
const WAITING_FOR_NETWORK: usize = 64;
/// What publishing is called where it leaves something out.
#[cfg(feature = "ros2")]
const ROS2: &str = "ROS 2";
/// How long a recorder waits for a frame before it puts by what it has.
const PAUSE: Duration = Duration::from_millis(400);

/// A recording that is being made.
pub struct RecordingSink {
    path: PathBuf,
    shared: Arc<LiveHandle>,
    mailbox: Arc<Mailbox<Event>>,
    told: Arc<Mutex<Told>>,
    thread: JoinHandle<()>,
}

/// How a recording goes.
#[derive(Debug, Clone, Default)]
pub struct Told {
    /// What it holds by now.
    pub written: Written,
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
    /// A file that is there already or cannot be written.
    pub fn start(shared: &Arc<LiveHandle>, path: &Path, twin_toml: Option<&str>) -> Result<Self, LiveError> {
        if path.exists() {
            let message =
                format!("{} is there already: give another name, recordings are not overwritten", path.display());
            return Err(LiveError::Given(message));
        }
        let mailbox = shared.subscribe_as("the recording", WAITING_FOR_DISK);
        shared.tell_state();
        let told = Arc::new(Mutex::new(Told::default()));
        let tape = RecorderThread {
            shared: Arc::clone(shared),
            mailbox: Arc::clone(&mailbox),
            told: Arc::clone(&told),
            path: path.into(),
            twin_toml: twin_toml.map(str::to_string),
        };
        let thread = std::thread::Builder::new().name("dermis-record".into()).spawn(move || tape.run());
        let thread = thread.map_err(|source| LiveError::Io { path: path.into(), source })?;
        Ok(RecordingSink { path: path.into(), shared: Arc::clone(shared), mailbox, told, thread })
    }

    /// The file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// How it goes.
    pub fn told(&self) -> Told {
        self.told.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// Ends it: what was told by now is recorded, and the file closed.
    pub fn stop(self) -> Told {
        self.shared.unsubscribe(&self.mailbox);
        // A thread that panicked has told so already.
        let _ = self.thread.join();
        self.told.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }
}

/// What the recording thread has.
struct RecorderThread {
    shared: Arc<LiveHandle>,
    mailbox: Arc<Mailbox<Event>>,
    told: Arc<Mutex<Told>>,
    path: PathBuf,
    twin_toml: Option<String>,
}

impl RecorderThread {
    fn run(self) {
        if let Err(error) = self.record() {
            let text = format!("the recording has ended: {error}; contacts go on");
            self.told.lock().unwrap_or_else(PoisonError::into_inner).problem = Some(error.to_string());
            self.shared.tell(&Event::Notice(Notice { level: Severity::Error, text, at: clock::now() }));
            self.shared.unsubscribe(&self.mailbox);
        }
    }

    fn record(&self) -> Result<(), RecordError> {
        let Some(session) = self.await_session() else { return Ok(()) };
        let skin = self.shared.skin();
        let reference = Reference { frame_id: skin.design().name.clone(), space: Arc::clone(skin.pixels()) };
        let mut recorder = Recorder::create(&self.path, reference, &session)?;
        let mut left_out = self.mailbox.dropped();
        loop {
            match self.mailbox.take(PAUSE) {
                Taken::Item(Event::Frame(frame)) => recorder.frame(&frame)?,
                Taken::Item(Event::Done(command)) => {
                    recorder.event(clock::now(), &record::Event::Command(command_value(&command)))?;
                }
                Taken::Item(Event::Notice(notice)) => {
                    recorder.event(notice.at, &record::Event::Notice(notice.clone()))?;
                }
                Taken::Item(Event::Connected(facts)) => {
                    recorder.event(clock::now(), &record::Event::Hello(facts.hello.clone()))?;
                }
                Taken::Item(Event::Lost(_) | Event::State(_)) => {}
                Taken::TimedOut => recorder.flush()?,
                Taken::Closed => break,
            }
            self.told.lock().unwrap_or_else(PoisonError::into_inner).written = recorder.written();
            // A replay of what follows differs: say so where it is.
            let dropped = self.mailbox.dropped();
            if dropped > left_out {
                let text = format!("{} frames or events are missing here: the disk is too slow", dropped - left_out);
                let notice = Notice { level: Severity::Warning, text, at: clock::now() };
                recorder.event(notice.at, &record::Event::Notice(notice.clone()))?;
                left_out = dropped;
            }
        }
        let written = recorder.finish()?;
        self.told.lock().unwrap_or_else(PoisonError::into_inner).written = written;
        Ok(())
    }

    /// What the recording begins with; `None` where it ends before that.
    fn await_session(&self) -> Option<Session> {
        loop {
            match self.mailbox.take(PAUSE) {
                Taken::Item(Event::State(state)) => {
                    // A device that is away is waited for: without its hello nobody can read its messages.
                    let Some(facts) = self.shared.facts() else { continue };
                    let method = self.shared.methods().method(&state.settings.method);
                    return Some(Session {
                        version: String::new(),
                        design_toml: self.shared.skin().design_text().unwrap_or_default().into(),
                        twin_toml: self.twin_toml.clone(),
                        model_card_json: method.ok().and_then(|method| method.card()).map(str::to_string),
                        hello: facts.hello.clone(),
                        options: serde_json::to_value(&state.settings).unwrap_or(Value::Null),
                        state: serde_json::to_value(&*state).unwrap_or(Value::Null),
                    });
                }
                Taken::Item(Event::Connected(_)) => self.shared.tell_state(),
                Taken::Item(_) | Taken::TimedOut => {}
                Taken::Closed => return None,
            }
        }
    }
}

fn command_value(command: &Command) -> Value {
    serde_json::to_value(command).unwrap_or(Value::Null)
}

/// Publishes over DDS until the live skin stops.
///
/// # Errors
/// A domain that cannot be joined.
#[cfg(feature = "ros2")]
pub fn publish(shared: &Arc<LiveHandle>, options: &crate::dds::PublisherOptions) -> Result<JoinHandle<()>, LiveError> {
    let skin = shared.skin();
    let reference = Reference { frame_id: skin.design().name.clone(), space: Arc::clone(skin.pixels()) };
    let given = |error: crate::dds::PublishError| LiveError::Given(error.to_string());
    let mut publisher = crate::dds::Publisher::new(reference, options).map_err(given)?;
    let shared = Arc::clone(shared);
    let mailbox = shared.subscribe_as(ROS2, WAITING_FOR_NETWORK);
    let run = move || {
        let mut left_out = 0;
        loop {
            match mailbox.take(Duration::from_secs(1)) {
                Taken::Item(Event::Frame(frame)) => {
                    shared.leave_out(ROS2, publisher.dropped() - left_out);
                    left_out = publisher.dropped();
                    if let Err(error) = publisher.frame(&frame) {
                        let text = format!("publishing has ended: {error}; contacts go on");
                        shared.tell(&Event::Notice(Notice { level: Severity::Error, text, at: clock::now() }));
                        shared.unsubscribe(&mailbox);
                        return;
                    }
                }
                Taken::Item(_) | Taken::TimedOut => {}
                Taken::Closed => return,
            }
        }
    };
    let thread = std::thread::Builder::new().name("dermis-ros2".into()).spawn(run);
    thread.map_err(|error| LiveError::Given(format!("no thread for publishing: {error}")))
}
