//! Forward and backward through a network, for a batch.

use crate::kernel::conv2d::{Last, TAPS, WeightGradient, convolve, pack};
use crate::kernel::matrix::{add_product, product_of_transpose, product_with_transpose};
use crate::kernel::norm::{change_rows, column_sums};
use crate::kernel::run;
use crate::network::{BatchNorm, CHANNELS_TOGETHER, Convolution, Dense, Kind, Network, Refinement};
use rayon::prelude::*;

/// Parts of a batch whose gradients are summed separately: the same for any number of threads.
const PARTS: usize = 12;

/// Work memory for the passes of a network over batches of one size.
#[derive(Debug)]
pub(crate) struct Pass {
    rows: usize,
    /// The output of each layer of the trunk, rows x outputs.
    outputs: Vec<Vec<f32>>,
    /// Mean and reciprocal standard deviation over the batch, for batch normalisations.
    statistics: Vec<[Vec<f32>; 2]>,
    /// The gradient of the loss with respect to the outputs of the current layer, and to its inputs.
    error: Vec<f32>,
    next_error: Vec<f32>,
    parts: Vec<Part>,
    /// The gradient of the loss with respect to each trained tensor.
    pub gradient: Vec<Vec<f32>>,
}

/// Inputs and targets of a batch.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Batch<'a> {
    /// Inputs, rows x inputs.
    pub inputs: &'a [f32],
    /// Targets, rows x outputs.
    pub targets: &'a [f32],
}

/// Work memory of one thread for the refinement of some rows.
#[derive(Debug)]
struct Part {
    /// The bordered image at the input of each convolution, then the output of the last one.
    pictures: Vec<Vec<f32>>,
    /// The gradient of the loss with respect to each of them.
    errors: Vec<Vec<f32>>,
    gradient: Vec<Vec<f32>>,
    loss: f64,
}

impl Pass {
    /// Work memory for batches of `rows` samples.
    pub(crate) fn new(network: &Network, rows: usize) -> Self {
        let outputs = |layer: &crate::network::Layer| match &layer.kind {
            Kind::Dense(dense) => dense.outputs,
            Kind::BatchNorm(norm) => norm.scale.len(),
        };
        let learned = network.tensors().into_iter().filter(|tensor| tensor.is_learned);
        let gradient: Vec<Vec<f32>> = learned.map(|tensor| vec![0.0; tensor.values.len()]).collect();
        let parts = match &network.refinement {
            Some(refinement) => (0..PARTS.min(rows)).map(|_| Part::new(refinement)).collect(),
            None => Vec::new(),
        };
        Pass {
            rows,
            outputs: network.trunk.iter().map(|layer| vec![0.0; rows * outputs(layer)]).collect(),
            statistics: network.trunk.iter().map(|_| [Vec::new(), Vec::new()]).collect(),
            error: Vec::new(),
            next_error: Vec::new(),
            parts,
            gradient,
        }
    }

    /// The loss of a batch and its gradient with respect to every trained tensor: the mean square over all values of
    /// the difference of output and target. Moving averages over batches are updated.
    pub(crate) fn descend(&mut self, network: &mut Network, batch: Batch<'_>) -> f64 {
        self.forward(network, batch.inputs, true);
        let loss = self.loss_and_error(network, batch);
        self.backward(network, batch.inputs);
        loss
    }

    /// The outputs for a batch in inference mode, in which layers normalise by their moving averages.
    pub(crate) fn outputs(&mut self, network: &mut Network, inputs: &[f32]) -> Vec<f32> {
        self.forward(network, inputs, false);
        let trunk = self.outputs.last().expect("a network has layers");
        let Some(refinement) = &network.refinement else { return trunk.clone() };
        let pixels = refinement.shape.pixels();
        let mut outputs = vec![0.0; self.rows * pixels];
        let each = self.rows.div_ceil(self.parts.len());
        let rows = trunk.par_chunks(each * pixels * refinement.channels_in());
        outputs.par_chunks_mut(each * pixels).zip(rows).zip(&mut self.parts).for_each(|((outputs, rows), part)| {
            let packed = Packed::new(refinement);
            let rows = rows.chunks_exact(pixels * refinement.channels_in());
            for (output, row) in outputs.chunks_exact_mut(pixels).zip(rows) {
                part.forward(refinement, &packed, row);
                part.take_output(refinement, output);
            }
        });
        outputs
    }

    fn forward(&mut self, network: &mut Network, inputs: &[f32], is_training: bool) {
        for (index, layer) in network.trunk.iter_mut().enumerate() {
            let (before, from) = self.outputs.split_at_mut(index);
            let (input, output) = (before.last().map_or(inputs, |last| last), &mut from[0]);
            match &mut layer.kind {
                Kind::Dense(dense) => dense.forward(input, output, self.rows, layer.relu),
                Kind::BatchNorm(norm) => {
                    let [mean, factor] = &mut self.statistics[index];
                    norm.statistics_into(input, self.rows, is_training, mean, factor);
                    norm.forward(input, output, mean, factor, layer.relu);
                }
            }
        }
    }

    /// The loss; its gradient with respect to the trunk's outputs is written to `error`.
    fn loss_and_error(&mut self, network: &Network, batch: Batch<'_>) -> f64 {
        let trunk = self.outputs.last().expect("a network has layers");
        self.error.resize(trunk.len(), 0.0);
        let scale = 1.0 / batch.targets.len() as f32;
        match &network.refinement {
            None => {
                let columns = trunk.len() / self.rows;
                let rows = self.error.par_chunks_mut(columns).zip(trunk.par_chunks(columns));
                let losses: Vec<f64> = (rows.zip(batch.targets.par_chunks(columns)))
                    .map(|((error, output), target)| square_error(output, target, scale, error))
                    .collect();
                losses.iter().sum()
            }
            Some(refinement) => self.refine(refinement, batch.targets, scale),
        }
    }

    /// The same through the convolutions, whose gradients are summed part by part.
    fn refine(&mut self, refinement: &Refinement, targets: &[f32], scale: f32) -> f64 {
        let trunk = self.outputs.last().expect("a network has layers");
        let (pixels, inputs) = (refinement.shape.pixels(), refinement.shape.pixels() * refinement.channels_in());
        let each = self.rows.div_ceil(self.parts.len());
        let packed = Packed::new(refinement);
        let rows = self.error.par_chunks_mut(each * inputs).zip(trunk.par_chunks(each * inputs));
        let rows = rows.zip(targets.par_chunks(each * pixels));
        self.parts.par_iter_mut().zip(rows).for_each(|(part, ((errors, rows), targets))| {
            part.begin();
            let rows = errors.chunks_exact_mut(inputs).zip(rows.chunks_exact(inputs));
            for ((error, row), target) in rows.zip(targets.chunks_exact(pixels)) {
                part.descend(refinement, &packed, row, target, scale, error);
            }
        });
        let used = self.rows.div_ceil(each);
        let first = self.gradient.len() - self.parts[0].gradient.len();
        for (index, gradient) in self.gradient[first..].iter_mut().enumerate() {
            gradient.fill(0.0);
            for part in &self.parts[..used] {
                gradient.iter_mut().zip(&part.gradient[index]).for_each(|(sum, value)| *sum += value);
            }
        }
        self.parts[..used].iter().map(|part| part.loss).sum()
    }

    fn backward(&mut self, network: &Network, inputs: &[f32]) {
        // Every layer of the trunk has two trained tensors.
        for (index, layer) in network.trunk.iter().enumerate().rev() {
            let output = &self.outputs[index];
            if layer.relu {
                let columns = output.len() / self.rows;
                change_rows(&mut self.error, output, columns, |_, error, value| if value > 0.0 { error } else { 0.0 });
            }
            let input = if index == 0 { inputs } else { &self.outputs[index - 1] };
            let [first, second] = &mut self.gradient[2 * index..2 * index + 2] else { unreachable!("two tensors") };
            match &layer.kind {
                Kind::Dense(dense) => {
                    product_of_transpose(first, input, &self.error, [dense.inputs, self.rows, dense.outputs]);
                    let [sums, _] = column_sums(&self.error, &self.error, dense.outputs, |_, error, _| [error, 0.0]);
                    second.copy_from_slice(&sums);
                    if index > 0 {
                        self.next_error.resize(self.rows * dense.inputs, 0.0);
                        let shape = [self.rows, dense.outputs, dense.inputs];
                        product_with_transpose(&mut self.next_error, &self.error, &dense.weight, shape);
                        std::mem::swap(&mut self.error, &mut self.next_error);
                    }
                }
                Kind::BatchNorm(norm) => {
                    let [mean, factor] = &self.statistics[index];
                    norm.backward(input, &mut self.error, self.rows, [mean, factor], [first, second]);
                }
            }
        }
    }
}

/// The square error of a row times a scale, and its gradient.
fn square_error(output: &[f32], target: &[f32], scale: f32, error: &mut [f32]) -> f64 {
    let mut sum = 0.0;
    for ((error, output), target) in error.iter_mut().zip(output).zip(target) {
        let difference = output - target;
        *error = 2.0 * scale * difference;
        sum += difference * difference;
    }
    f64::from(scale) * f64::from(sum)
}

impl Dense {
    fn forward(&self, input: &[f32], output: &mut [f32], rows: usize, relu: bool) {
        output.par_chunks_mut(self.outputs).for_each(|row| row.copy_from_slice(&self.bias));
        add_product(output, input, &self.weight, [rows, self.inputs, self.outputs]);
        if relu {
            output
                .par_chunks_mut(self.outputs)
                .for_each(|row| row.iter_mut().for_each(|value| *value = value.max(0.0)));
        }
    }
}

impl BatchNorm {
    /// Mean and reciprocal standard deviation for normalisation: those of a batch in training, which also update the
    /// moving averages.
    fn statistics_into(
        &mut self,
        x: &[f32],
        rows: usize,
        is_training: bool,
        mean: &mut Vec<f32>,
        factor: &mut Vec<f32>,
    ) {
        let columns = self.scale.len();
        if !is_training {
            mean.clone_from(&self.mean);
            *factor = self.variance.iter().map(|variance| 1.0 / (variance + Self::EPSILON).sqrt()).collect();
            return;
        }
        let each = 1.0 / rows as f32;
        let [sums, _] = column_sums(x, x, columns, |_, x, _| [x, 0.0]);
        *mean = sums.iter().map(|sum| sum * each).collect();
        let centre = &mean[..];
        let [squares, _] = column_sums(x, x, columns, |at, x, _| [(x - centre[at]) * (x - centre[at]), 0.0]);
        *factor = squares.iter().map(|square| 1.0 / (square * each + Self::EPSILON).sqrt()).collect();
        let keep = |lasting: &mut f32, now: f32| *lasting += (1.0 - Self::MOMENTUM) * (now - *lasting);
        self.mean.iter_mut().zip(&*mean).for_each(|(lasting, &now)| keep(lasting, now));
        self.variance.iter_mut().zip(&squares).for_each(|(lasting, &square)| keep(lasting, square * each));
    }

    fn forward(&self, x: &[f32], y: &mut [f32], mean: &[f32], factor: &[f32], relu: bool) {
        let scale: Vec<f32> = self.scale.iter().zip(factor).map(|(scale, factor)| scale * factor).collect();
        let shift: Vec<f32> = (0..mean.len()).map(|at| self.shift[at] - scale[at] * mean[at]).collect();
        let (scale, shift) = (&scale[..], &shift[..]);
        match relu {
            true => change_rows(y, x, scale.len(), |at, _, x| (scale[at] * x + shift[at]).max(0.0)),
            false => change_rows(y, x, scale.len(), |at, _, x| scale[at] * x + shift[at]),
        }
    }

    /// Converts the gradient with respect to the outputs to that with respect to the inputs, and computes those of
    /// scale and shift.
    fn backward(
        &self,
        x: &[f32],
        error: &mut [f32],
        rows: usize,
        [mean, factor]: [&[f32]; 2],
        [by_scale, by_shift]: [&mut [f32]; 2],
    ) {
        let columns = self.scale.len();
        let [sums, products] =
            column_sums(error, x, columns, |at, error, x| [error, error * (x - mean[at]) * factor[at]]);
        by_shift.copy_from_slice(&sums);
        by_scale.copy_from_slice(&products);
        let each = 1.0 / rows as f32;
        let outer: Vec<f32> = self.scale.iter().zip(factor).map(|(scale, factor)| scale * factor).collect();
        let (outer, sums, products) = (&outer[..], &sums[..], &products[..]);
        change_rows(error, x, columns, |at, error, x| {
            outer[at] * (error - each * sums[at] - (x - mean[at]) * factor[at] * each * products[at])
        });
    }
}

/// The weights of convolutions in the orders in which the passes read them.
#[derive(Debug)]
pub(crate) struct Packed {
    forward: Vec<Vec<f32>>,
    backward: Vec<Vec<f32>>,
}

impl Packed {
    pub(crate) fn new(refinement: &Refinement) -> Self {
        Packed {
            forward: refinement.convolutions.iter().map(|one| pack(&one.weight, one.channels)).collect(),
            backward: (refinement.convolutions.iter())
                .map(|one| pack(&turned(one), [one.channels[1], one.channels[0]]))
                .collect(),
        }
    }
}

/// The weights of the convolution for backpropagation: rotated by half a turn, inputs and outputs exchanged.
fn turned(one: &Convolution) -> Vec<f32> {
    let [from, to] = one.channels;
    let mut turned = vec![0.0; one.weight.len()];
    for (tap, weight) in one.weight.chunks_exact(from * to).enumerate() {
        for (i, weight) in weight.chunks_exact(to).enumerate() {
            for (o, &value) in weight.iter().enumerate() {
                turned[((TAPS - 1 - tap) * to + o) * from + i] = value;
            }
        }
    }
    turned
}

impl Part {
    fn new(refinement: &Refinement) -> Self {
        let gradient =
            refinement.convolutions.iter().flat_map(|one| [vec![0.0; one.weight.len()], vec![0.0; one.bias.len()]]);
        Part { pictures: refinement.pictures(), errors: refinement.pictures(), gradient: gradient.collect(), loss: 0.0 }
    }

    fn begin(&mut self) {
        self.loss = 0.0;
        self.gradient.iter_mut().for_each(|gradient| gradient.fill(0.0));
    }

    fn forward(&mut self, refinement: &Refinement, packed: &Packed, row: &[f32]) {
        refinement.shape.put(row, refinement.channels_in(), &mut self.pictures[0]);
        let count = refinement.convolutions.len();
        for (index, one) in refinement.convolutions.iter().enumerate() {
            let (before, after) = self.pictures.split_at_mut(index + 1);
            let last = if index + 1 < count { Last::Relu } else { Last::Keep };
            let weight = &packed.forward[index];
            convolve(refinement.shape, one.channels, weight, Some(&one.bias), &before[index], &mut after[0], last);
        }
    }

    fn take_output(&self, refinement: &Refinement, output: &mut [f32]) {
        let (shape, channels) = (refinement.shape, refinement.channels_in());
        shape.take(self.pictures.last().expect("there are convolutions"), 1, output);
        for (row, output) in output.chunks_exact_mut(shape.columns).enumerate() {
            let input = &self.pictures[0][shape.row(row, channels)];
            output.iter_mut().zip(input.iter().step_by(channels)).for_each(|(output, input)| *output += input);
        }
    }

    /// Adds the loss of one row and its gradient; the gradient with respect to the input is written to `error`.
    fn descend(
        &mut self,
        refinement: &Refinement,
        packed: &Packed,
        row: &[f32],
        target: &[f32],
        scale: f32,
        error: &mut [f32],
    ) {
        self.forward(refinement, packed, row);
        let shape = refinement.shape;
        let mut output = vec![0.0; target.len()];
        self.take_output(refinement, &mut output);
        let mut by_output = vec![0.0; target.len()];
        self.loss += square_error(&output, target, scale, &mut by_output);
        let count = refinement.convolutions.len();
        shape.put(&by_output, 1, &mut self.errors[count]);
        for (index, one) in refinement.convolutions.iter().enumerate().rev() {
            self.add_gradient(refinement, index);
            let (before, after) = self.errors.split_at_mut(index + 1);
            let channels = [one.channels[1], one.channels[0]];
            let last = if index > 0 { Last::Where(&self.pictures[index]) } else { Last::Keep };
            convolve(shape, channels, &packed.backward[index], None, &after[0], &mut before[index], last);
        }
        let channels = refinement.channels_in();
        shape.take(&self.errors[0], channels, error);
        error.iter_mut().step_by(channels).zip(&by_output).for_each(|(error, value)| *error += value);
    }

    fn add_gradient(&mut self, refinement: &Refinement, index: usize) {
        let (shape, channels @ [from, to]) = (refinement.shape, refinement.convolutions[index].channels);
        let (input, error) = (&self.pictures[index], &self.errors[index + 1]);
        let [by_weight, by_bias] = &mut self.gradient[2 * index..2 * index + 2] else { unreachable!("two tensors") };
        if to.is_multiple_of(CHANNELS_TOGETHER) {
            run(WeightGradient { shape, input, error, channels, gradient: by_weight });
        } else {
            // Exchanged: the few channels of the error are read next to each pixel of the input.
            let mut turned = vec![0.0; by_weight.len()];
            run(WeightGradient { shape, input: error, error: input, channels: [to, from], gradient: &mut turned });
            for (tap, turned) in turned.chunks_exact(from * to).enumerate() {
                for (o, turned) in turned.chunks_exact(from).enumerate() {
                    for (i, value) in turned.iter().enumerate() {
                        by_weight[((TAPS - 1 - tap) * from + i) * to + o] += value;
                    }
                }
            }
        }
        for row in 0..shape.rows {
            for pixel in error[shape.row(row, to)].chunks_exact(to) {
                by_bias.iter_mut().zip(pixel).for_each(|(sum, value)| *sum += value);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::network::Architecture;

    fn filled(count: usize, step: f32) -> Vec<f32> {
        (0..count).map(|at| (at as f32 * step).sin()).collect()
    }

    /// The gradient of a network compared with differences of its loss.
    fn gradient_is_right(architecture: &Architecture, rows: usize) {
        let mut network = Network::new(architecture, 3);
        // Not at the initial weights, where the last convolution is zero.
        for (at, values) in network.values_mut().into_iter().enumerate() {
            values.iter_mut().zip(filled(100_000, 0.37 + at as f32)).for_each(|(value, more)| *value += 0.1 * more);
        }
        let (inputs, targets) = (filled(rows * architecture.inputs(), 0.7), filled(rows * architecture.outputs(), 1.3));
        let batch = Batch { inputs: &inputs, targets: &targets };
        let mut pass = Pass::new(&network, rows);
        pass.descend(&mut network, batch);
        let gradient = pass.gradient.clone();
        let learned: Vec<usize> =
            network.tensors().iter().enumerate().filter(|(_, t)| t.is_learned).map(|(at, _)| at).collect();
        for (tensor, gradient) in learned.into_iter().zip(&gradient) {
            // Along one direction per tensor; for single values the rounding error would be too large.
            let direction: Vec<f32> = gradient.iter().map(|value| value.signum()).collect();
            let slope: f64 = gradient.iter().map(|value| f64::from(value.abs())).sum();
            let step = 3e-4 / (gradient.len() as f32).sqrt();
            let mut at = |factor: f32| {
                let mut moved = network.clone();
                let values = moved.values_mut().swap_remove(tensor);
                values.iter_mut().zip(&direction).for_each(|(value, way)| *value += factor * step * way);
                pass.descend(&mut moved, batch)
            };
            let measured = (at(1.0) - at(-1.0)) / f64::from(2.0 * step);
            assert!((measured - slope).abs() < 0.03 * slope + 3e-3, "tensor {tensor}: {measured} and {slope}");
        }
    }

    #[test]
    fn the_gradient_is_the_slope_of_the_loss() {
        gradient_is_right(&Architecture::paper(24, 30), 17);
        gradient_is_right(&Architecture::paper_norm_first(24, 30), 17);
        gradient_is_right(&Architecture::refined(11, [4, 5], true, &[4, 16, 16, 1]), 5);
        gradient_is_right(&Architecture::refined(11, [3, 7], false, &[1, 32, 1]), 14);
    }

    #[test]
    fn threads_change_no_bit() {
        let architecture = Architecture::refined(40, [6, 7], true, &[4, 16, 1]);
        let (inputs, targets) = (filled(30 * 40, 0.7), filled(30 * 42, 1.3));
        let with = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| {
                let mut network = Network::new(&architecture, 3);
                let mut pass = Pass::new(&network, 30);
                let loss = pass.descend(&mut network, Batch { inputs: &inputs, targets: &targets });
                (loss, pass.gradient)
            })
        };
        assert_eq!(with(1).0, with(2).0);
        assert_eq!(with(1).1[2..], with(2).1[2..]);
    }
}
