//! The score of an experiment.

use crate::evaluate::EvaluateError;
use crate::evaluate::matching::match_contacts;
use dermis::contact::Contact;
use dermis::detect::{Detector, whole_image_centroid};
use dermis::geom::Surface;
use dermis::image::Image;
use dermis::stats::{ForceErrors, Summary, coefficient_of_variation};
use serde::Serialize;

/// Scores of a method in an experiment; serialised to the JSON output of `dermis evaluate --json`.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Score {
    /// Number of true touches.
    pub presses: usize,
    /// Touches without a contact within the gate.
    pub misses: usize,
    /// Contacts without a touch within the gate.
    pub false_positives: usize,
    /// Distance along the surface between touches and their contacts, over all pairs within the gate, m.
    pub localisation_m: Summary,
    /// Distance of the whole image's centroid (the paper's Eq. 11) from the touch, over all frames with one touch, m.
    pub eq11_m: Summary,
    /// Standard deviation over mean of the image's peak per newton (the paper's Eq. 12), over all frames with one touch
    /// of known force; `NaN` (in JSON `null`) if there are none.
    pub sensitivity_spread: f64,
    /// Standard deviation over mean of the contact's strength per newton, over the pairs of frames with one touch of known
    /// force; `NaN` (in JSON `null`) if there are none.
    pub strength_spread: f64,
    /// Forces of the contacts against those of their touches; `None` (in JSON `null`) if either are not known.
    pub force: Option<ForceErrors>,
    /// The method's name.
    pub method: String,
    /// Its alpha, if it has one.
    pub alpha: Option<f64>,
}

impl Score {
    /// A hint for the user if no contact was detected in any frame; `None` otherwise. An example is a network with too
    /// little training, whose images never exceed the threshold that follows from its own noise.
    pub fn advice(&self) -> Option<&'static str> {
        let found_none = self.presses > 0 && self.misses == self.presses && self.false_positives == 0;
        found_none.then_some(
            "no contact was found in any frame: the images never exceed the detection threshold, which follows from their noise; \
             train a network longer (more samples or epochs), or press harder",
        )
    }
}

/// Scores images against the true touches of their frames.
///
/// # Errors
/// A number of images that differs from the number of frames of the ground truth.
pub fn score(
    images: &[Image],
    truth: &[Vec<Contact>],
    detector: &Detector,
    method: &str,
    alpha: Option<f64>,
) -> Result<Score, EvaluateError> {
    let contacts: Vec<Vec<Contact>> = images.iter().map(|image| detector.detect(image)).collect();
    score_contacts(images, &contacts, truth, method, alpha)
}

/// [`score`] of contacts that were already detected, a list for each image.
///
/// # Errors
/// As [`score`].
pub fn score_contacts(
    images: &[Image],
    contacts: &[Vec<Contact>],
    truth: &[Vec<Contact>],
    method: &str,
    alpha: Option<f64>,
) -> Result<Score, EvaluateError> {
    if images.len() != truth.len() {
        return Err(EvaluateError::Count { images: images.len(), truths: truth.len() });
    }
    let (mut misses, mut false_positives) = (0, 0);
    let (mut distances, mut eq11, mut sensitivities) = (Vec::new(), Vec::new(), Vec::new());
    let (mut strengths, mut force_ratios) = (Vec::new(), Vec::new());
    for ((image, contacts), touches) in images.iter().zip(contacts).zip(truth) {
        let surface = &image.space.surface;
        let found = match_contacts(touches, contacts, surface);
        misses += found.missed.len();
        false_positives += found.false_positives.len();
        distances.extend(found.pairs.iter().map(|pair| pair.2));
        let ratios = found.pairs.iter().map(|&(touch, contact, _)| contacts[contact].force_n / touches[touch].force_n);
        force_ratios.extend(ratios.filter(|ratio| ratio.is_finite()));
        if let [touch] = touches[..] {
            eq11.extend(whole_image_centroid(image).map(|centre| surface.distance_m(centre, touch.position_m)));
            let peak = image.peak().map_or(f64::NAN, |(_, value)| value);
            let known_force = |value: f64| Some(value / touch.force_n).filter(|_| touch.force_n > 0.0);
            sensitivities.extend(known_force(peak));
            strengths.extend(found.pairs.iter().filter_map(|pair| known_force(contacts[pair.1].strength)));
        }
    }
    Ok(Score {
        presses: truth.iter().map(Vec::len).sum(),
        misses,
        false_positives,
        localisation_m: Summary::of(&distances),
        eq11_m: Summary::of(&eq11),
        sensitivity_spread: coefficient_of_variation(&sensitivities),
        strength_spread: coefficient_of_variation(&strengths),
        force: ForceErrors::of(&force_ratios),
        method: method.to_string(),
        alpha,
    })
}

/// Whether two touches were resolved: exactly two contacts, each within 10 mm of its touch and within a third of the
/// touches' distance from each other.
pub fn resolves_two(touches: &[Contact; 2], contacts: &[Contact], surface: &Surface) -> bool {
    const NEAR_M: f64 = 0.01;
    let apart = surface.distance_m(touches[0].position_m, touches[1].position_m);
    let found = match_contacts(touches, contacts, surface);
    contacts.len() == 2 && found.pairs.len() == 2 && found.pairs.iter().all(|pair| pair.2 <= NEAR_M.min(apart / 3.0))
}
