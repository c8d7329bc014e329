//! All that a pipeline remembers.

use crate::LiveError;
use crate::baseline::{Baseline, Noise, Touch};
use crate::drift::Fitter;
use crate::health::{ElectrodeMonitor, ElectrodeTopology};
use crate::meter::Measures;
use crate::settings::Settings;
use crate::timestamp::Timestamp;
use crate::touch_detector::TouchDetector;
use dermis::geom::Surface;
use dermis::track::Tracker;
use serde::{Deserialize, Serialize};

/// Nothing must have touched for so long before the baseline follows, s.
const QUIET_S: f64 = 0.5;
/// What is felt for so long without a contact is no touch but a skin that has changed, s.
const PUZZLED_S: f64 = 5.0;

/// All that a pipeline remembers, as recordings and restarts keep it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct State {
    /// What may be changed.
    pub settings: Settings,
    pub(crate) phase: Phase,
    /// When the first frame came: the zero of its clock.
    pub(crate) begun: Option<Timestamp>,
    pub(crate) last: Option<Timestamp>,
    pub(crate) frames: u64,
    /// Channels that the method was made without.
    pub(crate) made_without: Vec<usize>,
    pub(crate) tracker: Tracker,
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) enum Phase {
    /// The untouched frame is being taken.
    Taring { frames: Vec<Measures> },
    /// Contacts are found.
    Reading(Box<Reading>),
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct Reading {
    pub baseline: Baseline,
    pub watch: ElectrodeMonitor,
    pub alarm: TouchDetector,
    /// The tare's frames less their mean, ohm.
    pub untouched: Vec<Vec<f64>>,
    /// Since when nothing touches, and since when something is felt that is no contact; s.
    pub quiet_since_s: Option<f64>,
    pub puzzled_since_s: Option<f64>,
}

impl State {
    /// Goes on after a while without frames: with the baseline as it was, and nobody's contacts.
    pub(crate) fn after_gap(&mut self, measures: &Measures) {
        self.tracker.clear();
        if let Phase::Reading(reading) = &mut self.phase {
            reading.watch.forget_last(measures);
            reading.quiet_since_s = None;
            reading.puzzled_since_s = None;
        }
    }

    /// Refuses a state of another skin.
    pub(crate) fn check(&self, topology: &ElectrodeTopology, drift_count: usize) -> Result<(), LiveError> {
        let channel_count = topology.channel_count();
        let fits = match &self.phase {
            Phase::Taring { frames } => frames.iter().all(|frame| frame.values_ohm.len() == channel_count),
            Phase::Reading(reading) => {
                reading.baseline.fits(channel_count, drift_count)
                    && reading.watch.fits(topology)
                    && reading.untouched.iter().all(|frame| frame.len() == channel_count)
            }
        };
        if fits && self.made_without.iter().all(|&channel| channel < channel_count) {
            return Ok(());
        }
        Err(LiveError::Given(format!(
            "the kept state is of another skin than this one of {channel_count} channels: tare anew"
        )))
    }
}

impl Phase {
    /// The tare's frames less their mean, ohm.
    pub fn untouched(&self) -> &[Vec<f64>] {
        match self {
            Phase::Taring { .. } => &[],
            Phase::Reading(reading) => &reading.untouched,
        }
    }
}

impl Reading {
    /// Has the baseline follow what drifts; whether nothing has touched for a while.
    pub fn follow(
        &mut self,
        surface: &Surface,
        fitter: &mut Fitter,
        alarm: bool,
        masked: &[bool],
        touch: Touch<'_>,
    ) -> bool {
        let since = |holds: bool, since_s: Option<f64>| holds.then(|| since_s.unwrap_or(touch.time_s));
        let for_s = |since_s: Option<f64>| since_s.map_or(0.0, |since_s| touch.time_s - since_s);
        let felt = !touch.places.is_empty();
        self.quiet_since_s = since(!alarm && !felt, self.quiet_since_s);
        self.puzzled_since_s = since(alarm && !felt, self.puzzled_since_s);
        let quiet = for_s(self.quiet_since_s) >= QUIET_S;
        if quiet || for_s(self.puzzled_since_s) >= PUZZLED_S {
            self.baseline.follow(touch.frame_ohm, touch.step_s);
        } else if felt {
            let noise = Noise { sd_ohm: self.watch.noise_ohm(), masked };
            self.baseline.hold(surface, fitter, noise, touch);
        }
        quiet
    }
}
