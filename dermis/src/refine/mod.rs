//! Contacts refined by a model of touches: their most probable places, forms, strengths and number.
//!
//! A touch changes the conductance by a density along the surface times a symmetric tensor: a capsule (a segment smeared by a
//! Gaussian), as a pin, a palm and an edge are, and three strengths, because patches under a touch carry current along some
//! directions and not along others (the tensor of a small inclusion: Ammari and Kang, 2004, DOI 10.1007/b98245). To first
//! order the frame changes by
//!
//! `g = sum over touches of e^s J [rho (I + a_1 (uu' - vv') + a_2 (uv' + vu'))]`,
//!
//! with `J` the derivative of the forward model, `rho` the density with integral 1, `u` and `v` the axes of the tangent plane.
//! The unknowns of all touches minimise
//!
//! `(f + k) ln(1 + |W (y - g)|^2 / (f + (f + k) m^2 |W y|^2 / n)) + sum of (1 + d) ln(1 + |x|^2 / s^2)`,
//!
//! with `W' W` the inverse covariance of noise and drift, `m` the least part of the change that the model of a touch leaves
//! unexplained, `n` the number of values, `k` that of their combinations that touches change. The first term is Student's
//! distribution: noise is known, the variance of the misfit as if from `0.2 n` other values, and the frame tells the rest, with
//! `f = 0.2 n (1 + n / (m^2 |W y|^2))`. Those of the logarithm of the width, the segment and the uneven tensor have one degree of
//! freedom (`d` dimensions, scale `s`): most touches are round and even, some have any form.
//! The number of touches is the most probable one, by Laplace's approximation of the probability of the frame (MacKay, 2003,
//! "Information Theory, Inference, and Learning Algorithms", chapters 27 and 28). Touches near each other become one where one of
//! any inner form is more probable, with an amount of its own on each square of its area.
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
//! assert!((contacts[0].position_m[0] - 0.03).abs() < 1e-4 && contacts[0].sd_m < 2e-3);
//! # Ok::<(), dermis::Error>(())
//! ```

mod cubes;
mod fit;
mod form;
mod free_form;
mod places;
mod responses;
#[cfg(test)]
mod tests;

use crate::contact::{Contact, DOUBT, GATE_M};
use crate::design::Body;
use crate::forward::{ForwardError, ForwardModel};
use crate::geom::Point3;
use crate::mesh::Cells;
use fit::{Fit, Fitted, Touch, UNKNOWNS};
use form::{Density, Form};
use responses::Responses;
use std::f64::consts::{LN_2, PI};
use thiserror::Error;

/// The touches of a skin.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RefineOptions {
    /// Usual width of a touch: standard deviation of its change of conductance along the surface, m; on a coarse mesh at
    /// least 0.6 of the edge length of its cells.
    pub width_m: f64,
    /// Half of all touches are wider or narrower than usual by at most this factor.
    pub width_ratio: f64,
    /// Scale of the half lengths of touches, m.
    pub length_m: f64,
    /// Scale of the uneven part of the change of conductance, over the even part.
    pub unevenness: f64,
    /// Least part of a frame's change that a touch of this form does not explain.
    pub misfit: f64,
    /// Logarithm of the odds against a touch on an untouched skin.
    pub log_odds: f64,
    /// Logarithm of the odds against one more touch where there is one.
    pub log_odds_further: f64,
    /// Edge of the squares whose conductance changes independently under a touch, m: of the contact itself, not of the model.
    pub grain_m: f64,
    /// Edge of the squares on which a touch of any form changes the conductance by amounts of their own, m.
    pub inner_form_m: f64,
    /// Standard deviation of the relative change of the coating's conductance since the untouched frames: of the whole, and at the ends
    /// of its longest side, linear along each axis.
    pub coating_drift: f64,
    /// Standard deviation of the relative change of each contact impedance since the untouched frames.
    pub contact_drift: f64,
}

impl Default for RefineOptions {
    fn default() -> Self {
        RefineOptions {
            width_m: 4e-3,
            width_ratio: 1.3,
            length_m: 4.5e-3,
            unevenness: 0.05,
            misfit: 0.14,
            log_odds: 6.0,
            log_odds_further: 4.0,
            grain_m: 3e-3,
            inner_form_m: 15e-3,
            coating_drift: 0.01,
            contact_drift: 0.1,
        }
    }
}

/// A skin on which contacts cannot be refined.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum RefineError {
    /// A mesh of tetrahedra.
    #[error("contacts are refined on skins of triangles, not in volumes: choose a method without refinement")]
    Volume,
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
    #[error("`{field}` is {value}: it must be finite and positive (0 is possible for a misfit, a grain and a drift)")]
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

/// Touches that leave more than this part of a frame's change, and more than noise and misfit, are not what changed it: contacts
/// are then kept as they were detected, with [half](DOUBT) of their confidence. Drift that leaves less of it, where
/// no touch is probable, is what changed it: there is then no contact.
const MAX_LEFT: f64 = 0.5;
/// Fewer values than this per unknown of the fit do not determine the contacts of a frame.
const VALUES_PER_UNKNOWN: usize = 4;

/// Refines contacts on one skin with one noise.
#[derive(Debug, Clone)]
pub struct Refiner {
    responses: Responses,
    options: RefineOptions,
}

impl Refiner {
    /// Prepares the responses of touches at all places of a body: of the forward model at its rest conductivity, for
    /// values with the given standard deviations, ohm. Channels whose deviation is not finite and positive are left out. An
    /// instrument that reports amplitudes must be given the signs of the model.
    ///
    /// # Errors
    /// A body on which contacts cannot be refined, invalid options, no usable channel.
    pub fn new(
        body: &Body,
        model: &ForwardModel,
        noise_ohm: &[f64],
        options: RefineOptions,
    ) -> Result<Self, RefineError> {
        let positive = [
            ("width_m", options.width_m),
            ("width_ratio", options.width_ratio.ln()),
            ("length_m", options.length_m),
            ("unevenness", options.unevenness),
            ("inner_form_m", options.inner_form_m),
        ];
        let others = [
            ("misfit", options.misfit),
            ("grain_m", options.grain_m),
            ("coating_drift", options.coating_drift),
            ("contact_drift", options.contact_drift),
        ];
        let is_wrong =
            |&(_, value): &(&str, f64), least: bool| !(value.is_finite() && (value > 0.0 || least && value == 0.0));
        let wrong = positive.into_iter().find(|option| is_wrong(option, false));
        if let Some((field, value)) = wrong.or_else(|| others.into_iter().find(|option| is_wrong(option, true))) {
            return Err(RefineError::Option { field, value });
        }
        Self::check(model)?;
        let expected = model.protocol().channel_count();
        if noise_ohm.len() != expected {
            return Err(RefineError::Length { got: noise_ohm.len(), expected });
        }
        Ok(Refiner { responses: Responses::new(body, model, noise_ohm, &options)?, options })
    }

    /// The same for a skin with another untouched frame than that of the model, ohm.
    #[must_use]
    pub(crate) fn with_rest(mut self, rest_ohm: &[f64]) -> Self {
        self.responses.set_rest(rest_ohm);
        self
    }

    /// Whether contacts can be refined on a skin.
    ///
    /// # Errors
    /// A mesh of tetrahedra.
    pub fn check(model: &ForwardModel) -> Result<(), RefineError> {
        if matches!(model.mesh().cells, Cells::Triangles(_)) { Ok(()) } else { Err(RefineError::Volume) }
    }

    /// The change of a frame by a touch at a position, round and even, with a strength (relative change of conductance times
    /// area, m2); ohm. Channels that are left out are 0.
    pub fn change(&self, position_m: Point3, strength_m2: f64) -> Vec<f64> {
        let place = self.responses.space().place(position_m);
        self.responses.change(&place, &Form::default(), [0.0; 2], strength_m2)
    }

    /// Refines contacts from the difference that they were detected in, ohm: their places and strengths, their forms,
    /// deviations and confidence. The force of a refined contact is `NaN`, as its strength is that of the fit and no longer
    /// the integral of an image.
    ///
    /// Contacts that are more probably one become one, one that is more probably two becomes two, one that is more probably
    /// none is removed, and touches that were not detected are added, at the end of the list, with ids that no detected contact
    /// has. Where touches explain less than half of the change, or none is probable, the contacts are kept as they were detected,
    /// with half of their confidence; where none is probable, and drift since the untouched frames explains
    /// more than half of it, there is none.
    ///
    /// # Panics
    /// If the difference has another length than the protocol.
    pub fn refine(&self, difference: &[f64], contacts: &mut Vec<Contact>) {
        self.refine_by_edges(difference, contacts, &|_| f64::NAN);
    }

    /// The same on a skin with edges, from the distance of a place to the nearest one, m; `NaN` where there is none.
    ///
    /// A touch that reaches beyond the edge may lose what lies there, or press it onto the skin beside the edge, as a ball does
    /// on a foam that ends. The middle of what the skin bears is then displaced by up to that of a Gaussian that is [cut
    /// off](cut_off_m). The part that is displaced is not known: it is uniform from 0 to 1, which adds to the deviation. The
    /// width is one deviation above that of the fit, which is narrow where an edge hides how wide a touch is.
    pub(crate) fn refine_by_edges(
        &self,
        difference: &[f64],
        contacts: &mut Vec<Contact>,
        edge_m: &dyn Fn(Point3) -> f64,
    ) {
        // In units of the frame's own noise, strengths too.
        let noise_ratio = self.responses.noise_ratio(difference);
        let values = self.responses.whitened(difference, noise_ratio);
        let count = self.responses.value_count() as f64;
        let most = self.responses.value_count() / (VALUES_PER_UNKNOWN * UNKNOWNS);
        if most == 0 {
            return;
        }
        // More contacts than the values determine are kept, unless drift explains the frame.
        let are_determined = contacts.len() <= most;
        let square = crate::linalg::dot(&values, &values);
        let misfit = self.options.misfit.powi(2) * square / count;
        let fit = Fit { responses: &self.responses, options: &self.options, values: &values, misfit, others: 0 };
        let start = |(index, contact): (usize, &Contact)| {
            Touch::at(self.responses.space().place(contact.position_m), Some(index))
        };
        let fitted = fit.run(contacts.iter().enumerate().filter(|_| are_determined).map(start).collect());
        let residuals = fitted.state.sum_of_squares();
        let is_unexplained = residuals > (1.0 + misfit) * count && residuals > MAX_LEFT * square;
        if fitted.state.touches.is_empty() && self.responses.left_by_drift(difference) < MAX_LEFT {
            contacts.clear();
            return;
        }
        if !are_determined {
            return;
        }
        if !contacts.is_empty() && (is_unexplained || fitted.state.touches.is_empty()) {
            contacts.iter_mut().for_each(|contact| contact.confidence *= DOUBT);
            return;
        }
        let next_id = contacts.iter().map(|contact| contact.id).max().map_or(0, |id| id + 1);
        let mut order: Vec<usize> = (0..fitted.state.touches.len()).collect();
        order.sort_by_key(|&index| fitted.state.touches[index].of.unwrap_or(usize::MAX));
        let mut new_id = next_id;
        let refined = |index: usize| {
            let contact = fitted.state.touches[index].of.map(|of| contacts[of]).unwrap_or_else(|| {
                new_id += 1;
                Contact { id: new_id - 1, ..Contact::truth([f64::NAN; 3], [f64::NAN; 3], f64::NAN) }
            });
            let contact = self.refined(contact, &fitted, index, &fit, edge_m);
            Contact { strength: noise_ratio * contact.strength, ..contact }
        };
        *contacts = order.into_iter().map(refined).collect();
        // A touch of no strength may lie anywhere on the skin.
        contacts.retain(|contact| contact.sd_m < self.responses.area_m2().sqrt());
    }

    /// A contact with the place, form, strength and deviation of a touch.
    fn refined(
        &self,
        contact: Contact,
        fitted: &Fitted,
        index: usize,
        fit: &Fit<'_>,
        edge_m: &dyn Fn(Point3) -> f64,
    ) -> Contact {
        let touch = &fitted.state.touches[index];
        let density = Density::new(&touch.form, self.responses.usual_m());
        let [along, across] = density.half_extents_m();
        let wide_m = fitted.wide(index, fit) * across / (2.0 * LN_2).sqrt();
        let shift_m = cut_off_m(wide_m, edge_m(touch.place.point_m));
        let beyond_m = if shift_m.is_finite() { shift_m / 3.0_f64.sqrt() * sd_m([1.0, 0.0, 0.0]) } else { 0.0 };
        let sd_m = sd_m(fitted.place_covariance_m2(index, fit)).hypot(beyond_m);
        let is_there = fitted.apart[index] / (1.0 + (-0.5 * fitted.odds(index, fit)).exp());
        let place = match &fitted.free[index] {
            Some(free) => self.responses.space().walk(&touch.place, free.mean_step()),
            None => touch.place,
        };
        Contact {
            position_m: place.point_m,
            normal: place.axes[2],
            strength: fitted.strength_m2(index, fit),
            // A rectangle with two half disks.
            area_m2: across * (4.0 * (along - across) + PI * across),
            direction: touch.place.vector(density.axis),
            half_length_m: along,
            half_width_m: across,
            force_n: f64::NAN,
            force_sd_n: f64::NAN,
            sd_m,
            confidence: is_there * is_near(sd_m),
            ..contact
        }
    }
}

/// By how much the mean of a Gaussian of the width `width_m` moves when what is farther than `edge_m` on one side is cut off, m: `w
/// phi(c/w) / Phi(c/w)` for the width `w` and the distance `c` (Johnson, Kotz and Balakrishnan 1994, Continuous Univariate
/// Distributions 1, 13.135). The distribution function is that of Abramowitz and Stegun (1964), 26.2.16, right to `1e-5`.
fn cut_off_m(width_m: f64, edge_m: f64) -> f64 {
    let z = edge_m / width_m;
    let density = (-0.5 * z * z).exp() / (2.0 * PI).sqrt();
    let t = 1.0 / (1.0 + 0.332_67 * z);
    width_m * density / (1.0 - density * t * (0.436_183_6 + t * (-0.120_167_6 + t * 0.937_298)))
}

/// The probability that a place is within the distance at which it counts as that of a touch.
fn is_near(sd_m: f64) -> f64 {
    1.0 - (-0.5 * (GATE_M / sd_m).powi(2)).exp()
}

/// The standard deviation per axis of a round distribution whose circle of 95 % is as large as that of a covariance (of the
/// first axis, of both, of the second); m. The squared distance has nearly a chi-square distribution with between one (a line)
/// and two degrees of freedom (Satterthwaite, 1946, DOI 10.2307/3002019), whose quantile is that of Wilson and Hilferty (1931,
/// DOI 10.1073/pnas.17.12.684).
fn sd_m([first, both, second]: [f64; 3]) -> f64 {
    const QUANTILE: f64 = 1.6449;
    let freedom = (first + second).powi(2) / (first * first + second * second + 2.0 * both * both);
    let over_mean = |freedom: f64| (1.0 - 2.0 / (9.0 * freedom) + QUANTILE * (2.0 / (9.0 * freedom)).sqrt()).powi(3);
    (0.5 * (first + second) * over_mean(freedom) / over_mean(2.0)).sqrt()
}
