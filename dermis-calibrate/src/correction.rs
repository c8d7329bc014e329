//! Correction of the contacts of another method by measured presses.

use crate::calibration::Label;
use crate::covariance::matern;
use crate::error::CalibrateError;
use crate::gaussian_process::{GaussianProcess, Group, Input};
use crate::located::{REGION_SHARE, limit};
use crate::matching;
use crate::strength::{
    ForceLaw, UnusedForces, force_range, force_within, has_force, ratio_spread, relative_deviation, relative_error,
};
use dermis::contact::Contact;
use dermis::detect::Detector;
use dermis::files::sha256;
use dermis::frame::Frame;
use dermis::geom::vector::distance;
use dermis::geom::{Point3, Surface};
use dermis::image::PixelSpace;
use dermis::method::Method;
use dermis::stats::{mean, mean_and_sd, quantile, rms, sorted};
use dermis::text::hexadecimal;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::collections::BTreeSet;

/// Fewest presses that the method must find.
pub(crate) const MIN_FOUND: usize = 20;
/// A contact further from the label is not that press, m.
const GATE_M: f64 = dermis::contact::GATE_M;
/// Typical length over which errors of a method vary, as a part of the size of the skin.
pub(crate) const LENGTH_PART: f64 = 0.1;
/// A place is among labels up to this many times their median distance from each other: of labels at random places of one density,
/// one place in 500 is farther from the nearest one.
const AMONG: f64 = 3.0;

/// What measured presses state of the contacts of another method (a network, or a linear one): a shift of the position
/// that varies over the skin, the force as a function of the strength, the frame and the position, and the deviations
/// of both.
///
/// Each is a Gaussian process over the estimated position. The method keeps what it does best: several contacts at
/// once, and its rate.
///
/// ```
/// use dermis::frame::Frame;
/// use dermis::method::{MethodOptions, Methods};
/// use dermis::skin::Skin;
/// use dermis_calibrate::{CalibrateError, Correction};
///
/// let skin = Skin::load("skin16")?;
/// let method = Methods::linear().method(&skin, "noser", &MethodOptions::default())?;
/// let detector = method.detector(&[], &skin.design().protocol)?;
/// let untouched = Frame(vec![0.0; skin.design().protocol.channel_count()]);
/// // Without presses there is nothing to correct.
/// let fit = Correction::fit(skin.pixels(), &method, &detector, &[untouched], &[]);
/// assert!(matches!(fit, Err(CalibrateError::TooFewFound { found: 0, .. })));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Correction {
    /// Name of the corrected method.
    pub(crate) method: String,
    /// The checksum of the card of the corrected method, if it has one: a network that is trained again is another method.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    card_sha256: Option<String>,
    /// Shift along the two directions of the [chart](Surface::chart), m; `None` where no shift lowers the
    /// cross-validated error.
    shift_m: Option<[GaussianProcess; 2]>,
    /// Standard deviation of a position over the stated one.
    sd_factor: f64,
    force: Option<ForceCorrection>,
    quality: CorrectionQuality,
    /// Where there were labels; `None` in a correction of before this was stored.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    labelled: Option<Labelled>,
    /// The untouched frame of the labels, ohm, if it is known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) rest: Option<Frame>,
}

/// The part of a skin that labels describe.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct Labelled {
    /// The contacts of the labels, m.
    places_m: Vec<Point3>,
    /// Places up to this distance from the nearest of them are among them, m.
    among_m: f64,
    /// The length over which errors vary beyond it, m.
    length_m: f64,
}

impl Labelled {
    fn new(found: &[Found], length_m: f64) -> Self {
        let mut places_m: Vec<Point3> = Vec::new();
        let mut known = BTreeSet::new();
        places_m.extend(found.iter().filter(|one| known.insert(one.group().place)).map(|one| one.contact.position_m));
        let gaps_m = sorted((0..places_m.len()).map(|own| {
            let others = (0..places_m.len()).filter(|&other| other != own);
            others.map(|other| distance(places_m[own], places_m[other])).fold(f64::INFINITY, f64::min)
        }));
        let among_m = if gaps_m.len() > 1 { AMONG * quantile(&gaps_m, 0.5) } else { 0.0 };
        Labelled { places_m, among_m, length_m }
    }

    /// How much the labels say of a place: 1 among them, 0 far from them.
    fn weight(&self, place_m: Point3) -> f64 {
        let nearest_m = self.places_m.iter().map(|other| distance(*other, place_m)).fold(f64::INFINITY, f64::min);
        matern((nearest_m - self.among_m).max(0.0) / self.length_m)
    }
}

/// Forces from contacts.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct ForceCorrection {
    /// Logarithm of the force of the only contact of a frame.
    single: GaussianProcess,
    /// Logarithm of the force of one of several contacts: the size of the frame is not known for each.
    several: GaussianProcess,
    /// Relative standard deviation.
    relative_sd: f64,
    /// The median of the stated deviations of the labels' positions, m: where the place of a contact is less certain, as at an
    /// edge, so is its force.
    #[serde(default)]
    usual_sd_m: Option<f64>,
    /// Range of the logarithm: that of the labels, and a [factor](force_range) on each side.
    range: [f64; 2],
}

/// By how much the relative deviation of a force exceeds the usual one, from the deviation of the position.
fn less_certain(sd_m: f64, usual_sd_m: Option<f64>) -> f64 {
    usual_sd_m.map_or(1.0, |usual_sd_m| (sd_m / usual_sd_m).max(1.0))
}

/// What cross-validation on the labels, of which those at one place are left out together, states of a correction.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct CorrectionQuality {
    /// Labelled presses.
    pub labels: usize,
    /// Labels that the method found.
    pub found: usize,
    /// Labels whose frames have contacts, but none within [`GATE_M`](dermis::contact::GATE_M).
    #[serde(default)]
    pub elsewhere: usize,
    /// Length of the mean of the vectors from the contacts to their labels, without the correction, m: what a wrong origin of
    /// the labels gives all of them alike. `None` in a correction of before this was stored.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub common_shift_m: Option<f64>,
    /// Mean error of the position without the correction, m.
    pub mean_error_before_m: f64,
    /// Mean error of labels that the correction had not seen, m.
    pub mean_error_m: f64,
    /// Mean errors without and with the correction of all labels, m; one that the method does not find counts as
    /// [`GATE_M`](dermis::contact::GATE_M). `None` in a correction of before this was stored.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub with_misses_m: Option<[f64; 2]>,
    /// By how many standard deviations the labels are nearer to the strongest contacts of their own frames, without the
    /// correction, than those of a random order; `None` for too few labels, and in a correction of before this was stored.
    pub evidence: Option<f64>,
    /// Mean relative error of the force, where forces are known.
    pub force_error: Option<f64>,
    /// Standard deviation over mean of the estimated over the true force.
    pub force_spread: Option<f64>,
}

/// A label and its contact.
struct Found {
    contact: Contact,
    label: Label,
    frame: usize,
}

impl Correction {
    /// Fits the correction of a method to labelled frames (differences from the untouched skin). The labels are in the
    /// skin's own coordinates; `detector` is that of the method.
    ///
    /// # Errors
    /// Fewer than 20 labels that the method finds; a method that fails on a frame.
    pub fn fit(
        pixels: &PixelSpace,
        method: &Method,
        detector: &Detector,
        frames: &[Frame],
        labels: &[Label],
    ) -> Result<Self, CalibrateError> {
        let surface = &pixels.surface;
        let Searched { found, elsewhere, evidence } = find(surface, method, detector, frames, labels)?;
        let groups: Vec<Group> = found.iter().map(Found::group).collect();
        let presses = distinct(&groups);
        if presses < MIN_FOUND {
            let error_m = |one: &Found| surface.distance_m(one.contact.position_m, one.label.position_m);
            let errors_m: Vec<f64> = found.iter().map(error_m).collect();
            return Err(CalibrateError::TooFewFound {
                method: method.name().into(),
                found: presses,
                labels: labels.len(),
                uncalibrated_m: with_misses(&errors_m, labels.len()),
            });
        }
        let length_m = LENGTH_PART * size_m(pixels);
        let errors_m: Vec<[f64; 2]> =
            found.iter().map(|one| surface.chart(one.contact.position_m, one.label.position_m)).collect();
        let places: Vec<Input> =
            found.iter().map(|one| Input { position_m: one.contact.position_m, features: Vec::new() }).collect();
        let fit = |axis: usize| {
            let values: Vec<f64> = errors_m.iter().map(|error| error[axis]).collect();
            GaussianProcess::fit(&places, &values, &groups, length_m)
        };
        let ((u, left_u), (v, left_v)) = (fit(0)?, fit(1)?);
        let shifted_m: Vec<f64> = left_u.iter().zip(&left_v).map(|(u, v)| u.hypot(*v)).collect();
        let before_m: Vec<f64> = errors_m.iter().map(|[u, v]| u.hypot(*v)).collect();
        let mean_along = |axis: usize| mean(&errors_m.iter().map(|error| error[axis]).collect::<Vec<f64>>());
        let helps = mean(&shifted_m) < mean(&before_m);
        let left_m = if helps { shifted_m } else { before_m.clone() };
        let force = ForceCorrection::fit(&found, frames, length_m)?;
        let quality = CorrectionQuality {
            labels: labels.len(),
            found: found.len(),
            elsewhere,
            common_shift_m: Some(mean_along(0).hypot(mean_along(1))),
            mean_error_before_m: mean(&before_m),
            mean_error_m: mean(&left_m),
            with_misses_m: Some([&before_m, &left_m].map(|errors_m| with_misses(errors_m, labels.len()))),
            evidence,
            force_error: force.as_ref().map(|(_, left)| relative_error(left)),
            force_spread: force.as_ref().map(|(_, left)| ratio_spread(left)),
        };
        Ok(Correction {
            method: method.name().into(),
            card_sha256: card_sha256(method),
            shift_m: helps.then_some([u, v]),
            sd_factor: match method.reconstruct().is_adaptable() {
                // The deviations of refined contacts are those of each place: most labels are far from edges, where they are small.
                true => sd_factor(&found, &left_m).max(1.0),
                false => sd_factor(&found, &left_m),
            },
            force: force.map(|(force, _)| force),
            quality,
            labelled: Some(Labelled::new(&found, length_m)),
            rest: None,
        })
    }

    /// Why the forces of its labels are not used; `None` where they are, or where no label has one.
    pub(crate) fn unused_forces(&self, labels: &[Label]) -> Option<UnusedForces> {
        if !has_force(labels) || self.quality.force_error.is_some() {
            return None;
        }
        let known: Vec<Label> = labels.iter().filter(|label| label.force_n > 0.0).copied().collect();
        Some(match ForceLaw::log_forces(&known) {
            _ if known.len().min(self.quality.found) < MIN_FOUND => UnusedForces::TooFewFound,
            Err(reason) => reason,
            Ok(_) => UnusedForces::Unrelated,
        })
    }

    /// What cross-validation states.
    pub fn quality(&self) -> &CorrectionQuality {
        &self.quality
    }

    /// The cross-validated mean error of all labels, where those that were not found count as the gate, m.
    pub(crate) fn with_misses_m(&self) -> f64 {
        self.quality.with_misses_m.map_or(self.quality.mean_error_m, |[_, after_m]| after_m)
    }

    /// Whether a method is the corrected one, as it was at the fit.
    pub(crate) fn is_of(&self, method: &Method) -> bool {
        self.card_sha256.is_none() || self.card_sha256 == card_sha256(method)
    }

    /// Name of the corrected method.
    pub fn method(&self) -> &str {
        &self.method
    }

    /// Relative standard deviation of the forces, where they are known.
    pub(crate) fn relative_force_sd(&self) -> Option<f64> {
        self.force.as_ref().map(|force| force.relative_sd)
    }

    /// Whether it was stored whole.
    pub(crate) fn is_consistent(&self) -> bool {
        let force = |force: &ForceCorrection| {
            force.single.is_consistent(SINGLE_FEATURES)
                && force.several.is_consistent(SEVERAL_FEATURES)
                && force.range[0] <= force.range[1]
                && force.usual_sd_m.is_none_or(|usual_sd_m| usual_sd_m > 0.0)
        };
        self.shift_m.iter().flatten().all(|shift| shift.is_consistent(0))
            && self.force.as_ref().is_none_or(force)
            && self.labelled.as_ref().is_none_or(|labelled| labelled.length_m > 0.0 && labelled.among_m >= 0.0)
            && self.sd_factor > 0.0
    }

    /// Corrects the contacts of a difference.
    pub(crate) fn apply(&self, surface: &Surface, difference: &[f64], contacts: &mut [Contact]) {
        let several = contacts.len() > 1;
        for contact in contacts {
            if let Some(force) = &self.force {
                let log = match several {
                    true => force.several.predict(&several_input(contact)),
                    false => force.single.predict(&single_input(contact, difference)),
                };
                let relative_sd = force.relative_sd * less_certain(contact.sd_m, force.usual_sd_m);
                [contact.force_n, contact.force_sd_n] = force_within(log, force.range, relative_sd);
            }
            // Far from the labels the contacts are those of the method, and a shift as near the labels is not known.
            let weight = self.labelled.as_ref().map_or(1.0, |labelled| labelled.weight(contact.position_m));
            let mut unknown_m = 0.0;
            if let Some(shift_m) = &self.shift_m {
                let place = Input { position_m: contact.position_m, features: Vec::new() };
                let shift_m = [0, 1].map(|axis| shift_m[axis].predict(&place));
                unknown_m = (1.0 - weight * weight).sqrt() * shift_m[0].hypot(shift_m[1]);
                contact.position_m = surface.walk(contact.position_m, shift_m.map(|shift_m| weight * shift_m));
                contact.normal = surface.normal(contact.position_m).unwrap_or(contact.normal);
            }
            let sd_factor = weight * self.sd_factor + (1.0 - weight) * self.sd_factor.max(1.0);
            contact.sd_m = (sd_factor * contact.sd_m).hypot(unknown_m / 2f64.sqrt());
        }
    }
}

impl ForceCorrection {
    /// The correction, and what the logarithm of each force leaves unexplained where its place was left out; `None` without forces,
    /// or where their mean says as much.
    fn fit(found: &[Found], frames: &[Frame], length_m: f64) -> Result<Option<(Self, Vec<f64>)>, CalibrateError> {
        let known: Vec<&Found> = found.iter().filter(|one| one.label.force_n > 0.0).collect();
        let groups: Vec<Group> = known.iter().map(|one| one.group()).collect();
        if distinct(&groups) < MIN_FOUND {
            return Ok(None);
        }
        let labels: Vec<Label> = known.iter().map(|one| one.label).collect();
        let Ok(logs) = ForceLaw::log_forces(&labels) else { return Ok(None) };
        let single: Vec<Input> = known.iter().map(|one| single_input(&one.contact, &frames[one.frame])).collect();
        let several: Vec<Input> = known.iter().map(|one| several_input(&one.contact)).collect();
        let (single, left) = GaussianProcess::fit(&single, &logs, &groups, length_m)?;
        // Whatever else they say, frames grow with the force.
        if rms(left.iter().copied()) >= mean_and_sd(&logs).1 || single.slope() <= 0.0 {
            return Ok(None);
        }
        let (several, _) = GaussianProcess::fit(&several, &logs, &groups, length_m)?;
        let range = force_range(&logs);
        let sd_m = sorted(known.iter().map(|one| one.contact.sd_m).filter(|sd_m| sd_m.is_finite()));
        let usual_sd_m = (!sd_m.is_empty()).then(|| quantile(&sd_m, 0.5)).filter(|usual_sd_m| *usual_sd_m > 0.0);
        let usual = |(one, left): (&&Found, &f64)| left / less_certain(one.contact.sd_m, usual_sd_m);
        let relative_sd = relative_deviation(&known.iter().zip(&left).map(usual).collect::<Vec<f64>>());
        Ok(Some((ForceCorrection { single, several, relative_sd, usual_sd_m, range }, left)))
    }
}

/// The checksum of the card of a method, if it has one, hexadecimal.
fn card_sha256(method: &Method) -> Option<String> {
    method.card().map(|card| hexadecimal(&sha256(card.as_bytes())))
}

/// Number of different presses.
fn distinct(groups: &[Group]) -> usize {
    groups.iter().collect::<BTreeSet<_>>().len()
}

impl Found {
    /// Labels at one place are left out together; those of one place and force are of one press.
    fn group(&self) -> Group {
        // No instrument tells places apart that are nearer than this.
        const PLACE_M: f64 = 1e-4;
        let place = self.label.position_m.map(|value| (value / PLACE_M).round() as i64 as u64);
        Group { place, key: self.label.force_n.to_bits() }
    }
}

/// The mean of the errors of labels, where those that were not found count as the gate, m.
fn with_misses(errors_m: &[f64], labels: usize) -> f64 {
    (errors_m.iter().sum::<f64>() + (labels - errors_m.len()) as f64 * GATE_M) / labels as f64
}

/// What a method finds of labels.
struct Searched {
    /// Those that it finds, each with the nearest contact.
    found: Vec<Found>,
    /// Number of those whose frames have contacts elsewhere only.
    elsewhere: usize,
    /// The [evidence](matching::evidence) of all that have a contact, of the strongest one: the nearest one would make any label
    /// fit.
    evidence: Option<f64>,
}

/// Searches the contacts of the labels' frames.
fn find(
    surface: &Surface,
    method: &Method,
    detector: &Detector,
    frames: &[Frame],
    labels: &[Label],
) -> Result<Searched, CalibrateError> {
    let contacts = |label: &Label| {
        let mut contacts = method.contacts(&frames[label.row], detector).map_err(dermis::Error::from)?;
        contacts.retain(|contact| contact.strength > 0.0);
        Ok((contacts, *label))
    };
    let contacts = labels.par_iter().map(contacts).collect::<Result<Vec<_>, CalibrateError>>()?;
    let strongest = |(contacts, label): &(Vec<Contact>, Label)| {
        let strongest = contacts.iter().max_by(|a, b| a.strength.total_cmp(&b.strength));
        strongest.map(|contact| (contact.position_m, label.position_m))
    };
    let (estimates_m, labels_m): (Vec<Point3>, Vec<Point3>) = contacts.iter().filter_map(strongest).unzip();
    let nearest = |(contacts, label): (Vec<Contact>, Label)| {
        let apart = |contact: &Contact| surface.distance_m(contact.position_m, label.position_m);
        let nearest = contacts.into_iter().min_by(|a, b| apart(a).total_cmp(&apart(b)));
        nearest.filter(|contact| apart(contact) <= GATE_M).map(|contact| Found { contact, label, frame: label.row })
    };
    let evidence = matching::evidence(&estimates_m, &labels_m, std::slice::from_ref(&(0..labels_m.len())));
    let found: Vec<Found> = contacts.into_iter().filter_map(nearest).collect();
    Ok(Searched { elsewhere: estimates_m.len() - found.len(), found, evidence })
}

/// Number of features of a force.
const SINGLE_FEATURES: usize = 6;
const SEVERAL_FEATURES: usize = 2;

/// Strength of the contact, and norms of the frame: they weigh weak and strong channels differently, and patches that
/// saturate change their ratio.
fn single_input(contact: &Contact, difference: &[f64]) -> Input {
    let positive = |value: f64| value.max(f64::MIN_POSITIVE).ln();
    let sizes = || difference.iter().map(|value| value.abs());
    let square = positive(sizes().map(|size| size * size).sum::<f64>().sqrt());
    let strength = positive(contact.strength);
    let features = vec![
        strength,
        strength * strength,
        square,
        square * square,
        positive(sizes().sum()),
        positive(sizes().fold(0.0, f64::max)),
    ];
    Input { position_m: contact.position_m, features }
}

fn several_input(contact: &Contact) -> Input {
    let strength = contact.strength.max(f64::MIN_POSITIVE).ln();
    Input { position_m: contact.position_m, features: vec![strength, strength * strength] }
}

/// The factor on the stated deviations with which 95 % of the regions contain the true position.
fn sd_factor(found: &[Found], left_m: &[f64]) -> f64 {
    let ratios = found.iter().zip(left_m).map(|(one, left_m)| (left_m / one.contact.sd_m).powi(2));
    let ratios = sorted(ratios.filter(|ratio| ratio.is_finite()));
    if ratios.is_empty() { 1.0 } else { (quantile(&ratios, 0.95) / limit(REGION_SHARE)).sqrt().max(1e-3) }
}

/// The diagonal of the bounding box of the skin.
pub(crate) fn size_m(pixels: &PixelSpace) -> f64 {
    pixels.box_m().iter().map(|[low, high]| (high - low).powi(2)).sum::<f64>().sqrt()
}
