//! The structure and the weights of a network.

use crate::LearnError;
use crate::kernel::conv2d::{Shape, TAPS};
use crate::tensors::{self, Named, Precision};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use serde::{Deserialize, Serialize};
use std::collections::HashMap;
use std::path::Path;

/// The number of output channels of a convolution, except the last one, is a multiple of this, to fill whole vectors.
pub(crate) const CHANNELS_TOGETHER: usize = 16;

/// The architecture of a network, as stored in a model's card: a sequence of layers on vectors (the trunk), optionally
/// followed by convolutions that refine the resulting image.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Architecture {
    /// The layers, in their order.
    pub trunk: Vec<LayerSpec>,
    /// The refinement after the layers.
    pub refinement: Option<RefinementSpec>,
}

/// A layer's shape.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum LayerSpec {
    /// A dense layer: every output is a sum over all inputs.
    Dense {
        /// Number of inputs.
        inputs: usize,
        /// Number of outputs.
        outputs: usize,
        /// Whether a rectifier follows.
        relu: bool,
    },
    /// Each value minus its mean over the batch, divided by its standard deviation, then scaled and shifted.
    BatchNorm {
        /// Number of inputs and outputs.
        features: usize,
        /// Whether a rectifier follows.
        relu: bool,
    },
}

/// The architecture of a refinement: convolutions of 3 x 3 pixels with rectifiers between them; the first channel of
/// the input is added to the output.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RefinementSpec {
    /// Number of rows of the image.
    pub(crate) rows: usize,
    /// Number of columns.
    pub(crate) columns: usize,
    /// Whether the last column is adjacent to the first.
    pub(crate) is_ring: bool,
    /// Number of channels of the input, and after each convolution; the last is 1.
    pub(crate) channels: Vec<usize>,
}

impl Architecture {
    /// The paper's network in our interpretation (dense, batch normalisation, rectifier) three times and a final dense
    /// layer: on its skin 870 values, hidden layers of 870, 880 and 890, an image of 900; on other skins the hidden
    /// sizes are interpolated linearly.
    pub fn paper(channels: usize, pixels: usize) -> Self {
        let size = |step: usize| (channels * (3 - step) + pixels * step + 1) / 3;
        let sizes = [channels, size(0), size(1), size(2), pixels];
        let mut trunk = Vec::new();
        for pair in sizes[..4].windows(2) {
            trunk.push(LayerSpec::Dense { inputs: pair[0], outputs: pair[1], relu: false });
            trunk.push(LayerSpec::BatchNorm { features: pair[1], relu: true });
        }
        trunk.push(LayerSpec::Dense { inputs: sizes[3], outputs: pixels, relu: false });
        Architecture { trunk, refinement: None }
    }

    /// The other interpretation of the paper: batch normalisation of the input of each of four hidden layers, and a
    /// fifth layer that makes the image.
    pub fn paper_norm_first(channels: usize, pixels: usize) -> Self {
        let size = |step: usize| (channels * (3 - step) + pixels * step + 1) / 3;
        let sizes = [channels, size(0), size(1), size(2), pixels];
        let mut trunk = Vec::new();
        for pair in sizes.windows(2) {
            trunk.push(LayerSpec::BatchNorm { features: pair[0], relu: false });
            trunk.push(LayerSpec::Dense { inputs: pair[0], outputs: pair[1], relu: true });
        }
        trunk.push(LayerSpec::Dense { inputs: pixels, outputs: pixels, relu: false });
        Architecture { trunk, refinement: None }
    }

    /// A linear layer that makes several images of the frame, and convolutions that combine them into one.
    pub fn refined(inputs: usize, [rows, columns]: [usize; 2], is_ring: bool, channels: &[usize]) -> Self {
        let outputs = rows * columns * channels[0];
        let refinement = RefinementSpec { rows, columns, is_ring, channels: channels.to_vec() };
        Architecture { trunk: vec![LayerSpec::Dense { inputs, outputs, relu: false }], refinement: Some(refinement) }
    }

    /// Checks that the input size of every layer equals the output size of the one before.
    ///
    /// # Errors
    /// A description of the mismatch.
    pub(crate) fn check(&self) -> Result<(), String> {
        let mut values = None;
        for (index, layer) in self.trunk.iter().enumerate() {
            let (inputs, outputs) = layer.sizes();
            if inputs == 0 || outputs == 0 || values.is_some_and(|values| values != inputs) {
                return Err(format!("layer {index} takes {inputs} values, which the one before it does not give"));
            }
            values = Some(outputs);
        }
        let Some(values) = values else { return Err("it has no layer".into()) };
        if !matches!(self.trunk.last(), Some(LayerSpec::Dense { .. })) {
            return Err("its trunk must end with a dense layer".into());
        }
        if let Some(index) = (0..self.trunk.len()).find(|&index| !self.is_foldable(index)) {
            return Err(format!(
                "layer {index} normalises a batch: a plain dense layer must stand before it, or one after it"
            ));
        }
        let Some(RefinementSpec { rows, columns, channels, .. }) = &self.refinement else { return Ok(()) };
        let hidden = channels.get(1..channels.len().max(2) - 1).unwrap_or_default();
        if hidden.is_empty() || hidden.iter().any(|count| *count == 0 || !count.is_multiple_of(CHANNELS_TOGETHER)) {
            return Err(format!("its convolutions have channels {channels:?}: those between must be multiples of 16"));
        }
        if channels.last() != Some(&1) || rows * columns * channels[0] != values || *columns < 2 {
            return Err(format!(
                "its convolutions cannot take {values} values as {channels:?} channels of {rows} x {columns}"
            ));
        }
        Ok(())
    }

    /// Whether a layer can be folded into an adjacent dense layer: a batch normalisation into the layer before if that
    /// has no rectifier, else, if it has no rectifier itself, into the layer after.
    fn is_foldable(&self, index: usize) -> bool {
        let LayerSpec::BatchNorm { relu, .. } = self.trunk[index] else { return true };
        let before = index.checked_sub(1).map(|before| self.trunk[before]);
        let after = self.trunk.get(index + 1);
        matches!(before, Some(LayerSpec::Dense { relu: false, .. }))
            || (!relu && matches!(after, Some(LayerSpec::Dense { .. })))
    }

    /// Number of inputs.
    pub fn inputs(&self) -> usize {
        self.trunk.first().map_or(0, |layer| layer.sizes().0)
    }

    /// Number of outputs.
    pub fn outputs(&self) -> usize {
        match &self.refinement {
            Some(refinement) => refinement.rows * refinement.columns,
            None => self.trunk.last().map_or(0, |layer| layer.sizes().1),
        }
    }
}

impl LayerSpec {
    fn sizes(&self) -> (usize, usize) {
        match *self {
            LayerSpec::Dense { inputs, outputs, .. } => (inputs, outputs),
            LayerSpec::BatchNorm { features, .. } => (features, features),
        }
    }
}

/// A network: an architecture and its weights.
#[derive(Debug, Clone, PartialEq)]
pub struct Network {
    architecture: Architecture,
    pub(crate) trunk: Vec<Layer>,
    pub(crate) refinement: Option<Refinement>,
}

/// A layer on vectors.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Layer {
    pub kind: Kind,
    pub relu: bool,
}

#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Kind {
    Dense(Dense),
    BatchNorm(BatchNorm),
}

/// `y = b + x W`.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Dense {
    pub inputs: usize,
    pub outputs: usize,
    /// Row-major, inputs x outputs.
    pub weight: Vec<f32>,
    pub bias: Vec<f32>,
}

/// `y = scale (x - mean) / sqrt(variance + epsilon) + shift`.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct BatchNorm {
    pub scale: Vec<f32>,
    pub shift: Vec<f32>,
    /// Over the batches so far, exponentially weighted.
    pub mean: Vec<f32>,
    pub variance: Vec<f32>,
}

impl BatchNorm {
    /// Added to the variance (Keras' default).
    pub(crate) const EPSILON: f32 = 1e-3;
    /// Decay of the moving averages per batch (Keras' default).
    pub(crate) const MOMENTUM: f32 = 0.99;
}

/// Convolutions that refine an image.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Refinement {
    pub shape: Shape,
    pub convolutions: Vec<Convolution>,
}

#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Convolution {
    /// Input and output channels.
    pub channels: [usize; 2],
    /// `[tap][input channel][output channel]`.
    pub weight: Vec<f32>,
    pub bias: Vec<f32>,
}

/// One tensor of a network.
#[derive(Debug)]
pub struct Tensor<T> {
    /// "trunk.0.weight".
    pub(crate) name: String,
    /// Sizes, row-major.
    pub(crate) shape: Vec<usize>,
    /// Whether it is trained by gradient descent; the others are moving averages.
    pub(crate) is_learned: bool,
    /// Its values.
    pub values: T,
}

impl Network {
    /// A network before training: weights uniform within the bounds of Glorot and Bengio (2010),
    /// `+-sqrt(6 / (inputs + outputs))`, the last convolution zero so that a refinement initially changes nothing.
    ///
    /// # Panics
    /// If the architecture's layers do not fit together.
    pub fn new(architecture: &Architecture, seed: u64) -> Self {
        if let Err(message) = architecture.check() {
            panic!("{message}");
        }
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let mut even = |count: usize, sum: usize| {
            let bound = (6.0 / sum as f32).sqrt();
            (0..count).map(|_| bound * (2.0 * rng.random::<f32>() - 1.0)).collect::<Vec<f32>>()
        };
        let trunk = (architecture.trunk.iter())
            .map(|layer| match *layer {
                LayerSpec::Dense { inputs, outputs, relu } => {
                    let weight = even(inputs * outputs, inputs + outputs);
                    Layer { kind: Kind::Dense(Dense { inputs, outputs, weight, bias: vec![0.0; outputs] }), relu }
                }
                LayerSpec::BatchNorm { features, relu } => {
                    let norm = BatchNorm {
                        scale: vec![1.0; features],
                        shift: vec![0.0; features],
                        mean: vec![0.0; features],
                        variance: vec![1.0; features],
                    };
                    Layer { kind: Kind::BatchNorm(norm), relu }
                }
            })
            .collect();
        let refinement = architecture.refinement.as_ref().map(|refinement| {
            let shape = Shape { rows: refinement.rows, columns: refinement.columns, is_ring: refinement.is_ring };
            let convolution = |pair: &[usize]| {
                let (from, to) = (pair[0], pair[1]);
                let weight = even(TAPS * from * to, TAPS * (from + to));
                Convolution { channels: [from, to], weight, bias: vec![0.0; to] }
            };
            let mut convolutions: Vec<Convolution> = refinement.channels.windows(2).map(convolution).collect();
            if let Some(last) = convolutions.last_mut() {
                last.weight.fill(0.0);
            }
            Refinement { shape, convolutions }
        });
        Network { architecture: architecture.clone(), trunk, refinement }
    }

    /// Its architecture.
    pub(crate) fn architecture(&self) -> &Architecture {
        &self.architecture
    }

    /// Number of trained values.
    pub fn learned_count(&self) -> usize {
        self.tensors().iter().filter(|tensor| tensor.is_learned).map(|tensor| tensor.values.len()).sum()
    }

    /// The network with the outputs of this one times a positive factor.
    #[must_use]
    pub fn scaled(mut self, factor: f32) -> Self {
        let scale = |values: &mut [f32]| values.iter_mut().for_each(|value| *value *= factor);
        let last = self.trunk.iter_mut().rev().find_map(|layer| match &mut layer.kind {
            Kind::Dense(dense) => Some(dense),
            Kind::BatchNorm(_) => None,
        });
        let last = last.expect("a network ends with a dense layer");
        scale(&mut last.weight);
        scale(&mut last.bias);
        // A rectifier is positively homogeneous, so in the following layers only the additive terms are scaled.
        let convolutions = self.refinement.iter_mut().flat_map(|refinement| &mut refinement.convolutions);
        convolutions.for_each(|one| scale(&mut one.bias));
        self
    }

    /// The network with the weights of a safetensors file; the path is for messages.
    ///
    /// # Errors
    /// A damaged file; tensors that are missing or of another shape; values that are not finite.
    pub fn parse(architecture: &Architecture, path: &Path, weights: &[u8]) -> Result<Self, LearnError> {
        let file = tensors::parse(path, weights)?;
        let mut network = Network::new(architecture, 0);
        let shapes: Vec<(String, Vec<usize>)> =
            network.tensors().into_iter().map(|tensor| (tensor.name, tensor.shape)).collect();
        for ((name, shape), values) in shapes.iter().zip(network.values_mut()) {
            *values = tensors::values(path, &file, name, shape)?;
        }
        Ok(network)
    }

    /// The weights as a safetensors file: matrices and convolutions in the given precision, all other values in single
    /// precision.
    pub fn to_safetensors(&self, precision: Precision) -> Vec<u8> {
        let named = |tensor: Tensor<_>| {
            let precision = if tensor.shape.len() > 1 { precision } else { Precision::Single };
            Named { name: tensor.name, shape: tensor.shape, values: tensor.values, precision }
        };
        tensors::to_bytes(&self.tensors().into_iter().map(named).collect::<Vec<_>>(), HashMap::new())
    }

    /// All tensors, in a fixed order.
    pub fn tensors(&self) -> Vec<Tensor<&[f32]>> {
        let mut tensors = Vec::new();
        let mut add = |name: String, shape: Vec<usize>, is_learned: bool, values| {
            tensors.push(Tensor { name, shape, is_learned, values });
        };
        for (index, layer) in self.trunk.iter().enumerate() {
            match &layer.kind {
                Kind::Dense(Dense { inputs, outputs, weight, bias }) => {
                    add(format!("trunk.{index}.weight"), vec![*inputs, *outputs], true, &weight[..]);
                    add(format!("trunk.{index}.bias"), vec![*outputs], true, bias);
                }
                Kind::BatchNorm(BatchNorm { scale, shift, mean, variance }) => {
                    let shape = vec![scale.len()];
                    add(format!("trunk.{index}.scale"), shape.clone(), true, scale);
                    add(format!("trunk.{index}.shift"), shape.clone(), true, shift);
                    add(format!("trunk.{index}.mean"), shape.clone(), false, mean);
                    add(format!("trunk.{index}.variance"), shape, false, variance);
                }
            }
        }
        for (index, one) in self.refinement.iter().flat_map(|refinement| refinement.convolutions.iter().enumerate()) {
            let [from, to] = one.channels;
            add(format!("refinement.{index}.weight"), vec![3, 3, from, to], true, &one.weight);
            add(format!("refinement.{index}.bias"), vec![to], true, &one.bias);
        }
        tensors
    }

    /// The values of all tensors, mutable; in the order of [`tensors`](Self::tensors).
    pub(crate) fn values_mut(&mut self) -> Vec<&mut Vec<f32>> {
        let mut values = Vec::new();
        for layer in &mut self.trunk {
            match &mut layer.kind {
                Kind::Dense(dense) => values.extend([&mut dense.weight, &mut dense.bias]),
                Kind::BatchNorm(norm) => {
                    values.extend([&mut norm.scale, &mut norm.shift, &mut norm.mean, &mut norm.variance]);
                }
            }
        }
        for one in self.refinement.iter_mut().flat_map(|refinement| &mut refinement.convolutions) {
            values.extend([&mut one.weight, &mut one.bias]);
        }
        values
    }
}

impl Refinement {
    pub(crate) fn channels_in(&self) -> usize {
        self.convolutions[0].channels[0]
    }

    /// Bordered images: the input of each convolution, then the last one's output.
    pub(crate) fn pictures(&self) -> Vec<Vec<f32>> {
        let first = std::iter::once(self.channels_in());
        let channels = first.chain(self.convolutions.iter().map(|one| one.channels[1]));
        channels.map(|channels| vec![0.0; self.shape.bordered(channels)]).collect()
    }
}
