//! Training samples: augmented by symmetries and noise, and converted to inputs and targets.

use crate::LearnError;
use crate::input::Input;
use crate::options::{DomainRandomization, Noise, Target};
use crate::training::preset::TrainingPreset;
use crate::training::source::Source;
use crate::training::symmetry::Symmetries;
use dermis::forward::ForwardModel;
use dermis::geom::Point3;
use dermis::image::PixelSpace;
use dermis_sim::dataset::{Sample, SampleTouch};
use dermis_sim::elementary::{Chart, exp_f32, powf_f32, unrolled};
use dermis_sim::random::{Normal, sample_rng};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

/// The random streams from here on are for the domain randomization of the samples that inputs are normalised by.
const TYPICAL_STREAMS: u64 = 3 << 61;

/// Training samples, and their conversion to inputs and targets.
#[derive(Debug)]
pub struct Samples {
    source: Box<dyn Source>,
    symmetries: Option<Symmetries>,
    noise: Noise,
    /// The change of a difference by each contact's drift, for one standard deviation.
    contacts: Vec<Vec<f32>>,
    target: Target,
    chart: Chart,
    pixels: Vec<Point3>,
    /// Whether the instrument reports amplitudes.
    amplitude_only: bool,
}

/// Augmentation of a sample.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Augmentation {
    /// None.
    Nothing,
    /// By noise and by a symmetry, if there are any, drawn from a seed and the index of the step.
    Step(u64, u64),
}

impl Samples {
    /// Samples of a source on the skin of a forward model, with a preset's target, noise and symmetries. Symmetries
    /// move touches: if the target is an image of conductance, samples are not moved.
    ///
    /// # Errors
    /// A contact whose drift cannot be computed.
    pub fn new(
        source: impl Source + 'static,
        forward: &ForwardModel,
        pixels: &PixelSpace,
        preset: &TrainingPreset,
    ) -> Result<Self, LearnError> {
        let chart = unrolled(&pixels.surface);
        Ok(Samples {
            source: Box::new(source),
            symmetries: preset.symmetries.clone().filter(|_| preset.target != Target::Conductance),
            contacts: contact_patterns(forward, preset.noise.contact_drift)?,
            noise: preset.noise.clone(),
            target: preset.target,
            chart,
            amplitude_only: forward.protocol().amplitude_only(),
            pixels: pixels.centres_m.iter().map(|&centre| chart.unroll_in_space(centre)).collect(),
        })
    }

    /// The source of the samples.
    pub fn source(&self) -> &dyn Source {
        &*self.source
    }

    /// The undisturbed difference of a prepared sample, ohm.
    ///
    /// # Errors
    /// A file that cannot be read; a value that is not finite.
    pub fn difference(&self, number: usize) -> Result<Vec<f32>, LearnError> {
        Ok(self.read(number, false)?.1)
    }

    /// The difference of a prepared sample with domain randomization but without noise: used to normalise inputs.
    ///
    /// # Errors
    /// As [`difference`](Self::difference).
    pub(crate) fn typical_difference(&self, number: usize, seed: u64) -> Result<Vec<f32>, LearnError> {
        let (sample, mut difference) = self.read(number, false)?;
        if let Some(randomization) = &self.noise.domain_randomization {
            randomization.stretch(
                &mut sample_rng(seed, TYPICAL_STREAMS + number as u64),
                &sample.rest,
                &mut difference,
            );
        }
        Ok(difference)
    }

    /// A prepared sample, and the change by its touches as reported by the instrument, ohm. If amplitudes are reported,
    /// the untouched frame is converted to amplitudes too.
    ///
    /// # Errors
    /// A file that cannot be read; a value that is not finite.
    pub fn read(&self, number: usize, with_image: bool) -> Result<(Sample, Vec<f32>), LearnError> {
        let mut sample = self.source.read(number, with_image)?;
        if self.amplitude_only {
            sample.rest.iter_mut().chain(&mut sample.frame).for_each(|value| *value = value.abs());
        }
        let difference = sample.frame.iter().zip(&sample.rest).map(|(touched, rest)| touched - rest).collect();
        Ok((sample, difference))
    }

    /// The variance of all values of the undisturbed targets of some samples.
    ///
    /// # Errors
    /// A file that cannot be read.
    pub fn target_variance(&self, numbers: &[usize]) -> Result<f64, LearnError> {
        self.source.prepare(numbers)?;
        let sums = |&number: &usize| -> Result<[f64; 2], LearnError> {
            let mut target = vec![0.0; self.pixels.len()];
            let sample = self.source.read(number, self.target == Target::Conductance)?;
            self.target(&sample, 0, None, &mut target);
            let values = || target.iter().map(|&value| f64::from(value));
            Ok([values().sum(), values().map(|value| value * value).sum()])
        };
        let sums = numbers.par_iter().map(sums).collect::<Result<Vec<_>, _>>()?;
        let count = (numbers.len() * self.pixels.len()) as f64;
        let [mean, square] = [0, 1].map(|at| sums.iter().map(|sums| sums[at]).sum::<f64>() / count);
        Ok(square - mean * mean)
    }

    /// The inputs and the target of a prepared sample.
    ///
    /// # Errors
    /// As [`difference`](Self::difference).
    pub fn fill(
        &self,
        number: usize,
        disturb: Augmentation,
        input: &Input,
        inputs: &mut [f32],
        target: &mut [f32],
    ) -> Result<(), LearnError> {
        let (sample, mut difference) = self.read(number, self.target == Target::Conductance)?;
        let mut element = 0;
        let mut drawn = None;
        if let Augmentation::Step(seed, step) = disturb {
            let mut rng = sample_rng(seed, step);
            if let Some(symmetries) = &self.symmetries {
                element = rng.random_range(0..symmetries.len() as u32) as usize;
                let mut moved = vec![0.0; difference.len()];
                symmetries.frame(element, &difference, &mut moved);
                difference = moved;
            }
            if let Some(randomization) = &self.noise.domain_randomization {
                randomization.stretch(&mut rng, &sample.rest, &mut difference);
            }
            self.disturb(&mut rng, element, &sample.rest, &mut difference);
            drawn = Some(rng);
        }
        input.normalised(|channel| difference[channel], inputs);
        if let (Some(randomization), Some(rng)) = (&self.noise.domain_randomization, &mut drawn) {
            randomization.blur(rng, inputs);
        }
        let size = input.take_size(inputs);
        self.target(&sample, element, input.scale_free.then_some(size), target);
        Ok(())
    }

    fn disturb(&self, rng: &mut ChaCha8Rng, element: usize, rest: &[f32], difference: &mut [f32]) {
        let Noise { sd_ohm, factor: [low, high], coat_drift, .. } = &self.noise;
        let mut normal = Normal::default();
        if *coat_drift > 0.0 || !self.contacts.is_empty() {
            // The age of the untouched frame: from zero to long.
            let ago = normal.next(rng).abs().min(1.0);
            let share = ago * coat_drift * normal.next(rng);
            let mut moved = vec![0.0; rest.len()];
            match &self.symmetries {
                Some(symmetries) => symmetries.frame(element, rest, &mut moved),
                None => moved.copy_from_slice(rest),
            }
            difference.iter_mut().zip(&moved).for_each(|(value, rest)| *value += share * rest);
            for pattern in &self.contacts {
                let share = ago * normal.next(rng);
                difference.iter_mut().zip(pattern).for_each(|(value, of_one)| *value += share * of_one);
            }
        }
        let factor = low * powf_f32(high / low, rng.random::<f32>());
        for (value, sd) in difference.iter_mut().zip(sd_ohm) {
            *value += factor * sd * normal.next(rng);
        }
    }

    fn target(&self, sample: &Sample, element: usize, size: Option<f32>, target: &mut [f32]) {
        let Target::Touches { width_m } = self.target else {
            let factor = size.map_or(1.0, f32::recip);
            return target.iter_mut().zip(&sample.image).for_each(|(target, image)| *target = factor * image);
        };
        target.fill(0.0);
        let whole = if size.is_some() { sample.touches.iter().map(SampleTouch::size).sum() } else { 1.0 };
        for touch in &sample.touches {
            let mut place = touch.centre_m.map(f64::from);
            if let Some(symmetries) = &self.symmetries {
                place = symmetries.point(element, place);
            }
            let place = self.chart.unroll_in_space(place);
            let height = (touch.size() / whole).sqrt();
            let per = -0.5 / (width_m * width_m);
            for (value, &pixel) in target.iter_mut().zip(&self.pixels) {
                let exponent = per * self.chart.squared_distance_m2(place, pixel);
                if exponent > -16.0 {
                    *value += height * exp_f32(exponent as f32);
                }
            }
        }
    }
}

impl DomainRandomization {
    /// The uniform change of the whole coating, and gain errors of the channels. A uniform decrease of conductance
    /// raises all values by the same factor, for either sign of the touch effect: the change is proportional to the
    /// untouched frame.
    fn stretch(&self, rng: &mut ChaCha8Rng, rest: &[f32], difference: &mut [f32]) {
        let size = |values: &[f32]| values.iter().map(|value| value * value).sum::<f32>().sqrt();
        let along: f32 = rest.iter().zip(&*difference).map(|(rest, value)| rest * value).sum();
        let [low, high] = self.whole;
        let share = (low + (high - low) * rng.random::<f32>()) * size(difference) / size(rest).max(f32::MIN_POSITIVE);
        let mut normal = Normal::default();
        for (value, rest) in difference.iter_mut().zip(rest) {
            *value = (*value + share.copysign(along) * rest) * exp_f32(self.loudness_sd * normal.next(rng));
        }
    }

    /// Noise of the inputs, and missing inputs.
    fn blur(&self, rng: &mut ChaCha8Rng, inputs: &mut [f32]) {
        let square: f32 = inputs.iter().map(|input| input * input).sum();
        let [low, high] = self.relative;
        let sd = (low + (high - low) * rng.random::<f32>()) * (square / inputs.len() as f32).sqrt();
        let missing = self.missing * rng.random::<f32>();
        let mut normal = Normal::default();
        for input in inputs {
            let deviate = normal.next(rng);
            *input = if rng.random::<f32>() < missing { 0.0 } else { *input + sd * deviate };
        }
    }
}

/// For each contact the change of the untouched frame by a resistance in series with it, a fraction of the design's.
fn contact_patterns(forward: &ForwardModel, share: f32) -> Result<Vec<Vec<f32>>, LearnError> {
    if share == 0.0 {
        return Ok(Vec::new());
    }
    let network = forward.solver().network(forward.rest_conductivity()).map_err(dermis::Error::from)?;
    let frame = |network: &dermis::forward::ElectrodeNetwork| {
        let mut frame = vec![0.0; forward.protocol().channel_count()];
        network.frame_into(forward.protocol(), &mut frame);
        forward.protocol().drop_signs(&mut frame);
        frame
    };
    let rest = frame(&network);
    let electrodes = 0..forward.mesh().electrodes.len();
    let contacts_ohm: Vec<f64> = electrodes.map(|electrode| forward.contact_resistance_ohm(electrode)).collect();
    let pattern = |electrode: usize| -> Result<Vec<f32>, LearnError> {
        let mut series = vec![0.0; contacts_ohm.len()];
        series[electrode] = f64::from(share) * contacts_ohm[electrode];
        let changed = network.clone().with_series(&series).map_err(dermis::Error::from)?;
        Ok(frame(&changed).iter().zip(&rest).map(|(one, rest)| (one - rest) as f32).collect())
    };
    (0..contacts_ohm.len()).map(pattern).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::training::source::Streamed;
    use dermis::design::SkinDesign;
    use dermis::mesh::Mesh;
    use dermis_sim::dataset::{GaussianTouches, Generator, Recipe, Skins, Touch};

    /// A point electrode has no contact impedance in the model, so it cannot drift.
    #[test]
    fn samples_of_a_skin_with_point_electrodes_are_finite() {
        let text = SkinDesign::text_of("tank16").unwrap();
        let points = text.replace("shape.arc.length_m = 0.010", "shape = \"point\"");
        let points =
            points.lines().filter(|line| !line.starts_with("contact_impedance")).collect::<Vec<_>>().join("\n");
        let design = SkinDesign::parse(&points, "points").unwrap();
        assert!(design.electrodes.iter().all(|electrode| electrode.shape == dermis::design::ElectrodeShape::Point));
        let forward = ForwardModel::new(&design, &Mesh::generate(&design).unwrap()).unwrap();
        let pixels = PixelSpace::for_design(&design, forward.mesh()).unwrap();
        let touch = Touch::Gaussian(GaussianTouches::for_effect(design.sheet.touch));
        let recipe = Recipe { seed: 1, samples: 16, touch, skins: Skins::Even };
        let source = Streamed::new(Generator::new(&design, &forward, &recipe).unwrap(), 16);
        let noise_ohm = vec![1e-3; forward.protocol().channel_count()];
        let preset = TrainingPreset::spots(&design, forward.protocol(), &pixels, noise_ohm);
        assert!(preset.noise.contact_drift > 0.0);
        let samples = Samples::new(source, &forward, &pixels, &preset).unwrap();
        samples.source().prepare(&[3]).unwrap();
        let (mut inputs, mut target) = (vec![0.0; preset.input.len()], vec![0.0; pixels.len()]);
        samples.fill(3, Augmentation::Step(1, 0), &preset.input, &mut inputs, &mut target).unwrap();
        assert!(inputs.iter().chain(&target).all(|value| value.is_finite()));
    }
}
