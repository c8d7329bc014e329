//! The baseline: the untouched frame and its drift correction.
//!
//! Without a touch, the baseline follows the frame itself. During a touch it follows only the drift of the coating's
//! conductance (as a whole and along each axis) and of each electrode's contact. Their amounts in a frame are fitted
//! together with the touch (least squares with a prior variance for each), and only their change since the start of the
//! touch counts, so that a long press does not fade. What the model of the skin does not know of a touch may be taken
//! for drift: where the baseline of before the touch explains a frame, it is used again.

use crate::forward::Matrix;
use crate::geom::{Point3, Surface};
use crate::linalg::add_scaled;
use crate::pipeline::drift::{DriftFitter, FitQuestion, mode};
use crate::pipeline::error::PipelineError;
use serde::{Deserialize, Serialize};

/// Time constant with which the untouched baseline follows the frame, s: slower than the rise of a press, faster than
/// the thermal drift of a coating.
const FOLLOW_S: f64 = 10.0;
/// Time constant of the fitted drift under a touch, s.
const FIT_S: f64 = 2.0;
/// Drift is fitted once the contacts have been stationary for this time, s.
const SETTLE_S: f64 = 1.0;
/// The fit is requested once they have been stationary for this time, s.
const PREPARE_S: f64 = 0.5;
/// The fits during this first time are averaged: they are the reference for the drift, s.
const REFERENCE_S: f64 = 0.5;
/// A contact that moves farther than this is another touch, m.
const MOVED_M: f64 = 0.005;

/// The current untouched frame.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct Baseline {
    values_ohm: Vec<f64>,
    hold: Option<Hold>,
    /// The last one without a touch, during one, ohm.
    #[serde(default)]
    before_ohm: Option<Vec<f64>>,
}

/// A stationary touch, and the drift since its start.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct Hold {
    /// Positions of its contacts, m.
    #[serde(rename = "places")]
    positions_m: Vec<Point3>,
    /// Its start time, s on the clock of the frames.
    since_s: f64,
    /// The baseline at its start, ohm.
    #[serde(rename = "begun_ohm")]
    initial_ohm: Vec<f64>,
    /// Channels that were masked when the fit was requested.
    masked: Option<Vec<bool>>,
    /// Linear map from a frame's difference to the drift in it, channels x drift modes.
    fit: Option<Matrix>,
    /// The fit without drift, and the number of frames in this average.
    reference: Vec<f64>,
    reference_frames: f64,
    /// The current fit, smoothed.
    now: Vec<f64>,
}

/// The noise of each channel.
#[derive(Debug, Clone, Copy)]
pub(super) struct ChannelNoise<'a> {
    /// Standard deviation of each channel, ohm.
    pub sd_ohm: &'a [f64],
    /// Channels that are masked.
    pub masked: &'a [bool],
}

/// A frame with its contacts.
#[derive(Debug, Clone, Copy)]
pub(super) struct TouchedFrame<'a> {
    /// Its values, ohm.
    pub values_ohm: &'a [f64],
    /// Positions of its contacts, m.
    pub positions_m: &'a [Point3],
    /// Its time, s on the clock of the frames.
    pub time_s: f64,
    /// Time since the last frame, s.
    pub step_s: f64,
}

impl Baseline {
    /// From the mean of untouched frames, ohm.
    pub(super) fn new(values_ohm: Vec<f64>) -> Self {
        Baseline { values_ohm, hold: None, before_ohm: None }
    }

    /// Whether it has these numbers of channels and drift modes.
    pub(super) fn fits(&self, channel_count: usize, drift_count: usize) -> bool {
        self.values_ohm.len() == channel_count
            && self.before_ohm.as_ref().is_none_or(|before_ohm| before_ohm.len() == channel_count)
            && self.hold.as_ref().is_none_or(|hold| hold.fits(channel_count, drift_count))
    }

    /// The baseline, ohm.
    pub(super) fn values_ohm(&self) -> &[f64] {
        &self.values_ohm
    }

    /// Changes the baseline, and that of before the touch alike.
    pub(super) fn change(&mut self, change: impl FnOnce(&mut [f64])) {
        let was_ohm = self.before_ohm.is_some().then(|| self.values_ohm.clone());
        change(&mut self.values_ohm);
        let values = self.values_ohm.iter().zip(was_ohm.iter().flatten());
        let changed = self.before_ohm.iter_mut().flatten().zip(values).filter(|(_, (now, was))| now != was);
        changed.for_each(|(before, (now, _))| *before = *now);
    }

    /// That of before the touch, ohm, during one.
    pub(super) fn before_ohm(&self) -> Option<&[f64]> {
        self.before_ohm.as_deref()
    }

    /// Uses that of before the touch again.
    pub(super) fn restore(&mut self) {
        self.hold = None;
        if let Some(before_ohm) = self.before_ohm.take() {
            self.values_ohm = before_ohm;
        }
    }

    /// Follows an untouched frame, except in masked channels.
    pub(super) fn follow(&mut self, frame_ohm: &[f64], masked: &[bool], step_s: f64) {
        (self.hold, self.before_ohm) = (None, None);
        let share = -(-step_s / FOLLOW_S).exp_m1();
        for ((value, now), _) in self.values_ohm.iter_mut().zip(frame_ohm).zip(masked).filter(|(_, masked)| !**masked) {
            *value += share * (now - *value);
        }
    }

    /// Follows the drift of a frame with contacts.
    pub(super) fn hold(
        &mut self,
        surface: &Surface,
        fitter: &mut DriftFitter,
        noise: ChannelNoise<'_>,
        frame: TouchedFrame<'_>,
    ) -> Result<(), PipelineError> {
        if self.before_ohm.is_none() {
            self.before_ohm = Some(self.values_ohm.clone());
        }
        let drift_count = fitter.modes().rows;
        let stays = |hold: &&mut Hold| hold.stays(surface, frame.positions_m) && hold.uses(noise.masked);
        let Some(hold) = self.hold.as_mut().filter(stays) else {
            self.hold = Some(Hold::new(&self.values_ohm, frame, drift_count));
            return Ok(());
        };
        let held_s = frame.time_s - hold.since_s;
        if held_s < PREPARE_S {
            return Ok(());
        }
        if hold.masked.is_none() {
            hold.masked = Some(noise.masked.to_vec());
            fitter.request(hold.question(noise));
        }
        if held_s < SETTLE_S {
            return Ok(());
        }
        if hold.fit.is_none() {
            hold.fit = Some(fitter.fit(hold.question(noise))?);
        }
        hold.update(held_s, frame);
        hold.add_drift(fitter.modes(), &mut self.values_ohm);
        Ok(())
    }
}

impl Hold {
    fn new(baseline_ohm: &[f64], frame: TouchedFrame<'_>, drift_count: usize) -> Self {
        Hold {
            positions_m: frame.positions_m.to_vec(),
            since_s: frame.time_s,
            initial_ohm: baseline_ohm.to_vec(),
            masked: None,
            fit: None,
            reference: vec![0.0; drift_count],
            reference_frames: 0.0,
            now: vec![0.0; drift_count],
        }
    }

    fn fits(&self, channel_count: usize, drift_count: usize) -> bool {
        let Hold { initial_ohm, masked, fit, reference, now, .. } = self;
        let is_fit = |fit: &Matrix| {
            [fit.rows, fit.columns] == [channel_count, drift_count] && fit.values.len() == channel_count * drift_count
        };
        initial_ohm.len() == channel_count
            && masked.as_ref().is_none_or(|masked| masked.len() == channel_count)
            && fit.as_ref().is_none_or(is_fit)
            && [reference, now].iter().all(|drifts| drifts.len() == drift_count)
    }

    /// Whether the contacts are still in place.
    fn stays(&self, surface: &Surface, positions_m: &[Point3]) -> bool {
        let near = |(a, b): (&Point3, &Point3)| surface.distance_m(*a, *b) <= MOVED_M;
        self.positions_m.len() == positions_m.len() && self.positions_m.iter().zip(positions_m).all(near)
    }

    /// Whether the fit, where there is one, is for these masked channels.
    fn uses(&self, masked: &[bool]) -> bool {
        self.masked.as_ref().is_none_or(|own| own == masked)
    }

    /// The input of the fit at the time of the request.
    fn question(&self, noise: ChannelNoise<'_>) -> FitQuestion {
        let masked = self.masked.clone().unwrap_or_else(|| noise.masked.to_vec());
        FitQuestion {
            rest_ohm: self.initial_ohm.clone(),
            positions_m: self.positions_m.clone(),
            sd_ohm: noise.sd_ohm.to_vec(),
            masked,
        }
    }

    /// Updates the fitted drift with a frame.
    fn update(&mut self, held_s: f64, frame: TouchedFrame<'_>) {
        let Some(fit) = &self.fit else { return };
        let mut found = vec![0.0; self.now.len()];
        let values = frame.values_ohm.iter().zip(&self.initial_ohm);
        for (row, (now, initial)) in fit.values.chunks_exact(found.len()).zip(values) {
            let difference = now - initial;
            found.iter_mut().zip(row).for_each(|(found, value)| *found += difference * value);
        }
        if held_s < SETTLE_S + REFERENCE_S {
            self.reference_frames += 1.0;
            for (reference, found) in self.reference.iter_mut().zip(&found) {
                *reference += (found - *reference) / self.reference_frames;
            }
            self.now.copy_from_slice(&self.reference);
            return;
        }
        let share = -(-frame.step_s / FIT_S).exp_m1();
        self.now.iter_mut().zip(&found).for_each(|(now, found)| *now += share * (found - *now));
    }

    /// Sets the baseline to its initial values plus the drift since then.
    fn add_drift(&self, modes: &Matrix, values_ohm: &mut [f64]) {
        values_ohm.copy_from_slice(&self.initial_ohm);
        for (index, (now, reference)) in self.now.iter().zip(&self.reference).enumerate() {
            add_scaled(values_ohm, now - reference, &mode(modes, index, &self.initial_ohm));
        }
    }
}
