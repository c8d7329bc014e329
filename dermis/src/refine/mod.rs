//! Contacts refined by maximum likelihood: the positions at which touches explain a frame best.
//!
//! A touch of strength `q` at a place `p` changes the frame by `q (g(p) + t laplace g(p))`, to first order in the
//! change of conductance: `g` is the Jacobian of the forward model, averaged with a Gaussian of the width `w` of a usual
//! touch, and `t = (w'^2 - w^2) / 2` accounts for one of another width `w'` (heat equation). Places, strengths and
//! widths of all touches of a frame minimise
//!
//! `|W (y - sum_i q_i (g(p_i) + t_i laplace g(p_i)))|^2 + sum_i (t_i / s)^2`,
//!
//! with `W' W` the inverse covariance of noise and drift and `s` the standard deviation of `t` (Levenberg-Marquardt steps
//! from the detected contacts; Kay, 1993, "Fundamentals of Statistical Signal Processing: Estimation Theory", section 7.7).
//! The inverse of the normal matrix is the covariance due to noise and drift, which for those of that size is the
//! Cramer-Rao bound.
//!
//! ```
//! use dermis::contact::Contact;
//! use dermis::design::SkinDesign;
//! use dermis::forward::ForwardModel;
//! use dermis::mesh::Mesh;
//! use dermis::refine::{RefineOptions, Refiner};
//!
//! let mut design = SkinDesign::shipped("tank16").expect("a shipped design");
//! design.mesh = design.mesh.scaled(2.0);
//! let model = ForwardModel::new(&design, &Mesh::generate(&design)?)?;
//! let noise_ohm = vec![1e-3; model.protocol().channel_count()];
//! let refiner = Refiner::new(&design.body, &model, &noise_ohm, RefineOptions::default())?;
//! let change = refiner.change([0.03, 0.02, 0.0], 1e-4); // a touch of 100 mm2 there, ohm
//! let mut contacts = vec![Contact::truth([0.027, 0.023, 0.0], [0.0, 0.0, 1.0], f64::NAN)];
//! refiner.refine(&change, &mut contacts);
//! assert!((contacts[0].position_m[0] - 0.03).abs() < 1e-5 && contacts[0].sd_m < 2e-3);
//! # Ok::<(), dermis::Error>(())
//! ```

mod axis;
mod fit;
mod table;
#[cfg(test)]
mod tests;

use crate::contact::Contact;
use crate::design::Body;
use crate::forward::{ForwardError, ForwardModel};
use crate::geom::{Point3, Surface};
use crate::mesh::Cells;
use fit::{Fit, Fitted, LEAST_APART_M, Touch};
use std::f64::consts::{LN_2, TAU};
use table::ResponseTable;
use thiserror::Error;

/// The touches of a skin.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RefineOptions {
    /// Standard deviation of a touch's change of conductance along the surface, m; on a coarse mesh at least 0.6 of the
    /// edge length of its cells.
    pub width_m: f64,
    /// Standard deviation of `(w'^2 - w^2) / 2` over touches of different widths `w'`, and of their oblong forms, m2.
    pub width_spread_m2: f64,
    /// Standard deviation per axis of the centre of a touch's change of conductance about the place that is pressed, m.
    pub offset_sd_m: f64,
    /// Standard deviation of the relative change of the whole coating's conductance since the untouched frames.
    pub coating_drift: f64,
    /// Standard deviation of the relative change of each contact impedance since the untouched frames.
    pub contact_drift: f64,
}

impl Default for RefineOptions {
    /// A ball of 10 mm under 1 to 5 N on patches of 8 to 12 mm under thin foam: the width at which positions on clean
    /// frames of an even twin are best, with the range of widths of contacts under these forces; and the offset of the
    /// contact, which lies under the patches and not in their gaps.
    fn default() -> Self {
        RefineOptions {
            width_m: 3e-3,
            width_spread_m2: 3e-6,
            offset_sd_m: 6e-4,
            coating_drift: 0.01,
            contact_drift: 0.1,
        }
    }
}

/// A skin on which contacts cannot be refined.
#[derive(Debug, Error)]
pub enum RefineError {
    /// A body without a chart.
    #[error("contacts are refined on cylinders and flat skins of triangles alone: choose a method without refinement")]
    NoChart,
    /// An instrument without signs.
    #[error(
        "contacts are not refined from frames without signs (`amplitude_only`): choose a method without refinement"
    )]
    AmplitudeOnly,
    /// A list of another length than the protocol.
    #[error("there are {got} standard deviations, but the protocol has {expected} channels")]
    Length {
        /// Number of deviations.
        got: usize,
        /// Channels of the protocol.
        expected: usize,
    },
    /// No usable channel.
    #[error("no channel has a finite and positive standard deviation: give untouched frames with their noise")]
    NoChannel,
    /// Options out of their range.
    #[error("`{field}` is {value}: it must be finite and positive (0 is possible for an offset and a drift)")]
    Option {
        /// The field.
        field: &'static str,
        /// Its value.
        value: f64,
    },
    /// A forward problem without a solution.
    #[error(transparent)]
    Forward(#[from] ForwardError),
}

/// A contact that moves farther than this in a fit that does not explain the frame is another one, or none: it is kept as it
/// was detected, m. It is the gate of the scores.
const FARTHEST_M: f64 = 0.02;
/// At most this many touches are added to those detected.
const MOST_ADDED: usize = 3;
/// Fewer values than this per unknown of the fit do not determine the contacts of a frame.
const VALUES_PER_UNKNOWN: usize = 4;

/// Refines contacts on one skin with one noise.
#[derive(Debug, Clone)]
pub struct Refiner {
    surface: Surface,
    table: ResponseTable,
    options: RefineOptions,
}

impl Refiner {
    /// Prepares the responses of touches at all places of a body: of the forward model at its rest conductivity, for
    /// values with the given standard deviations, ohm. Channels whose deviation is not finite and positive are left out.
    ///
    /// # Errors
    /// A body or protocol on which contacts cannot be refined, invalid options, no usable channel.
    pub fn new(
        body: &Body,
        model: &ForwardModel,
        noise_ohm: &[f64],
        options: RefineOptions,
    ) -> Result<Self, RefineError> {
        let RefineOptions { width_m, width_spread_m2, offset_sd_m, coating_drift, contact_drift } = options;
        for (field, value) in [("width_m", width_m), ("width_spread_m2", width_spread_m2)] {
            if !(value > 0.0 && value.is_finite()) {
                return Err(RefineError::Option { field, value });
            }
        }
        for (field, value) in
            [("offset_sd_m", offset_sd_m), ("coating_drift", coating_drift), ("contact_drift", contact_drift)]
        {
            if !(value >= 0.0 && value.is_finite()) {
                return Err(RefineError::Option { field, value });
            }
        }
        Self::check(body, model)?;
        let expected = model.protocol().channel_count();
        if noise_ohm.len() != expected {
            return Err(RefineError::Length { got: noise_ohm.len(), expected });
        }
        let table = ResponseTable::new(body, model, noise_ohm, &options)?;
        Ok(Refiner { surface: body.surface(), table, options })
    }

    /// Whether contacts can be refined on a skin.
    ///
    /// # Errors
    /// A body without a chart, an instrument without signs.
    pub fn check(body: &Body, model: &ForwardModel) -> Result<(), RefineError> {
        if body.surface() == Surface::Free || !matches!(model.mesh().cells, Cells::Triangles(_)) {
            return Err(RefineError::NoChart);
        }
        if model.protocol().amplitude_only() { Err(RefineError::AmplitudeOnly) } else { Ok(()) }
    }

    /// The change of a frame by a touch at a position, of the usual width, with a strength (relative change of
    /// conductance times area, m2); ohm. Channels that are left out are 0.
    pub fn change(&self, position_m: Point3, strength_m2: f64) -> Vec<f64> {
        self.table.change(self.table.place(position_m), strength_m2)
    }

    /// Refines the positions and strengths of contacts from the difference that they were detected in, ohm, and states
    /// the standard deviations of the positions. The force of a refined contact is `NaN`, as its strength is that of the
    /// fit and no longer the integral of an image.
    ///
    /// - A contact without which the others explain the frame as well is removed.
    /// - One that is far better explained as two touches gets a second one, with the area of both together.
    /// - A touch that explains most of what the contacts leave is added, wherever it is: where electrodes are disconnected,
    ///   images miss touches.
    /// - A contact that does not fit the frame is left as it is, unless another one is there: one with a negative strength, or
    ///   that would move by more than 20 mm although the frame is not explained.
    ///
    /// The stated deviations contain noise, drift, the forms of the touches and what touches on the same patches share.
    /// New contacts are at the end of the list, with ids that no detected contact has.
    ///
    /// # Panics
    /// If the difference has another length than the protocol.
    pub fn refine(&self, difference: &[f64], contacts: &mut Vec<Contact>) {
        let values = self.table.whitened(difference);
        let fit = Fit { table: &self.table, values: &values, width_spread_m2: self.options.width_spread_m2 };
        let mut starts: Vec<Start> = contacts.iter().map(|contact| self.detected(contact)).collect();
        let places: Vec<[f64; 2]> = starts.iter().map(|start| start.place).collect();
        let Some(mut fitted) = fit.run(&places) else { return };
        let mut next_id = contacts.iter().map(|contact| contact.id).max().map_or(0, |id| id + 1);
        let mut new = |contact: Contact, touch: &Touch| {
            next_id += 1;
            Start { contact: Contact { id: next_id - 1, ..contact }, place: touch.place, is_new: true }
        };
        let prune = |starts: &mut Vec<Start>, fitted: &mut Fitted| {
            while let Some((index, fewer)) = fit.without_excess(fitted) {
                starts.remove(index);
                *fitted = fewer;
            }
        };
        prune(&mut starts, &mut fitted);
        if let Some((index, two)) = fit.split(&fitted) {
            // Either may be far from where both were detected as one.
            starts[index].place = two.touches[index].place;
            starts.extend(two.touches.last().map(|touch| new(starts[index].contact, touch)));
            fitted = two;
        }
        for _ in 0..MOST_ADDED {
            let Some(more) = fit.added(&fitted) else { break };
            starts.extend(more.touches.last().map(|touch| new(self.unseen(touch), touch)));
            fitted = more;
            prune(&mut starts, &mut fitted);
        }
        let is_explained = fit.is_explained(&fitted);
        let fits = |(start, touch): (&Start, &Touch)| {
            let moved_m = self.table.distance_m(touch.place, start.place);
            touch.strength > 0.0 && touch.sd_m(0.0).is_finite() && (is_explained || moved_m <= FARTHEST_M)
        };
        let fits: Vec<bool> = starts.iter().zip(&fitted.touches).map(fits).collect();
        // Where another contact is now, none is kept as it was detected.
        let is_taken = |place: [f64; 2]| {
            let mut others = fitted.touches.iter().zip(&fits).filter(|(_, fits)| **fits);
            others.any(|(other, _)| self.table.distance_m(other.place, place) < LEAST_APART_M)
        };
        let refined = |((start, touch), fits): ((Start, &Touch), &bool)| match fits {
            true => Some(self.refined(start.contact, touch)),
            false => (!start.is_new && !is_taken(start.place)).then_some(start.contact),
        };
        *contacts = starts.into_iter().zip(&fitted.touches).zip(&fits).filter_map(refined).collect();
    }

    fn detected(&self, contact: &Contact) -> Start {
        Start { contact: *contact, place: self.table.place(contact.position_m), is_new: false }
    }

    /// A contact that was not detected, where a touch explains the frame.
    fn unseen(&self, touch: &Touch) -> Contact {
        let position_m = self.table.position_m(touch.place);
        let normal = self.surface.normal(position_m).unwrap_or_default();
        let far = FARTHEST_M / touch.sd_m(self.options.offset_sd_m);
        Contact {
            area_m2: TAU * LN_2 * self.table.width_m().powi(2),
            confidence: 1.0 - (-0.5 * far * far).exp(),
            ..Contact::truth(position_m, normal, f64::NAN)
        }
    }

    /// A contact with the place, strength and deviation of a touch.
    fn refined(&self, contact: Contact, touch: &Touch) -> Contact {
        let position_m = self.table.position_m(touch.place);
        Contact {
            position_m,
            normal: self.surface.normal(position_m).unwrap_or(contact.normal),
            strength: touch.strength,
            force_n: f64::NAN,
            force_sd_n: f64::NAN,
            sd_m: touch.sd_m(self.options.offset_sd_m),
            ..contact
        }
    }
}

/// A contact before it is refined, and its place in the chart.
struct Start {
    contact: Contact,
    place: [f64; 2],
    /// Whether the fit has found it.
    is_new: bool,
}
