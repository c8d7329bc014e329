//! A network prepared for inference: normalisation folded into the adjacent layers, memory allocated once.

use crate::input::Input;
use crate::kernel::conv2d::{Last, convolve, pack};
use crate::kernel::matrix::{RowProduct, add_product};
use crate::kernel::run;
use crate::network::{BatchNorm, Dense, Kind, Network, Refinement};
use crate::options::Target;
use rayon::prelude::*;
use std::sync::Mutex;

/// A network that computes images from differences.
#[derive(Debug)]
pub struct Inference {
    input: Input,
    layers: Vec<Folded>,
    refinement: Option<(Refinement, Vec<Vec<f32>>)>,
    target: Target,
    pixels: usize,
    /// Memory that is not in use by a thread.
    idle: Mutex<Vec<Scratch>>,
}

/// A dense layer with batch normalisation folded in.
#[derive(Debug)]
pub(crate) struct Folded {
    pub dense: Dense,
    pub relu: bool,
}

#[derive(Debug)]
struct Scratch {
    /// The input of each layer, then the output of the last one.
    values: Vec<Vec<f32>>,
    pictures: Vec<Vec<f32>>,
}

impl Inference {
    /// Prepares a network.
    pub fn new(network: &Network, input: &Input, target: Target) -> Self {
        let layers = fold(network);
        let refinement = network.refinement.clone().map(|refinement| {
            let packed = refinement.convolutions.iter().map(|one| pack(&one.weight, one.channels)).collect();
            (refinement, packed)
        });
        let pixels = network.architecture().outputs();
        Inference { input: input.clone(), layers, refinement, target, pixels, idle: Mutex::new(Vec::new()) }
    }

    /// Values of an image.
    pub fn pixel_count(&self) -> usize {
        self.pixels
    }

    /// The image of a difference, ohm. After the first call in each concurrent thread no memory is allocated.
    pub fn image_into(&self, difference: &[f64], image: &mut [f64]) {
        let mut scratch = self.take();
        let size = self.input.prepare(|channel| difference[channel] as f32, &mut scratch.values[0]);
        for (index, layer) in self.layers.iter().enumerate() {
            let (before, after) = scratch.values.split_at_mut(index + 1);
            let Dense { weight, bias, .. } = &layer.dense;
            run(RowProduct { input: &before[index], weight, bias, relu: layer.relu, output: &mut after[0] });
        }
        self.finish(&mut scratch, size, image);
        self.give_back(scratch);
    }

    /// The images of many differences, row by row.
    pub(crate) fn images_into(&self, differences: &[f64], images: &mut [f64]) {
        let count = images.len() / self.pixels;
        let mut values = vec![0.0; count * self.input.len()];
        let rows =
            values.par_chunks_mut(self.input.len()).zip(differences.par_chunks(differences.len() / count.max(1)));
        let sizes: Vec<f32> =
            rows.map(|(inputs, row)| self.input.prepare(|channel| row[channel] as f32, inputs)).collect();
        for Folded { dense, relu } in &self.layers {
            let mut outputs = dense.bias.repeat(count);
            add_product(&mut outputs, &values, &dense.weight, [count, dense.inputs, dense.outputs]);
            if *relu {
                outputs.par_iter_mut().for_each(|value| *value = value.max(0.0));
            }
            values = outputs;
        }
        let width = values.len() / count.max(1);
        let rows = values.par_chunks(width).zip(sizes).zip(images.par_chunks_mut(self.pixels));
        rows.for_each(|((row, size), image)| {
            let mut scratch = self.take();
            scratch.values.last_mut().expect("there are layers").copy_from_slice(row);
            self.finish(&mut scratch, size, image);
            self.give_back(scratch);
        });
    }

    /// Converts the outputs of the layers to the image, times the size of the network's input.
    fn finish(&self, scratch: &mut Scratch, size: f32, image: &mut [f64]) {
        let made = scratch.values.last().expect("there are layers");
        let Some((refinement, packed)) = &self.refinement else {
            image.iter_mut().zip(made).for_each(|(pixel, &value)| *pixel = f64::from(size * self.target.image(value)));
            return;
        };
        let (shape, channels) = (refinement.shape, refinement.channels_in());
        let pictures = &mut scratch.pictures;
        shape.put(made, channels, &mut pictures[0]);
        let count = packed.len();
        for (index, (one, weight)) in refinement.convolutions.iter().zip(packed).enumerate() {
            let (before, after) = pictures.split_at_mut(index + 1);
            let last = if index + 1 < count { Last::Relu } else { Last::Keep };
            convolve(shape, one.channels, weight, Some(&one.bias), &before[index], &mut after[0], last);
        }
        for (row, line) in image.chunks_exact_mut(shape.columns).enumerate() {
            let refined = &pictures[count][shape.row(row, 1)];
            let first = pictures[0][shape.row(row, channels)].iter().step_by(channels);
            for (pixel, (refined, first)) in line.iter_mut().zip(refined.iter().zip(first)) {
                *pixel = f64::from(size * self.target.image(refined + first));
            }
        }
    }

    fn take(&self) -> Scratch {
        let idle = self.idle.lock().expect("no thread panics while it holds the lock").pop();
        idle.unwrap_or_else(|| {
            let sizes = std::iter::once(self.input.len()).chain(self.layers.iter().map(|layer| layer.dense.outputs));
            let pictures = self.refinement.as_ref().map(|(refinement, _)| refinement.pictures());
            Scratch { values: sizes.map(|size| vec![0.0; size]).collect(), pictures: pictures.unwrap_or_default() }
        })
    }

    fn give_back(&self, scratch: Scratch) {
        self.idle.lock().expect("no thread panics while it holds the lock").push(scratch);
    }
}

/// The dense layers of a network with its batch normalisations folded into them: one that follows a dense layer scales
/// and shifts its outputs, one that precedes it its inputs.
pub(crate) fn fold(network: &Network) -> Vec<Folded> {
    let mut layers: Vec<Folded> = Vec::new();
    let mut waiting: Option<(Vec<f64>, Vec<f64>)> = None;
    let mut may_follow = false;
    for layer in &network.trunk {
        match &layer.kind {
            Kind::Dense(dense) => {
                let mut dense = dense.clone();
                if let Some((scale, shift)) = waiting.take() {
                    dense.take_in(&scale, &shift);
                }
                may_follow = !layer.relu;
                layers.push(Folded { dense, relu: layer.relu });
            }
            Kind::BatchNorm(norm) => {
                let (scale, shift) = norm.factors();
                match layers.last_mut().filter(|_| may_follow) {
                    Some(last) => {
                        last.dense.put_out(&scale, &shift);
                        last.relu = layer.relu;
                    }
                    None => waiting = Some((scale, shift)),
                }
                may_follow = false;
            }
        }
    }
    layers
}

impl BatchNorm {
    /// The factor and the offset of the trained normalisation.
    fn factors(&self) -> (Vec<f64>, Vec<f64>) {
        let factor = |at: usize| f64::from(self.scale[at]) / f64::from(self.variance[at] + Self::EPSILON).sqrt();
        let scale: Vec<f64> = (0..self.scale.len()).map(factor).collect();
        let shift =
            (0..scale.len()).map(|at| f64::from(self.shift[at]) - scale[at] * f64::from(self.mean[at])).collect();
        (scale, shift)
    }
}

impl Dense {
    /// The layer for inputs that are scaled and shifted before it.
    fn take_in(&mut self, scale: &[f64], shift: &[f64]) {
        let mut bias: Vec<f64> = self.bias.iter().map(|&value| f64::from(value)).collect();
        for ((row, scale), shift) in self.weight.chunks_exact_mut(self.outputs).zip(scale).zip(shift) {
            for (weight, bias) in row.iter_mut().zip(&mut bias) {
                *bias += shift * f64::from(*weight);
                *weight = (scale * f64::from(*weight)) as f32;
            }
        }
        self.bias = bias.into_iter().map(|value| value as f32).collect();
    }

    /// The layer with outputs that are scaled and shifted after it.
    fn put_out(&mut self, scale: &[f64], shift: &[f64]) {
        for row in self.weight.chunks_exact_mut(self.outputs) {
            row.iter_mut().zip(scale).for_each(|(weight, scale)| *weight = (scale * f64::from(*weight)) as f32);
        }
        for ((bias, scale), shift) in self.bias.iter_mut().zip(scale).zip(shift) {
            *bias = (scale * f64::from(*bias) + shift) as f32;
        }
    }
}

#[cfg(all(test, feature = "train"))]
mod tests {
    use super::*;
    use crate::network::Architecture;
    use crate::training::pass::Pass;

    fn filled(count: usize, step: f32) -> Vec<f32> {
        (0..count).map(|at| (at as f32 * step).sin()).collect()
    }

    #[test]
    fn images_are_the_training_network_s_outputs_one_by_one_and_together() {
        let architectures = [
            Architecture::paper(24, 30),
            Architecture::paper_norm_first(24, 30),
            Architecture::refined(24, [5, 6], true, &[4, 16, 16, 1]),
        ];
        for architecture in architectures {
            let mut network = Network::new(&architecture, 5);
            for (at, values) in network.values_mut().into_iter().enumerate() {
                let more = filled(values.len(), 0.37 + at as f32);
                values.iter_mut().zip(more).for_each(|(value, more)| *value += 0.1 * more);
            }
            let channels = (0..24).map(|channel| vec![channel, 47 - channel]).collect();
            let input = Input { channels, mean_ohm: filled(24, 0.2), sd_ohm: vec![2.5; 24], scale_free: false };
            let inference = Inference::new(&network, &input, Target::Conductance);
            let differences: Vec<f64> = filled(3 * 48, 0.7).into_iter().map(f64::from).collect();
            let mut inputs = vec![0.0; 3 * 24];
            for (inputs, row) in inputs.chunks_exact_mut(24).zip(differences.chunks_exact(48)) {
                input.prepare(|channel| row[channel] as f32, inputs);
            }
            let expected = Pass::new(&network, 3).outputs(&mut network, &inputs);
            // Scaling by a power of two is exact for all outputs.
            let halved = Pass::new(&network, 3).outputs(&mut network.clone().scaled(0.5), &inputs);
            assert!(halved.iter().zip(&expected).all(|(half, whole)| *half == 0.5 * whole));
            let near = |image: &[f64]| image.iter().zip(&expected).all(|(a, b)| (a - f64::from(*b)).abs() < 1e-5);
            let mut images = vec![0.0; 3 * 30];
            inference.images_into(&differences, &mut images);
            assert!(near(&images));
            images.fill(0.0);
            for (image, row) in images.chunks_exact_mut(30).zip(differences.chunks_exact(48)) {
                inference.image_into(row, image);
            }
            assert!(near(&images));
        }
    }
}
