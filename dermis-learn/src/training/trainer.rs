//! Training: epochs of gradient descent steps, until the test loss stops decreasing.

use crate::LearnError;
use crate::input::Input;
use crate::kernel::run;
use crate::network::{Architecture, Network};
use crate::options::{Epoch, TrainOptions};
use crate::training::adam::{AdamOptions, AdamStep};
use crate::training::checkpoint;
use crate::training::pass::{Batch, Pass};
use crate::training::samples::{Augmentation, Samples};
use rayon::prelude::*;
use std::path::Path;
use std::time::Instant;

/// Number of samples for the inputs' mean and standard deviation.
const NORMALISE_BY: usize = 20_000;
/// Number of values updated by one thread at a time.
const STEP_TOGETHER: usize = 1 << 15;
/// The random streams from here on are for noise of the test samples, those below for the training samples.
const TEST_STREAMS: u64 = 1 << 62;

/// A network during training.
#[derive(Debug)]
pub struct Trainer<'a> {
    options: TrainOptions,
    /// Skin, noise and datasets, by which a checkpoint is known.
    pub(super) origin: String,
    training: &'a Samples,
    test: &'a Samples,
    pub(crate) state: State,
    pass: Pass,
    inputs: Vec<f32>,
    targets: Vec<f32>,
    /// The targets are multiplied by this for training: then they have standard deviation one, for which Adam's
    /// learning rate is intended.
    scale: f32,
}

/// The complete state that is needed to continue training.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct State {
    pub network: Network,
    pub input: Input,
    /// Adam's means and mean squares of each trained tensor.
    pub moments: Vec<[Vec<f32>; 2]>,
    pub steps: u64,
    pub epochs: Vec<Epoch>,
}

impl<'a> Trainer<'a> {
    /// A network before its first step, with the input normalised by the training samples.
    ///
    /// # Errors
    /// Fewer samples than the batch size; options out of range; samples that cannot be read.
    pub fn new(
        architecture: &Architecture,
        mut input: Input,
        options: &TrainOptions,
        training: &'a Samples,
        test: &'a Samples,
    ) -> Result<Self, LearnError> {
        let out_of_range = |what, value, must| Err(LearnError::OutOfRange { what, value, must });
        if !(options.rate > 0.0 && options.rate.is_finite()) {
            return out_of_range("the rate", f64::from(options.rate), "positive and finite");
        }
        if options.batch < 2 || options.batch > training.source().len() {
            return out_of_range(
                "the samples of a step",
                options.batch as f64,
                "2 or more, and no more than the training samples",
            );
        }
        if options.epochs == 0 {
            return out_of_range("the number of epochs", 0.0, "at least 1");
        }
        let order = training.source().order(options.seed, 0);
        let few = &order[..order.len().min(NORMALISE_BY)];
        training.source().prepare(few)?;
        let differences = few
            .par_iter()
            .map(|&index| training.typical_difference(index, options.seed))
            .collect::<Result<Vec<_>, _>>()?;
        input.normalise(&differences);
        let scale = training.target_variance(few)?.sqrt().recip() as f32;
        let scale = if scale.is_finite() { scale } else { 1.0 };
        let network = Network::new(architecture, options.seed);
        let learned = network.tensors().into_iter().filter(|tensor| tensor.is_learned);
        let moments = learned.map(|tensor| [vec![0.0; tensor.values.len()], vec![0.0; tensor.values.len()]]).collect();
        let pass = Pass::new(&network, options.batch);
        Ok(Trainer {
            options: options.clone(),
            origin: String::new(),
            training,
            test,
            inputs: vec![0.0; options.batch * architecture.inputs()],
            targets: vec![0.0; options.batch * architecture.outputs()],
            state: State { network, input, moments, steps: 0, epochs: Vec::new() },
            pass,
            scale,
        })
    }

    /// Continues from a checkpoint, if there is one.
    ///
    /// # Errors
    /// A checkpoint of another network or training, or a damaged one.
    pub fn resume(&mut self, path: &Path) -> Result<bool, LearnError> {
        checkpoint::read(path, &self.options, &self.origin, &mut self.state)
    }

    /// Writes the state that is needed to continue.
    ///
    /// # Errors
    /// A file that cannot be written; the previous checkpoint is then unchanged.
    pub fn save(&self, path: &Path) -> Result<(), LearnError> {
        checkpoint::write(path, &self.options, &self.origin, &self.state)
    }

    /// The current network.
    pub fn network(&self) -> Network {
        self.state.network.clone().scaled(self.scale.recip())
    }

    /// The factor of the targets during training: one over their standard deviation.
    pub fn target_scale(&self) -> f32 {
        self.scale
    }

    /// The conversion of differences to its inputs.
    pub fn input(&self) -> &Input {
        &self.state.input
    }

    /// The finished epochs.
    pub fn epochs(&self) -> &[Epoch] {
        &self.state.epochs
    }

    /// Steps per epoch.
    pub fn steps_per_epoch(&self) -> usize {
        self.options.steps_per_epoch(self.training.source().len())
    }

    /// Whether all epochs are finished, or the test loss has stopped decreasing.
    pub fn is_done(&self) -> bool {
        self.options.is_done(&self.state.epochs)
    }

    /// One epoch, then the test. `on_step` is called with the mean loss so far after every step.
    ///
    /// # Errors
    /// Samples that cannot be read; a loss that is not finite.
    pub fn epoch(&mut self, mut on_step: impl FnMut(f64)) -> Result<Epoch, LearnError> {
        let begun = Instant::now();
        let number = self.state.epochs.len() + 1;
        let order = self.training.source().order(self.options.seed, number as u64);
        let steps = self.steps_per_epoch();
        let mut sum = 0.0;
        for (done, indices) in order.chunks_exact(self.options.batch).take(steps).enumerate() {
            // Every sample of every epoch has its own noise.
            let first = self.state.steps * self.options.batch as u64;
            self.fill(self.training, indices, first)?;
            sum += self.step() / f64::from(self.scale * self.scale);
            if !sum.is_finite() {
                return Err(LearnError::Diverged { epoch: number });
            }
            on_step(sum / (done + 1) as f64);
        }
        let test_loss = self.test_loss()?;
        let seconds = begun.elapsed().as_secs_f64();
        let epoch = Epoch { training_loss: sum / steps as f64, test_loss, seconds };
        self.state.epochs.push(epoch);
        Ok(epoch)
    }

    /// The mean square error on the test samples, whose noise is always the same.
    fn test_loss(&mut self) -> Result<f64, LearnError> {
        let batch = self.options.batch;
        let indices: Vec<usize> = (0..self.test.source().len()).collect();
        let (mut sum, mut values) = (0.0, 0);
        for (number, chunk) in indices.chunks(batch).enumerate() {
            let mut padded = chunk.to_vec();
            padded.resize(batch, chunk[0]);
            self.fill(self.test, &padded, TEST_STREAMS + (number * batch) as u64)?;
            let outputs = self.pass.outputs(&mut self.state.network, &self.inputs);
            let count = chunk.len() * self.state.network.architecture().outputs();
            let square = |(output, target): (&f32, &f32)| f64::from(output - target).powi(2);
            sum += outputs[..count].iter().zip(&self.targets).map(square).sum::<f64>();
            values += count;
        }
        Ok(sum / values as f64 / f64::from(self.scale * self.scale))
    }

    fn fill(&mut self, samples: &Samples, indices: &[usize], first: u64) -> Result<(), LearnError> {
        samples.source().prepare(indices)?;
        let architecture = self.state.network.architecture();
        let (inputs, targets) = (architecture.inputs(), architecture.outputs());
        let rows = self.inputs.par_chunks_mut(inputs).zip(self.targets.par_chunks_mut(targets));
        rows.zip(indices).enumerate().try_for_each(|(row, ((inputs, target), &index))| {
            let disturb = Augmentation::Step(self.options.seed, first + row as u64);
            samples.fill(index, disturb, &self.state.input, inputs, target)?;
            target.iter_mut().for_each(|value| *value *= self.scale);
            Ok(())
        })
    }

    /// One gradient step on the current batch; returns the loss before it.
    fn step(&mut self) -> f64 {
        let batch = Batch { inputs: &self.inputs, targets: &self.targets };
        let loss = self.pass.descend(&mut self.state.network, batch);
        self.state.steps += 1;
        let options = AdamOptions::default();
        let rate = self.options.rate_at(self.state.steps, self.steps_per_epoch());
        let rate = options.corrected(rate, self.state.steps);
        let learned: Vec<bool> = self.state.network.tensors().iter().map(|tensor| tensor.is_learned).collect();
        let values = self.state.network.values_mut().into_iter().zip(learned).filter(|(_, learned)| *learned);
        for (((values, _), gradient), [mean, square]) in values.zip(&self.pass.gradient).zip(&mut self.state.moments) {
            let moments = mean.par_chunks_mut(STEP_TOGETHER).zip(square.par_chunks_mut(STEP_TOGETHER));
            let values = values.par_chunks_mut(STEP_TOGETHER).zip(gradient.par_chunks(STEP_TOGETHER));
            values.zip(moments).for_each(|((values, gradient), (mean, square))| {
                run(AdamStep { options, rate, values, gradient, mean, square });
            });
        }
        loss
    }
}
