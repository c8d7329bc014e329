//! From a frame to its contacts.

use crate::contact::Contact;
use crate::detect::Circumstances;
use crate::geom::Point3;
use crate::pipeline::baseline::TouchedFrame;
use crate::pipeline::condition::PartMonitor;
use crate::pipeline::contact::TrackedContact;
use crate::pipeline::degradation::Degradation;
use crate::pipeline::electrodes::{Change, ContactFrame, ElectrodeTopology, NoiseFrame};
use crate::pipeline::error::PipelineError;
use crate::pipeline::frame::Measurement;
use crate::pipeline::health::{ElectrodeState, Severity};
use crate::pipeline::instrument::{Findings, is_most};
use crate::pipeline::process::FrameTime;
use crate::pipeline::settings::Settings;
use crate::pipeline::state::{Phase, Reading};
use crate::pipeline::statistics::difference;
use crate::pipeline::timestamp::Timestamp;
use crate::pipeline::touch_detector::statistic;
use crate::pipeline::validity::{InvalidReason, Validity};
use crate::pipeline::{Pipeline, marked};
use crate::reconstruct::Reconstruct;
use crate::text::counted;
use crate::track::Sighting;

/// Maximum signal of a sighting that cannot start a contact.
const NOT_TO_BEGIN: f64 = 0.99;

/// The contacts of a frame.
pub(super) struct Outcome {
    pub validity: Validity,
    pub touched: Option<bool>,
    pub contacts: Vec<TrackedContact>,
}

impl Outcome {
    /// Of an invalid frame.
    pub(super) fn invalid(reason: InvalidReason) -> Self {
        Outcome { validity: Validity::Invalid { reason }, touched: None, contacts: Vec::new() }
    }
}

/// A frame as far as it can be used: its difference from the baseline.
struct Signal {
    /// The difference, zero in masked channels, ohm.
    difference: Vec<f64>,
    masked: Vec<bool>,
    /// The statistic of the touch detector, and whether it exceeds the threshold.
    statistic: f64,
    is_touched: bool,
}

impl Signal {
    /// Why it cannot be used, if so.
    fn reason(&self) -> Option<InvalidReason> {
        is_most(&self.masked).then_some(InvalidReason::TooFewChannels)
    }
}

impl Pipeline {
    /// The contacts of a frame.
    pub(super) fn read(&mut self, measurement: &Measurement, time: FrameTime) -> Result<Outcome, PipelineError> {
        let Phase::Reading(reading) = &mut self.state.phase else { return Ok(Outcome::invalid(InvalidReason::Tare)) };
        let findings = reading.check(&self.topology, measurement, time);
        if findings.reason.is_some() {
            let reason = reading.instrument.update_whole(findings.reason, time.time_s);
            return Ok(Outcome::invalid(reason.unwrap_or(InvalidReason::OnTrial)));
        }
        let changes = reading.update_parts(&self.topology, measurement, &findings, time);
        let signal = reading.signal(&self.topology, measurement);
        let reason = reading.instrument.update_whole(signal.reason(), time.time_s);
        self.apply_changes(&changes, time.at);
        if let Some(reason) = reason {
            // Parts come back only after untouched frames.
            self.update_baseline(measurement, &signal, &findings, &[], signal.is_touched, time)?;
            return Ok(Outcome::invalid(reason));
        }
        self.locate(measurement, &signal, &findings, time)
    }

    /// The contacts of a frame that can be used.
    fn locate(
        &mut self,
        measurement: &Measurement,
        signal: &Signal,
        findings: &Findings,
        time: FrameTime,
    ) -> Result<Outcome, PipelineError> {
        let Phase::Reading(reading) = &mut self.state.phase else { return Ok(Outcome::invalid(InvalidReason::Tare)) };
        let felt = reading.touch_detector.update(signal.statistic);
        let difference = &signal.difference;
        self.method.reconstruct().reconstruct_into(difference, &mut self.image.values)?;
        let settings = &self.state.settings;
        let sightings = match self.method.reconstruct().contacts(difference)? {
            Some(contacts) => sightings_of(contacts, felt),
            None => {
                let mut found = self.detector.detect_under(&self.image);
                correct(self.method.reconstruct(), difference, &mut found);
                sightings(found, self.noise_factor, settings, felt)
            }
        };
        let tracked = self.state.tracker.update(&sightings, time.time_s);
        let start = self.state.start.unwrap_or_default();
        let contacts: Vec<TrackedContact> =
            tracked.iter().map(|tracked| TrackedContact::new(tracked, &self.image, settings, start)).collect();
        let positions_m: Vec<Point3> = tracked.iter().map(|tracked| tracked.contact.position_m).collect();
        self.update_baseline(measurement, signal, findings, &positions_m, felt, time)?;
        let touched = felt || !contacts.is_empty();
        let Phase::Reading(reading) = &mut self.state.phase else { return Ok(Outcome::invalid(InvalidReason::Tare)) };
        let aged = reading.novelty.update(touched, || self.method.reconstruct().novelty(difference));
        self.warn_of_ageing(aged, time.at);
        Ok(Outcome { validity: self.validity(&signal.masked), touched: Some(touched), contacts })
    }

    /// Updates the baseline and the noise with a frame.
    fn update_baseline(
        &mut self,
        measurement: &Measurement,
        signal: &Signal,
        findings: &Findings,
        positions_m: &[Point3],
        felt: bool,
        FrameTime { time_s, step_s, .. }: FrameTime,
    ) -> Result<(), PipelineError> {
        let Phase::Reading(reading) = &mut self.state.phase else { return Ok(()) };
        let frame = TouchedFrame { values_ohm: &measurement.values_ohm, positions_m, time_s, step_s };
        let surface = &self.methods.skin().pixels().surface;
        let untouched = reading.update_baseline(surface, &mut self.fitter, felt, &signal.masked, frame)?;
        let about = NoiseFrame { untouched, masked: &signal.masked, sick_drives: &findings.drives, step_s };
        reading.electrodes.update_noise(&self.topology, measurement, about);
        Ok(())
    }

    /// The validity of a frame with some masked channels.
    fn validity(&self, masked: &[bool]) -> Validity {
        let channels = marked(masked);
        if channels.is_empty() {
            return Validity::Ok;
        }
        let cost = self.cost.filter(|_| channels == self.state.method_masked);
        Validity::Degraded(Box::new(Degradation { channels, cost }))
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

    /// Masks the channels of parts that are confirmed as bad, and unmasks those of parts that are sound again.
    fn apply_changes(&mut self, changes: &[Change], at: Timestamp) {
        let Phase::Reading(reading) = &self.state.phase else { return };
        self.masked = reading.mark(&self.topology, PartMonitor::is_confirmed);
        let drives = reading.instrument.bad_drives();
        let channels = reading.instrument.bad_channel_count();
        self.announce_parts(drives, channels, at);
        for Change { electrode, state } in changes {
            let (level, what) = match state {
                ElectrodeState::Loose => (Severity::Warning, "is loose and its channels are masked: fix its contact"),
                ElectrodeState::Open => {
                    (Severity::Warning, "carries no current and its channels are masked: check its wire")
                }
                _ => (Severity::Info, "is sound again"),
            };
            self.notice(level, format!("electrode {electrode} {what}"), at);
        }
    }

    /// Reports drives and channels that become bad or sound again.
    fn announce_parts(&mut self, drives: Vec<usize>, channels: usize, at: Timestamp) {
        let before = std::mem::replace(&mut self.announced_drives, drives.clone());
        for &drive in drives.iter().filter(|drive| !before.contains(drive)) {
            let [source, sink] = self.topology.ends_of(drive);
            let text = format!(
                "the current of drive {drive} (electrodes {source} and {sink}) is wrong and its channels are masked: check \
                 the source and the reference resistor"
            );
            self.notice(Severity::Warning, text, at);
        }
        for drive in before.iter().filter(|drive| !drives.contains(drive)) {
            self.notice(Severity::Info, format!("the current of drive {drive} is sound again"), at);
        }
        let before = std::mem::replace(&mut self.announced_channels, channels);
        if before == 0 && channels > 0 {
            let text = format!("{} out of range or unlike the others: masked", counted(channels, "channel"));
            self.notice(Severity::Warning, text, at);
        } else if before > 0 && channels == 0 {
            self.notice(Severity::Info, "all channels are in range again".into(), at);
        }
    }
}

impl Reading {
    fn check(&mut self, topology: &ElectrodeTopology, measurement: &Measurement, time: FrameTime) -> Findings {
        let baseline_ohm = self.baseline.values_ohm();
        self.instrument.check(topology, &self.electrodes, baseline_ohm, measurement, time.step_s)
    }

    /// Updates the states of electrodes, drives and channels, and the baseline of those that come back.
    fn update_parts(
        &mut self,
        topology: &ElectrodeTopology,
        measurement: &Measurement,
        findings: &Findings,
        FrameTime { time_s, .. }: FrameTime,
    ) -> Vec<Change> {
        // The frame before was untouched.
        let may_return = self.quiet_since_s.is_some();
        let difference = &difference(&measurement.values_ohm, self.baseline.values_ohm());
        let about = ContactFrame { difference, sick_drives: &findings.drives, may_return, time_s };
        let changes = match findings.is_noisy {
            true => Vec::new(),
            false => self.electrodes.update_contacts(topology, measurement, about),
        };
        self.instrument.update_parts(findings, may_return, time_s);
        let [masked, blocked] =
            [PartMonitor::is_masked, PartMonitor::is_blocked].map(|holds| self.mark(topology, holds));
        let baseline_ohm = self.baseline.values_ohm_mut();
        self.trials.update(&measurement.values_ohm, [&masked, &blocked], may_return, baseline_ohm);
        changes
    }

    /// The difference of a frame from the baseline, without the channels that cannot be used.
    fn signal(&self, topology: &ElectrodeTopology, measurement: &Measurement) -> Signal {
        let masked = self.mark(topology, PartMonitor::is_masked);
        let mut difference = difference(&measurement.values_ohm, self.baseline.values_ohm());
        mask(&mut difference, &masked);
        let statistic = statistic(&difference, self.electrodes.noise_ohm(), &masked);
        Signal { difference, masked, statistic, is_touched: self.touch_detector.exceeds(statistic) }
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
