//! The state of a pipeline.

use crate::geom::Surface;
use crate::pipeline::baseline::{Baseline, ChannelNoise, TouchedFrame};
use crate::pipeline::condition::PartMonitor;
use crate::pipeline::drift::DriftFitter;
use crate::pipeline::electrodes::{ElectrodeMonitor, ElectrodeTopology};
use crate::pipeline::error::PipelineError;
use crate::pipeline::frame::Measurement;
use crate::pipeline::instrument::InstrumentMonitor;
use crate::pipeline::novelty::NoveltyMonitor;
use crate::pipeline::settings::Settings;
use crate::pipeline::timestamp::Timestamp;
use crate::pipeline::touch_detector::TouchDetector;
use crate::pipeline::trial::TrialMeans;
use crate::track::Tracker;
use serde::{Deserialize, Serialize};
use std::num::NonZeroU32;

/// The baseline follows the frames after this time without a touch, s.
const QUIET_S: f64 = 0.5;
/// A difference without a contact that lasts this long is a change of the skin, not a touch, s.
const UNEXPLAINED_S: f64 = 5.0;

/// The complete state of a pipeline, for recordings and restarts.
// The field names in files are older than some of the names here.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct State {
    /// The settings.
    pub settings: Settings,
    /// Serial number of the device that the baseline was measured with; `None` if it has none or is unknown.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) device_serial: Option<NonZeroU32>,
    pub(super) phase: Phase,
    /// Time of the first frame: the zero of the tracker's clock.
    #[serde(rename = "begun")]
    pub(super) start: Option<Timestamp>,
    /// Time of the last frame.
    pub(super) last: Option<Timestamp>,
    pub(super) frames: u64,
    /// Channels that the method was prepared without.
    #[serde(rename = "made_without")]
    pub(super) method_masked: Vec<usize>,
    /// Whether the method is adapted to the untouched frames of the tare.
    #[serde(default)]
    pub(super) method_adapted: bool,
    pub(super) tracker: Tracker,
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) enum Phase {
    /// Untouched frames are collected.
    Taring { frames: Vec<Measurement> },
    /// Contacts are detected.
    Reading(Box<Reading>),
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct Reading {
    pub baseline: Baseline,
    #[serde(rename = "watch")]
    pub electrodes: ElectrodeMonitor,
    #[serde(rename = "alarm")]
    pub touch_detector: TouchDetector,
    /// Whether presses look like those of the calibration.
    #[serde(default)]
    pub novelty: NoveltyMonitor,
    #[serde(default)]
    pub instrument: InstrumentMonitor,
    #[serde(default)]
    pub trials: TrialMeans,
    #[serde(default)]
    pub masked_time: MaskedTime,
    /// Differences of the tare's frames from their mean, ohm.
    pub untouched: Vec<Vec<f64>>,
    /// Their mean, ohm; empty in older states.
    #[serde(default)]
    pub rest_ohm: Vec<f64>,
    /// Since when the frames are touched, by either test, s.
    #[serde(default)]
    pub felt_since_s: Option<f64>,
    /// How often in a row the change was the end of a touch.
    #[serde(default)]
    pub ended_judgements: u32,
    /// Start of the time without a touch, s.
    pub quiet_since_s: Option<f64>,
    /// Start of the time in which frames differ from the baseline without a contact, s.
    #[serde(rename = "puzzled_since_s")]
    pub unexplained_since_s: Option<f64>,
}

/// The time in which channels are masked.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub(super) struct MaskedTime {
    /// Its start, s, while there are masked channels.
    since_s: Option<f64>,
    /// Masked channels of the last frame.
    channels: usize,
}

impl MaskedTime {
    /// Takes the masked channels of a frame. If some have come back, returns the start of the time.
    pub(super) fn update(&mut self, masked: &[bool], time_s: f64) -> Option<f64> {
        let channels = masked.iter().filter(|masked| **masked).count();
        let since_s = self.since_s.filter(|_| channels < self.channels);
        self.since_s = (channels > 0).then(|| self.since_s.unwrap_or(time_s));
        self.channels = channels;
        since_s
    }
}

/// Channels that are not used, with a flag for each channel.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Marks {
    /// All of them.
    pub masked: Vec<bool>,
    /// Those that are not on trial.
    pub blocked: Vec<bool>,
    /// Those of parts that are confirmed as bad.
    pub confirmed: Vec<bool>,
}

impl State {
    /// The values of the untouched skin now, ohm; `None` during a tare.
    pub fn baseline_ohm(&self) -> Option<&[f64]> {
        match &self.phase {
            Phase::Taring { .. } => None,
            Phase::Reading(reading) => Some(reading.baseline.values_ohm()),
        }
    }

    /// Continues after a gap in the frames: with the same baseline and no contacts.
    pub(super) fn after_gap(&mut self, measurement: &Measurement) {
        self.tracker.clear();
        if let Phase::Reading(reading) = &mut self.phase {
            reading.electrodes.set_last(measurement);
            reading.quiet_since_s = None;
            reading.unexplained_since_s = None;
        }
    }

    /// Refuses a state of another skin.
    pub(super) fn check(&self, topology: &ElectrodeTopology, drift_count: usize) -> Result<(), PipelineError> {
        let channel_count = topology.channel_count();
        let fits = match &self.phase {
            Phase::Taring { frames } => frames.iter().all(|frame| topology.fits(frame)),
            Phase::Reading(reading) => {
                reading.baseline.fits(channel_count, drift_count)
                    && reading.electrodes.fits(topology)
                    && reading.instrument.fits(topology)
                    && reading.trials.fits(channel_count)
                    && reading.untouched.iter().chain([&reading.rest_ohm]).all(|frame| frame.len() == channel_count)
            }
        };
        match fits && self.method_masked.iter().all(|&channel| channel < channel_count) {
            true => Ok(()),
            false => Err(PipelineError::State { channel_count }),
        }
    }
}

impl State {
    /// Completes a state that was written before the instrument was monitored, before methods were adapted, or before electrodes
    /// were left out.
    pub(super) fn restore(&mut self, topology: &ElectrodeTopology) {
        let Phase::Reading(reading) = &mut self.phase else { return };
        if reading.rest_ohm.is_empty() {
            reading.rest_ohm = reading.baseline.values_ohm().to_vec();
        }
        if reading.instrument == InstrumentMonitor::default() {
            reading.instrument = InstrumentMonitor::unmonitored(topology);
            reading.trials = TrialMeans::new(topology.channel_count());
            reading.electrodes.restore();
        }
        reading.electrodes.leave_out(topology);
    }
}

impl Phase {
    /// Moves the phase out; a tare without frames takes its place.
    pub(super) fn take(&mut self) -> Self {
        std::mem::replace(self, Phase::Taring { frames: Vec::new() })
    }

    /// Standard deviation of the noise of each channel, ohm; empty during a tare.
    pub(super) fn noise_ohm(&self) -> &[f64] {
        match self {
            Phase::Taring { .. } => &[],
            Phase::Reading(reading) => reading.electrodes.noise_ohm(),
        }
    }

    /// The mean of the tare's frames, ohm; `None` during a tare.
    pub(super) fn rest_ohm(&self) -> Option<&[f64]> {
        match self {
            Phase::Taring { .. } => None,
            Phase::Reading(reading) => Some(&reading.rest_ohm),
        }
    }

    /// Differences of the tare's frames from their mean, ohm.
    pub(super) fn untouched(&self) -> &[Vec<f64>] {
        match self {
            Phase::Taring { .. } => &[],
            Phase::Reading(reading) => &reading.untouched,
        }
    }
}

impl Reading {
    /// The channels that are not used, of electrodes, drives and single channels.
    pub(super) fn marks(&self, topology: &ElectrodeTopology) -> Marks {
        let mark = |holds: fn(&PartMonitor) -> bool| {
            let mut marked = vec![false; topology.channel_count()];
            topology.mark_channels_of(self.electrodes.in_condition(holds), &mut marked);
            self.instrument.mark(topology, holds, &mut marked);
            marked
        };
        Marks {
            masked: mark(PartMonitor::is_masked),
            blocked: mark(PartMonitor::is_blocked),
            confirmed: mark(PartMonitor::is_confirmed),
        }
    }

    /// Updates the baseline; returns whether there has been no touch for a while. `touched`: the result of the touch
    /// detector; `masked`: channels that are not used in this frame.
    pub(super) fn update_baseline(
        &mut self,
        surface: &Surface,
        fitter: &mut DriftFitter,
        touched: bool,
        masked: &[bool],
        frame: TouchedFrame<'_>,
    ) -> Result<bool, PipelineError> {
        let since = |holds: bool, since_s: Option<f64>| holds.then(|| since_s.unwrap_or(frame.time_s));
        let lasts_s = |since_s: Option<f64>| since_s.map_or(0.0, |since_s| frame.time_s - since_s);
        let has_contacts = !frame.positions_m.is_empty();
        self.quiet_since_s = since(!touched && !has_contacts, self.quiet_since_s);
        self.unexplained_since_s = since(touched && !has_contacts, self.unexplained_since_s);
        let is_quiet = lasts_s(self.quiet_since_s) >= QUIET_S;
        if is_quiet || lasts_s(self.unexplained_since_s) >= UNEXPLAINED_S {
            self.baseline.follow(frame.values_ohm, masked, frame.step_s);
        } else if has_contacts {
            let noise = ChannelNoise { sd_ohm: self.electrodes.noise_ohm(), masked };
            self.baseline.hold(surface, fitter, noise, frame)?;
        }
        Ok(is_quiet)
    }
}
