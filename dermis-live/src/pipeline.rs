//! From the values of a frame to contacts: what happens to each frame, one after another, on one thread.
//!
//! A pipeline is a function of the frames and commands that it is given, and of nothing else: the same ones in the same order
//! give the same contacts to the last bit, which is what a replay rests on.

use crate::LiveError;
use crate::baseline::{Baseline, Touch};
use crate::drift::Fitter;
use crate::health::{Change, ElectrodeMonitor, ElectrodeTopology, Untouched, masked};
use crate::meter::Measures;
use crate::rebuild::{Rebuilding, Rebuilt, noise_of};
use crate::report::{Counts, ElectrodeState, Health, LiveContact, LiveFrame, Notice, Severity};
use crate::settings::{Command, Settings};
use crate::skin::{LiveSkin, NamedMethod};
use crate::state::{Phase, Reading, State};
use crate::timestamp::Timestamp;
use crate::touch_detector::{TouchDetector, statistic};
use crate::untouched::{Statistics, difference};
use dermis::contact::Contact;
use dermis::detect::{Circumstances, Detector, Forces, ImageNoise};
use dermis::geom::Point3;
use dermis::image::Image;
use dermis::track::{Sighting, TrackOptions, Tracked, Tracker};
use std::sync::Arc;

/// One frame as it came in.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Incoming {
    /// Its number, not wrapping round.
    pub sequence: u64,
    /// When it was taken.
    pub measured_at: Timestamp,
    /// When its last byte came.
    pub received_at: Timestamp,
    /// What its readings say.
    pub measures: Measures,
    /// The message as the device sent it.
    pub message: Vec<u8>,
    /// Frames and packets so far.
    pub counts: Counts,
    /// Frames a second now.
    pub rate_hz: f64,
}

/// Makes contacts from frames.
#[derive(Debug)]
pub struct Pipeline {
    skin: Arc<LiveSkin>,
    fitter: Fitter,
    topology: ElectrodeTopology,
    state: State,
    method: NamedMethod,
    /// Channels that are left out now.
    masked: Vec<bool>,
    detector: Detector,
    /// The noise of untouched images.
    noise: Option<ImageNoise>,
    /// The method's own threshold, and what it knows of forces.
    noise_factor: f64,
    forces: Option<Forces>,
    image: Image,
    health: Arc<Health>,
    notices: Vec<Notice>,
}

/// A signal that lets a contact go on but none begin.
const NOT_TO_BEGIN: f64 = 0.99;
/// What happened between frames that lie farther apart than this is not known, s: a device that was away, a program that was.
const GAP_S: f64 = 2.0;
/// Reciprocal channels that differ by so many times their noise are not those of the skin.
const FOREIGN: f64 = 30.0;
/// Frames from one look at the health to the next.
const HEALTH_FRAMES: u64 = 12;

impl Pipeline {
    /// A pipeline that begins with a tare.
    ///
    /// # Errors
    /// A method that there is not, settings out of their ranges.
    pub fn new(skin: Arc<LiveSkin>, settings: Settings) -> Result<Self, LiveError> {
        let phase = Phase::Taring { frames: Vec::new() };
        let options = TrackOptions::for_skin(&skin.pixels, skin.design.electrodes.len());
        let tracker = Tracker::on(&skin.pixels, options);
        let state = State { settings, phase, begun: None, last: None, frames: 0, made_without: Vec::new(), tracker };
        Self::resume(skin, state)
    }

    /// A pipeline that goes on where another one was.
    ///
    /// # Errors
    /// A method that there is not, settings out of their ranges, a state of another skin.
    pub fn resume(skin: Arc<LiveSkin>, state: State) -> Result<Self, LiveError> {
        state.settings.check(&skin.pixels)?;
        let channel_count = skin.design.protocol.channel_count();
        let (fitter, topology) = (Fitter::new(Arc::clone(&skin)), ElectrodeTopology::of(&skin));
        state.check(&topology, fitter.drifts().modes.rows)?;
        let method = skin.without(&skin.by_name(&state.settings.method)?.name, &state.made_without)?;
        let mut pipeline = Pipeline {
            fitter,
            topology,
            masked: vec![false; channel_count],
            detector: Detector::default(),
            noise: None,
            noise_factor: 0.0,
            forces: None,
            image: Image { space: Arc::clone(&skin.pixels), values: vec![0.0; skin.pixels.len()] },
            health: Arc::default(),
            notices: Vec::new(),
            method,
            skin,
            state,
        };
        if let Phase::Reading(reading) = &pipeline.state.phase {
            pipeline.masked = masked(&pipeline.topology, reading.watch.bad());
        }
        pipeline.measure_noise()?;
        Ok(pipeline)
    }

    /// All that it remembers.
    pub fn state(&self) -> &State {
        &self.state
    }

    /// The skin.
    pub fn skin(&self) -> &Arc<LiveSkin> {
        &self.skin
    }

    /// The method in use.
    pub fn method(&self) -> &NamedMethod {
        &self.method
    }

    /// Whether the untouched frame is still being taken.
    pub fn is_taring(&self) -> bool {
        matches!(self.state.phase, Phase::Taring { .. })
    }

    /// What has been noticed since this was last asked.
    pub fn take_notices(&mut self) -> Vec<Notice> {
        std::mem::take(&mut self.notices)
    }

    /// Whether the method would do better if it were [made anew](Command::Rebuild) without the channels that are left out.
    pub fn wants_rebuild(&self) -> bool {
        self.state.made_without != self.left_out()
    }

    /// The channels that are left out now.
    pub fn left_out(&self) -> Vec<usize> {
        numbers(&self.masked)
    }

    /// The method without the channels that are left out now, for [`install`](Self::install): what
    /// [`Command::Rebuild`] does, in two parts so that the first may be done beside the frames.
    pub fn rebuilding(&self) -> Rebuilding {
        let (skin, name) = (Arc::clone(&self.skin), self.method.name.clone());
        Rebuilding { skin, name, without: self.left_out(), untouched: self.state.phase.untouched().to_vec() }
    }

    /// Uses a method that was made anew, if it is still the one that is wanted; whether it is.
    pub fn install(&mut self, rebuilt: Rebuilt) -> bool {
        let wanted = rebuilt.without == self.left_out() && rebuilt.method.name == self.method.name;
        if wanted {
            self.method = rebuilt.method;
            self.state.made_without = rebuilt.without;
            self.noise = rebuilt.noise;
            self.prepare();
        }
        wanted
    }

    /// Does what it is told.
    ///
    /// # Errors
    /// A method that there is not, a threshold out of its range.
    pub fn command(&mut self, command: &Command) -> Result<(), LiveError> {
        match command {
            Command::Tare => {
                self.state.phase = Phase::Taring { frames: Vec::new() };
                self.state.tracker.clear();
            }
            Command::Threshold { value } => self.set(Settings { threshold: *value, ..self.state.settings.clone() })?,
            Command::Zones { zones } => self.set(Settings { zones: zones.clone(), ..self.state.settings.clone() })?,
            Command::Method { name } => {
                self.method = self.skin.by_name(name)?.clone();
                self.state.made_without.clear();
                self.state.settings.method.clone_from(name);
                self.measure_noise()?;
            }
            Command::Rebuild => drop(self.install(self.rebuilding().run()?)),
        }
        Ok(())
    }

    fn set(&mut self, settings: Settings) -> Result<(), LiveError> {
        settings.check(&self.skin.pixels)?;
        self.state.settings = settings;
        self.prepare();
        Ok(())
    }

    /// Prepares the detector for the method, the thresholds and the noise.
    fn prepare(&mut self) {
        let mut options = self.method.method.detection();
        (self.noise_factor, self.forces) = (options.noise_factor, options.forces);
        options.noise_factor *= self.state.settings.least() * TrackOptions::default().release_fraction;
        let detector = Detector::new(options);
        self.detector = match &self.noise {
            Some(noise) => detector.with_noise(noise.clone()),
            None => detector,
        };
    }

    /// Measures the noise of the method's images anew: slow, as it makes an image of every frame of the tare.
    fn measure_noise(&mut self) -> Result<(), LiveError> {
        self.noise = noise_of(&self.method, self.state.phase.untouched(), &self.state.made_without)?;
        self.prepare();
        Ok(())
    }

    /// What a frame says.
    ///
    /// # Errors
    /// A method that fails, which is our fault.
    pub fn process(&mut self, incoming: Incoming) -> Result<LiveFrame, LiveError> {
        let begun = *self.state.begun.get_or_insert(incoming.measured_at);
        let time_s = incoming.measured_at.seconds_since(begun);
        let mut step_s = self.state.last.map_or(0.0, |last| incoming.measured_at.seconds_since(last).max(0.0));
        self.state.last = Some(incoming.measured_at);
        if step_s > GAP_S {
            self.state.after_gap(&incoming.measures);
            step_s = 0.0;
        }
        self.state.frames += 1;
        let (touched, contacts) = match &mut self.state.phase {
            Phase::Taring { frames } => {
                frames.push(incoming.measures.clone());
                if frames.len() >= self.state.settings.tare_frames {
                    self.tared(incoming.measured_at)?;
                }
                self.image.values.fill(0.0);
                (false, Vec::new())
            }
            Phase::Reading(_) => self.read(&incoming.measures, time_s, step_s, incoming.measured_at)?,
        };
        self.look_at_health(&incoming);
        Ok(LiveFrame {
            sequence: incoming.sequence,
            measured_at: incoming.measured_at,
            received_at: incoming.received_at,
            output_at: Timestamp::now(),
            message: incoming.message,
            values_ohm: incoming.measures.values_ohm,
            image: self.image.values.iter().map(|&value| value as f32).collect(),
            touched,
            contacts,
            health: Arc::clone(&self.health),
        })
    }

    /// The tare is done.
    fn tared(&mut self, at: Timestamp) -> Result<(), LiveError> {
        let Phase::Taring { frames } = &mut self.state.phase else { return Ok(()) };
        let frames = std::mem::take(frames);
        let values: Vec<&[f64]> = frames.iter().map(|frame| frame.values_ohm.as_slice()).collect();
        let statistics = Statistics::of(values.iter().copied());
        let watch = ElectrodeMonitor::new(&self.topology, &frames, &statistics);
        self.masked = masked(&self.topology, watch.bad());
        self.state.phase = Phase::Reading(Box::new(Reading {
            untouched: values.iter().map(|values| difference(values, &statistics.mean)).collect(),
            alarm: TouchDetector::of(&values, &self.masked),
            baseline: Baseline::new(statistics.mean),
            watch,
            quiet_since_s: None,
            puzzled_since_s: None,
        }));
        self.notices.push(Notice { level: Severity::Info, text: format!("tared on {} frames", frames.len()), at });
        self.warn_of_the_tare(at);
        self.measure_noise()
    }

    /// Tells of what a tare found wrong.
    fn warn_of_the_tare(&mut self, at: Timestamp) {
        let Phase::Reading(reading) = &self.state.phase else { return };
        let mut warn = |text: String| self.notices.push(Notice { level: Severity::Warning, text, at });
        for electrode in reading.watch.bad() {
            warn(format!(
                "electrode {electrode} carries hardly any current: its readings are left out; see its wire and contact, then tare"
            ));
        }
        if let Some(times) = reading.watch.reciprocity(&self.topology).filter(|times| *times > FOREIGN) {
            warn(format!(
                "channels that should read the same differ by {times:.0} times their noise: wires in the wrong places, or a scan \
                 table of another skin"
            ));
        }
    }

    /// Contacts in a frame.
    fn read(
        &mut self,
        measures: &Measures,
        time_s: f64,
        step_s: f64,
        at: Timestamp,
    ) -> Result<(bool, Vec<LiveContact>), LiveError> {
        let Phase::Reading(reading) = &mut self.state.phase else { return Ok((false, Vec::new())) };
        let mut difference = difference(&measures.values_ohm, reading.baseline.values_ohm());
        let changes = reading.watch.contacts(&self.topology, measures, &difference);
        let deaf =
            masked(&self.topology, (0..self.skin.design.electrodes.len()).filter(|&e| reading.watch.is_suspect(e)));
        for ((value, masked), deaf) in difference.iter_mut().zip(&self.masked).zip(&deaf) {
            if *masked || *deaf {
                *value = 0.0;
            }
        }
        let noise_ohm = reading.watch.noise_ohm();
        let alarm = reading.alarm.take(statistic(&difference, noise_ohm, &deaf));
        self.method.method.reconstruct_into(&difference, &mut self.image.values)?;
        let (settings, forces) = (&self.state.settings, self.forces);
        let sightings = sightings(&self.detector, &self.image, self.noise_factor, settings, alarm);
        let tracked = self.state.tracker.update(&sightings, time_s).to_vec();
        let contacts: Vec<LiveContact> =
            tracked.iter().map(|tracked| live(tracked, &self.image, settings, forces, self.state.begun)).collect();
        let places: Vec<Point3> = tracked.iter().map(|tracked| tracked.contact.position_m).collect();
        let touch = Touch { frame_ohm: &measures.values_ohm, places: &places, time_s, step_s };
        let untouched = reading.follow(&self.skin.pixels.surface, &mut self.fitter, alarm, &deaf, touch);
        let about = Untouched { untouched, masked: &deaf, step_s };
        reading.watch.noise(&self.topology, measures, about);
        self.take_changes(&changes, at);
        Ok((alarm || !contacts.is_empty(), contacts))
    }

    /// Leaves the channels of bad electrodes out, takes those of mended ones in.
    fn take_changes(&mut self, changes: &[Change], at: Timestamp) {
        if changes.is_empty() {
            return;
        }
        let Phase::Reading(reading) = &self.state.phase else { return };
        self.masked = masked(&self.topology, reading.watch.bad());
        for Change { electrode, state } in changes {
            let (level, what) = match state {
                ElectrodeState::Loose => {
                    (Severity::Warning, "is loose: its readings are left out; press it on or glue it")
                }
                ElectrodeState::Open => {
                    (Severity::Warning, "carries no current: its readings are left out; see its wire")
                }
                ElectrodeState::Sound | ElectrodeState::Doubtful => (Severity::Info, "is sound again"),
            };
            self.notices.push(Notice { level, text: format!("electrode {electrode} {what}"), at });
        }
    }

    fn look_at_health(&mut self, incoming: &Incoming) {
        let named = !self.notices.is_empty();
        if self.state.frames % HEALTH_FRAMES != 1 && !named {
            return;
        }
        let mut health = Health {
            saturated_channels: incoming.measures.saturated.len(),
            masked_channels: self.masked.iter().filter(|masked| **masked).count(),
            rate_hz: incoming.rate_hz,
            counts: incoming.counts,
            ..Health::default()
        };
        if let Phase::Reading(reading) = &self.state.phase {
            health.electrodes = reading.watch.told(&self.topology);
            health.noise = Some(reading.watch.noise_ratio(&self.masked)).filter(|noise| noise.is_finite());
            health.reciprocity = reading.watch.reciprocity(&self.topology);
        }
        self.health = Arc::new(health);
    }
}

/// What an image shows, each with its signal over what it takes to begin where it lies. Where the voltages say that nothing
/// touches, a contact may go on but none begins.
fn sightings(detector: &Detector, image: &Image, noise_factor: f64, settings: &Settings, alarm: bool) -> Vec<Sighting> {
    let sighting = |(contact, under): (Contact, Circumstances)| {
        let needed = noise_factor * settings.threshold_at(contact.position_m);
        let signal = if needed > 0.0 { under.signal / needed } else { f64::INFINITY };
        // An image without noise has no signal over it.
        let signal = if signal.is_nan() { settings.least() } else { signal };
        Sighting { contact, signal: if alarm { signal } else { signal.min(NOT_TO_BEGIN) } }
    };
    detector.detect_under(image).into_iter().map(sighting).collect()
}

/// Which of a list are marked.
fn numbers(marked: &[bool]) -> Vec<usize> {
    (0..marked.len()).filter(|&index| marked[index]).collect()
}

/// A contact as sinks are told of it.
fn live(
    tracked: &Tracked,
    image: &Image,
    settings: &Settings,
    forces: Option<Forces>,
    begun: Option<Timestamp>,
) -> LiveContact {
    let contact = &tracked.contact;
    let [centroid_m, centre_of_pressure_m] =
        if tracked.seen { dermis::detect::centres(image, contact) } else { [contact.position_m; 2] };
    let known = |value: f64| Some(value).filter(|value| value.is_finite());
    let since = std::time::Duration::from_secs_f64(tracked.since_s.max(0.0));
    LiveContact {
        id: contact.id,
        position_m: contact.position_m,
        normal: contact.normal,
        centroid_m,
        centre_of_pressure_m,
        velocity_m_s: tracked.velocity_m_s,
        strength: contact.strength,
        area_m2: contact.area_m2,
        force_n: known(contact.force_n),
        force_sd_n: forces.map(|forces| forces.relative_sd * contact.force_n),
        sd_m: contact.sd_m,
        confidence: contact.confidence,
        seen: tracked.seen,
        since: begun.unwrap_or_default().after(since),
        zone: settings.zone_at(contact.position_m).map(|zone| zone.name.clone()),
    }
}
