//! From the difference of a frame to what a network takes: the same in training, evaluation and live.

use dermis::protocol::Protocol;
use serde::{Deserialize, Serialize};
use std::collections::HashMap;

/// How a difference (frame less the untouched frame of the same skin, ohm) becomes the inputs of a network.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Input {
    /// For each input the channels whose mean it is.
    pub channels: Vec<Vec<usize>>,
    /// What is taken off each, ohm: its mean over the training set.
    pub mean_ohm: Vec<f32>,
    /// What it is divided by, ohm: its standard deviation there.
    pub sd_ohm: Vec<f32>,
}

impl Input {
    /// Every channel by itself, not normalised yet.
    pub fn each(protocol: &Protocol) -> Self {
        Self::of((0..protocol.channel_count()).map(|channel| vec![channel]).collect())
    }

    /// Channels that read the same by reciprocity (drive and measure exchanged) averaged, not normalised yet. Noise of the
    /// two is independent, so that nothing is lost.
    pub fn reciprocal(protocol: &Protocol) -> Self {
        let numbers: HashMap<_, usize> =
            protocol.channels().iter().enumerate().map(|(number, &channel)| (channel, number)).collect();
        let pair = |(number, channel): (usize, &dermis::protocol::Channel)| match numbers.get(&channel.reciprocal()) {
            Some(&other) if other < number => None,
            Some(&other) if other > number => Some(vec![number, other]),
            _ => Some(vec![number]),
        };
        Self::of(protocol.channels().iter().enumerate().filter_map(pair).collect())
    }

    fn of(channels: Vec<Vec<usize>>) -> Self {
        let count = channels.len();
        Input { channels, mean_ohm: vec![0.0; count], sd_ohm: vec![1.0; count] }
    }

    /// Number of inputs.
    pub fn len(&self) -> usize {
        self.channels.len()
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.channels.is_empty()
    }

    /// The inputs of a difference, ohm.
    pub fn prepare(&self, difference: impl Fn(usize) -> f32, inputs: &mut [f32]) {
        for ((input, channels), (mean, sd)) in
            inputs.iter_mut().zip(&self.channels).zip(self.mean_ohm.iter().zip(&self.sd_ohm))
        {
            let sum: f32 = channels.iter().map(|&channel| difference(channel)).sum();
            *input = (sum / channels.len() as f32 - mean) / sd;
        }
    }

    /// Normalises by the mean and the standard deviation of some differences. An input that is always the same is divided
    /// by the smallest deviation of the others.
    pub fn normalise(&mut self, differences: &[Vec<f32>]) {
        self.mean_ohm.fill(0.0);
        self.sd_ohm.fill(1.0);
        let (mut sums, mut squares) = (vec![0.0f64; self.len()], vec![0.0f64; self.len()]);
        let mut inputs = vec![0.0; self.len()];
        for difference in differences {
            self.prepare(|channel| difference[channel], &mut inputs);
            for (at, &value) in inputs.iter().enumerate() {
                sums[at] += f64::from(value);
                squares[at] += f64::from(value).powi(2);
            }
        }
        let count = differences.len() as f64;
        let sd = |at: usize| (squares[at] / count - (sums[at] / count).powi(2)).max(0.0).sqrt();
        let least = (0..self.len()).map(sd).filter(|sd| *sd > 0.0).fold(f64::INFINITY, f64::min);
        let least = if least.is_finite() { least } else { 1.0 };
        self.mean_ohm = sums.iter().map(|sum| (sum / count) as f32).collect();
        self.sd_ohm = (0..self.len()).map(|at| sd(at).max(least) as f32).collect();
    }
}
