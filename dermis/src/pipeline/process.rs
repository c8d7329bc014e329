//! Processing of one frame in the pipeline: the tare, and what every frame reports.

use crate::estimate::noise::ChannelNoise;
use crate::finding::Severity;
use crate::pipeline::baseline::Baseline;
use crate::pipeline::electrodes::ElectrodeMonitor;
use crate::pipeline::error::PipelineError;
use crate::pipeline::frame::{FrameInput, Measurement, PipelineFrame};
use crate::pipeline::health::{Health, Notice};
use crate::pipeline::instrument::InstrumentMonitor;
use crate::pipeline::novelty::NoveltyMonitor;
use crate::pipeline::read::{Outcome, mask};
use crate::pipeline::state::{MaskedTime, Phase, Reading};
use crate::pipeline::statistics::{Statistics, difference};
use crate::pipeline::tare::{self, Refusal, Tared};
use crate::pipeline::timestamp::Timestamp;
use crate::pipeline::touch_detector::TouchDetector;
use crate::pipeline::trial::TrialMeans;
use crate::pipeline::validity::InvalidReason;
use crate::pipeline::{Pipeline, marked};
use std::sync::Arc;

/// A longer interval between frames is a gap, s: nothing is known about it.
pub const GAP_S: f64 = 2.0;
/// Reciprocal channels that differ by more than this many times their noise do not match the design.
const FOREIGN: f64 = 30.0;
/// The health is computed once in this many frames.
const HEALTH_FRAMES: u64 = 12;

/// The time of a frame.
#[derive(Debug, Clone, Copy)]
pub(super) struct FrameTime {
    pub at: Timestamp,
    /// Time since the first frame, s.
    pub time_s: f64,
    /// Time since the last frame, s; 0 after a gap.
    pub step_s: f64,
}

impl Pipeline {
    /// Processes the next frame.
    ///
    /// # Errors
    /// A frame of another size than the skin's, values that are not finite, a reconstruction that fails.
    pub fn process(&mut self, input: FrameInput) -> Result<PipelineFrame, PipelineError> {
        self.check(&input)?;
        let time = self.advance(&input);
        let Outcome { validity, touched, contacts, .. } = match self.state.phase.take() {
            Phase::Taring { frames } => self.tare(frames, &input.measurement, time.at)?,
            Phase::Reading(mut reading) => {
                let outcome = self.read(&mut reading, &input.measurement, time);
                self.state.phase = Phase::Reading(reading);
                let outcome = outcome?;
                if outcome.tare_again {
                    self.tare_again(time.at);
                }
                outcome
            }
        };
        if !validity.is_usable() {
            self.image.values.fill(0.0);
        }
        let texts = [self.reports.validity(&validity), self.reports.method(self.method.reconstruct().warning())];
        texts.into_iter().flatten().for_each(|(level, text)| self.notice(level, text, time.at));
        self.update_health(&input);
        Ok(PipelineFrame {
            sequence: input.sequence,
            measured_at: input.measured_at,
            values_ohm: input.measurement.values_ohm,
            image: self.image.values.iter().map(|&value| value as f32).collect(),
            validity,
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

    /// Adds a frame to those of the tare, and ends the tare with the last one.
    fn tare(
        &mut self,
        mut frames: Vec<Measurement>,
        measurement: &Measurement,
        at: Timestamp,
    ) -> Result<Outcome, PipelineError> {
        frames.push(measurement.clone());
        if frames.len() < self.state.settings.tare_frames {
            self.state.phase = Phase::Taring { frames };
            return Ok(Outcome::invalid(InvalidReason::Tare));
        }
        let left_out = self.topology.left_out_channels();
        let is_forced = self.state.settings.force_tare;
        match tare::judge(frames, &left_out, self.methods.skin(), self.fitter.modes(), is_forced)? {
            Ok(Tared { frames, doubt }) => {
                self.refusal = None;
                self.finish_tare(&frames, at)?;
                if let Some(found) = doubt {
                    self.notice(Severity::Warning, format!("{}; {}", found.evidence, found.fix), at);
                }
            }
            Err((refusal, frames)) => {
                self.state.phase = Phase::Taring { frames: Refusal::kept(frames) };
                // Once for each reason.
                if self.refusal.as_ref().map(std::mem::discriminant) != Some(std::mem::discriminant(&refusal)) {
                    self.notice(Severity::Warning, refusal.text(), at);
                    self.refusal = Some(refusal);
                }
            }
        }
        Ok(Outcome::invalid(InvalidReason::Tare))
    }

    /// Begins to tare again.
    fn tare_again(&mut self, at: Timestamp) {
        let text =
            "a touch has ended that was there at the tare: the skin is tared again. Leave it untouched until then";
        self.notice(Severity::Warning, text.into(), at);
        self.begin_tare();
    }

    /// Starts to detect contacts, with the frames of the tare.
    fn finish_tare(&mut self, frames: &[Measurement], at: Timestamp) -> Result<(), PipelineError> {
        let values: Vec<&[f64]> = frames.iter().map(|frame| frame.values_ohm.as_slice()).collect();
        let statistics = Statistics::of(values.iter().copied());
        let protocol = &self.methods.skin().design().protocol;
        let noise = ChannelNoise::of(&values, protocol).expect("a tare has frames");
        let electrodes = ElectrodeMonitor::new(&self.topology, frames, &statistics, noise.sd_ohm());
        let instrument = InstrumentMonitor::new(&self.topology, frames, &statistics, noise.sd_ohm());
        self.masked = vec![false; self.topology.channel_count()];
        self.topology.mark_channels_of(electrodes.confirmed(), &mut self.masked);
        let untouched: Vec<Vec<f64>> = values.iter().map(|values| difference(values, &statistics.mean)).collect();
        let filter = self.filter_of(&statistics.mean, electrodes.noise_ohm(), &untouched)?;
        self.state.phase = Phase::Reading(Box::new(Reading {
            touch_detector: TouchDetector::of(&values, protocol, |difference, noise_ohm| {
                let mut difference = difference.to_vec();
                mask(&mut difference, &self.masked);
                filter.statistic(&difference, noise_ohm, &self.masked)
            }),
            untouched,
            rest_ohm: statistics.mean.clone(),
            baseline: Baseline::new(statistics.mean),
            electrodes,
            instrument,
            trials: TrialMeans::new(self.topology.channel_count()),
            masked_time: MaskedTime::default(),
            novelty: NoveltyMonitor::default(),
            felt_since_s: None,
            ended_judgements: 0,
            quiet_since_s: None,
            unexplained_since_s: None,
        }));
        self.notice(Severity::Info, format!("tared with {} frames; {noise}", frames.len()), at);
        self.warn_after_tare(at);
        self.filter = Some(filter);
        if self.state.method_adapted {
            // To the tare before.
            self.method = self.state.settings.method_of(&self.methods, &self.state.settings.method)?.clone();
            self.forget_preparation();
        }
        self.measure_noise()
    }

    pub(super) fn notice(&mut self, level: Severity, text: String, at: Timestamp) {
        self.notices.push(Notice { level, text, at });
    }

    /// Reports the problems found by the tare.
    fn warn_after_tare(&mut self, at: Timestamp) {
        let Phase::Reading(reading) = &self.state.phase else { return };
        let mut warnings: Vec<String> = (reading.electrodes.confirmed())
            .filter(|&electrode| !self.topology.leaves_out(electrode))
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

    /// Computes the health every few frames, and immediately after a notice.
    fn update_health(&mut self, input: &FrameInput) {
        if self.state.frames % HEALTH_FRAMES != 1 && self.notices.is_empty() {
            return;
        }
        let mut health = Health {
            device_serial: self.state.device_serial,
            saturated_channels: input.measurement.saturated.len(),
            masked_channels: marked(&self.masked).len(),
            rate_hz: input.rate_hz,
            nominal_rate_hz: input.nominal_rate_hz,
            counts: input.counts,
            ..Health::default()
        };
        if let Phase::Reading(reading) = &self.state.phase {
            health.electrodes = reading.electrodes.health(&self.topology);
            health.noise = Some(reading.electrodes.noise_ratio(&self.masked)).filter(|noise| noise.is_finite());
            health.bad_drives = reading.instrument.bad_drives();
            health.reciprocity = reading.electrodes.reciprocity(&self.topology);
        }
        self.health = Arc::new(health);
    }
}
