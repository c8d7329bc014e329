//! `dermis.Pipeline`, `dermis.Live` and `dermis.Replay`: streams of frames with tracked contacts.

use crate::arrays;
use crate::contacts;
use crate::failure::{Failure, Outcome};
use crate::method::method_name;
use crate::skin::Skin;
use crate::worker;
use dermis::design::SkinDesign;
use dermis::method::MethodSet;
use dermis::pipeline::{self, Command, FrameInput, Notice, PipelineFrame, Settings, Timestamp, Validity};
use dermis::skin;
use dermis_calibrate::Calibration;
use dermis_emulate::emulator::{Emulator, EmulatorOptions, Script};
use dermis_live::device::Address;
use dermis_live::recording::{self, Player, Replayed};
use dermis_live::runtime::{Event, LiveOptions, Mailbox, Popped};
use dermis_live::{LiveFrame, clock};
use dermis_sim::twin::TwinOptions;
use numpy::PyArray1;
use pyo3::prelude::*;
use std::collections::VecDeque;
use std::path::PathBuf;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// Interval between two looks at signals while no frame arrives.
const LOOK: Duration = Duration::from_millis(50);
/// Capacity of the queue of a live skin: the oldest frames are dropped.
const QUEUE: usize = 4096;

/// A time since 1970, s; now without it.
pub fn time(time_s: Option<f64>) -> Outcome<Timestamp> {
    let Some(time_s) = time_s else { return Ok(clock::now()) };
    let since = Duration::try_from_secs_f64(time_s)
        .map_err(|_| Failure::given(format!("`time_s` is {time_s}: it must be a time since 1970, s")))?;
    Ok(Timestamp::default().after(since))
}

/// A frame with its contacts.
#[pyclass(frozen, module = "dermis")]
pub struct Frame {
    skin: skin::Skin,
    frame: PipelineFrame,
}

impl Frame {
    pub(crate) fn frame(&self) -> &PipelineFrame {
        &self.frame
    }

    pub(crate) fn skin(&self) -> &skin::Skin {
        &self.skin
    }
}

#[pymethods]
impl Frame {
    /// Its number.
    #[getter]
    fn sequence(&self) -> u64 {
        self.frame.sequence
    }

    /// Time of measurement, s since 1970.
    #[getter]
    fn time_s(&self) -> f64 {
        self.frame.measured_at.seconds()
    }

    /// The values, (channels,), ohm.
    #[getter]
    fn values<'py>(&self, py: Python<'py>) -> Bound<'py, PyAny> {
        PyArray1::from_slice(py, &self.frame.values_ohm).into_any()
    }

    /// The image, (rows, columns) with NaN outside the body, or (cells,).
    #[getter]
    fn image<'py>(&self, py: Python<'py>) -> Outcome<Bound<'py, PyAny>> {
        let values = self.frame.image.iter().map(|&value| f64::from(value)).collect();
        let space = Arc::clone(self.skin.pixels());
        let shape = space.grid.map_or_else(|| vec![space.len()], Vec::from);
        arrays::rows(py, dermis::image::Image { space, values }.to_grid(), &shape, true)
    }

    /// `ok`, `degraded`, `invalid` or `stale`.
    #[getter]
    fn validity(&self) -> &'static str {
        self.frame.validity.name()
    }

    /// The validity in words.
    #[getter]
    fn reason(&self) -> String {
        self.frame.validity.to_string()
    }

    /// Whether the contacts can be relied on.
    #[getter]
    fn is_usable(&self) -> bool {
        self.frame.validity.is_usable()
    }

    /// Whether the skin is touched; None if the frame is invalid.
    #[getter]
    fn touched(&self) -> Option<bool> {
        self.frame.touched
    }

    /// The contacts, the oldest first.
    #[getter]
    fn contacts<'py>(&self, py: Python<'py>) -> Outcome<Bound<'py, PyAny>> {
        contacts::tracked(py, &self.frame)
    }

    fn __repr__(&self) -> String {
        let PipelineFrame { sequence, contacts, validity, .. } = &self.frame;
        let validity = if *validity == Validity::Ok { "ok".into() } else { validity.to_string() };
        format!("<dermis.Frame {sequence}: {validity}, {} contacts>", contacts.len())
    }
}

#[doc = stub_doc!(Pipeline)]
#[pyclass(frozen, module = "dermis")]
pub struct Pipeline {
    feed: Mutex<Feed>,
    skin: skin::Skin,
}

/// A pipeline, and the number of its next frame and the time of the last one.
struct Feed {
    pipeline: pipeline::Pipeline,
    next: u64,
    last: Timestamp,
}

impl Pipeline {
    fn feed(&self) -> MutexGuard<'_, Feed> {
        self.feed.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// The methods of a skin, with the one of this name or folder.
fn methods(py: Python<'_>, skin: &Skin, method: Option<&str>) -> Outcome<Arc<MethodSet>> {
    let skin = skin.skin().clone();
    worker::run(py, "preparing the methods", 1, |_| {
        Ok(Arc::new(MethodSet::new(&dermis_learn::methods(), skin, method)?))
    })
}

#[pymethods]
impl Pipeline {
    #[new]
    #[pyo3(signature = (skin, method=None, *, threshold=1.0, tare_frames=100, both_signs=false, force=false))]
    fn new(
        skin: &Bound<'_, Skin>,
        method: Option<&Bound<'_, PyAny>>,
        threshold: f64,
        tare_frames: usize,
        both_signs: bool,
        force: bool,
    ) -> Outcome<Self> {
        let method = method_name(skin.py(), method)?;
        let methods = methods(skin.py(), skin.get(), method.as_deref())?;
        let method = method.unwrap_or_default();
        let force_tare = force || Calibration::is_named(&method);
        let settings = Settings { method, threshold, tare_frames, both_signs, force_tare, ..Settings::default() };
        let feed = Mutex::new(Feed {
            pipeline: pipeline::Pipeline::new(methods, settings)?,
            next: 0,
            last: Timestamp::default(),
        });
        Ok(Pipeline { feed, skin: skin.get().skin().clone() })
    }

    #[doc = stub_doc!(Pipeline.process)]
    #[pyo3(signature = (frame, time_s=None))]
    fn process(&self, py: Python<'_>, frame: &Bound<'_, PyAny>, time_s: Option<f64>) -> Outcome<Frame> {
        let rows = arrays::frames(frame, "frame", &self.skin.design().protocol)?;
        if !rows.is_single {
            return Err(Failure::with_hint("`frame` has rows", "give one frame, (channels,)"));
        }
        let values = rows.values()?.to_vec();
        let measured_at = time(time_s)?;
        let frame = worker::run_short(py, || {
            let Feed { pipeline, next, last } = &mut *self.feed();
            let before_s = last.seconds_since(measured_at);
            if before_s > 0.0 {
                let message = format!("the frame is {before_s:.3} s older than the one before");
                return Err(Failure::with_hint(message, "give a `time_s` that increases"));
            }
            let frame = pipeline.process(FrameInput::new(*next, measured_at, values))?;
            (*next, *last) = (*next + 1, measured_at);
            if pipeline.wants_rebuild()
                && let Ok(rebuilt) = pipeline.rebuild_job().run()
            {
                pipeline.install_method(rebuilt);
            }
            Ok::<_, Failure>(frame)
        })?;
        Ok(Frame { skin: self.skin.clone(), frame })
    }

    /// Measures the baseline again, from the next frames.
    fn tare(&self) -> Outcome<()> {
        Ok(self.feed().pipeline.command(&Command::Tare)?)
    }

    /// The messages since the last call: what was masked, what came back.
    fn notices(&self) -> Vec<String> {
        self.feed().pipeline.take_notices().into_iter().map(|notice| notice.text).collect()
    }
}

#[doc = stub_doc!(Live)]
#[pyclass(frozen, module = "dermis")]
pub struct Live {
    skin: skin::Skin,
    source: String,
    threads: Threads,
    mailbox: Arc<Mailbox<Event>>,
    /// Whether frames that have waited for the caller are given too.
    keeps_all: bool,
    notices: Notices,
}

/// Messages that wait for `notices`: the newest.
#[derive(Default)]
pub struct Notices(Mutex<VecDeque<String>>);

impl Notices {
    /// Another message.
    pub fn add(&self, text: String) {
        let mut notices = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        notices.push_back(text);
        let excess = notices.len().saturating_sub(MAX_NOTICES);
        notices.drain(..excess);
    }

    /// The messages since the last call.
    pub fn take(&self) -> Vec<String> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).drain(..).collect()
    }
}

/// The threads of a live skin and of its simulated device, which end with it.
struct Threads {
    live: Mutex<Option<dermis_live::Live>>,
    emulator: Option<Arc<Emulator>>,
    /// The process that has them: a forked child has none.
    process: u32,
}

impl Threads {
    fn live(&self) -> MutexGuard<'_, Option<dermis_live::Live>> {
        self.live.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn are_here(&self) -> bool {
        self.process == std::process::id()
    }

    fn end(&self) {
        if self.are_here() {
            let live = self.live().take();
            live.map(dermis_live::Live::stop);
            self.emulator.iter().for_each(|emulator| emulator.stop());
        }
    }
}

impl Drop for Threads {
    fn drop(&mut self) {
        self.end();
        if !self.are_here() {
            // Threads that do not exist here cannot be joined.
            std::mem::forget(self.live.get_mut().unwrap_or_else(PoisonError::into_inner).take());
        }
    }
}

/// Notices that wait for `Live.notices`.
const MAX_NOTICES: usize = 1000;

#[pymethods]
impl Live {
    #[new]
    #[pyo3(signature = (skin, source="emulate", method=None, *, threshold=1.0, both_signs=false, twin="lab", seed=1,
        touch="none", speed=1.0, all_frames=false))]
    #[expect(clippy::too_many_arguments, reason = "keyword arguments of Python")]
    fn new(
        py: Python<'_>,
        skin: &Bound<'_, Skin>,
        source: &str,
        method: Option<&Bound<'_, PyAny>>,
        threshold: f64,
        both_signs: bool,
        twin: &str,
        seed: u64,
        touch: &str,
        speed: f64,
        all_frames: bool,
    ) -> Outcome<Self> {
        let method = method_name(py, method)?;
        let methods = methods(py, skin.get(), method.as_deref())?;
        let skin = skin.get().skin().clone();
        let threads = worker::run(py, "connecting", 1, |_| {
            let mut threads = Threads { live: Mutex::default(), emulator: None, process: std::process::id() };
            if let Some(path) = source.strip_prefix("replay:") {
                let player = Player::open(path.as_ref(), &methods, speed)?;
                *threads.live() = Some(dermis_live::Live::play(methods, player)?);
                return Ok(threads);
            }
            let address = match source {
                "emulate" => {
                    threads.emulator.insert(emulator(skin.design(), twin, seed, touch, speed)?).serve_locally()?
                }
                source => Address::parse(source)?,
            };
            let method = method.unwrap_or_default();
            let is_noise_free = || TwinOptions::load(twin).is_ok_and(|twin| twin.electronics.snr_db.is_none());
            let force_tare = Calibration::is_named(&method) || source == "emulate" && is_noise_free();
            let settings = Settings { method, threshold, both_signs, force_tare, ..Settings::default() };
            *threads.live() = Some(dermis_live::Live::start(methods, LiveOptions::new(address, settings))?);
            Ok(threads)
        })?;
        let mailbox = {
            let live = threads.live();
            let live = live.as_ref().ok_or_else(|| Failure::given("the skin is not read"))?;
            let mailbox = live.shared().subscribe_as("python", QUEUE);
            live.begin();
            mailbox
        };
        let keeps_all = all_frames || source.starts_with("replay:");
        Ok(Live { skin, source: source.into(), threads, mailbox, keeps_all, notices: Notices::default() })
    }

    fn __iter__(slf: PyRef<'_, Self>) -> PyRef<'_, Self> {
        slf
    }

    fn __next__(&self, py: Python<'_>) -> Outcome<Option<Frame>> {
        if !self.threads.are_here() {
            return Err(Failure::with_hint("this live skin is read by another process", "open one in this process"));
        }
        // Of frames that have waited for the caller only the newest is of now.
        let mut late: Option<Arc<LiveFrame>> = None;
        let given = |frame: Arc<LiveFrame>| Ok(Some(Frame { skin: self.skin.clone(), frame: frame.result.clone() }));
        loop {
            py.check_signals()?;
            let patience = if late.is_some() { Duration::ZERO } else { LOOK };
            match py.detach(|| self.mailbox.take(patience)) {
                Popped::Item(Event::Frame(frame) | Event::Stale(frame)) => {
                    let waited_s = clock::now().seconds_since(frame.output_at);
                    if self.keeps_all || waited_s <= LOOK.as_secs_f64() {
                        return given(frame);
                    }
                    late = Some(frame);
                }
                Popped::TimedOut | Popped::Closed if late.is_some() => return late.map_or(Ok(None), given),
                Popped::Item(Event::Notice(Notice { text, .. })) => self.notices.add(text),
                Popped::Item(Event::Lost(why)) => self.notices.add(why),
                Popped::Item(_) | Popped::TimedOut => {}
                Popped::Closed => {
                    let live = self.threads.live();
                    let failure = live.as_ref().and_then(dermis_live::Live::take_failure);
                    return failure.map_or(Ok(None), |failure| Err(failure.into()));
                }
            }
        }
    }

    /// Measures the baseline again.
    fn tare(&self) {
        let live = self.threads.live();
        live.iter().for_each(|live| live.shared().command(Command::Tare));
    }

    /// The messages since the last call: faults, parts that came back, a lost device.
    fn notices(&self) -> Vec<String> {
        self.notices.take()
    }

    /// Stops reading.
    fn stop(&self, py: Python<'_>) {
        py.detach(|| self.threads.end());
    }

    fn __enter__(slf: PyRef<'_, Self>) -> PyRef<'_, Self> {
        slf
    }

    #[pyo3(signature = (*_exception))]
    fn __exit__(&self, py: Python<'_>, _exception: &Bound<'_, pyo3::types::PyTuple>) {
        self.stop(py);
    }

    fn __repr__(&self) -> String {
        format!("<dermis.Live {:?} from {:?}>", self.skin.design().name, self.source)
    }
}

impl Drop for Live {
    fn drop(&mut self) {
        // Other threads of the interpreter go on while those of the skin end.
        Python::attach(|py| py.detach(|| self.threads.end()));
    }
}

/// A simulated device.
pub fn emulator(design: &SkinDesign, twin: &str, seed: u64, touch: &str, speed: f64) -> Outcome<Arc<Emulator>> {
    let twin = TwinOptions::load(twin)?;
    let script = Script::load(touch, design, &twin, seed)?;
    let options = EmulatorOptions { script, twin, seed, faults: Vec::new(), speed, prerendered: 0, unpaced: false };
    Ok(Emulator::new(design, options)?)
}

#[doc = stub_doc!(Replay)]
#[pyclass(frozen, module = "dermis")]
pub struct Replay {
    replay: Mutex<recording::Replay>,
    skin: skin::Skin,
    path: PathBuf,
}

#[pymethods]
impl Replay {
    #[new]
    #[pyo3(signature = (path, *, method=None))]
    fn new(py: Python<'_>, path: PathBuf, method: Option<&Bound<'_, PyAny>>) -> Outcome<Self> {
        let method = method_name(py, method)?;
        let replay = worker::run(py, "opening the recording", 1, |_| {
            Ok(recording::Replay::open(&path, &dermis_learn::methods(), method.as_deref())?)
        })?;
        let skin = replay.skin().clone();
        Ok(Replay { replay: Mutex::new(replay), skin, path })
    }

    /// The skin of the recording.
    #[getter]
    fn skin(&self) -> Skin {
        Skin::prepared(self.skin.clone(), "design.toml")
    }

    fn __iter__(slf: PyRef<'_, Self>) -> PyRef<'_, Self> {
        slf
    }

    fn __next__(&self, py: Python<'_>) -> Outcome<Option<Frame>> {
        py.check_signals()?;
        let frame = worker::run_short(py, || {
            let mut replay = self.replay.lock().unwrap_or_else(PoisonError::into_inner);
            loop {
                match replay.step()? {
                    None => return Ok::<_, Failure>(None),
                    Some(Replayed::Frame(frame)) => return Ok(Some(frame.result)),
                    Some(Replayed::Command(_)) => {}
                }
            }
        })?;
        Ok(frame.map(|frame| Frame { skin: self.skin.clone(), frame }))
    }

    fn __repr__(&self) -> String {
        format!("<dermis.Replay {} of {:?}>", self.path.display(), self.skin.design().name)
    }
}
