//! The untouched frame, and how it follows what drifts.
//!
//! Where nothing touches, the baseline follows the frame itself. Under a touch it follows only what drifts in the ways that
//! a coat and its contacts do: the coat's conductance as a whole and along each axis, and each electrode's contact. How much
//! of these is in a frame is fitted together with the touch (least squares with a prior variance for each), and only what
//! changes from the beginning of the touch counts, so that a long press does not fade.

use crate::drift::{Drifts, Fitter, Question};
use dermis::forward::Matrix;
use dermis::geom::{Point3, Surface};
use serde::{Deserialize, Serialize};

/// Time constant at which the untouched baseline follows the frame, s: slower than any press comes up, faster than a coat
/// warms.
const FOLLOW_S: f64 = 10.0;
/// Time constant of what is fitted under a touch, s.
const FIT_S: f64 = 2.0;
/// The touch must have stayed where it is for so long before drift is fitted beside it, s.
const SETTLE_S: f64 = 1.0;
/// And for so long before that is prepared, s.
const PREPARE_S: f64 = 0.5;
/// From there on for so long the fit is averaged: what it says is no drift, s.
const REFERENCE_S: f64 = 0.5;
/// A contact that moves farther than this is another touch, m.
const MOVED_M: f64 = 0.005;

/// The untouched frame now.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Baseline {
    values_ohm: Vec<f64>,
    hold: Option<Hold>,
}

/// A touch that stays, and the drift beside it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct Hold {
    /// Where its contacts are, m.
    places: Vec<Point3>,
    /// Since when, s on the clock of the frames.
    since_s: f64,
    /// The baseline at its beginning, ohm.
    begun_ohm: Vec<f64>,
    /// Channels that were left out when the fit was asked for.
    masked: Option<Vec<bool>>,
    /// From a frame's difference to the drifts in it, channels x drifts.
    fit: Option<Matrix>,
    /// What the fit says where nothing has drifted, and the frames that say so.
    reference: Vec<f64>,
    reference_frames: f64,
    /// What it says now, smoothed.
    now: Vec<f64>,
}

impl Baseline {
    /// From the mean of untouched frames, ohm.
    pub fn new(values_ohm: Vec<f64>) -> Self {
        Baseline { values_ohm, hold: None }
    }

    /// Whether it is one of so many channels and drifts.
    pub fn fits(&self, channel_count: usize, drift_count: usize) -> bool {
        let is_frame = |values: &Vec<f64>| values.len() == channel_count;
        is_frame(&self.values_ohm)
            && self.hold.as_ref().is_none_or(|hold| {
                let Hold { begun_ohm, masked, fit, reference, now, .. } = hold;
                let is_fit = |fit: &Matrix| {
                    [fit.rows, fit.columns] == [channel_count, drift_count]
                        && fit.values.len() == channel_count * drift_count
                };
                is_frame(begun_ohm)
                    && masked.as_ref().is_none_or(|masked| masked.len() == channel_count)
                    && fit.as_ref().is_none_or(is_fit)
                    && [reference, now].iter().all(|drifts| drifts.len() == drift_count)
            })
    }

    /// It, ohm.
    pub fn values_ohm(&self) -> &[f64] {
        &self.values_ohm
    }

    /// Follows a frame that nothing touches.
    pub fn follow(&mut self, frame_ohm: &[f64], step_s: f64) {
        self.hold = None;
        let share = -(-step_s / FOLLOW_S).exp_m1();
        for (value, now) in self.values_ohm.iter_mut().zip(frame_ohm) {
            *value += share * (now - *value);
        }
    }

    /// Follows the drift under contacts at some places.
    pub fn hold(&mut self, surface: &Surface, fitter: &mut Fitter, noise: Noise<'_>, touch: Touch<'_>) {
        let Some(hold) = self.hold.as_mut().filter(|hold| hold.stays(surface, touch.places)) else {
            self.hold = Some(Hold::new(&self.values_ohm, touch, fitter.drifts().modes.rows));
            return;
        };
        let held_s = touch.time_s - hold.since_s;
        if held_s < PREPARE_S {
            return;
        }
        if hold.masked.is_none() {
            hold.masked = Some(noise.masked.to_vec());
            fitter.ask(&hold.question(noise));
        }
        if held_s < SETTLE_S {
            return;
        }
        if hold.fit.is_none() {
            hold.fit = Some(fitter.answer(&hold.question(noise)));
        }
        hold.take(held_s, touch);
        hold.put_drift(fitter.drifts(), &mut self.values_ohm);
    }
}

impl Hold {
    fn new(values_ohm: &[f64], touch: Touch<'_>, drift_count: usize) -> Self {
        Hold {
            places: touch.places.to_vec(),
            since_s: touch.time_s,
            begun_ohm: values_ohm.to_vec(),
            masked: None,
            fit: None,
            reference: vec![0.0; drift_count],
            reference_frames: 0.0,
            now: vec![0.0; drift_count],
        }
    }

    /// Whether contacts are still where they were.
    fn stays(&self, surface: &Surface, places: &[Point3]) -> bool {
        let near = |(a, b): (&Point3, &Point3)| surface.distance_m(*a, *b) <= MOVED_M;
        self.places.len() == places.len() && self.places.iter().zip(places).all(near)
    }

    /// What the fit is made for: as it was when it was asked for.
    fn question(&self, noise: Noise<'_>) -> Question {
        let masked = self.masked.clone().unwrap_or_else(|| noise.masked.to_vec());
        Question { places: self.places.clone(), sd_ohm: noise.sd_ohm.to_vec(), masked }
    }

    /// Takes in what the fit says of a frame.
    fn take(&mut self, held_s: f64, touch: Touch<'_>) {
        let Some(fit) = &self.fit else { return };
        let mut found = vec![0.0; self.now.len()];
        for (row, (now, begun)) in fit.values.chunks_exact(found.len()).zip(touch.frame_ohm.iter().zip(&self.begun_ohm))
        {
            let difference = now - begun;
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
        let share = -(-touch.step_s / FIT_S).exp_m1();
        self.now.iter_mut().zip(&found).for_each(|(now, found)| *now += share * (found - *now));
    }

    /// The baseline with what has drifted since.
    fn put_drift(&self, drifts: &Drifts, values_ohm: &mut [f64]) {
        values_ohm.copy_from_slice(&self.begun_ohm);
        for (drift, (now, reference)) in self.now.iter().zip(&self.reference).enumerate() {
            let change = now - reference;
            for (value, mode) in values_ohm.iter_mut().zip(drifts.modes.row(drift)) {
                *value += change * mode;
            }
        }
    }
}

/// The noise of each channel, ohm, and which are left out.
#[derive(Debug, Clone, Copy)]
pub struct Noise<'a> {
    /// Standard deviation of each channel, ohm.
    pub sd_ohm: &'a [f64],
    /// Channels that are left out.
    pub masked: &'a [bool],
}

/// A touched frame.
#[derive(Debug, Clone, Copy)]
pub struct Touch<'a> {
    /// Its values, ohm.
    pub frame_ohm: &'a [f64],
    /// Where its contacts are, m.
    pub places: &'a [Point3],
    /// When, s on the clock of the frames.
    pub time_s: f64,
    /// Since the last frame, s.
    pub step_s: f64,
}
