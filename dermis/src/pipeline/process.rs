//! Processing of one frame in the pipeline.

use crate::contact::Contact;
use crate::detect::Circumstances;
use crate::geom::Point3;
use crate::pipeline::baseline::{Baseline, TouchedFrame};
use crate::pipeline::contact::TrackedContact;
use crate::pipeline::electrodes::{Change, ElectrodeMonitor, NoiseFrame};
use crate::pipeline::error::PipelineError;
use crate::pipeline::frame::{FrameInput, Measurement, PipelineFrame};
use crate::pipeline::health::{ElectrodeState, Health, Notice, Severity};
use crate::pipeline::novelty::NoveltyMonitor;
use crate::pipeline::settings::Settings;
use crate::pipeline::state::{Phase, Reading};
use crate::pipeline::statistics::{Statistics, difference};
use crate::pipeline::timestamp::Timestamp;
use crate::pipeline::touch_detector::{TouchDetector, statistic};
use crate::pipeline::{Pipeline, marked};
use crate::reconstruct::Reconstruct;
use crate::track::Sighting;
use std::sync::Arc;

/// Maximum signal of a sighting that cannot start a contact.
const NOT_TO_BEGIN: f64 = 0.99;
/// A longer interval between frames is a gap, s: nothing is known about it.
const GAP_S: f64 = 2.0;
/// Reciprocal channels that differ by more than this many times their noise do not match the design.
const FOREIGN: f64 = 30.0;
/// The health is computed once in this many frames.
const HEALTH_FRAMES: u64 = 12;

/// The time of a frame.
#[derive(Debug, Clone, Copy)]
struct FrameTime {
    at: Timestamp,
    /// Time since the first frame, s.
    time_s: f64,
    /// Time since the last frame, s; 0 after a gap.
    step_s: f64,
}

impl Pipeline {
    /// Processes the next frame.
    ///
    /// # Errors
    /// A frame of another size than the skin's, values that are not finite, a reconstruction that fails.
    pub fn process(&mut self, input: FrameInput) -> Result<PipelineFrame, PipelineError> {
        self.check(&input)?;
        let time = self.advance(&input);
        let (touched, contacts) = match &mut self.state.phase {
            Phase::Taring { frames } => {
                frames.push(input.measurement.clone());
                if frames.len() >= self.state.settings.tare_frames {
                    self.finish_tare(time.at)?;
                }
                self.image.values.fill(0.0);
                (false, Vec::new())
            }
            Phase::Reading(_) => self.read(&input.measurement, time)?,
        };
        self.update_health(&input);
        Ok(PipelineFrame {
            sequence: input.sequence,
            measured_at: input.measured_at,
            values_ohm: input.measurement.values_ohm,
            image: self.image.values.iter().map(|&value| value as f32).collect(),
            touched,
            contacts,
            health: Arc::clone(&self.health),
        })
    }

    fn check(&self, input: &FrameInput) -> Result<(), PipelineError> {
        let refused = |message: String| Err(PipelineError::Frame { sequence: input.sequence, message });
        let (measurement, topology) = (&input.measurement, &self.topology);
        let Measurement { values_ohm, loops_ohm, .. } = measurement;
        if !topology.fits(measurement) {
            return refused(format!(
                "{} values and {} loops, but the protocol has {} channels and {} drives: give a value for each channel in the \
                 order of the protocol, and a loop for each drive or none",
                values_ohm.len(),
                loops_ohm.len(),
                topology.channel_count(),
                topology.drive_count()
            ));
        }
        if let Some(channel) = values_ohm.iter().position(|value| !value.is_finite()) {
            return refused(format!("the value of channel {channel} is {}: it must be finite", values_ohm[channel]));
        }
        if let Some(drive) = loops_ohm.iter().position(|value| !value.is_finite()) {
            return refused(format!("the loop of drive {drive} is {} ohm: it must be finite", loops_ohm[drive]));
        }
        Ok(())
    }

    fn advance(&mut self, input: &FrameInput) -> FrameTime {
        let at = input.measured_at;
        let start = *self.state.start.get_or_insert(at);
        let time_s = at.seconds_since(start);
        let mut step_s = self.state.last.map_or(0.0, |last| at.seconds_since(last).max(0.0));
        self.state.last = Some(at);
        if step_s > GAP_S {
            self.state.after_gap(&input.measurement);
            step_s = 0.0;
        }
        self.state.frames += 1;
        FrameTime { at, time_s, step_s }
    }

    /// Ends the tare with the frames that it has.
    fn finish_tare(&mut self, at: Timestamp) -> Result<(), PipelineError> {
        let Phase::Taring { frames } = &mut self.state.phase else { return Ok(()) };
        let frames = std::mem::take(frames);
        let values: Vec<&[f64]> = frames.iter().map(|frame| frame.values_ohm.as_slice()).collect();
        let statistics = Statistics::of(values.iter().copied());
        let electrodes = ElectrodeMonitor::new(&self.topology, &frames, &statistics);
        self.masked = self.topology.channels_of(electrodes.bad());
        self.state.phase = Phase::Reading(Box::new(Reading {
            untouched: values.iter().map(|values| difference(values, &statistics.mean)).collect(),
            touch_detector: TouchDetector::of(&values, &self.masked),
            baseline: Baseline::new(statistics.mean),
            electrodes,
            novelty: NoveltyMonitor::default(),
            quiet_since_s: None,
            unexplained_since_s: None,
        }));
        self.notice(Severity::Info, format!("tared with {} frames", frames.len()), at);
        self.warn_after_tare(at);
        self.measure_noise()
    }

    fn notice(&mut self, level: Severity, text: String, at: Timestamp) {
        self.notices.push(Notice { level, text, at });
    }

    /// Reports the problems found by the tare.
    fn warn_after_tare(&mut self, at: Timestamp) {
        let Phase::Reading(reading) = &self.state.phase else { return };
        let mut warnings: Vec<String> = (reading.electrodes.bad())
            .map(|electrode| {
                format!(
                    "electrode {electrode} carries hardly any current and its channels are masked: check its wire and its \
                     contact, then tare again"
                )
            })
            .collect();
        if let Some(times) = reading.electrodes.reciprocity(&self.topology).filter(|times| *times > FOREIGN) {
            warnings.push(format!(
                "reciprocal channels differ by {times:.0} times their noise: check the order of the wires, and that the scan \
                 table is this skin's"
            ));
        }
        warnings.into_iter().for_each(|text| self.notice(Severity::Warning, text, at));
    }

    /// The contacts of a frame, and whether it is touched.
    fn read(
        &mut self,
        measurement: &Measurement,
        time: FrameTime,
    ) -> Result<(bool, Vec<TrackedContact>), PipelineError> {
        let Phase::Reading(reading) = &mut self.state.phase else { return Ok((false, Vec::new())) };
        let FrameTime { at, time_s, step_s } = time;
        let mut difference = difference(&measurement.values_ohm, reading.baseline.values_ohm());
        let changes = reading.electrodes.update_contacts(&self.topology, measurement, &difference);
        let suspect = self.topology.channels_of(reading.electrodes.suspect());
        mask(&mut difference, &self.masked);
        mask(&mut difference, &suspect);
        let felt = reading.touch_detector.update(statistic(&difference, reading.electrodes.noise_ohm(), &suspect));
        self.method.reconstruct().reconstruct_into(&difference, &mut self.image.values)?;
        let settings = &self.state.settings;
        let sightings = match self.method.reconstruct().contacts(&difference)? {
            Some(contacts) => sightings_of(contacts, felt),
            None => {
                let mut found = self.detector.detect_under(&self.image);
                correct(self.method.reconstruct(), &difference, &mut found);
                sightings(found, self.noise_factor, settings, felt)
            }
        };
        let tracked = self.state.tracker.update(&sightings, time_s);
        let start = self.state.start.unwrap_or_default();
        let contacts: Vec<TrackedContact> = tracked
            .iter()
            .map(|tracked| TrackedContact::new(tracked, &self.image, settings, self.forces, start))
            .collect();
        let positions_m: Vec<Point3> = tracked.iter().map(|tracked| tracked.contact.position_m).collect();
        let frame = TouchedFrame { values_ohm: &measurement.values_ohm, positions_m: &positions_m, time_s, step_s };
        let surface = &self.methods.skin().pixels().surface;
        let untouched = reading.update_baseline(surface, &mut self.fitter, felt, &suspect, frame)?;
        let about = NoiseFrame { untouched, masked: &suspect, step_s };
        reading.electrodes.update_noise(&self.topology, measurement, about);
        let touched = felt || !contacts.is_empty();
        let aged = reading.novelty.update(touched, || self.method.reconstruct().novelty(&difference));
        self.apply_changes(&changes, at);
        self.warn_of_ageing(aged, at);
        Ok((touched, contacts))
    }

    /// Reports that presses have become unlike those of the calibration, with their median novelty.
    fn warn_of_ageing(&mut self, novelty: Option<f64>, at: Timestamp) {
        if let Some(novelty) = novelty {
            let text = format!(
                "the last presses are unlike those of the calibration: their residuals are {novelty:.1} times those of its \
                 most unusual presses. Press at some known places; if the contacts are wrong, calibrate again"
            );
            self.notice(Severity::Warning, text, at);
        }
    }

    /// Masks the channels of bad electrodes, and unmasks those of electrodes that are good again.
    fn apply_changes(&mut self, changes: &[Change], at: Timestamp) {
        if changes.is_empty() {
            return;
        }
        let Phase::Reading(reading) = &self.state.phase else { return };
        self.masked = self.topology.channels_of(reading.electrodes.bad());
        for Change { electrode, state } in changes {
            let (level, what) = match state {
                ElectrodeState::Loose => (Severity::Warning, "is loose and its channels are masked: fix its contact"),
                ElectrodeState::Open => {
                    (Severity::Warning, "carries no current and its channels are masked: check its wire")
                }
                ElectrodeState::Sound | ElectrodeState::Doubtful => (Severity::Info, "is sound again"),
            };
            self.notice(level, format!("electrode {electrode} {what}"), at);
        }
    }

    /// Computes the health every few frames, and immediately after a notice.
    fn update_health(&mut self, input: &FrameInput) {
        if self.state.frames % HEALTH_FRAMES != 1 && self.notices.is_empty() {
            return;
        }
        let mut health = Health {
            saturated_channels: input.measurement.saturated.len(),
            masked_channels: marked(&self.masked).len(),
            rate_hz: input.rate_hz,
            counts: input.counts,
            ..Health::default()
        };
        if let Phase::Reading(reading) = &self.state.phase {
            health.electrodes = reading.electrodes.health(&self.topology);
            health.noise = Some(reading.electrodes.noise_ratio(&self.masked)).filter(|noise| noise.is_finite());
            health.reciprocity = reading.electrodes.reciprocity(&self.topology);
        }
        self.health = Arc::new(health);
    }
}

/// Sets the marked values to zero.
fn mask(difference: &mut [f64], masked: &[bool]) {
    difference.iter_mut().zip(masked).filter(|(_, masked)| **masked).for_each(|(value, _)| *value = 0.0);
}

/// Corrects detected contacts by the method.
fn correct(method: &dyn Reconstruct, difference: &[f64], found: &mut [(Contact, Circumstances)]) {
    let mut contacts: Vec<Contact> = found.iter().map(|(contact, _)| *contact).collect();
    method.correct(difference, &mut contacts);
    found.iter_mut().zip(contacts).for_each(|((contact, _), corrected)| *contact = corrected);
}

/// Detected contacts, each with its signal relative to the threshold at its position. If the touch detector has not
/// detected a touch in the frame (`felt`), a contact may continue but none can start.
fn sightings(
    found: Vec<(Contact, Circumstances)>,
    noise_factor: f64,
    settings: &Settings,
    felt: bool,
) -> Vec<Sighting> {
    let sighting = |(contact, under): (Contact, Circumstances)| {
        let needed = noise_factor * settings.threshold_at(contact.position_m);
        let signal = if needed > 0.0 { under.signal / needed } else { f64::INFINITY };
        // In an image without noise the signal-to-noise ratio is not defined.
        let signal = if signal.is_nan() { settings.lowest_threshold() } else { signal };
        Sighting { contact, signal: if felt { signal } else { signal.min(NOT_TO_BEGIN) } }
    };
    found.into_iter().map(sighting).collect()
}

/// Contacts that the method located itself. It gives no noise level, so only the touch detector decides.
fn sightings_of(contacts: Vec<Contact>, felt: bool) -> Vec<Sighting> {
    let signal = if felt { f64::INFINITY } else { NOT_TO_BEGIN };
    contacts.into_iter().map(|contact| Sighting { contact, signal }).collect()
}
