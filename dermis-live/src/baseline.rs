//! The untouched frame, and how it follows what drifts.
//!
//! Where nothing touches, the baseline follows the frame itself. Under a touch it follows only what drifts in the ways that
//! a coat and its contacts do: the coat's conductance as a whole and along each axis, and each electrode's contact. How much
//! of these is in a frame is fitted together with the touch (least squares with a prior variance for each), and only what
//! changes from the beginning of the touch counts, so that a long press does not fade.

use crate::skin::LiveSkin;
use dermis::forward::Matrix;
use dermis::geom::Point3;
use dermis::geom::vector::centroid;
use dermis::linalg::invert_spd;
use serde::{Deserialize, Serialize};

/// Time constant at which the untouched baseline follows the frame, s: slower than any press comes up, faster than a coat
/// warms.
const FOLLOW_S: f64 = 10.0;
/// Time constant of what is fitted under a touch, s.
const FIT_S: f64 = 2.0;
/// The touch must have stayed where it is for so long before drift is fitted beside it, s.
const SETTLE_S: f64 = 1.0;
/// From there on for so long the fit is averaged: what it says is no drift, s.
const REFERENCE_S: f64 = 0.5;
/// A contact that moves farther than this is another touch, m.
const MOVED_M: f64 = 0.005;
/// Pixels so near a contact may have changed by it, m.
const REACH_M: f64 = 0.035;
/// Standard deviation of the relative change of a touched pixel.
const TOUCH_SD: f64 = 0.5;
/// Standard deviation of the relative drift of a coat.
const COAT_SD: f64 = 0.03;
/// Standard deviation of the drift of a contact's resistance, relative to itself, and at least, ohm.
const CONTACT_SD: f64 = 0.5;
const CONTACT_LEAST_OHM: f64 = 0.5;

/// The ways in which the frame of a skin drifts.
#[derive(Debug, Clone)]
pub struct Drifts {
    /// What each changes in a frame for one standard deviation of it, drifts x channels, ohm.
    modes: Matrix,
}

impl Drifts {
    /// Of a skin: its coat as a whole and along each axis, then each electrode's contact.
    pub fn of(skin: &LiveSkin) -> Self {
        let channel_count = skin.design.protocol.channel_count();
        let extent_m = extent_m(&skin.pixels.centres_m);
        let mut modes: Vec<Vec<f64>> = Vec::new();
        let shapes: [Box<dyn Fn(Point3) -> f64>; 4] = [
            Box::new(|_| 1.0),
            Box::new(|[x, _, _]| x / extent_m),
            Box::new(|[_, y, _]| y / extent_m),
            Box::new(|[_, _, z]| z / extent_m),
        ];
        let centre = centroid(&skin.pixels.centres_m);
        for shape in shapes {
            let weights: Vec<f64> = (skin.pixels.centres_m.iter())
                .map(|place| COAT_SD * shape([0, 1, 2].map(|axis| place[axis] - centre[axis])))
                .map(|weight| if weight.is_finite() { weight } else { 0.0 })
                .collect();
            let mode =
                |channel: usize| skin.linear.jacobian.row(channel).iter().zip(&weights).map(|(j, w)| j * w).sum();
            // The constant shape is the coat as a whole; a body without extent along an axis has no such mode.
            modes.push((0..channel_count).map(mode).collect());
        }
        for electrode in 0..skin.design.electrodes.len() {
            let sd_ohm = (CONTACT_SD * skin.contact_ohm(electrode)).max(CONTACT_LEAST_OHM);
            // The voltage of an electrode that a current leaves through differs from the coat's below by its contact's.
            modes.push(skin.contact_gains(electrode).map(|gain| sd_ohm * gain).collect());
        }
        let values: Vec<f64> = modes.iter().flatten().copied().collect();
        Drifts { modes: Matrix { rows: modes.len(), columns: channel_count, values } }
    }
}

/// Half of the longest side of the box round some places, m.
fn extent_m(places: &[Point3]) -> f64 {
    let side = |axis: usize| {
        let (low, high) = places.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), place| {
            (low.min(place[axis]), high.max(place[axis]))
        });
        0.5 * (high - low)
    };
    side(0).max(side(1)).max(side(2)).max(f64::MIN_POSITIVE)
}

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
    /// From a frame's difference to the drifts in it, drifts x channels; empty until the touch has settled.
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
    pub fn hold(&mut self, skin: &LiveSkin, drifts: &Drifts, noise: Noise<'_>, touch: Touch<'_>) {
        let surface = &skin.pixels.surface;
        let stays = |hold: &Hold| {
            let near = |(a, b): (&Point3, &Point3)| surface.distance_m(*a, *b) <= MOVED_M;
            hold.places.len() == touch.places.len() && hold.places.iter().zip(touch.places).all(near)
        };
        if !self.hold.as_ref().is_some_and(stays) {
            self.hold = Some(Hold {
                places: touch.places.to_vec(),
                since_s: touch.time_s,
                begun_ohm: self.values_ohm.clone(),
                fit: None,
                reference: vec![0.0; drifts.modes.rows],
                reference_frames: 0.0,
                now: vec![0.0; drifts.modes.rows],
            });
            return;
        }
        let Some(hold) = &mut self.hold else { return };
        let held_s = touch.time_s - hold.since_s;
        if held_s < SETTLE_S || touch.places.is_empty() {
            return;
        }
        let fit = hold.fit.get_or_insert_with(|| fit(skin, drifts, noise, &hold.places));
        let begun = &hold.begun_ohm;
        let difference: Vec<f64> = touch.frame_ohm.iter().zip(begun).map(|(now, begun)| now - begun).collect();
        let found = |drift: usize| fit.row(drift).iter().zip(&difference).map(|(a, b)| a * b).sum::<f64>();
        if held_s < SETTLE_S + REFERENCE_S {
            hold.reference_frames += 1.0;
            for (drift, reference) in hold.reference.iter_mut().enumerate() {
                *reference += (found(drift) - *reference) / hold.reference_frames;
            }
            hold.now.copy_from_slice(&hold.reference);
            return;
        }
        let share = -(-touch.step_s / FIT_S).exp_m1();
        for (drift, now) in hold.now.iter_mut().enumerate() {
            *now += share * (found(drift) - *now);
        }
        self.values_ohm.copy_from_slice(begun);
        for (drift, (now, reference)) in hold.now.iter().zip(&hold.reference).enumerate() {
            let change = now - reference;
            for (value, mode) in self.values_ohm.iter_mut().zip(drifts.modes.row(drift)) {
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
    pub silent: &'a [bool],
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

/// The map from a difference to the drifts in it, fitted together with changes of the pixels near the contacts: the rows of
/// `(A' W A + 1)^-1 A' W` that belong to drifts, with the columns of `A` for one standard deviation each and
/// `W` the inverse variances of the noise.
fn fit(skin: &LiveSkin, drifts: &Drifts, noise: Noise<'_>, places: &[Point3]) -> Matrix {
    let (jacobian, pixels) = (&skin.linear.jacobian, &skin.pixels);
    let reached = |pixel: &usize| {
        places.iter().any(|&place| pixels.surface.distance_m(place, pixels.centres_m[*pixel]) <= REACH_M)
    };
    let touched: Vec<usize> = (0..pixels.len()).filter(reached).collect();
    let (drift_count, channel_count) = (drifts.modes.rows, jacobian.rows);
    let count = drift_count + touched.len();
    // Columns of A over the deviations of the noise, one after another.
    let mut columns = Matrix::zeros(count, channel_count);
    for (row, values) in columns.values.chunks_exact_mut(channel_count).enumerate() {
        for (channel, value) in values.iter_mut().enumerate().filter(|(channel, _)| !noise.silent[*channel]) {
            let effect = match row.checked_sub(drift_count) {
                None => drifts.modes.at(row, channel),
                Some(pixel) => TOUCH_SD * jacobian.at(channel, touched[pixel]),
            };
            *value = effect / noise.sd_ohm[channel];
        }
    }
    let mut gram = Matrix::zeros(count, count);
    for i in 0..count {
        for j in 0..=i {
            let product: f64 = columns.row(i).iter().zip(columns.row(j)).map(|(a, b)| a * b).sum();
            *gram.at_mut(i, j) = product;
            *gram.at_mut(j, i) = product;
        }
        *gram.at_mut(i, i) += 1.0;
    }
    let mut fit = Matrix::zeros(drift_count, channel_count);
    // The ones on the diagonal keep it positive definite, if the noise is finite.
    let Ok(gram) = invert_spd(&gram) else { return fit };
    for drift in 0..drift_count {
        let row = fit.row_mut(drift);
        for other in 0..count {
            let weight = gram.at(drift, other);
            for (channel, value) in row.iter_mut().enumerate() {
                *value += weight * columns.at(other, channel);
            }
        }
        row.iter_mut().zip(noise.sd_ohm).for_each(|(value, sd)| *value /= sd);
    }
    fit
}
