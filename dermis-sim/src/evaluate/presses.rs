//! Scores of real presses whose positions are known only in a robot's frame.

use crate::evaluate::EvaluateError;
use crate::evaluate::align::{Alignment, distance};
use crate::evaluate::matching::match_contacts;
use crate::evaluate::score::Score;
use dermis::contact::Contact;
use dermis::design::TouchEffect;
use dermis::detect::{Detector, whole_image_centroid};
use dermis::forward::ForwardModel;
use dermis::frame::{EvaluatedPress, Frame, PressEstimate, Screening};
use dermis::geom::vector::Point3;
use dermis::geom::{Point2, Surface};
use dermis::image::{Image, PixelSpace};
use dermis::reconstruct::{Alpha, Linearised, OneStep, OneStepOptions, Prior, Reconstruct};
use dermis::stats::Summary;
use rand::SeedableRng;
use rand::seq::index::sample;
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use serde::Serialize;
use std::sync::Arc;

/// The options among which the presses for alignment choose.
#[derive(Debug, Clone)]
pub struct AlignOptions {
    /// Priors to choose from.
    pub priors: Vec<Prior>,
    /// Alphas to choose from.
    pub alphas: Vec<Alpha>,
    /// Limits of outliers, in robust standard deviations of their channel, to choose from.
    pub limits_sd: Vec<f64>,
    /// The detection options.
    pub detector: Detector,
    /// The sign of the conductance change under touch.
    pub touch: TouchEffect,
    /// Channels that are known to be broken, in addition to the result of the screening.
    pub left_out: Vec<usize>,
    /// Rules for excluding other channels, to choose from.
    pub screens: Vec<Screen>,
}

/// A rule for excluding channels, without labels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Screen {
    /// Those that disagree with their reciprocal channels.
    Disagreeing,
    /// Those whose polarity the instrument cannot measure ([`Screening::polarity_blind`]).
    PolarityBlind,
}

/// A method to choose from, and its alpha if it has one.
pub type AlignMethod = (Box<dyn Reconstruct>, Option<f64>);

impl AlignOptions {
    /// NOSER with the exponents 0.25 and 0.5 (with larger ones the small clipped pixels at the rim have too large
    /// values), alphas from 2 to 16 by factors of two, no outlier limit and two; the default detection options.
    /// Channels that disagree with their twins are excluded; excluding `polarity_blind` channels does not improve the
    /// linear method.
    pub fn new(touch: TouchEffect) -> Self {
        AlignOptions {
            priors: [0.25, 0.5].map(|exponent| Prior::Noser { exponent }).to_vec(),
            alphas: [2.0, 4.0, 8.0, 16.0].map(Alpha::Given).to_vec(),
            limits_sd: vec![f64::INFINITY, 3.0, 2.0],
            detector: Detector::default(),
            touch,
            left_out: Vec::new(),
            screens: vec![Screen::Disagreeing],
        }
    }
}

/// The results of one method for every press, in the skin's frame.
#[derive(Debug, Clone)]
struct Candidate {
    method: String,
    limit_sd: f64,
    left_out: Vec<usize>,
    alpha: Option<f64>,
    /// All contacts of each press, the strongest first.
    contacts: Vec<Vec<Contact>>,
    /// The mean of the contacts weighted by their strength, as one press made them all; without a contact the centroid
    /// of the whole image.
    places: Vec<Point2>,
    /// The centroid of the whole image.
    centroids: Vec<Point2>,
}

/// The results of some methods for every press of an experiment, before the alignment of the skin is known.
#[derive(Debug, Clone)]
pub struct PressEstimates {
    candidates: Vec<Candidate>,
}

/// Presses scored after alignment; serialised to the JSON output of `dermis evaluate --align --json`.
#[derive(Debug, Clone, Serialize)]
pub struct Aligned {
    /// The score of the other presses. Every press is scored, one without a contact by the centroid of the whole image:
    /// `localisation_m` has no gate; misses and false_positives count contacts as in other scores.
    #[serde(flatten)]
    pub score: Score,
    /// The alignment of the skin.
    pub alignment: Alignment,
    /// Number of presses for alignment.
    pub aligned_by: usize,
    /// Excluded channels: those known to be broken, and those that disagree with their twins, or are `polarity_blind`.
    pub left_out: Vec<usize>,
    /// The limit of outliers, in robust standard deviations of their channel; infinite (in JSON `null`) for no limit.
    #[serde(rename = "cut_sd")]
    pub limit_sd: f64,
    /// The presses scored: index, true position and estimated position, in the robot's frame.
    #[serde(skip)]
    pub places: Vec<(usize, Point2, Point2)>,
}

impl Aligned {
    /// The presses that were scored, of all presses, in the robot's frame. An estimate has the height of its press.
    pub fn evaluated(&self, presses: &[Point3]) -> Vec<EvaluatedPress> {
        let one = |&(row, truth_m, [x, y]): &(usize, Point2, Point2)| {
            let at = |position_m: Point3| Contact::truth(position_m, [0.0, 0.0, 1.0], f64::NAN);
            let contact = Contact { confidence: f64::NAN, ..at([x, y, presses[row][2]]) };
            let estimate = PressEstimate::new(contact, (x - truth_m[0]).hypot(y - truth_m[1]));
            EvaluatedPress { row, truth: at(presses[row]), estimate: Some(estimate) }
        };
        self.places.iter().map(one).collect()
    }
}

impl PressEstimates {
    /// Screens the channels of the differences, without labels, and detects the contacts of every press by every
    /// method.
    ///
    /// # Errors
    /// A skin that is not flat, options out of their range, differences of the wrong length.
    ///
    /// # Panics
    /// If there is no prior, alpha, limit or screen to choose from.
    pub fn new(
        forward: &ForwardModel,
        pixels: &Arc<PixelSpace>,
        differences: &[Frame],
        options: &AlignOptions,
    ) -> crate::Result<Self> {
        let choices = [options.priors.len(), options.alphas.len(), options.limits_sd.len(), options.screens.len()];
        assert!(!choices.contains(&0), "a prior, an alpha, a limit and a screen to choose from");
        let model = Linearised::new(forward, pixels)?;
        Self::by(forward, pixels, differences, options, |cut, left_out| {
            let mut methods: Vec<AlignMethod> = Vec::new();
            for &prior in &options.priors {
                for &alpha in &options.alphas {
                    let one_step = OneStepOptions {
                        prior,
                        alpha,
                        touch: options.touch,
                        excluded: left_out.to_vec(),
                        examples: if matches!(alpha, Alpha::LCurve | Alpha::Gcv) { cut.to_vec() } else { Vec::new() },
                        ..OneStepOptions::default()
                    };
                    let method = OneStep::from_linearised(&model, Arc::clone(pixels), &one_step)?;
                    let alpha = method.alpha();
                    methods.push((Box::new(method), Some(alpha)));
                }
            }
            Ok(methods)
        })
    }

    /// The same for any methods: `methods` prepares them for limited differences and excluded channels, once for every
    /// limit and each screen of the options.
    ///
    /// # Errors
    /// A skin that is not flat, differences of the wrong length, the errors of `methods`.
    pub fn by<E: From<crate::Error>>(
        forward: &ForwardModel,
        pixels: &PixelSpace,
        differences: &[Frame],
        options: &AlignOptions,
        mut methods: impl FnMut(&[Frame], &[usize]) -> Result<Vec<AlignMethod>, E>,
    ) -> Result<Self, E> {
        if pixels.surface != Surface::Plane {
            return Err(crate::Error::from(EvaluateError::NotFlat).into());
        }
        let screening = Screening::of(differences, forward.protocol());
        let untouched = forward.solve(forward.rest_conductivity()).map_err(crate::Error::from)?;
        let left_out = |screen: &Screen| {
            let mut channels = match screen {
                Screen::Disagreeing => screening.disagreeing.clone(),
                Screen::PolarityBlind => screening.polarity_blind(forward.protocol(), &untouched),
            };
            channels.extend(&options.left_out);
            channels.sort_unstable();
            channels.dedup();
            channels
        };
        let screened: Vec<Vec<usize>> = options.screens.iter().map(left_out).collect();
        let mut candidates = Vec::new();
        for &limit_sd in &options.limits_sd {
            let cut: Vec<Frame> = differences.iter().map(|difference| screening.cut(difference, limit_sd)).collect();
            for left_out in &screened {
                for (method, alpha) in methods(&cut, left_out)? {
                    let found = Candidate::new(&*method, &cut, &options.detector)?;
                    candidates.push(Candidate { limit_sd, alpha, left_out: left_out.clone(), ..found });
                }
            }
        }
        Ok(PressEstimates { candidates })
    }

    /// The mean errors, m, after alignments by a few presses, for a number of random draws (draw `i` depends only on
    /// `i`); ascending.
    ///
    /// # Errors
    /// As [`align`](Self::align).
    pub fn align_by_few(&self, presses: &[Point3], few: usize, draws: u64) -> Result<Vec<f64>, EvaluateError> {
        if few >= presses.len() {
            return Err(EvaluateError::NothingToScore { align: few, presses: presses.len() });
        }
        let mean = |draw: u64| {
            let drawn = sample(&mut ChaCha8Rng::seed_from_u64(draw), presses.len(), few).into_vec();
            Ok(self.align(presses, &drawn)?.score.localisation_m.mean)
        };
        let mut means = (0..draws).into_par_iter().map(mean).collect::<Result<Vec<f64>, EvaluateError>>()?;
        means.sort_by(f64::total_cmp);
        Ok(means)
    }

    /// Aligns by the presses `align_by`, which also choose the method with the smallest remaining mean distance, and
    /// scores all others.
    ///
    /// # Errors
    /// A frame that does not have exactly one press, a press that is not finite, fewer than three positions for
    /// alignment, no press left to score.
    pub fn align(&self, presses: &[Point3], align_by: &[usize]) -> Result<Aligned, EvaluateError> {
        let frames = self.candidates[0].places.len();
        if presses.len() != frames {
            return Err(EvaluateError::Count { images: frames, truths: presses.len() });
        }
        if let Some(press) = presses.iter().position(|press| !press.iter().all(|value| value.is_finite())) {
            return Err(EvaluateError::Press { press, position: presses[press] });
        }
        let mut held_back = vec![false; frames];
        for &press in align_by {
            let slot = held_back.get_mut(press);
            *slot.ok_or(EvaluateError::NoSuchPress { press, presses: frames })? = true;
        }
        let scored: Vec<usize> = (0..frames).filter(|&press| !held_back[press]).collect();
        if scored.is_empty() {
            return Err(EvaluateError::NothingToScore { align: align_by.len(), presses: frames });
        }
        let mut best: Option<(&Candidate, Alignment)> = None;
        for candidate in &self.candidates {
            let alignment = fit(&candidate.places, presses, align_by)?;
            if best.is_none_or(|(_, best)| alignment.residual_m < best.residual_m) {
                best = Some((candidate, alignment));
            }
        }
        let (candidate, alignment) = best.expect("there is a prior and an alpha");
        let score = candidate.score(presses, align_by, &scored, &alignment)?;
        let place =
            |&press: &usize| (press, [presses[press][0], presses[press][1]], alignment.apply(candidate.places[press]));
        Ok(Aligned {
            alignment,
            limit_sd: candidate.limit_sd,
            aligned_by: align_by.len(),
            left_out: candidate.left_out.clone(),
            score,
            places: scored.iter().map(place).collect(),
        })
    }
}

fn fit(places: &[Point2], presses: &[Point3], align_by: &[usize]) -> Result<Alignment, EvaluateError> {
    let estimates: Vec<Point2> = align_by.iter().map(|&press| places[press]).collect();
    let presses: Vec<Point2> = align_by.iter().map(|&press| [presses[press][0], presses[press][1]]).collect();
    Alignment::fit(&estimates, &presses)
}

impl Candidate {
    fn new(method: &dyn Reconstruct, differences: &[Frame], detector: &Detector) -> Result<Self, crate::Error> {
        let found = |difference: &Frame| -> crate::Result<(Vec<Contact>, Point2)> {
            let image: Image = method.reconstruct(difference)?;
            // Without a positive value in the image, the centre of the skin is the best estimate.
            let [x, y, _] = whole_image_centroid(&image).unwrap_or_default();
            Ok((detector.detect(&image), [x, y]))
        };
        let (contacts, centroids): (Vec<_>, Vec<_>) =
            differences.par_iter().map(found).collect::<crate::Result<Vec<_>>>()?.into_iter().unzip();
        let place = |(contacts, &centroid): (&Vec<Contact>, &Point2)| {
            let total: f64 = contacts.iter().map(|contact| contact.strength).sum();
            let mean = |axis: usize| {
                contacts.iter().map(|contact| contact.strength * contact.position_m[axis]).sum::<f64>() / total
            };
            if contacts.is_empty() { centroid } else { [mean(0), mean(1)] }
        };
        let places = contacts.iter().zip(&centroids).map(place).collect();
        let (limit_sd, left_out, alpha) = (f64::INFINITY, Vec::new(), None);
        Ok(Candidate { method: method.name(), limit_sd, left_out, alpha, contacts, places, centroids })
    }

    fn score(
        &self,
        presses: &[Point3],
        align_by: &[usize],
        scored: &[usize],
        alignment: &Alignment,
    ) -> Result<Score, EvaluateError> {
        let flat = |press: usize| [presses[press][0], presses[press][1]];
        let of_centroids = fit(&self.centroids, presses, align_by)?;
        let (mut misses, mut false_positives) = (0, 0);
        for &press in scored {
            let [x, y] = flat(press);
            let touch = Contact::truth([x, y, 0.0], [0.0, 0.0, 1.0], f64::NAN);
            let moved =
                |contact: &Contact| Contact { position_m: alignment.apply_to_point(contact.position_m), ..*contact };
            let contacts: Vec<Contact> = self.contacts[press].iter().map(moved).collect();
            let found = match_contacts(&[touch], &contacts, &Surface::Plane);
            misses += found.missed.len();
            false_positives += found.false_positives.len();
        }
        let errors = |places: &[Point2], alignment: &Alignment| {
            let error = |&press: &usize| distance(alignment.apply(places[press]), flat(press));
            Summary::of(&scored.iter().map(error).collect::<Vec<f64>>())
        };
        Ok(Score {
            presses: scored.len(),
            misses,
            false_positives,
            localisation_m: errors(&self.places, alignment),
            eq11_m: errors(&self.centroids, &of_centroids),
            sensitivity_spread: f64::NAN,
            strength_spread: f64::NAN,
            force: None,
            method: self.method.clone(),
            alpha: self.alpha,
        })
    }
}
