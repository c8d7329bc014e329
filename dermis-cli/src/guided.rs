//! A guided calibration session: where to press next, the presses taken, and the calibration as it gets better.

use crate::console::{Progress, StatusLine, interrupted, print, print_json, warn, warn_of};
use crate::failure::{Failure, Outcome};
use crate::fitted;
use crate::range::count;
use crate::skin;
use crate::source::{PageArguments, SourceArguments};
use clap::Args;
use dermis::frame::{Differences, read_places};
use dermis::geom::{Point3, Surface};
use dermis::pipeline::{Severity, Timestamp};
use dermis::skin::Skin;
use dermis::text::counted;
use dermis_calibrate::checks::check_labels;
use dermis_calibrate::{CalibrateError, Correction, Fitted, LabelFrame, MIN_LABELS, Places, Quality, Session};
use dermis_emulate::emulator::Emulator;
use dermis_live::guide::{Guide, GuideAction, GuideStep, PressCollector, PressEvent};
use dermis_live::recording::RecordingLimits;
use dermis_live::{Event, Live, Popped};
use serde_json::json;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::thread::JoinHandle;
use std::time::Duration;

/// Presses of a session without a file of places.
const USUAL_PRESSES: usize = 50;
/// A calibration is computed again after this many presses.
const FIT_EVERY: usize = 4;
/// Events that can wait.
const WAITING: usize = 1 << 12;
/// The page shows the end of the session for this time before its server ends.
const SHOWN: Duration = Duration::from_secs(1);

/// The arguments of a guided session.
#[derive(Debug, Args)]
#[command(next_help_heading = "Guided session")]
pub struct GuidedArguments {
    /// Calibrate a live skin in a guided session: the page and the terminal show where to press. Keys, each followed by
    /// Enter: s skips the place, r repeats the last press, q ends the session. The same command continues it.
    #[arg(long, conflicts_with_all = ["frames", "baseline", "currents", "baseline_currents", "truth", "labels", "unlabelled", "method"])]
    pub live: bool,
    /// Number of presses, evenly spread over the skin [default: 50]
    #[arg(long, value_name = "N", conflicts_with = "places", value_parser = count(1..=1_000_000usize))]
    presses: Option<usize>,
    /// Places to press instead, in their order: rows as of --truth on the skin.
    #[arg(long, value_name = "FILE")]
    places: Option<PathBuf>,
    #[command(flatten)]
    source: SourceArguments,
    #[command(flatten)]
    page: PageArguments,
}

impl GuidedArguments {
    /// Refuses options of a session where there is none.
    pub fn check_unused(&self) -> Outcome {
        if self.presses.is_some() || self.places.is_some() {
            let fix = Some("give --live, or leave them out");
            return Err(Failure::given("--presses and --places belong to a guided session", fix));
        }
        Ok(())
    }

    /// Runs the session until all places are pressed or it is stopped.
    pub fn run(&self, design: &str, folder: &Path, difference: bool, json: bool) -> Outcome {
        if self.source.recording().is_some() {
            return Err(Failure::given("a recording cannot be pressed", Some("give the device with --source")));
        }
        let skin = skin::load(design)?;
        let session = Session::open(&skin, folder, self.places(&skin)?)?;
        let (live, emulator) = self.source.start(&skin, difference)?;
        let guide = Arc::new(Guide::default());
        let control =
            self.source.control(&live, emulator.clone(), RecordingLimits::default())?.with_guide(Arc::clone(&guide));
        let server = self.page.serve(&Arc::new(control))?;
        if !self.source.is_stdin() {
            read_keys(&guide);
        }
        let mut guided = Guided::new(session, guide);
        let ended = guided.watch(&live, emulator.as_deref()).and_then(|()| guided.finish());
        if server.is_some() {
            std::thread::sleep(SHOWN);
        }
        let failure = live.take_failure();
        live.stop();
        emulator.into_iter().for_each(|emulator| emulator.stop());
        server.into_iter().for_each(|server| server.stop());
        ended?;
        guided.show(folder, json)?;
        failure.map_or(Ok(()), |failure| Err(failure.into()))
    }

    fn places(&self, skin: &Skin) -> Outcome<Places> {
        let Some(path) = &self.places else {
            let (count, most) = (self.presses.unwrap_or(USUAL_PRESSES), skin.pixels().len());
            if !(1..=most).contains(&count) {
                let message = format!("{count} presses are not possible: the image of the skin has {most} pixels");
                return Err(Failure::given(message, Some("give a number from 1 on, or the places with --places")));
            }
            return Ok(Places::spread(skin, count));
        };
        Ok(Places::given(skin, read_places(path, &skin.place_limits())?))
    }
}

/// Takes the keys of the terminal, a line each.
fn read_keys(guide: &Arc<Guide>) {
    let guide = Arc::clone(guide);
    let read = move || {
        for line in std::io::stdin().lines().map_while(Result::ok) {
            match line.trim() {
                "s" => guide.request(GuideAction::Skip),
                "r" => guide.request(GuideAction::Redo),
                "q" => guide.request(GuideAction::Finish),
                _ => {}
            }
        }
    };
    // Without the thread the page has the same buttons.
    let _ = std::thread::Builder::new().name("dermis-keys".into()).spawn(read);
}

/// A calibration that is being computed, and the revision of its presses.
struct Fitting {
    revision: usize,
    presses: usize,
    thread: JoinHandle<Result<Quality, CalibrateError>>,
}

/// A session in progress.
struct Guided {
    session: Session,
    guide: Arc<Guide>,
    collector: PressCollector,
    step: GuideStep,
    note: String,
    fitting: Option<Fitting>,
    /// Presses of the last calibration that was begun.
    fitted: usize,
    errors: Vec<(usize, f64)>,
    /// Number of changes of the presses.
    revision: usize,
    /// The calibration in the folder, and the revision of its presses.
    quality: Option<(usize, Quality)>,
    line: StatusLine,
    surface: Surface,
    coverage: f64,
    /// Time of the last frame.
    now: Timestamp,
}

impl Guided {
    fn new(session: Session, guide: Arc<Guide>) -> Self {
        let surface = session.skin().design().body.surface();
        Guided {
            coverage: session.coverage(),
            now: Timestamp::default(),
            session,
            guide,
            surface,
            collector: PressCollector::default(),
            step: GuideStep::Wait,
            note: String::new(),
            fitting: None,
            fitted: 0,
            errors: Vec::new(),
            revision: 0,
            quality: None,
            line: StatusLine::new(),
        }
    }

    /// Takes presses until all places are pressed, the input ends or a person ends the session.
    fn watch(&mut self, live: &Live, emulator: Option<&Emulator>) -> Outcome {
        let ended = interrupted()?;
        let mailbox = live.shared().subscribe(WAITING);
        live.begin();
        self.line.print("leave the skin untouched: the baseline is measured");
        while !ended.load(Ordering::Relaxed) && self.session.place().is_some() {
            match mailbox.take(Duration::from_millis(100)) {
                Popped::Item(Event::Frame(frame)) => {
                    self.now = frame.result.measured_at;
                    if self.step == GuideStep::Wait {
                        live.shared().request_state();
                    }
                    if let Some(event) = self.collector.take(&frame.result) {
                        self.react(event, live)?;
                    }
                }
                Popped::Item(Event::State(state)) if self.step == GuideStep::Wait => {
                    if state.baseline_ohm().is_some() {
                        self.ask();
                    }
                }
                Popped::Item(Event::State(state)) => self.collector.set_baseline(&state),
                Popped::Item(Event::Notice(notice)) => self.line.notice(notice.level, &notice.text),
                Popped::Item(Event::Lost(why)) => self.line.notice(Severity::Error, &why),
                Popped::Item(_) | Popped::TimedOut => {}
                Popped::Closed => break,
            }
            if emulator.is_some_and(Emulator::has_failed) {
                return Err(Failure::Ours("the emulated device has failed (see above)".into()));
            }
            if self.obey()? {
                break;
            }
            self.fit();
            self.publish();
        }
        Ok(())
    }

    /// Asks for the next press.
    fn ask(&mut self) {
        self.step = GuideStep::Press;
        if let Some(place) = self.session.place() {
            let (number, planned) = (self.session.taken() + 1, self.session.taken() + self.session.left());
            self.line
                .print(&format!("{number} of {planned}: press with about 2 N at {}", place_text(&self.surface, place)));
        }
    }

    fn react(&mut self, event: PressEvent, live: &Live) -> Outcome {
        let asks = matches!(self.step, GuideStep::Press | GuideStep::Hold);
        match event {
            PressEvent::Began if asks => {
                live.shared().request_state();
                self.step = GuideStep::Hold;
            }
            PressEvent::TooShort if asks => {
                self.note = "too short: hold the press until it is taken".into();
                self.line.print(&self.note);
                self.step = GuideStep::Lift;
            }
            PressEvent::Steady(difference) if asks => {
                self.session.take(difference)?;
                self.revision += 1;
                self.coverage = self.session.coverage();
                self.note.clear();
                self.step = GuideStep::Lift;
                self.line.print(&format!("taken; lift the finger ({})", self.progress()));
            }
            PressEvent::Left if self.step != GuideStep::Wait => self.ask(),
            _ => {}
        }
        Ok(())
    }

    /// Carries out what a person wants; whether the session is to end.
    fn obey(&mut self) -> Outcome<bool> {
        while let Some(action) = self.guide.take_request() {
            match action {
                GuideAction::Finish => return Ok(true),
                GuideAction::Skip => {
                    self.session.skip();
                    self.note = "skipped".into();
                }
                GuideAction::Redo if self.session.redo()? => {
                    self.note = "the last press is discarded: repeat it".into();
                    self.revision += 1;
                    self.fitted = self.fitted.min(self.session.taken());
                    self.coverage = self.session.coverage();
                }
                GuideAction::Redo => self.note = "there is no press of this session to repeat".into(),
            }
            self.line.print(&self.note);
            match self.step {
                GuideStep::Press => self.ask(),
                GuideStep::Hold => {
                    self.collector.restart(self.now);
                    self.step = GuideStep::Lift;
                }
                _ => {}
            }
        }
        Ok(false)
    }

    /// Takes the calibration that is ready, and begins the next one on a thread of its own.
    fn fit(&mut self) {
        if let Some(fitting) = self.fitting.take_if(|fitting| fitting.thread.is_finished()) {
            self.take_fit(fitting);
        }
        if self.fitting.is_none() && self.session.taken() >= self.fitted + FIT_EVERY {
            self.begin_fit();
        }
    }

    fn begin_fit(&mut self) {
        let Some(fit) = self.session.fit() else { return };
        self.fitted = fit.presses();
        // The pipeline keeps a core for itself.
        let cores = std::thread::available_parallelism().map_or(1, |cores| cores.get().saturating_sub(1).max(1));
        let run = move || match rayon::ThreadPoolBuilder::new().num_threads(cores).build() {
            Ok(pool) => pool.install(|| fit.run()),
            Err(_) => fit.run(),
        };
        let thread = std::thread::Builder::new().name("dermis-fit".into()).spawn(run);
        self.fitting = thread.ok().map(|thread| Fitting { revision: self.revision, presses: self.fitted, thread });
    }

    fn take_fit(&mut self, Fitting { revision, presses, thread }: Fitting) {
        match thread.join() {
            Ok(Ok(quality)) => {
                self.errors.push((presses, quality.mean_error_m));
                self.quality = Some((revision, quality));
                self.line.print(&format!(
                    "calibrated with {presses} presses: mean error {:.2} mm",
                    1e3 * quality.mean_error_m
                ));
            }
            Ok(Err(error)) => {
                self.note = error.to_string();
                self.line.notice(Severity::Warning, &self.note);
            }
            // A thread that panicked has printed its message already.
            Err(_) => {}
        }
    }

    /// Computes the calibration of all presses.
    fn finish(&mut self) -> Outcome {
        self.step = GuideStep::Fit;
        self.publish();
        let waiting = Progress::waiting("calibrating with all presses");
        if let Some(fitting) = self.fitting.take() {
            self.take_fit(fitting);
        }
        if self.quality.is_none_or(|(revision, _)| revision != self.revision) {
            self.begin_fit();
        }
        if let Some(fitting) = self.fitting.take() {
            self.take_fit(fitting);
        }
        drop(waiting);
        self.step = GuideStep::Finished;
        self.publish();
        Ok(())
    }

    /// The state for pages, and the line of the terminal.
    fn publish(&mut self) {
        let asks = matches!(self.step, GuideStep::Press | GuideStep::Hold);
        self.guide.change(|status| {
            status.step = self.step;
            status.position_m = if asks { self.session.place() } else { None };
            status.taken = self.session.taken();
            status.planned = self.session.taken() + self.session.left();
            status.coverage = self.coverage;
            status.reach_m = self.session.reach_m();
            status.errors.clone_from(&self.errors);
            status.fitting = self.fitting.is_some();
            status.note.clone_from(&self.note);
        });
        self.line.show(&self.progress());
    }

    fn progress(&self) -> String {
        let error = self.errors.last().map(|(_, error_m)| format!(", mean error {:.2} mm", 1e3 * error_m));
        let (taken, planned) = (self.session.taken(), self.session.taken() + self.session.left());
        format!(
            "{taken} of {}, {:.0} % of the skin covered{}",
            counted(planned, "press"),
            1e2 * self.coverage,
            error.unwrap_or_default()
        )
    }

    /// Replaces the forward map in the folder by the correction of the skin's default method, where that is better.
    fn save_better_correction(&self, folder: &Path, map: Option<&Quality>) -> Outcome<Option<Correction>> {
        let Some(map) = map else { return Ok(None) };
        let (frames, labels) = self.session.presses();
        let differences = Differences { frames: frames.to_vec(), ..Differences::default() };
        let (correction, alternatives) =
            Fitted::better_correction(&dermis_learn::methods(), self.session.skin(), &differences, &labels, map)?;
        let reason = match &correction {
            Some(correction) => {
                correction.save(folder, self.session.skin().design())?;
                alternatives.reason(&Fitted::Correction(Box::new(correction.clone())))
            }
            None => alternatives.reason_of_map(map),
        };
        if let Some(reason) = reason {
            warn(&format!("{reason}: take more presses; the same command continues the session"));
        }
        Ok(correction)
    }

    /// Prints the result.
    fn show(&self, folder: &Path, as_json: bool) -> Outcome {
        let quality = self.quality.filter(|(revision, _)| *revision == self.revision).map(|(_, quality)| quality);
        let correction = self.save_better_correction(folder, quality.as_ref())?;
        let (frames, labels) = self.session.presses();
        let doubts = match labels.len() < MIN_LABELS {
            true => Vec::new(),
            false => check_labels(self.session.skin(), frames, &labels, LabelFrame::Skin)?,
        };
        for doubt in doubts {
            warn_of(&doubt);
        }
        if as_json {
            let method = correction.as_ref().map_or(Fitted::FORWARD_MAP, Correction::method);
            let quality = correction.as_ref().map_or_else(|| json!(quality), |correction| json!(correction.quality()));
            return print_json(&json!({
                "skin": self.session.skin().design().name,
                "presses": self.session.taken(),
                "left": self.session.left(),
                "coverage": self.coverage,
                "method": method,
                "quality": quality,
            }));
        }
        if let Some(correction) = correction {
            print(&format!("{}\n", fitted::summary(&Fitted::Correction(Box::new(correction)), &[], None).to_text()))?;
        }
        let path = folder.display();
        match quality {
            Some(_) => print(&format!("{}\nwritten to {path}\n", self.progress())),
            None => print(&format!(
                "{}\n{path} holds no calibration of these presses: at least {MIN_LABELS} are needed; the same command \
                 continues the session\n",
                self.progress()
            )),
        }
    }
}

/// A place as text, mm and degrees.
fn place_text(surface: &Surface, place: Point3) -> String {
    let [x, y, z] = place.map(|value| 1e3 * value);
    match (surface, surface.theta_rad(place)) {
        (Surface::Cylinder { .. }, Some(theta_rad)) => {
            format!("z {z:.1} mm, theta {:.0} degrees", theta_rad.to_degrees())
        }
        (Surface::Plane, _) => format!("x {x:.1} mm, y {y:.1} mm"),
        _ => format!("x {x:.1} mm, y {y:.1} mm, z {z:.1} mm"),
    }
}
