//! A recording played again: the same frames and commands give the same contacts.

use crate::LiveError;
use crate::device::Stream;
use crate::moment::Moment;
use crate::processor::{Processor, State};
use crate::record::{Event, Recorded, Recording, Session};
use crate::report::LiveFrame;
use crate::settings::Command;
use crate::skin::LiveSkin;
use dermis_wire::ToHost;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// A recording being played again, frame by frame.
pub struct Replay {
    path: PathBuf,
    recording: Recording,
    processor: Processor,
    stream: Stream,
}

impl std::fmt::Debug for Replay {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        formatter.debug_struct("Replay").field("path", &self.path).finish_non_exhaustive()
    }
}

/// What a step of a replay gives.
#[derive(Debug)]
pub enum Replayed {
    /// A frame and its contacts, made anew.
    Frame(Box<LiveFrame>),
    /// A command that was carried out.
    Command(Command),
}

impl Replay {
    /// Opens a recording and prepares its skin.
    ///
    /// # Errors
    /// A file that is no recording; a design or a state that this version cannot read.
    pub fn open(path: &Path) -> Result<Self, LiveError> {
        let recording = Recording::open(path)?;
        let skin = Arc::new(LiveSkin::new(&recording.session.design_toml, "design.toml", None)?);
        let wrong =
            |what: &str, why: String| LiveError::Given(format!("{}: its {what} cannot be read: {why}", path.display()));
        let state: State = serde_json::from_value(recording.session.state.clone())
            .map_err(|error| wrong("state", error.to_string()))?;
        let mut stream = Stream::default();
        greet(&mut stream, &recording.session.hello, &skin).map_err(|why| wrong("hello", why))?;
        let processor = Processor::resume(skin, state)?;
        Ok(Replay { path: path.into(), recording, processor, stream })
    }

    /// The skin.
    pub fn skin(&self) -> &Arc<LiveSkin> {
        self.processor.skin()
    }

    /// What the recording says of itself.
    pub fn session(&self) -> &Session {
        &self.recording.session
    }

    /// The next frame or command; `None` at the end.
    ///
    /// # Errors
    /// A part of the file that is damaged; the next call goes on behind it.
    pub fn step(&mut self) -> Result<Option<Replayed>, LiveError> {
        loop {
            let Some(recorded) = self.recording.next().transpose()? else { return Ok(None) };
            match recorded {
                Recorded::Frame { measured_at, message, .. } => {
                    if let Some(frame) = self.frame(measured_at, &message)? {
                        return Ok(Some(Replayed::Frame(Box::new(frame))));
                    }
                }
                Recorded::Event { event: Event::Command(value), .. } => {
                    let command: Command = serde_json::from_value(value).map_err(|error| {
                        LiveError::Given(format!("{}: a command cannot be read: {error}", self.path.display()))
                    })?;
                    self.processor.command(&command)?;
                    return Ok(Some(Replayed::Command(command)));
                }
                Recorded::Event { event: Event::Hello(hello), .. } => {
                    let skin = Arc::clone(self.processor.skin());
                    greet(&mut self.stream, &hello, &skin).map_err(|why| {
                        LiveError::Given(format!("{}: a hello cannot be read: {why}", self.path.display()))
                    })?;
                }
                Recorded::Event { .. } => {}
            }
        }
    }

    fn frame(&mut self, measured_at: Moment, message: &[u8]) -> Result<Option<LiveFrame>, LiveError> {
        let Ok(ToHost::Frame(frame)) = ToHost::parse(message) else {
            return Err(LiveError::Given(format!("{}: a frame's message cannot be read", self.path.display())));
        };
        let Some(mut incoming) = self.stream.frame(&frame, message, measured_at) else { return Ok(None) };
        incoming.measured_at = measured_at;
        let frame = self.processor.process(incoming)?;
        self.processor.take_notices();
        Ok(Some(frame))
    }
}

fn greet(stream: &mut Stream, hello: &[u8], skin: &LiveSkin) -> Result<(), String> {
    match ToHost::parse(hello) {
        Ok(ToHost::Hello(hello)) => {
            stream.hello(&hello, skin);
            Ok(())
        }
        Ok(_) => Err("it is another message".into()),
        Err(error) => Err(error.to_string()),
    }
}
