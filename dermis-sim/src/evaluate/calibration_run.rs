//! Contacts of known touches in simulated frames, to measure the errors of their positions and forces.

use crate::dataset::{Generator, Sample, SampleTouch};
use crate::evaluate::{GainFit, match_contacts};
use crate::noise::Noise;
use crate::random::sample_rng;
use dermis::contact::Contact;
use dermis::detect::{DetectOptions, Detector, ImageNoise, Misplacement};
use dermis::frame::Frame;
use dermis::reconstruct::Reconstruct;
use rayon::prelude::*;
use std::ops::Range;

/// Noise levels for simulated touches, in turn, dB: from a bench to a moving body.
pub(crate) const NOISE_DB: [f64; 4] = [54.0, 50.0, 46.0, 42.0];
/// Number of noise frames from which the noise of a method's images is estimated if the method has no matrix; the
/// relative standard error is 1 / sqrt(2 * 400), 4 %.
const NOISE_FRAMES: u64 = 400;
/// The random stream of the noise, separate from those of the samples.
const NOISE_STREAM: u64 = 1 << 60;

/// Contacts detected by a method in simulated touches.
#[derive(Debug, Clone, Default)]
pub struct CalibrationRun {
    /// Each contact that was matched with a touch.
    pub misplacements: Vec<Misplacement>,
    /// Number of true touches.
    pub touches: usize,
    /// Number of contacts without a touch.
    pub false_positives: usize,
    /// The fit of the images to those of the generator.
    pub images: GainFit,
}

impl CalibrationRun {
    /// Adds noise to the samples of a generator, 54, 50, 46 and 42 dB in turn, and detects their contacts by a
    /// method. `on_sample` is called after every sample, from several threads.
    ///
    /// # Errors
    /// Samples that cannot be generated; a method that fails.
    pub fn of(
        method: &dyn Reconstruct,
        detection: &DetectOptions,
        generator: &Generator,
        samples: Range<u64>,
        on_sample: impl Fn() + Sync,
    ) -> crate::Result<Self> {
        let protocol = generator.forward().protocol();
        let rest = generator.stream(samples.start).next().expect("samples have no end")?.rest;
        let rest = Frame(rest.iter().map(|value| f64::from(*value)).collect());
        let levels = NOISE_DB.map(|snr_db| Noise::at_snr_db(snr_db, &rest, protocol, f64::INFINITY));
        let levels = levels.into_iter().collect::<Result<Vec<Noise>, _>>()?;
        let detector = |noise: &Noise| {
            Ok(Detector::new(detection.clone()).with_noise(image_noise(method, noise.sd_ohm, rest.len())?))
        };
        let detectors = levels.iter().map(detector).collect::<crate::Result<Vec<Detector>>>()?;
        let (_, drives) = protocol.drives();
        let seed = generator.recipe().seed;
        let one = |sample: Sample| -> crate::Result<CalibrationRun> {
            let level = sample.index as usize % levels.len();
            let frame = Frame(sample.frame.iter().map(|value| f64::from(*value)).collect());
            let rest = Frame(sample.rest.iter().map(|value| f64::from(*value)).collect());
            let noisy = levels[level].apply(&frame, &drives, &mut sample_rng(seed, NOISE_STREAM + sample.index));
            let image = method.reconstruct(&(&noisy - &rest))?;
            let mut run = CalibrationRun { touches: sample.touches.len(), ..CalibrationRun::default() };
            let target: Vec<f64> = sample.image.iter().map(|value| f64::from(*value)).collect();
            run.images.add(&image.values, &target);
            let found = detectors[level].detect_under(&image, 1.0);
            let contacts: Vec<Contact> = found.iter().map(|(contact, _)| *contact).collect();
            let place = |touch: &SampleTouch| {
                let force_n = touch.force_n().map_or(f64::NAN, f64::from);
                Contact::truth(touch.centre_m.map(f64::from), [f64::NAN; 3], force_n)
            };
            let touches: Vec<Contact> = sample.touches.iter().map(place).collect();
            let matched = match_contacts(&touches, &contacts, &image.space.surface);
            run.false_positives = matched.false_positives.len();
            let (count, is_shared) = (touches.len(), !matched.missed.is_empty());
            let misplacement = |&(touch, index, error_m): &(usize, usize, f64)| {
                let (contact, circumstances) = found[index];
                let (force_n, stated_m) = (touches[touch].force_n, contact.sd_m);
                let newtons_per_strength = force_n / contact.strength;
                Misplacement {
                    circumstances,
                    touches: count,
                    is_shared,
                    stated_m,
                    error_m,
                    force_n,
                    newtons_per_strength,
                }
            };
            run.misplacements = matched.pairs.iter().map(misplacement).collect();
            on_sample();
            Ok(run)
        };
        let all: Vec<u64> = samples.collect();
        // Whole units of samples, so that no thread generates a skin for only a part of one.
        let part = |indices: &[u64]| {
            let stream = generator.stream(indices[0]).take(indices.len());
            stream
                .map(|sample| one(sample?))
                .try_fold(CalibrationRun::default(), |sum, run| Ok::<_, crate::Error>(sum.with(run?)))
        };
        let parts = all.par_chunks(64).map(part).collect::<crate::Result<Vec<CalibrationRun>>>()?;
        Ok(parts.into_iter().fold(CalibrationRun::default(), CalibrationRun::with))
    }

    /// Merges two runs.
    #[must_use]
    pub fn with(mut self, other: CalibrationRun) -> Self {
        self.misplacements.extend(other.misplacements);
        self.touches += other.touches;
        self.false_positives += other.false_positives;
        self.images.merge(&other.images);
        self
    }
}

/// The noise of a method's images from the noise of every value of a frame, ohm.
fn image_noise(method: &dyn Reconstruct, sd_ohm: f64, channels: usize) -> crate::Result<ImageNoise> {
    if let Some(matrix) = method.matrix() {
        return Ok(ImageNoise::from_matrix(matrix, &vec![sd_ohm; matrix.columns]));
    }
    let noise = Noise { sd_ohm, reference_ohm: f64::INFINITY };
    let image = |index: u64| {
        let values = noise.readings(0, channels, &mut sample_rng(0, NOISE_STREAM + index)).values_ohm;
        Ok(method.reconstruct(&Frame(values))?)
    };
    let images = (0..NOISE_FRAMES).into_par_iter().map(image).collect::<crate::Result<Vec<_>>>()?;
    Ok(ImageNoise::from_untouched(&images).expect("there are images"))
}
