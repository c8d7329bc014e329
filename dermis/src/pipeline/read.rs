//! From a frame to its contacts.

use crate::finding::Severity;
use crate::geom::Point3;
use crate::pipeline::baseline::{ChannelNoise, TouchedFrame};
use crate::pipeline::cause::{Cause, cause};
use crate::pipeline::common_mode::CommonMode;
use crate::pipeline::condition::PartMonitor;
use crate::pipeline::contact::TrackedContact;
use crate::pipeline::degradation::Degradation;
use crate::pipeline::drift::modes_of;
use crate::pipeline::electrodes::{Change, ContactFrame, ElectrodeTopology, NoiseFrame};
use crate::pipeline::error::PipelineError;
use crate::pipeline::frame::Measurement;
use crate::pipeline::instrument::{Findings, InstrumentMonitor, Unjudged, is_most};
use crate::pipeline::matched_filter::MatchedFilter;
use crate::pipeline::process::FrameTime;
use crate::pipeline::state::{Marks, Reading};
use crate::pipeline::statistics::difference;
use crate::pipeline::timestamp::Timestamp;
use crate::pipeline::touch_detector::statistic as statistic_of;
use crate::pipeline::validity::{InvalidReason, Validity};
use crate::pipeline::{Pipeline, marked, reports};
use crate::reconstruct::{Detection, Search};
use crate::track::Sighting;

/// Maximum signal of a sighting that cannot start a contact.
const NOT_TO_BEGIN: f64 = 0.99;

/// Whether what lasts for longer than this is drift, s, ...
const LONG_S: f64 = 10.0;
/// ... is judged once in this many frames.
const JUDGED_FRAMES: u64 = 6;
/// After so many frames in a row with the end of a touch the skin is tared again.
const ENDED_JUDGEMENTS: u32 = 6;

/// The contacts of a frame.
pub(super) struct Outcome {
    pub validity: Validity,
    pub touched: Option<bool>,
    pub contacts: Vec<TrackedContact>,
    /// The baseline is that of a touched skin.
    pub tare_again: bool,
}

impl Outcome {
    /// Of an invalid frame.
    pub(super) fn invalid(reason: InvalidReason) -> Self {
        Outcome { validity: Validity::Invalid { reason }, touched: None, contacts: Vec::new(), tare_again: false }
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
    /// Of the test for weak touches: for a touch, and for the end of one.
    outputs: [f64; 2],
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
        let filter = self.filter.clone().expect("a tare prepares the test");
        let signal = reading.signal(measurement, findings, marks.masked, &filter);
        let reason = reading.instrument.update_whole(signal.reason(), time.time_s);
        self.masked = marks.confirmed;
        self.report_parts(&reading.instrument, &changes, time.at);
        if let Some(reason) = reason {
            // Parts come back only after untouched frames.
            self.update_baseline(reading, &signal, &[], signal.is_touched, time)?;
            return Ok(Outcome::invalid(reason));
        }
        self.locate(reading, &signal, &filter, time)
    }

    /// The contacts of a frame that can be used.
    fn locate(
        &mut self,
        reading: &mut Reading,
        signal: &Signal<'_>,
        filter: &MatchedFilter,
        time: FrameTime,
    ) -> Result<Outcome, PipelineError> {
        if let Some(since_s) = reading.masked_time.update(&signal.masked, time.time_s) {
            self.judge_again(reading, since_s);
        }
        let [touch, end] = signal.outputs;
        let was_felt = reading.felt_since_s.is_some();
        let felt = reading.touch_detector.update(signal.statistic) || filter.exceeds(touch, was_felt);
        reading.felt_since_s = felt.then(|| reading.felt_since_s.unwrap_or(time.time_s));
        let is_long = reading.felt_since_s.is_some_and(|since_s| time.time_s - since_s > LONG_S);
        // A skin that is unlike its model says nothing by it.
        let is_modelled = !self.state.settings.force_tare;
        let may_have_ended = end > touch && filter.exceeds(end, was_felt);
        if !may_have_ended {
            reading.ended_judgements = 0;
        }
        if is_modelled && (may_have_ended || is_long && self.state.frames.is_multiple_of(JUDGED_FRAMES)) {
            match self.cause(reading, signal)? {
                Cause::Drift(drift_ohm) if is_long => return Ok(self.drifted(reading, signal, &drift_ohm, time)),
                Cause::Touch | Cause::Drift(_) => reading.ended_judgements = 0,
                Cause::Ended => {
                    reading.ended_judgements += 1;
                    let tare_again = reading.ended_judgements >= ENDED_JUDGEMENTS;
                    return Ok(Outcome { tare_again, ..Outcome::invalid(InvalidReason::Tare) });
                }
            }
        }
        let sightings = self.sightings(signal, felt)?;
        let tracked = self.state.tracker.update(&sightings, time.time_s);
        let (settings, start) = (&self.state.settings, self.state.start.unwrap_or_default());
        let positive = self.methods.skin().design().sheet.touch.change();
        let contacts: Vec<TrackedContact> = (tracked.iter())
            .map(|tracked| TrackedContact::new(tracked, &self.image, positive, settings, [start, time.at]))
            .collect();
        let positions_m: Vec<Point3> = tracked.iter().map(|tracked| tracked.contact.position_m).collect();
        self.update_baseline(reading, signal, &positions_m, felt, time)?;
        let touched = felt || !contacts.is_empty();
        let aged = reading.novelty.update(touched, || self.method.reconstruct().novelty(&signal.difference));
        self.warn_of_ageing(aged, time.at);
        Ok(Outcome { validity: self.validity(&signal.masked), touched: Some(touched), contacts, tare_again: false })
    }

    /// What the difference of a touched frame is.
    fn cause(&self, reading: &Reading, signal: &Signal<'_>) -> Result<Cause, PipelineError> {
        let noise = ChannelNoise { sd_ohm: reading.electrodes.noise_ohm(), masked: &signal.masked };
        let modes = modes_of(self.fitter.modes(), reading.baseline.values_ohm());
        Ok(cause(self.methods.skin(), &modes, &signal.difference, noise)?)
    }

    /// Takes drift without a touch into the baseline: there is no contact.
    fn drifted(&mut self, reading: &mut Reading, signal: &Signal<'_>, drift_ohm: &[f64], time: FrameTime) -> Outcome {
        reading.baseline.change(|values_ohm| {
            let baseline = values_ohm.iter_mut().zip(drift_ohm).zip(&signal.masked);
            baseline.filter(|(_, masked)| !**masked).for_each(|((value, drift), _)| *value += drift);
        });
        reading.touch_detector.end_touch();
        self.state.tracker.clear();
        let text = "the skin has drifted under a touch: the drift is taken into the baseline";
        self.notice(Severity::Info, text.into(), time.at);
        Outcome {
            validity: self.validity(&signal.masked),
            touched: Some(false),
            contacts: Vec::new(),
            tare_again: false,
        }
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
    /// detector, without which a contact may continue but none can start.
    fn sightings(&mut self, signal: &Signal<'_>, felt: bool) -> Result<Vec<Sighting>, PipelineError> {
        let (settings, masked) = (&self.state.settings, &self.state.method_masked);
        // On a sound skin every touch is in the image; a residual alone is none.
        let unseen = (felt && marked(&signal.masked) == *masked).then_some(self.noise_factor);
        let search = Search { detector: &self.detector, unseen, alone: !masked.is_empty() };
        let found = self.method.reconstruct().find_contacts(&signal.difference, search, &mut self.image)?;
        let sighting = |Detection { contact, signal }| {
            let needed = self.noise_factor * settings.threshold_at(contact.position_m);
            let signal = if needed > 0.0 { signal / needed } else { f64::INFINITY };
            // In an image without noise the signal-to-noise ratio is not defined.
            let signal = if signal.is_nan() { settings.lowest_threshold() } else { signal };
            Sighting { contact, signal: if felt { signal } else { signal.min(NOT_TO_BEGIN) } }
        };
        Ok(found.into_iter().map(sighting).collect())
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
        let statistic = statistic_of(&findings.change_ohm, self.electrodes.noise_ohm(), &masked);
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
        self.baseline.change(|values_ohm| {
            self.trials.update(&measurement.values_ohm, [&marks.masked, &blocked], is_untouched, values_ohm);
        });
    }

    /// The difference of a frame from the baseline, without masked channels. Where the frame is untouched by the baseline of before the
    /// touch, and nearer to it than to the present one, that one is used again.
    fn signal<'a>(
        &mut self,
        measurement: &'a Measurement,
        findings: Findings,
        masked: Vec<bool>,
        filter: &MatchedFilter,
    ) -> Signal<'a> {
        let was_felt = self.felt_since_s.is_some();
        let of = |baseline_ohm: &[f64]| {
            let mut difference = difference(&measurement.values_ohm, baseline_ohm);
            mask(&mut difference, &masked);
            let whitened = filter.whitened(&difference);
            let statistic = filter.statistic(&difference, self.electrodes.noise_ohm(), &masked);
            (difference, whitened, statistic, self.touch_detector.exceeds(statistic))
        };
        let is_felt = |outputs: [f64; 2]| outputs.into_iter().any(|output| filter.exceeds(output, was_felt));
        let (mut difference, whitened, mut statistic, mut is_touched) = of(self.baseline.values_ohm());
        let mut outputs = filter.outputs(&whitened);
        let before_ohm = self.baseline.before_ohm().filter(|_| !is_most(&masked));
        if let Some(before) = before_ohm.map(of).filter(|before| !before.3) {
            let of_before = filter.outputs(&before.1);
            let size = |difference: &[f64]| statistic_of(difference, self.electrodes.noise_ohm(), &masked);
            if !is_felt(of_before) && size(&before.0) < size(&difference) {
                ((difference, _, statistic, is_touched), outputs) = (before, of_before);
                self.baseline.restore();
            }
        }
        Signal { measurement, findings, difference, masked, statistic, is_touched, outputs }
    }
}

/// Sets the marked values to zero.
pub(super) fn mask(difference: &mut [f64], masked: &[bool]) {
    difference.iter_mut().zip(masked).filter(|(_, masked)| **masked).for_each(|(value, _)| *value = 0.0);
}
