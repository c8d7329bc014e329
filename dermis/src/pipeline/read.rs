//! From a frame to its contacts.

use crate::contact::Contact;
use crate::detect::Circumstances;
use crate::finding::Severity;
use crate::geom::{Point3, Surface};
use crate::pipeline::baseline::TouchedFrame;
use crate::pipeline::common_mode::CommonMode;
use crate::pipeline::condition::PartMonitor;
use crate::pipeline::contact::TrackedContact;
use crate::pipeline::degradation::Degradation;
use crate::pipeline::electrodes::{Change, ContactFrame, ElectrodeTopology, NoiseFrame};
use crate::pipeline::error::PipelineError;
use crate::pipeline::frame::Measurement;
use crate::pipeline::instrument::{Findings, InstrumentMonitor, Unjudged, is_most};
use crate::pipeline::process::FrameTime;
use crate::pipeline::settings::Settings;
use crate::pipeline::state::{Marks, Reading};
use crate::pipeline::statistics::difference;
use crate::pipeline::timestamp::Timestamp;
use crate::pipeline::touch_detector::statistic;
use crate::pipeline::validity::{InvalidReason, Validity};
use crate::pipeline::{Pipeline, marked, reports};
use crate::track::Sighting;

/// Maximum signal of a sighting that cannot start a contact.
const NOT_TO_BEGIN: f64 = 0.99;
/// A contact that the method adds is a part of a detected one within this distance, m.
const PART_OF_CONTACT_M: f64 = 0.02;

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

/// A frame as far as it can be used.
struct Signal<'a> {
    measurement: &'a Measurement,
    findings: Findings,
    /// The difference from the baseline, zero in masked channels, ohm.
    difference: Vec<f64>,
    masked: Vec<bool>,
    /// The statistic of the touch detector, and whether it exceeds the threshold.
    statistic: f64,
    is_touched: bool,
}

impl Signal<'_> {
    /// Why it cannot be used, if so.
    fn reason(&self) -> Option<InvalidReason> {
        is_most(&self.masked).then_some(InvalidReason::TooFewChannels)
    }
}

impl Pipeline {
    /// The contacts of a frame.
    pub(super) fn read(
        &mut self,
        reading: &mut Reading,
        measurement: &Measurement,
        time: FrameTime,
    ) -> Result<Outcome, PipelineError> {
        let findings = reading.check(&self.topology, &self.common_mode, measurement, time);
        if findings.reason.is_some() {
            let reason = reading.instrument.update_whole(findings.reason, time.time_s);
            return Ok(Outcome::invalid(reason.unwrap_or(InvalidReason::OnTrial)));
        }
        let changes = reading.update_parts(&self.topology, measurement, &findings, time);
        let marks = reading.marks(&self.topology);
        reading.update_trials(&self.topology, measurement, &marks);
        let signal = reading.signal(measurement, findings, marks.masked);
        let reason = reading.instrument.update_whole(signal.reason(), time.time_s);
        self.masked = marks.confirmed;
        self.report_parts(&reading.instrument, &changes, time.at);
        if let Some(reason) = reason {
            // Parts come back only after untouched frames.
            self.update_baseline(reading, &signal, &[], signal.is_touched, time)?;
            return Ok(Outcome::invalid(reason));
        }
        self.locate(reading, &signal, time)
    }

    /// The contacts of a frame that can be used.
    fn locate(
        &mut self,
        reading: &mut Reading,
        signal: &Signal<'_>,
        time: FrameTime,
    ) -> Result<Outcome, PipelineError> {
        if let Some(since_s) = reading.masked_time.update(&signal.masked, time.time_s) {
            self.judge_again(reading, since_s);
        }
        let felt = reading.touch_detector.update(signal.statistic);
        let sightings = self.sightings(signal, felt)?;
        let tracked = self.state.tracker.update(&sightings, time.time_s);
        let (settings, start) = (&self.state.settings, self.state.start.unwrap_or_default());
        let positive = self.methods.skin().design().sheet.touch.change();
        let contacts: Vec<TrackedContact> = (tracked.iter())
            .map(|tracked| TrackedContact::new(tracked, &self.image, positive, settings, start))
            .collect();
        let positions_m: Vec<Point3> = tracked.iter().map(|tracked| tracked.contact.position_m).collect();
        self.update_baseline(reading, signal, &positions_m, felt, time)?;
        let touched = felt || !contacts.is_empty();
        let aged = reading.novelty.update(touched, || self.method.reconstruct().novelty(&signal.difference));
        self.warn_of_ageing(aged, time.at);
        Ok(Outcome { validity: self.validity(&signal.masked), touched: Some(touched), contacts })
    }

    /// Requires that contacts exceed the threshold to begin again that have begun since `since_s`, while channels were
    /// masked which are back: fewer channels resolve less.
    fn judge_again(&mut self, reading: &mut Reading, since_s: f64) {
        self.state.tracker.begin_again(since_s);
        if !self.state.tracker.has_older(since_s) {
            reading.touch_detector.end_touch();
        }
    }

    /// What the method finds in a difference from the baseline; updates the image. `felt`: the result of the touch
    /// detector.
    fn sightings(&mut self, signal: &Signal<'_>, felt: bool) -> Result<Vec<Sighting>, PipelineError> {
        let (method, difference) = (self.method.reconstruct(), &signal.difference);
        method.reconstruct_into(difference, &mut self.image.values)?;
        Ok(match method.contacts(difference)? {
            Some(contacts) => sightings_of(contacts, felt),
            None => {
                let detected = self.detector.detect_under(&self.image);
                let mut contacts: Vec<Contact> = detected.iter().map(|(contact, _)| *contact).collect();
                method.correct(difference, &mut contacts);
                let masked = &self.state.method_masked;
                // On a sound skin every touch is in the image; a residual alone is none.
                let is_missed =
                    felt && marked(&signal.masked) == *masked && !(detected.is_empty() && masked.is_empty());
                let threshold = is_missed.then_some(self.noise_factor);
                let contacts = with_signals(&method.pixels().surface, contacts, &detected, threshold);
                sightings(contacts, self.noise_factor, &self.state.settings, felt)
            }
        })
    }

    /// Updates the baseline and the noise with a frame.
    fn update_baseline(
        &mut self,
        reading: &mut Reading,
        signal: &Signal<'_>,
        positions_m: &[Point3],
        felt: bool,
        FrameTime { time_s, step_s, .. }: FrameTime,
    ) -> Result<(), PipelineError> {
        let Signal { measurement, findings, masked, .. } = signal;
        let frame = TouchedFrame { values_ohm: &measurement.values_ohm, positions_m, time_s, step_s };
        let surface = &self.methods.skin().pixels().surface;
        let untouched = reading.update_baseline(surface, &mut self.fitter, felt, masked, frame)?;
        let about = NoiseFrame { untouched, masked, sick_drives: &findings.drives, step_s };
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

    /// Reports electrodes, drives and channels that become bad or sound again.
    fn report_parts(&mut self, instrument: &InstrumentMonitor, changes: &[Change], at: Timestamp) {
        let mut texts = self.reports.drives(&self.topology, instrument.bad_drives());
        texts.extend(self.reports.channels(&instrument.bad_channels()));
        texts.extend(changes.iter().map(reports::electrode));
        texts.into_iter().for_each(|(level, text)| self.notice(level, text, at));
    }
}

impl Reading {
    fn check(
        &mut self,
        topology: &ElectrodeTopology,
        common_mode: &CommonMode,
        measurement: &Measurement,
        time: FrameTime,
    ) -> Findings {
        let baseline_ohm = self.baseline.values_ohm();
        let mut findings = self.instrument.check(topology, &self.electrodes, baseline_ohm, measurement, time.step_s);
        if findings.reason.is_none() && self.is_offset(topology, common_mode, &findings) {
            findings.reason = Some(InvalidReason::Offset);
        }
        findings
    }

    /// Whether a frame is touched, but by an offset of all values.
    fn is_offset(&self, topology: &ElectrodeTopology, common_mode: &CommonMode, findings: &Findings) -> bool {
        let mut masked = self.marks(topology).masked;
        InstrumentMonitor::mark_findings(topology, findings, &mut masked);
        let statistic = statistic(&findings.change_ohm, self.electrodes.noise_ohm(), &masked);
        self.touch_detector.exceeds(statistic) && common_mode.is_offset(&findings.change_ohm, &masked)
    }

    /// Whether the frame before was untouched.
    fn was_untouched(&self) -> bool {
        self.quiet_since_s.is_some()
    }

    /// Updates the states of electrodes, drives and channels.
    fn update_parts(
        &mut self,
        topology: &ElectrodeTopology,
        measurement: &Measurement,
        findings: &Findings,
        FrameTime { time_s, .. }: FrameTime,
    ) -> Vec<Change> {
        if findings.is_noisy {
            return Vec::new();
        }
        let is_untouched = self.was_untouched();
        let about =
            ContactFrame { difference: &findings.change_ohm, sick_drives: &findings.drives, is_untouched, time_s };
        let changes = self.electrodes.update_contacts(topology, measurement, about);
        let mut drives = vec![false; topology.drive_count()];
        topology.mark_drives_of(self.electrodes.confirmed(), &mut drives);
        let mut channels = vec![false; topology.channel_count()];
        topology.mark_channels_of(self.electrodes.in_condition(PartMonitor::is_masked), &mut channels);
        self.instrument.update_parts(findings, &Unjudged { drives, channels }, is_untouched, time_s);
        changes
    }

    /// Updates the baseline of channels that come back.
    fn update_trials(&mut self, topology: &ElectrodeTopology, measurement: &Measurement, marks: &Marks) {
        let is_untouched = self.was_untouched();
        let mut blocked = marks.blocked.clone();
        topology.mark_channels_of(self.electrodes.hiding_touch(), &mut blocked);
        let baseline_ohm = self.baseline.values_ohm_mut();
        self.trials.update(&measurement.values_ohm, [&marks.masked, &blocked], is_untouched, baseline_ohm);
    }

    /// The difference of a frame from the baseline, without masked channels.
    fn signal<'a>(&self, measurement: &'a Measurement, findings: Findings, masked: Vec<bool>) -> Signal<'a> {
        let mut difference = difference(&measurement.values_ohm, self.baseline.values_ohm());
        mask(&mut difference, &masked);
        let statistic = statistic(&difference, self.electrodes.noise_ohm(), &masked);
        let is_touched = self.touch_detector.exceeds(statistic);
        Signal { measurement, findings, difference, masked, statistic, is_touched }
    }
}

/// Sets the marked values to zero.
fn mask(difference: &mut [f64], masked: &[bool]) {
    difference.iter_mut().zip(masked).filter(|(_, masked)| **masked).for_each(|(value, _)| *value = 0.0);
}

/// Contacts after a correction by the method, each with the signal-to-noise ratio with which it was detected. The method may
/// have removed some. One that it has added has the ratio of the nearest detected one if it is a part of that. One that was
/// not detected has the ratio `threshold`; without, it is left out.
fn with_signals(
    surface: &Surface,
    contacts: Vec<Contact>,
    detected: &[(Contact, Circumstances)],
    threshold: Option<f64>,
) -> Vec<(Contact, f64)> {
    let signal = |contact: &Contact| {
        let same = detected.iter().find(|(other, _)| other.id == contact.id);
        let apart_m = |(other, _): &&(Contact, Circumstances)| surface.distance_m(contact.position_m, other.position_m);
        let nearest = || detected.iter().min_by(|a, b| apart_m(a).total_cmp(&apart_m(b)));
        let of = same.or_else(|| nearest().filter(|near| apart_m(near) <= PART_OF_CONTACT_M));
        of.map(|(_, under)| under.signal).or(threshold)
    };
    contacts.into_iter().filter_map(|contact| Some((contact, signal(&contact)?))).collect()
}

/// Contacts with their signal-to-noise ratios as sightings, whose signal is relative to the threshold at their positions.
/// If the touch detector has not detected a touch in the frame (`felt`), a contact may continue but none can start.
fn sightings(contacts: Vec<(Contact, f64)>, noise_factor: f64, settings: &Settings, felt: bool) -> Vec<Sighting> {
    let sighting = |(contact, ratio): (Contact, f64)| {
        let needed = noise_factor * settings.threshold_at(contact.position_m);
        let signal = if needed > 0.0 { ratio / needed } else { f64::INFINITY };
        // In an image without noise the signal-to-noise ratio is not defined.
        let signal = if signal.is_nan() { settings.lowest_threshold() } else { signal };
        Sighting { contact, signal: if felt { signal } else { signal.min(NOT_TO_BEGIN) } }
    };
    contacts.into_iter().map(sighting).collect()
}

/// Contacts that the method located itself. It gives no noise level, so only the touch detector decides.
fn sightings_of(contacts: Vec<Contact>, felt: bool) -> Vec<Sighting> {
    let signal = if felt { f64::INFINITY } else { NOT_TO_BEGIN };
    contacts.into_iter().map(|contact| Sighting { contact, signal }).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn contacts_that_the_method_removes_and_adds_keep_the_signals_of_the_others() {
        let contact = |id: u64, x_m: f64| Contact { id, ..Contact::truth([x_m, 0.0, 0.0], [0.0, 0.0, 1.0], 1.0) };
        let detected = [(0, 0.0, 9.0), (1, 0.02, 8.0), (2, 0.10, 7.0)].map(|(id, x_m, signal)| {
            (contact(id, x_m), Circumstances { signal, noise_m: 1e-3, radius_m: 5e-3, next_m: 0.02 })
        });
        // The one in the middle is removed, the first one moves past its place, the last one is split, and one is added.
        let corrected = vec![contact(0, 0.021), contact(2, 0.09), contact(3, 0.115), contact(4, 0.2)];
        let signals = |threshold: Option<f64>| -> Vec<(u64, f64)> {
            let signals = with_signals(&Surface::Plane, corrected.clone(), &detected, threshold);
            signals.iter().map(|(contact, signal)| (contact.id, *signal)).collect()
        };
        assert_eq!(signals(Some(4.0)), [(0, 9.0), (2, 7.0), (3, 7.0), (4, 4.0)]);
        assert_eq!(signals(None), [(0, 9.0), (2, 7.0), (3, 7.0)]);
    }
}
