//! The recording of a robot: a folder with a recording of each skin, and all that the robot was told, in its order.
//!
//! | file | what |
//! |---|---|
//! | `robot.toml`, `robot.urdf` | the robot; designs are those of this folder |
//! | `skins/NAME.toml` | the design of a skin |
//! | `skins/NAME.mcap`, `NAME+2.mcap`, ... | its frames; another file each time that it was read anew |
//! | `inputs.jsonl` | a line for each frame, fault, device, joint state and snapshot, with the time at which it was taken |
//!
//! Replayed, they give the same events and snapshots. Both kinds of files are complete up to half a second before a crash.

use super::{Prepared, RobotOutput};
use crate::recording::{RecordError, RecordingLimits, RecordingSink, Replay, Replayed};
use crate::runtime::{self, LiveFrame, LiveHandle};
use crate::{LiveError, clock};
use dermis::method::{MethodSet, Methods};
use dermis::pipeline::Timestamp;
use dermis::skin::Skin;
use dermis_robot::{Robot, RobotState, RuleEvent, SkinFrame, UnknownReason, WornSkin};
use serde::{Deserialize, Serialize};
use std::collections::VecDeque;
use std::fs::{self, File};
use std::io::{BufRead, BufReader, BufWriter, Write};
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, sync_channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::Duration;

const INPUTS: &str = "inputs.jsonl";
const ROBOT: &str = "robot.toml";
const DESCRIPTION: &str = "robot.urdf";
const SKINS: &str = "skins";
/// Inputs that can wait for the disk: half a minute of ten skins.
const WAITING: usize = 40_000;
/// Inputs are written at least this often.
const FLUSHED: Duration = Duration::from_millis(400);

/// What the state of a robot is told.
#[derive(Debug, Clone, Serialize, Deserialize)]
#[serde(tag = "input", rename_all = "snake_case")]
pub(super) enum Input {
    /// A frame of a skin, which is in its recording, and the rate at which they arrived.
    Frame { skin: String, measured_at: Timestamp, rate_hz: f64 },
    /// A frame of a skin that another program reads.
    Known { skin: String, frame: SkinFrame },
    /// Its last frame is stale.
    Stale { skin: String },
    /// Its device is there.
    Connected { skin: String, serial: u32 },
    /// It is unknown.
    Fault { skin: String, reason: UnknownReason },
    /// It is read from now on, and recorded in a file.
    Read { skin: String, file: String },
    /// Joint states.
    Joints { measured_at: Timestamp, positions: Vec<(String, f64)> },
    /// Time passes, and a snapshot is made.
    Snapshot,
    /// The recording was ended, and not cut off.
    End,
}

impl Input {
    /// Tells the state of a robot; frames in recordings and what concerns no skin are not told.
    pub(super) fn apply(&self, state: &mut RobotState, skin: usize, at: Timestamp) -> Vec<RuleEvent> {
        match self {
            Input::Known { frame, .. } => state.known(skin, frame.clone(), at),
            Input::Stale { .. } => state.stale(skin, at),
            Input::Connected { serial, .. } => state.connected(skin, *serial, at),
            Input::Fault { reason, .. } => state.fault(skin, *reason, at),
            Input::Frame { .. } | Input::Read { .. } | Input::Joints { .. } | Input::Snapshot | Input::End => {
                Vec::new()
            }
        }
    }

    /// The skin that it concerns.
    pub(super) fn skin(&self) -> Option<&str> {
        match self {
            Input::Frame { skin, .. }
            | Input::Known { skin, .. }
            | Input::Stale { skin }
            | Input::Connected { skin, .. }
            | Input::Fault { skin, .. }
            | Input::Read { skin, .. } => Some(skin),
            Input::Joints { .. } | Input::Snapshot | Input::End => None,
        }
    }
}

/// An input with the time at which it was taken.
#[derive(Debug, Serialize, Deserialize)]
pub(super) struct Line {
    pub(super) at: Timestamp,
    #[serde(flatten)]
    pub(super) input: Input,
}

/// A recording in progress.
#[derive(Debug)]
pub(super) struct RobotRecording {
    folder: PathBuf,
    inputs: SyncSender<Line>,
    thread: JoinHandle<()>,
    problem: Arc<Mutex<Option<String>>>,
    /// By skin, how often it has been read, and its recording in progress.
    skins: Vec<(u32, Option<RecordingSink>)>,
}

impl RobotRecording {
    /// Begins a recording in a new folder.
    pub(super) fn create(robot: &Robot, folder: &Path) -> Result<Self, LiveError> {
        if fs::read_dir(folder).is_ok_and(|mut entries| entries.next().is_some()) || folder.is_file() {
            let message =
                format!("{} is there already: give another folder, recordings are not overwritten", folder.display());
            return Err(LiveError::Given(message));
        }
        let io = |path: &Path, source| LiveError::Io { path: path.into(), source };
        let skins = folder.join(SKINS);
        fs::create_dir_all(&skins).map_err(|error| io(&skins, error))?;
        let write = |path: PathBuf, text: &str| fs::write(&path, text).map_err(|error| io(&path, error));
        write(folder.join(ROBOT), &moved(robot))?;
        if let Some(description) = robot.description() {
            let to = folder.join(DESCRIPTION);
            fs::copy(description, &to).map_err(|error| io(description, error))?;
        }
        for worn in robot.skins() {
            let skin = Skin::load(&worn.design)?;
            write(skins.join(format!("{}.toml", worn.name)), skin.design_text().unwrap_or_default())?;
            if let Some(method) = worn.method.as_deref().filter(|method| dermis::method::is_path(method)) {
                copy_files(Path::new(method), &folder.join(method_of(worn)))?;
            }
        }
        let path = folder.join(INPUTS);
        let file = File::create_new(&path).map_err(|error| io(&path, error))?;
        let (sender, inputs) = sync_channel(WAITING);
        let problem = Arc::new(Mutex::new(None));
        let shared = Arc::clone(&problem);
        let thread = runtime::spawn("dermis-inputs", move || {
            if let Err(error) = write_lines(&inputs, BufWriter::new(file)) {
                set(&shared, format!("{}: {error}", path.display()));
            }
        });
        let skins = robot.skins().iter().map(|_| (0, None)).collect();
        Ok(RobotRecording { folder: folder.into(), inputs: sender, thread, problem, skins })
    }

    /// Records an input; it never waits for the disk.
    pub(super) fn take(&self, at: Timestamp, input: Input) {
        if self.inputs.try_send(Line { at, input }).is_err() {
            set(&self.problem, "the disk is too slow: inputs are missing from here on".into());
        }
    }

    /// Records a skin that is going to be read.
    pub(super) fn read(
        &mut self,
        skin: usize,
        name: &str,
        at: Timestamp,
        live: &Arc<LiveHandle>,
    ) -> Result<(), LiveError> {
        self.end(skin);
        let (count, sink) = &mut self.skins[skin];
        *count += 1;
        // No skin has a name with a plus.
        let file = if *count == 1 { format!("{name}.mcap") } else { format!("{name}+{count}.mcap") };
        let path = self.folder.join(SKINS).join(&file);
        *sink = Some(RecordingSink::start(live, &path, None, RecordingLimits::default())?);
        self.take(at, Input::Read { skin: name.into(), file });
        Ok(())
    }

    /// Ends the recording of a skin that is no longer read.
    pub(super) fn end(&mut self, skin: usize) {
        if let Some(problem) = self.skins[skin].1.take().and_then(|sink| sink.stop().problem) {
            set(&self.problem, problem);
        }
    }

    /// Ends the recording. Returns why it is not complete, if it is not.
    pub(super) fn stop(mut self) -> Option<String> {
        (0..self.skins.len()).for_each(|skin| self.end(skin));
        self.take(clock::now(), Input::End);
        drop(self.inputs);
        // A thread that panicked has printed its message already.
        let _ = self.thread.join();
        self.problem.lock().unwrap_or_else(PoisonError::into_inner).take()
    }
}

/// Keeps the first problem.
fn set(problem: &Mutex<Option<String>>, text: String) {
    problem.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert(text);
}

/// Writes inputs until the recording ends.
fn write_lines(inputs: &Receiver<Line>, mut out: BufWriter<File>) -> std::io::Result<()> {
    let write = |line: &Line, out: &mut BufWriter<File>| {
        serde_json::to_writer(&mut *out, line)?;
        out.write_all(b"\n")
    };
    let mut flushed = std::time::Instant::now();
    loop {
        match inputs.recv_timeout(FLUSHED) {
            Ok(line) => write(&line, &mut out)?,
            Err(RecvTimeoutError::Timeout) => {}
            Err(RecvTimeoutError::Disconnected) => return out.flush(),
        }
        if flushed.elapsed() >= FLUSHED {
            flushed = std::time::Instant::now();
            out.flush()?;
        }
    }
}

/// The file of a robot with the files of its recording.
fn moved(robot: &Robot) -> String {
    robot.text_with_paths(DESCRIPTION, |worn| {
        let is_folder = worn.method.as_deref().is_some_and(dermis::method::is_path);
        (format!("{SKINS}/{}.toml", worn.name), is_folder.then(|| method_of(worn)))
    })
}

/// The folder of a skin's model or calibration in a recording.
fn method_of(worn: &WornSkin) -> String {
    format!("{SKINS}/{}.method", worn.name)
}

/// Copies the files of a model or calibration.
fn copy_files(from: &Path, to: &Path) -> Result<(), LiveError> {
    let io = |path: &Path| {
        let path = path.to_path_buf();
        |source| LiveError::Io { path, source }
    };
    fs::create_dir_all(to).map_err(io(to))?;
    for entry in fs::read_dir(from).map_err(io(from))? {
        let path = entry.map_err(io(from))?.path();
        if path.is_file() {
            fs::copy(&path, to.join(path.file_name().unwrap_or_default())).map_err(io(&path))?;
        }
    }
    Ok(())
}

/// A recording of a robot that is replayed: the same inputs give the same events and snapshots.
pub struct RobotReplay {
    folder: PathBuf,
    state: RobotState,
    methods: Methods,
    inputs: BufReader<File>,
    line: usize,
    skins: Vec<SkinReplay>,
    waiting: VecDeque<RobotOutput>,
    missing: u64,
    is_whole: bool,
    /// When the first frame that is missing was taken, and the last input.
    first_missing: Option<Timestamp>,
    last: Timestamp,
}

impl std::fmt::Debug for RobotReplay {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        formatter.debug_struct("RobotReplay").field("folder", &self.folder).finish_non_exhaustive()
    }
}

impl RobotReplay {
    /// Opens the recording in a folder.
    ///
    /// # Errors
    /// A folder that is no recording of a robot.
    pub fn open(folder: &Path, methods: &Methods) -> Result<Self, LiveError> {
        let robot = Robot::load(&folder.join(ROBOT)).map_err(dermis::Error::from)?;
        let path = folder.join(INPUTS);
        let file = File::open(&path).map_err(|error| {
            let what = "no recording of a robot, as `dermis robot run --record` makes it";
            LiveError::Given(format!("{} is {what}: {}: {error}", folder.display(), path.display()))
        })?;
        Ok(RobotReplay {
            folder: folder.into(),
            skins: robot.skins().iter().map(|_| SkinReplay::default()).collect(),
            state: RobotState::new(Arc::new(robot)),
            methods: methods.clone(),
            inputs: BufReader::new(file),
            line: 0,
            waiting: VecDeque::new(),
            missing: 0,
            is_whole: false,
            first_missing: None,
            last: Timestamp::default(),
        })
    }

    /// The state of the robot.
    pub fn state(&self) -> &RobotState {
        &self.state
    }

    /// Frames that the recordings of the skins do not hold, because they were cut off or damaged.
    pub fn missing_frames(&self) -> u64 {
        self.missing
    }

    /// Whether the recording was read to its end, and was not cut off.
    pub fn is_whole(&self) -> bool {
        self.is_whole
    }

    /// How long before its end the recording lacks frames, s, if it lacks any: less than a second after a crash or a kill.
    pub fn cut_off_s(&self) -> Option<f64> {
        self.first_missing.map(|first| self.last.seconds_since(first))
    }

    /// The next event or snapshot; `None` at the end. A last line that was cut off is left out.
    ///
    /// # Errors
    /// A line that cannot be read, with its number; a skin's recording that cannot be read.
    pub fn step(&mut self) -> Result<Option<RobotOutput>, LiveError> {
        let mut text = String::new();
        loop {
            if let Some(output) = self.waiting.pop_front() {
                return Ok(Some(output));
            }
            text.clear();
            let path = || self.folder.join(INPUTS);
            let length = self.inputs.read_line(&mut text).map_err(|source| LiveError::Io { path: path(), source })?;
            if length == 0 || !text.ends_with('\n') {
                return Ok(None);
            }
            self.line += 1;
            let line: Line = serde_json::from_str(&text).map_err(|error| self.wrong(&error.to_string()))?;
            let events = self.take(line.at, line.input)?;
            self.waiting.extend(events);
        }
    }

    fn wrong(&self, what: &str) -> LiveError {
        LiveError::Given(format!("{}, line {}: {what}", self.folder.join(INPUTS).display(), self.line))
    }

    fn skin(&self, name: &str) -> Result<usize, LiveError> {
        self.state.robot().skin(name).ok_or_else(|| self.wrong(&format!("the robot has no skin `{name}`")))
    }

    fn take(&mut self, at: Timestamp, input: Input) -> Result<Vec<RobotOutput>, LiveError> {
        self.last = at;
        let events = |events: Vec<RuleEvent>| Ok(events.into_iter().map(RobotOutput::Event).collect());
        match input {
            Input::Read { skin, file } => {
                let index = self.skin(&skin)?;
                self.read(index, &file)?;
                Ok(Vec::new())
            }
            Input::Frame { skin, measured_at, rate_hz } => {
                let index = self.skin(&skin)?;
                match self.skins[index].frame(measured_at)? {
                    Some(mut frame) => {
                        Arc::make_mut(&mut frame.result.health).rate_hz = rate_hz;
                        events(self.state.frame(index, &frame.result, at))
                    }
                    None => {
                        self.missing += 1;
                        self.first_missing.get_or_insert(at);
                        Ok(Vec::new())
                    }
                }
            }
            Input::Known { ref skin, .. }
            | Input::Stale { ref skin }
            | Input::Connected { ref skin, .. }
            | Input::Fault { ref skin, .. } => {
                let index = self.skin(skin)?;
                events(input.apply(&mut self.state, index, at))
            }
            Input::Joints { measured_at, positions } => {
                let positions: Vec<(&str, f64)> =
                    positions.iter().map(|(name, position)| (name.as_str(), *position)).collect();
                // States that were refused are refused again.
                let _ = self.state.joints(measured_at, &positions);
                Ok(Vec::new())
            }
            Input::End => {
                self.is_whole = true;
                Ok(Vec::new())
            }
            Input::Snapshot => {
                let mut outputs: Vec<RobotOutput> = self.state.tick(at).into_iter().map(RobotOutput::Event).collect();
                outputs.push(RobotOutput::Snapshot(Box::new(self.state.snapshot(at))));
                Ok(outputs)
            }
        }
    }

    /// A skin is read from another file; from none if it ended before its first frame.
    fn read(&mut self, skin: usize, file: &str) -> Result<(), LiveError> {
        let path = self.folder.join(SKINS).join(file);
        let SkinReplay { methods, replay, next, lacking } = &mut self.skins[skin];
        (*replay, *next, *lacking) = (None, None, None);
        if !path.exists() {
            *lacking = Some(path);
        } else {
            let methods = match methods {
                Some(methods) => methods,
                None => methods.insert(Prepared::new(&self.methods).of(&self.state.robot().skins()[skin])?),
            };
            *replay = Some(Replay::with(&path, methods)?);
        }
        Ok(())
    }
}

/// The recording of a skin that is replayed.
#[derive(Default)]
struct SkinReplay {
    methods: Option<Arc<MethodSet>>,
    replay: Option<Replay>,
    /// A frame that is later than the last one that was asked for.
    next: Option<Box<LiveFrame>>,
    /// Its file, if it is not there.
    lacking: Option<PathBuf>,
}

impl SkinReplay {
    /// The frame that was measured at a time.
    fn frame(&mut self, measured_at: Timestamp) -> Result<Option<Box<LiveFrame>>, LiveError> {
        if let Some(path) = &self.lacking {
            let message = format!("{} is missing, and the robot took frames of it: restore the file", path.display());
            return Err(LiveError::Given(message));
        }
        let Some(replay) = &mut self.replay else { return Ok(None) };
        loop {
            let frame = match self.next.take() {
                Some(frame) => frame,
                None => match replay.step() {
                    Ok(Some(Replayed::Frame(frame))) => frame,
                    Ok(Some(Replayed::Command(_))) | Err(LiveError::Record(RecordError::Damaged { .. })) => continue,
                    Ok(None) => return Ok(None),
                    Err(error) => return Err(error),
                },
            };
            match frame.result.measured_at.cmp(&measured_at) {
                // One that the robot did not take.
                std::cmp::Ordering::Less => {}
                std::cmp::Ordering::Equal => return Ok(Some(frame)),
                std::cmp::Ordering::Greater => {
                    self.next = Some(frame);
                    return Ok(None);
                }
            }
        }
    }
}
