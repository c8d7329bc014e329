//! What a network learns from: samples of datasets, moved by symmetries, disturbed by noise, turned into inputs and targets.

use crate::LearnError;
use crate::input::Input;
use crate::source::Source;
use crate::symmetry::{Flat, Symmetries};
use dermis::dataset::Sample;
use dermis::forward::ForwardModel;
use dermis::geom::Point3;
use dermis::image::PixelSpace;
use dermis::touch::sample_rng;
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// What a network is to make of a frame.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Target {
    /// The mean relative change of conductance of each pixel.
    Conductance,
    /// Every touch as a Gaussian of this standard deviation (m), its height the root of the touch's size: the force of a
    /// press (N), the strength of a Gaussian touch (in cm2). The image is the square of what the network makes, its sign
    /// kept.
    Touches {
        /// Standard deviation, m.
        width_m: f64,
    },
}

impl Target {
    /// What becomes of the network's output to make the image.
    pub fn image(&self, output: f32) -> f32 {
        match self {
            Target::Conductance => output,
            Target::Touches { .. } => output * output.abs(),
        }
    }
}

/// What is added to a difference before a network sees it, anew at every step.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Noise {
    /// Standard deviation of each channel's noise, ohm.
    pub sd_ohm: Vec<f32>,
    /// Each sample's noise is that times a factor between these, uniform in its logarithm.
    pub factor: [f32; 2],
    /// How far the coat's conductance drifts after the untouched frame: standard deviation of the relative change.
    pub coat_drift: f32,
    /// How far each contact's resistance drifts: standard deviation over the design's.
    pub contact_drift: f32,
}

impl Noise {
    /// White noise of given standard deviations and nothing else.
    pub fn white(sd_ohm: Vec<f32>) -> Self {
        Noise { sd_ohm, factor: [1.0, 1.0], coat_drift: 0.0, contact_drift: 0.0 }
    }
}

/// Samples to learn from, and how they become inputs and targets.
#[derive(Debug)]
pub struct Samples<'a> {
    source: Box<dyn Source + 'a>,
    symmetries: Option<Symmetries>,
    noise: Noise,
    /// What each contact's drift adds to a difference, at one standard deviation.
    contacts: Vec<Vec<f32>>,
    target: Target,
    flat: Flat,
    pixels: Vec<Point3>,
}

/// How the samples of a step are disturbed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Disturb {
    /// Not at all.
    Nothing,
    /// By noise that a seed and a step's number tell, moved by a symmetry where there are any.
    Step(u64, u64),
}

impl<'a> Samples<'a> {
    /// Samples of a source on the skin of a forward model.
    ///
    /// # Errors
    /// A contact whose drift cannot be solved.
    pub fn new(
        source: impl Source + 'a,
        forward: &ForwardModel,
        pixels: &PixelSpace,
        target: Target,
        noise: Noise,
        symmetries: Option<Symmetries>,
    ) -> Result<Self, LearnError> {
        let flat = Flat::of(&pixels.surface);
        Ok(Samples {
            source: Box::new(source),
            symmetries,
            contacts: contact_patterns(forward, noise.contact_drift)?,
            noise,
            target,
            flat,
            pixels: pixels.centres_m.iter().map(|&centre| flat.place(centre)).collect(),
        })
    }

    /// Where they come from.
    pub fn source(&self) -> &dyn Source {
        &*self.source
    }

    /// The undisturbed difference of a sample that was asked for, ohm.
    ///
    /// # Errors
    /// A file that cannot be read; a value that is not finite.
    pub fn difference(&self, number: usize) -> Result<Vec<f32>, LearnError> {
        Ok(difference(&self.source.read(number, false)?.0))
    }

    /// The variance of all values of the undisturbed targets of some samples.
    ///
    /// # Errors
    /// A file that cannot be read.
    pub fn target_variance(&self, numbers: &[usize]) -> Result<f64, LearnError> {
        self.source.prepare(numbers)?;
        let sums = |&number: &usize| -> Result<[f64; 2], LearnError> {
            let mut target = vec![0.0; self.pixels.len()];
            let (sample, is_press) = self.source.read(number, self.target == Target::Conductance)?;
            self.target(&sample, is_press, 0, &mut target);
            let values = || target.iter().map(|&value| f64::from(value));
            Ok([values().sum(), values().map(|value| value * value).sum()])
        };
        let sums = numbers.par_iter().map(sums).collect::<Result<Vec<_>, _>>()?;
        let count = (numbers.len() * self.pixels.len()) as f64;
        let [mean, square] = [0, 1].map(|at| sums.iter().map(|sums| sums[at]).sum::<f64>() / count);
        Ok(square - mean * mean)
    }

    /// The inputs and the target of a sample that was asked for.
    ///
    /// # Errors
    /// As [`difference`](Self::difference).
    pub fn fill(
        &self,
        number: usize,
        disturb: Disturb,
        input: &Input,
        inputs: &mut [f32],
        target: &mut [f32],
    ) -> Result<(), LearnError> {
        let (sample, is_press) = self.source.read(number, self.target == Target::Conductance)?;
        let mut difference = difference(&sample);
        let mut element = 0;
        if let Disturb::Step(seed, step) = disturb {
            let mut rng = sample_rng(seed, step);
            if let Some(symmetries) = &self.symmetries {
                element = rng.random_range(0..symmetries.len() as u32) as usize;
                let mut moved = vec![0.0; difference.len()];
                symmetries.frame(element, &difference, &mut moved);
                difference = moved;
            }
            self.disturb(&mut rng, element, &sample.rest, &mut difference);
        }
        input.prepare(|channel| difference[channel], inputs);
        self.target(&sample, is_press, element, target);
        Ok(())
    }

    fn disturb(&self, rng: &mut ChaCha8Rng, element: usize, rest: &[f32], difference: &mut [f32]) {
        let Noise { sd_ohm, factor: [low, high], coat_drift, .. } = &self.noise;
        let mut normal = || -> f32 { StandardNormal.sample(&mut *rng) };
        if *coat_drift > 0.0 || !self.contacts.is_empty() {
            // How long ago the untouched frame was: from just now to long.
            let ago = normal().abs().min(1.0);
            let share = ago * coat_drift * normal();
            let mut moved = vec![0.0; rest.len()];
            match &self.symmetries {
                Some(symmetries) => symmetries.frame(element, rest, &mut moved),
                None => moved.copy_from_slice(rest),
            }
            difference.iter_mut().zip(&moved).for_each(|(value, rest)| *value += share * rest);
            for pattern in &self.contacts {
                let share = ago * normal();
                difference.iter_mut().zip(pattern).for_each(|(value, of_one)| *value += share * of_one);
            }
        }
        let factor = low * (high / low).powf(rng.random::<f32>());
        for (value, sd) in difference.iter_mut().zip(sd_ohm) {
            let deviate: f32 = StandardNormal.sample(&mut *rng);
            *value += factor * sd * deviate;
        }
    }

    fn target(&self, sample: &Sample, is_press: bool, element: usize, target: &mut [f32]) {
        let Target::Touches { width_m } = self.target else { return target.copy_from_slice(&sample.image) };
        target.fill(0.0);
        for &[x, y, z, _, force, strength] in &sample.touches {
            let mut place = [x, y, z].map(f64::from);
            if let Some(symmetries) = &self.symmetries {
                place = symmetries.point(element, place);
            }
            let place = self.flat.place(place);
            let height = if is_press { force } else { strength * 1e4 }.sqrt();
            let per = -0.5 / (width_m * width_m);
            for (value, &pixel) in target.iter_mut().zip(&self.pixels) {
                let exponent = per * self.flat.square_distance(place, pixel);
                if exponent > -16.0 {
                    *value += height * (exponent as f32).exp();
                }
            }
        }
    }
}

/// What the touches of a sample changed, ohm.
fn difference(sample: &Sample) -> Vec<f32> {
    sample.frame.iter().zip(&sample.rest).map(|(touched, rest)| touched - rest).collect()
}

/// For each contact what a resistance of its own, a share of the design's in series with it, adds to the untouched frame.
fn contact_patterns(forward: &ForwardModel, share: f32) -> Result<Vec<Vec<f32>>, LearnError> {
    if share == 0.0 {
        return Ok(Vec::new());
    }
    let network = forward.solver().network(forward.rest_conductivity()).map_err(dermis::Error::from)?;
    let frame = |network: &dermis::forward::Network| {
        let mut frame = vec![0.0; forward.protocol().channel_count()];
        network.frame_into(forward.protocol(), &mut frame);
        frame
    };
    let rest = frame(&network);
    let impedances = forward.contact_impedances().iter().enumerate();
    let contacts_ohm: Vec<f64> =
        impedances.map(|(electrode, impedance)| impedance / forward.mesh().electrode_size(electrode)).collect();
    let pattern = |electrode: usize| -> Result<Vec<f32>, LearnError> {
        let mut series = vec![0.0; contacts_ohm.len()];
        series[electrode] = f64::from(share) * contacts_ohm[electrode];
        let changed = network.clone().with_series(&series).map_err(dermis::Error::from)?;
        Ok(frame(&changed).iter().zip(&rest).map(|(one, rest)| (one - rest) as f32).collect())
    };
    (0..contacts_ohm.len()).map(pattern).collect()
}
