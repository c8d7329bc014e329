//! Conversion of a frame difference to network inputs: the same in training, evaluation and live use.

use dermis::frame::reciprocal;
use dermis::protocol::Protocol;
use dermis::stats::upper_median;
use serde::{Deserialize, Serialize};

/// The conversion of a difference (frame minus the untouched frame of the same skin, ohm) to the inputs of a network.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Input {
    /// For each input the channels that are averaged; an input without a channel is zero, like one at its mean.
    pub(crate) channels: Vec<Vec<usize>>,
    /// The offset subtracted from each input, ohm: its mean over the training set.
    pub(crate) mean_ohm: Vec<f32>,
    /// The divisor of each input, ohm: its standard deviation over the training set; for scale-free inputs a robust
    /// estimate (1.4826 times the median of the absolute values).
    pub(crate) sd_ohm: Vec<f32>,
    /// Whether the inputs are scale-free: no offset is subtracted, all inputs are divided by their root mean square,
    /// and the image is multiplied by it. Then a multiple of a difference gives the same multiple of the image, for any
    /// unit of the instrument.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub scale_free: bool,
}

/// Ratio of the standard deviation of a normal distribution to its median absolute value.
const MEDIAN_TO_SD: f32 = 1.4826;

impl Input {
    /// Each channel is an input, not normalised yet.
    pub fn each(protocol: &Protocol) -> Self {
        Self::of((0..protocol.channel_count()).map(|channel| vec![channel]).collect())
    }

    /// Reciprocal channels (drive and measure exchanged) averaged, not normalised yet. Their noise is independent, so
    /// no information is lost.
    pub fn reciprocal(protocol: &Protocol) -> Self {
        let mut inputs: Vec<Vec<usize>> = (0..protocol.channel_count()).map(|channel| vec![channel]).collect();
        for [first, second] in protocol.reciprocal_pairs() {
            inputs[first].push(second);
            inputs[second].clear();
        }
        inputs.retain(|channels| !channels.is_empty());
        Self::of(inputs)
    }

    /// Channels that measure the same quantity with the same sign ([`reciprocal`]: drive or measure reversed, or both
    /// exchanged) averaged, scale-free; not normalised yet.
    pub fn shapes(protocol: &Protocol) -> Self {
        let groups = reciprocal(protocol).into_iter().enumerate().filter_map(|(channel, reciprocal)| {
            let same = reciprocal.into_iter().filter(|(_, sign)| *sign > 0.0).map(|(partner, _)| partner);
            let mut group: Vec<usize> = std::iter::once(channel).chain(same).collect();
            group.sort_unstable();
            (group[0] == channel).then_some(group)
        });
        Input { scale_free: true, ..Self::of(groups.collect()) }
    }

    fn of(channels: Vec<Vec<usize>>) -> Self {
        let count = channels.len();
        Input { channels, mean_ohm: vec![0.0; count], sd_ohm: vec![1.0; count], scale_free: false }
    }

    /// The same without some channels, which are replaced by their reciprocal channels.
    #[must_use]
    pub fn without(&self, left_out: &[usize]) -> Self {
        let kept = |group: &Vec<usize>| group.iter().copied().filter(|channel| !left_out.contains(channel)).collect();
        Input { channels: self.channels.iter().map(kept).collect(), ..self.clone() }
    }

    /// The same for an instrument whose channels have different amplitudes: each input is divided by its robust scale
    /// in some differences, as in training. No labels are needed, but touches all over the skin. An input that is zero
    /// in half of the differences keeps its divisor.
    ///
    /// # Panics
    /// If the inputs are not scale-free.
    #[must_use]
    pub fn matched(&self, differences: &[Vec<f32>]) -> Self {
        assert!(self.scale_free, "only of a frame's shape");
        let plain = Input { sd_ohm: vec![1.0; self.len()], ..self.clone() };
        let typical = plain.typical(differences);
        let sd_ohm = typical.into_iter().zip(&self.sd_ohm).map(|(own, &sd)| if own > 0.0 { own } else { sd });
        Input { sd_ohm: sd_ohm.collect(), ..self.clone() }
    }

    /// The robust standard deviation of each input about zero.
    fn typical(&self, differences: &[Vec<f32>]) -> Vec<f32> {
        let mut columns = vec![Vec::with_capacity(differences.len()); self.len()];
        let mut inputs = vec![0.0; self.len()];
        for difference in differences {
            self.normalised(|channel| difference[channel], &mut inputs);
            columns.iter_mut().zip(&inputs).for_each(|(column, input)| column.push(input.abs()));
        }
        columns.iter().map(|column| upper_median(column).map_or(0.0, |median| MEDIAN_TO_SD * median)).collect()
    }

    /// Number of inputs.
    pub fn len(&self) -> usize {
        self.channels.len()
    }

    /// Whether there are no inputs.
    pub fn is_empty(&self) -> bool {
        self.channels.is_empty()
    }

    /// The inputs of a difference, ohm; returns the factor of the image.
    pub fn prepare(&self, difference: impl Fn(usize) -> f32, inputs: &mut [f32]) -> f32 {
        self.normalised(difference, inputs);
        self.take_size(inputs)
    }

    /// Means of channels, normalised.
    pub(crate) fn normalised(&self, difference: impl Fn(usize) -> f32, inputs: &mut [f32]) {
        for ((input, channels), (mean, sd)) in
            inputs.iter_mut().zip(&self.channels).zip(self.mean_ohm.iter().zip(&self.sd_ohm))
        {
            let sum: f32 = channels.iter().map(|&channel| difference(channel)).sum();
            *input = if channels.is_empty() { 0.0 } else { (sum / channels.len() as f32 - mean) / sd };
        }
    }

    /// Divides the inputs by their root mean square if they are scale-free; returns the factor of the image.
    pub(crate) fn take_size(&self, inputs: &mut [f32]) -> f32 {
        if !self.scale_free {
            return 1.0;
        }
        let count = self.channels.iter().filter(|channels| !channels.is_empty()).count();
        let square: f32 = inputs.iter().map(|input| input * input).sum();
        let size = (square / count.max(1) as f32).sqrt();
        // Zero inputs stay zero: the factor of the image is then zero.
        let factor = if size > 0.0 { 1.0 / size } else { 0.0 };
        inputs.iter_mut().for_each(|input| *input *= factor);
        size
    }

    /// Normalises by the mean and the standard deviation of some differences. An input that is constant is divided by
    /// the smallest deviation of the others.
    pub(crate) fn normalise(&mut self, differences: &[Vec<f32>]) {
        self.mean_ohm.fill(0.0);
        self.sd_ohm.fill(1.0);
        if self.scale_free {
            return self.normalise_sizes(differences);
        }
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

    /// Divides by the robust scale; for an input that is zero in half of the differences, the smallest scale of the
    /// others is used.
    fn normalise_sizes(&mut self, differences: &[Vec<f32>]) {
        let typical = self.typical(differences);
        let least = typical.iter().copied().filter(|sd| *sd > 0.0).fold(f32::INFINITY, f32::min);
        let least = if least.is_finite() { least } else { 1.0 };
        self.sd_ohm = typical.into_iter().map(|sd| sd.max(least)).collect();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use dermis::design::SkinDesign;

    fn input() -> (Input, Vec<f32>) {
        let protocol = SkinDesign::shipped("skin16").unwrap().protocol;
        let mut input = Input::shapes(&protocol);
        let differences: Vec<Vec<f32>> = (0..50)
            .map(|k| (0..192).map(|c| (1.0 + c as f32) * (0.7 * (k * 192 + c) as f32).sin()).collect())
            .collect();
        input.normalise(&differences);
        (input, differences[3].clone())
    }

    fn prepared(input: &Input, difference: &[f32]) -> (Vec<f32>, f32) {
        let mut inputs = vec![0.0; input.len()];
        let size = input.prepare(|channel| difference[channel], &mut inputs);
        (inputs, size)
    }

    #[test]
    fn a_multiple_has_the_same_shape_and_a_multiple_of_the_size() {
        let (input, difference) = input();
        let thrice: Vec<f32> = difference.iter().map(|value| 3.0 * value).collect();
        let ((one, size), (other, larger)) = (prepared(&input, &difference), prepared(&input, &thrice));
        assert!(one.iter().zip(&other).all(|(a, b)| (a - b).abs() < 1e-5));
        assert!((larger / size - 3.0).abs() < 1e-5, "{size} and {larger}");
        let (nothing, zero) = prepared(&input, &[0.0; 192]);
        assert!(zero == 0.0 && nothing.iter().all(|value| *value == 0.0));
    }

    #[test]
    fn a_twin_replaces_an_excluded_channel() {
        let (input, mut difference) = input();
        // Drive d and drive d + 8 use the same pair of electrodes, measured in the same way.
        assert!(input.len() == 96 && input.channels.iter().all(|group| group[1] == group[0] + 96));
        for channel in 0..96 {
            difference[96 + channel] = difference[channel];
        }
        let whole = prepared(&input, &difference);
        for channel in [5, 40, 130] {
            difference[channel] = 1e6;
        }
        assert_eq!(prepared(&input.without(&[5, 40, 130]), &difference), whole);
        assert_ne!(prepared(&input, &difference), whole);
        // Without both channels the input is zero, and the size is computed from the others.
        let (gone, _) = prepared(&input.without(&[5, 101]), &difference);
        assert_eq!(gone[5], 0.0);
    }

    #[test]
    fn the_loudness_of_channels_is_matched_without_labels() {
        let (input, _) = input();
        let frames = |gain: fn(usize) -> f32| -> Vec<Vec<f32>> {
            let value = |k: usize, c: usize| gain(c) * (0.3 * (k * 7 + c) as f32).sin();
            (0..200).map(|k| (0..192).map(|c| value(k, c % 96)).collect()).collect()
        };
        let (even, uneven) = (frames(|_| 1.0), frames(|c| 1.0 + c as f32));
        let (one, other) = (input.matched(&even), input.matched(&uneven));
        let ((a, _), (b, _)) = (prepared(&one, &even[9]), prepared(&other, &uneven[9]));
        assert!(a.iter().zip(&b).all(|(a, b)| (a - b).abs() < 1e-4));
        assert_ne!(prepared(&input, &even[9]).0, prepared(&input, &uneven[9]).0);
    }
}
