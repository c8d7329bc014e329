//! What people and programs may ask of a live skin.

use crate::LiveError;
use crate::clock;
use crate::emulator::Emulator;
use crate::live::LiveHandle;
use crate::sink::{RecordingSink, Told};
use dermis::geom::{Point3, Surface};
use dermis::pipeline::Command;
use serde::Deserialize;
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// What may be asked of a live skin, as pages ask it.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(tag = "do", rename_all = "snake_case", deny_unknown_fields)]
pub enum Request {
    /// Take the skin as it is for untouched.
    // With braces, so that a field that it does not have is refused.
    Tare {},
    /// Change the threshold.
    Threshold {
        /// Times the method's own.
        value: f64,
    },
    /// Make images otherwise.
    Method {
        /// The method's name.
        name: String,
    },
    /// Begin or end a recording.
    Record {
        /// Begin.
        on: bool,
    },
    /// Hold the frames of this page back.
    Pause {
        /// Begin.
        on: bool,
    },
    /// Press the emulated skin.
    Press {
        /// Which finger.
        finger: u32,
        /// Where, m.
        position_m: Point3,
        /// How hard, N.
        force_n: f64,
    },
    /// Lift a finger.
    Release {
        /// Which.
        finger: u32,
    },
}

/// A live skin with all that belongs to it: what pages and programs talk to.
pub struct Control {
    shared: Arc<LiveHandle>,
    emulator: Option<Arc<Emulator>>,
    source: String,
    tapes: RecordingOptions,
    taping: Mutex<Option<RecordingSink>>,
    /// The number that the next finger of a guest has on the emulated skin.
    next_finger: AtomicU32,
}

/// Where recordings go, and what they carry.
#[derive(Debug, Clone, Default)]
pub struct RecordingOptions {
    /// The folder of recordings that pages ask for; they are named by the time.
    pub folder: PathBuf,
    /// The twin that an emulator plays.
    pub twin_toml: Option<String>,
}

/// The hardest press on an emulated skin, N.
const MOST_N: f64 = 20.0;

impl Control {
    /// Of a live skin; `source` tells in words where its frames come from.
    pub fn new(
        shared: Arc<LiveHandle>,
        emulator: Option<Arc<Emulator>>,
        source: String,
        tapes: RecordingOptions,
    ) -> Self {
        Control { shared, emulator, source, tapes, taping: Mutex::new(None), next_finger: AtomicU32::new(0) }
    }

    /// The live skin.
    pub fn shared(&self) -> &Arc<LiveHandle> {
        &self.shared
    }

    /// The emulated device, where there is one inside.
    pub fn emulator(&self) -> Option<&Arc<Emulator>> {
        self.emulator.as_ref()
    }

    /// Where frames come from, in words.
    pub fn source(&self) -> &str {
        &self.source
    }

    /// The recording as pages are told of it; `null` without one.
    pub fn recording(&self) -> Value {
        let taping = self.lock();
        let Some(taping) = &*taping else { return Value::Null };
        let told = taping.told();
        let bytes = std::fs::metadata(taping.path()).map_or(0, |file| file.len());
        let path = taping.path().display().to_string();
        json!({ "path": path, "frames": told.written.frames, "bytes": bytes, "problem": told.problem })
    }

    /// Begins a recording.
    ///
    /// # Errors
    /// One that is being made already; a file that is there already.
    pub fn record(&self, path: &Path) -> Result<(), LiveError> {
        let mut taping = self.lock();
        if let Some(taping) = &*taping {
            return Err(LiveError::Given(format!("{} is being recorded already", taping.path().display())));
        }
        *taping = Some(RecordingSink::start(&self.shared, path, self.tapes.twin_toml.as_deref())?);
        Ok(())
    }

    /// Ends the recording, if there is one; its file and how it went.
    pub fn end_recording(&self) -> Option<(PathBuf, Told)> {
        let taping = self.lock().take()?;
        let path = taping.path().to_path_buf();
        Some((path, taping.stop()))
    }

    fn lock(&self) -> MutexGuard<'_, Option<RecordingSink>> {
        self.taping.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn release(&self, finger: u32) {
        if let Some(emulator) = &self.emulator {
            emulator.release(finger);
        }
    }

    /// Does what is asked; fingers have their numbers on the emulated skin.
    fn carry_out(&self, request: &Request) -> Result<(), LiveError> {
        match request {
            Request::Tare {} => self.shared.command(Command::Tare),
            Request::Threshold { value } => {
                if !(*value > 0.0 && *value <= 1e6) {
                    return Err(LiveError::Given(format!(
                        "a threshold of {value}: it must be above 0 and at most 1e6"
                    )));
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
                let seconds = clock::now().unix_ns / 1_000_000_000;
                let name = format!("{}-{seconds}.mcap", self.shared.skin().design().name);
                self.record(&self.tapes.folder.join(name))?;
            }
            Request::Record { on: false } => drop(self.end_recording()),
            Request::Pause { .. } => {}
        }
        Ok(())
    }

    fn press(&self, finger: u32, position_m: Point3, force_n: f64) -> Result<(), LiveError> {
        let Some(emulator) = &self.emulator else {
            return Err(LiveError::Given("only an emulated skin can be pressed from here".into()));
        };
        if !(force_n > 0.0 && force_n <= MOST_N) {
            return Err(LiveError::Given(format!("a force of {force_n} N: it must be above 0 and at most {MOST_N}")));
        }
        emulator.press(finger, onto(&self.shared.skin().pixels().surface, position_m), force_n)
    }
}

/// One of those who ask things of a live skin, as a page does: with its own fingers, which are lifted when it goes.
pub struct ClientSession {
    control: Arc<Control>,
    /// Its fingers that press, by its own numbers: theirs on the emulated skin, where no other guest's finger has them.
    fingers: BTreeMap<u32, u32>,
    paused: bool,
}

/// Fingers of a guest that may press at once.
const MOST_FINGERS: usize = 10;

impl ClientSession {
    /// Of a live skin.
    pub fn new(control: Arc<Control>) -> Self {
        ClientSession { control, fingers: BTreeMap::new(), paused: false }
    }

    /// Whether it wants no frames now.
    pub fn is_paused(&self) -> bool {
        self.paused
    }

    /// Does what a message asks.
    ///
    /// # Errors
    /// A message that is no request, or that cannot be done; in words.
    pub fn ask(&mut self, text: &str) -> Result<(), String> {
        let mut request: Request =
            serde_json::from_str(text).map_err(|error| format!("this message is no command: {error}"))?;
        match &mut request {
            Request::Pause { on } => self.paused = *on,
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
        if !self.fingers.contains_key(&finger) && self.fingers.len() >= MOST_FINGERS {
            return Err(format!("{MOST_FINGERS} fingers are the most"));
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

/// The point of the surface nearest to one that was picked on a drawing of it, which has corners.
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
