//! Requests of pages and programs to a skin being read.

use crate::LiveError;
use crate::clock;
use crate::guide::{Guide, GuideAction};
use crate::recording::{RecordingLimits, RecordingSink, RecordingStatus};
use crate::runtime::{LiveHandle, RateLimit};
use dermis::geom::{Point3, Surface};
use dermis::pipeline::{Command, Severity};
use serde::Deserialize;
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Instant;

/// A request, as pages send it.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(tag = "do", rename_all = "snake_case", deny_unknown_fields)]
pub(crate) enum Request {
    /// Measure the baseline again.
    // The braces make serde reject unknown fields.
    Tare {},
    /// Change the detection threshold.
    Threshold {
        /// Threshold relative to the method's own.
        value: f64,
    },
    /// Change the method.
    Method {
        /// Name of the method.
        name: String,
    },
    /// Begin or end a recording.
    Record {
        /// Begin.
        on: bool,
    },
    /// Stop or continue the frames of this page; those of all pages where a recording is played.
    Pause {
        /// Begin.
        on: bool,
    },
    /// Go to another place of the recording that is played.
    Seek {
        /// The part of the file before it.
        part: f64,
    },
    /// Press the emulated skin.
    Press {
        /// Number of the finger.
        finger: u32,
        /// Position, m.
        position_m: Point3,
        /// Force, N.
        force_n: f64,
    },
    /// Lift a finger.
    Release {
        /// Number of the finger.
        finger: u32,
    },
    /// Skip or repeat a press of a guided session, or end the session.
    Guide {
        /// What to do.
        action: GuideAction,
    },
}

/// An emulated skin that pages press.
pub trait Pressable: Send + Sync {
    /// Presses with a finger by its number, or moves it.
    ///
    /// # Errors
    /// A press that the skin cannot take.
    fn press(&self, finger: u32, centre_m: Point3, force_n: f64) -> Result<(), LiveError>;

    /// Lifts a finger.
    fn release(&self, finger: u32);
}

/// A skin being read with its emulator and its recording: receives the requests of pages and programs.
pub struct Control {
    shared: Arc<LiveHandle>,
    emulator: Option<Arc<dyn Pressable>>,
    guide: Option<Arc<Guide>>,
    source: String,
    recording_options: RecordingOptions,
    recording: Mutex<Option<RecordingSink>>,
    /// Limits of all pages together on changes of the method, and on the other commands to the pipeline.
    limits: Mutex<[RateLimit; 2]>,
    /// The number of the next client's finger on the emulated skin.
    next_finger: AtomicU32,
}

/// Options of recordings.
#[derive(Debug, Clone, Default)]
pub struct RecordingOptions {
    /// Folder of the recordings that pages request, made when it is needed; they are named by the skin and the time.
    pub folder: PathBuf,
    /// The digital twin of the emulator (TOML).
    pub twin_toml: Option<String>,
    /// Limits of each recording.
    pub limits: RecordingLimits,
}

/// The hardest press on an emulated skin, N.
const MAX_N: f64 = 20.0;

impl Control {
    /// Controls a skin being read; `source` describes where its frames come from.
    pub fn new(
        shared: Arc<LiveHandle>,
        emulator: Option<Arc<dyn Pressable>>,
        source: String,
        recording_options: RecordingOptions,
    ) -> Self {
        Control {
            shared,
            emulator,
            guide: None,
            source,
            recording_options,
            recording: Mutex::new(None),
            limits: Mutex::new([RateLimit::new(5, 2.0), RateLimit::new(60, 60.0)]),
            next_finger: AtomicU32::new(0),
        }
    }

    /// The same for a guided session.
    #[must_use]
    pub fn with_guide(self, guide: Arc<Guide>) -> Self {
        Control { guide: Some(guide), ..self }
    }

    /// The guided session, if there is one.
    pub fn guide(&self) -> Option<&Arc<Guide>> {
        self.guide.as_ref()
    }

    /// The handle of the skin.
    pub fn shared(&self) -> &Arc<LiveHandle> {
        &self.shared
    }

    /// Whether pages can press the skin.
    pub fn is_pressable(&self) -> bool {
        self.emulator.is_some()
    }

    /// Description of where frames come from.
    pub fn source(&self) -> &str {
        &self.source
    }

    /// The recording as pages receive it; `null` without one.
    pub fn recording(&self) -> Value {
        let recording = self.lock();
        let Some(recording) = &*recording else { return Value::Null };
        let status = recording.status();
        let path = recording.path().display().to_string();
        json!({ "path": path, "frames": status.written.frames, "bytes": status.bytes, "problem": status.problem })
    }

    /// Begins a recording.
    ///
    /// # Errors
    /// A recording in progress; a file that exists already.
    pub fn record(&self, path: &Path) -> Result<(), LiveError> {
        let mut recording = self.lock();
        if let Some(recording) = &*recording {
            return Err(LiveError::Given(format!("{} is being recorded already", recording.path().display())));
        }
        let RecordingOptions { twin_toml, limits, .. } = &self.recording_options;
        *recording = Some(RecordingSink::start(&self.shared, path, twin_toml.as_deref(), *limits)?);
        Ok(())
    }

    /// Ends the recording, if there is one; its file and status.
    pub fn end_recording(&self) -> Option<(PathBuf, RecordingStatus)> {
        let recording = self.lock().take()?;
        let path = recording.path().to_path_buf();
        Some((path, recording.stop()))
    }

    fn lock(&self) -> MutexGuard<'_, Option<RecordingSink>> {
        self.recording.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn release(&self, finger: u32) {
        if let Some(emulator) = &self.emulator {
            emulator.release(finger);
        }
    }

    /// Refuses commands that come faster than people give them: each takes time that frames need.
    fn check_rate(&self, request: &Request) -> Result<(), LiveError> {
        let limit = match request {
            Request::Method { .. } | Request::Record { .. } | Request::Seek { .. } => 0,
            Request::Tare {} | Request::Threshold { .. } | Request::Guide { .. } => 1,
            Request::Pause { .. } | Request::Press { .. } | Request::Release { .. } => return Ok(()),
        };
        let mut limits = self.limits.lock().unwrap_or_else(PoisonError::into_inner);
        limits[limit]
            .passes(Instant::now())
            .map_err(|wait_s| LiveError::Given(format!("too many commands: the next one may come in {wait_s:.1} s")))
    }

    /// A new file in the folder of recordings. The name of the skin chooses no other folder.
    fn new_recording(&self) -> Result<PathBuf, LiveError> {
        let folder = &self.recording_options.folder;
        std::fs::create_dir_all(folder)
            .map_err(|source| LiveError::Given(format!("cannot make the folder {}: {source}", folder.display())))?;
        let seconds = clock::now().unix_ns / 1_000_000_000;
        Ok(folder.join(format!("{}-{seconds}.mcap", file_name(&self.shared.skin().design().name))))
    }

    /// Carries out a request; fingers have their numbers on the emulated skin.
    fn carry_out(&self, request: &Request) -> Result<(), LiveError> {
        self.check_rate(request)?;
        match request {
            Request::Tare {} => self.shared.command(Command::Tare),
            Request::Threshold { value } => {
                if !(1e-6..=1e6).contains(value) {
                    return Err(LiveError::Given(format!("a threshold of {value}: it must be from 1e-6 to 1e6")));
                }
                self.shared.command(Command::Threshold { value: *value });
            }
            Request::Method { name } => {
                self.shared.methods().method(name)?;
                self.shared.command(Command::Method { name: name.clone() });
            }
            Request::Press { finger, position_m, force_n } => self.press(*finger, *position_m, *force_n)?,
            Request::Release { finger } => self.release(*finger),
            Request::Record { on: true } => {
                let path = self.new_recording()?;
                self.record(&path)?;
                self.shared.notice(Severity::Info, format!("a page began the recording {}", path.display()));
            }
            Request::Record { on: false } => {
                if let Some((path, _)) = self.end_recording() {
                    self.shared.notice(Severity::Warning, format!("a page ended the recording {}", path.display()));
                }
            }
            Request::Pause { on } => self.shared.playback().into_iter().for_each(|playback| playback.pause(*on)),
            Request::Seek { part } => self.seek(*part)?,
            Request::Guide { action } => match &self.guide {
                Some(guide) => guide.request(*action),
                None => return Err(LiveError::Given("this is no guided session".into())),
            },
        }
        Ok(())
    }

    fn seek(&self, part: f64) -> Result<(), LiveError> {
        let refused = |why: &str| Err(LiveError::Given(why.into()));
        match self.shared.playback() {
            None => refused("only a recording that is played has another place to go to"),
            Some(_) if !(0.0..=1.0).contains(&part) => {
                refused("a place in a recording is from 0, its start, to 1, its end")
            }
            Some(_) if self.lock().is_some() => refused("end the recording first: its frames must follow each other"),
            Some(playback) => {
                playback.seek(part);
                Ok(())
            }
        }
    }

    fn press(&self, finger: u32, position_m: Point3, force_n: f64) -> Result<(), LiveError> {
        let Some(emulator) = &self.emulator else {
            return Err(LiveError::Given("only an emulated skin can be pressed from here".into()));
        };
        if !(force_n > 0.0 && force_n <= MAX_N) {
            return Err(LiveError::Given(format!("a force of {force_n} N: it must be above 0 and at most {MAX_N}")));
        }
        emulator.press(finger, onto(&self.shared.skin().pixels().surface, position_m), force_n)
    }
}

/// A client such as a page, with its own fingers on the emulated skin. They are released when it disconnects.
pub struct ClientSession {
    control: Arc<Control>,
    /// Its pressing fingers: a map from its own finger numbers to the numbers on the emulated skin, which are unique
    /// among all clients.
    fingers: BTreeMap<u32, u32>,
    paused: bool,
}

/// Most fingers of a client that press at once.
const MAX_FINGERS: usize = 10;

impl ClientSession {
    /// A session with the controls of a skin.
    pub fn new(control: Arc<Control>) -> Self {
        ClientSession { control, fingers: BTreeMap::new(), paused: false }
    }

    /// Whether its frames are paused.
    pub(crate) fn is_paused(&self) -> bool {
        self.paused
    }

    /// Carries out the request of a message.
    ///
    /// # Errors
    /// A message that is not a valid request, or a request that fails; the error is a text for people.
    pub fn ask(&mut self, text: &str) -> Result<(), String> {
        let mut request: Request =
            serde_json::from_str(text).map_err(|error| format!("this message is no command: {error}"))?;
        match &mut request {
            Request::Pause { on } => self.paused = *on && self.control.shared.playback().is_none(),
            Request::Press { finger, .. } => *finger = self.finger(*finger)?,
            Request::Release { finger } => match self.fingers.remove(finger) {
                Some(own) => *finger = own,
                None => return Ok(()),
            },
            _ => {}
        }
        self.control.carry_out(&request).map_err(|error| error.to_string())
    }

    /// The number of one of its fingers on the emulated skin.
    fn finger(&mut self, finger: u32) -> Result<u32, String> {
        if !self.fingers.contains_key(&finger) && self.fingers.len() >= MAX_FINGERS {
            return Err(format!("{MAX_FINGERS} fingers are the most"));
        }
        let next = &self.control.next_finger;
        Ok(*self.fingers.entry(finger).or_insert_with(|| next.fetch_add(1, Ordering::Relaxed)))
    }
}

impl Drop for ClientSession {
    fn drop(&mut self) {
        self.fingers.values().for_each(|&finger| self.control.release(finger));
    }
}

/// Longest part of a file's name that comes from the name of a skin, characters.
const LONGEST_FILE_NAME: usize = 60;

/// A text as a part of a file's name: letters, digits, `-`, `_` and inner dots; everything else becomes `_`.
fn file_name(text: &str) -> String {
    let clean = |character: char| match character {
        '-' | '_' | '.' => character,
        _ if character.is_alphanumeric() => character,
        _ => '_',
    };
    let name: String = text.trim_start_matches('.').chars().take(LONGEST_FILE_NAME).map(clean).collect();
    if name.is_empty() { "skin".into() } else { name }
}

/// The surface point nearest to one that was picked on the drawn triangles.
fn onto(surface: &Surface, point: Point3) -> Point3 {
    match *surface {
        Surface::Cylinder { length_m, .. } => {
            let on = surface.at(point[2].clamp(0.0, length_m), point[1].atan2(point[0]));
            on.unwrap_or(point)
        }
        Surface::Plane => [point[0], point[1], 0.0],
        Surface::Free => point,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_name_of_a_skin_chooses_no_folder() {
        for (name, expected) in [
            ("skin16", "skin16"),
            ("left arm.v2", "left_arm.v2"),
            ("/tmp/x", "_tmp_x"),
            ("../../x", "_.._x"),
            ("..", "skin"),
            (".hidden", "hidden"),
            ("C:\\x\u{1b}\n", "C__x__"),
            ("", "skin"),
        ] {
            assert_eq!(file_name(name), expected);
            let path = Path::new("folder").join(format!("{}-1.mcap", file_name(name)));
            assert_eq!(path.parent(), Some(Path::new("folder")), "{name}");
        }
        assert_eq!(file_name(&"x".repeat(1000)).len(), LONGEST_FILE_NAME);
    }
}
