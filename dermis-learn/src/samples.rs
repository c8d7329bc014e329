//! What a network learns from: samples of datasets, moved by symmetries, disturbed by noise, turned into inputs and targets.

use crate::LearnError;
use crate::input::Input;
use crate::symmetry::{Flat, Symmetries};
use dermis::dataset::Dataset;
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
    datasets: &'a [Dataset],
    /// Numbers of the samples: dataset and sample.
    numbers: Vec<(usize, u64)>,
    symmetries: Option<Symmetries>,
    noise: Noise,
    /// What each contact's drift adds to a difference, at one standard deviation.
    contacts: Vec<Vec<f32>>,
    target: Target,
    flat: Flat,
    pixels: Vec<Point3>,
    channels: usize,
}

/// Which samples of each dataset.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Part {
    /// All.
    All,
    /// All but the last thirtieth.
    Training,
    /// The last thirtieth.
    Test,
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
    /// The samples of some datasets of one design.
    ///
    /// # Errors
    /// A dataset of another design or mesh, or without a sample; a contact whose drift cannot be solved.
    pub fn new(
        datasets: &'a [Dataset],
        part: Part,
        forward: &ForwardModel,
        pixels: &PixelSpace,
        target: Target,
        noise: Noise,
        symmetries: Option<Symmetries>,
    ) -> Result<Self, LearnError> {
        let mut numbers = Vec::new();
        for (index, dataset) in datasets.iter().enumerate() {
            let wrong = |message: String| LearnError::Data { folder: dataset.folder().to_path_buf(), message };
            let mesh = &dataset.manifest().record.mesh.hash;
            if *mesh != forward.mesh().hash() {
                return Err(wrong(format!("made on the mesh {mesh}, not on this design's: simulate it anew")));
            }
            let count = dataset.len();
            let held_out = (count / 30).max(1);
            if count < 2 {
                return Err(wrong("a single sample: none is left to test by".into()));
            }
            numbers.extend(
                match part {
                    Part::All => 0..count,
                    Part::Training => 0..count - held_out,
                    Part::Test => count - held_out..count,
                }
                .map(|sample| (index, sample)),
            );
        }
        let flat = Flat::of(&pixels.surface);
        Ok(Samples {
            datasets,
            numbers,
            symmetries,
            contacts: contact_patterns(forward, noise.contact_drift)?,
            noise,
            target,
            flat,
            pixels: pixels.centres_m.iter().map(|&centre| flat.place(centre)).collect(),
            channels: forward.protocol().channel_count(),
        })
    }

    /// Number of samples.
    pub fn len(&self) -> usize {
        self.numbers.len()
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.numbers.is_empty()
    }

    /// The undisturbed difference of a sample, ohm.
    ///
    /// # Errors
    /// A file that cannot be read; a value that is not finite.
    pub fn difference(&self, index: usize) -> Result<Vec<f32>, LearnError> {
        Ok(self.read(index)?.1)
    }

    /// The variance of all values of the undisturbed targets.
    ///
    /// # Errors
    /// A file that cannot be read.
    pub fn target_variance(&self) -> Result<f64, LearnError> {
        let sums = |index: usize| -> Result<[f64; 2], LearnError> {
            let mut target = vec![0.0; self.pixels.len()];
            self.target(index, 0, &mut target)?;
            let values = || target.iter().map(|&value| f64::from(value));
            Ok([values().sum(), values().map(|value| value * value).sum()])
        };
        let sums = (0..self.len()).into_par_iter().map(sums).collect::<Result<Vec<_>, _>>()?;
        let count = (self.len() * self.pixels.len()) as f64;
        let [mean, square] = [0, 1].map(|at| sums.iter().map(|sums| sums[at]).sum::<f64>() / count);
        Ok(square - mean * mean)
    }

    /// The untouched frame and the difference of a sample.
    fn read(&self, index: usize) -> Result<(Vec<f32>, Vec<f32>), LearnError> {
        let (dataset, sample) = self.numbers[index];
        let dataset = &self.datasets[dataset];
        let (mut rest, mut difference) = (vec![0.0; self.channels], vec![0.0; self.channels]);
        dataset.rest_into(sample, &mut rest)?;
        dataset.frame_into(sample, &mut difference)?;
        difference.iter_mut().zip(&rest).for_each(|(value, rest)| *value -= rest);
        if !difference.iter().all(|value| value.is_finite()) {
            return Err(LearnError::NotFinite { folder: dataset.folder().to_path_buf(), sample });
        }
        Ok((rest, difference))
    }

    /// The inputs and the target of a sample.
    ///
    /// # Errors
    /// As [`difference`](Self::difference).
    pub fn fill(
        &self,
        index: usize,
        disturb: Disturb,
        input: &Input,
        inputs: &mut [f32],
        target: &mut [f32],
    ) -> Result<(), LearnError> {
        let (rest, mut difference) = self.read(index)?;
        let mut element = 0;
        if let Disturb::Step(seed, step) = disturb {
            let mut rng = sample_rng(seed, step);
            if let Some(symmetries) = &self.symmetries {
                element = rng.random_range(0..symmetries.len() as u32) as usize;
                let mut moved = vec![0.0; self.channels];
                symmetries.frame(element, &difference, &mut moved);
                difference = moved;
            }
            self.disturb(&mut rng, element, &rest, &mut difference);
        }
        input.prepare(|channel| difference[channel], inputs);
        self.target(index, element, target)
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

    fn target(&self, index: usize, element: usize, target: &mut [f32]) -> Result<(), LearnError> {
        let (dataset, sample) = self.numbers[index];
        let dataset = &self.datasets[dataset];
        let Target::Touches { width_m } = self.target else { return Ok(dataset.image_into(sample, target)?) };
        let is_press = matches!(dataset.manifest().record.recipe.touch, dermis::dataset::Touch::Patch(_));
        target.fill(0.0);
        for [x, y, z, _, force, strength] in dataset.touches(sample)? {
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
        Ok(())
    }
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
