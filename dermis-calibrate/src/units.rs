//! Robust units of the channels.

use dermis::stats::upper_median;
use serde::{Deserialize, Serialize};

/// The standard deviation of a normal distribution over its median absolute deviation.
const SD_PER_MAD: f64 = 1.4826;

/// The scale of each channel: values become `asinh((value - median) / sd)`, with the robust standard deviation
/// `1.4826 MAD`. Large values are compressed, so that no channel and no single press dominates.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct ChannelUnits {
    median: Vec<f64>,
    sd: Vec<f64>,
}

impl ChannelUnits {
    /// The units of the channels of some frames.
    ///
    /// # Panics
    /// Without a frame, or with frames of different lengths.
    pub(crate) fn of(frames: &[impl AsRef<[f64]>]) -> Self {
        let channels = frames[0].as_ref().len();
        let scale = |channel: usize| {
            let mut values: Vec<f64> = frames.iter().map(|frame| frame.as_ref()[channel]).collect();
            let middle = upper_median(&values).expect("at least one frame");
            values.iter_mut().for_each(|value| *value = (*value - middle).abs());
            (middle, SD_PER_MAD * upper_median(&values).expect("at least one frame"))
        };
        let (median, sd) = (0..channels).map(scale).unzip();
        ChannelUnits { median, sd }
    }

    /// Number of channels.
    pub(crate) fn channel_count(&self) -> usize {
        self.median.len()
    }

    /// Number of channels whose values differ between more than half of the frames; the others become 0.
    pub(crate) fn varying_count(&self) -> usize {
        self.sd.iter().filter(|sd| **sd > 0.0).count()
    }

    /// Whether every channel has both numbers.
    pub(crate) fn is_consistent(&self) -> bool {
        self.median.len() == self.sd.len() && self.sd.iter().chain(&self.median).all(|value| value.is_finite())
    }

    /// The value of a channel from its value in these units.
    pub(crate) fn invert(&self, channel: usize, value: f64) -> f64 {
        self.median[channel] + self.sd[channel] * value.sinh()
    }

    /// The untouched frame: differences of zero.
    pub(crate) fn untouched(&self) -> Vec<f64> {
        self.apply(&vec![0.0; self.channel_count()])
    }

    /// A frame in these units.
    ///
    /// # Panics
    /// Where the frame has another number of channels.
    pub(crate) fn apply(&self, frame: &[f64]) -> Vec<f64> {
        assert_eq!(frame.len(), self.channel_count(), "a value for each channel");
        let convert = |((value, median), sd): ((&f64, &f64), &f64)| {
            if *sd > 0.0 { ((value - median) / sd).asinh() } else { 0.0 }
        };
        frame.iter().zip(&self.median).zip(&self.sd).map(convert).collect()
    }
}

/// The change of a frame from the untouched one, both in [`ChannelUnits`], to be scaled.
pub(crate) struct Change {
    /// The untouched frame, in robust standard deviations from the median.
    untouched: Vec<f64>,
    /// The difference from it.
    difference: Vec<f64>,
}

impl Change {
    /// The change of a frame.
    pub(crate) fn of(values: &[f64], untouched: &[f64]) -> Self {
        let untouched: Vec<f64> = untouched.iter().map(|value| value.sinh()).collect();
        let difference = values.iter().zip(&untouched).map(|(value, untouched)| value.sinh() - untouched).collect();
        Change { untouched, difference }
    }

    /// The frame whose change is this one multiplied by a factor.
    pub(crate) fn amplified(&self, factor: f64) -> impl Iterator<Item = f64> {
        let changes = self.untouched.iter().zip(&self.difference);
        changes.map(move |(untouched, difference)| (untouched + factor * difference).asinh())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_constant_channel_becomes_zero() {
        let frames = [vec![1.0, 10.0], vec![2.0, 10.0], vec![3.0, 10.0]];
        let units = ChannelUnits::of(&frames);
        assert_eq!(units.apply(&[2.0, 10.0]), [0.0, 0.0]);
        assert!(units.apply(&[3.0, 10.0])[0] > 0.0);
    }

    #[test]
    fn an_amplified_frame_is_that_of_the_amplified_difference() {
        let frames = [vec![1.0, -3.0], vec![2.0, 4.0], vec![5.0, 1.0], vec![9.0, 0.5]];
        let units = ChannelUnits::of(&frames);
        let (values, untouched) = (units.apply(&frames[1]), units.untouched());
        let tripled = units.apply(&[6.0, 12.0]);
        for (value, tripled) in Change::of(&values, &untouched).amplified(3.0).zip(tripled) {
            assert!((value - tripled).abs() < 1e-12, "{value}");
        }
    }
}
