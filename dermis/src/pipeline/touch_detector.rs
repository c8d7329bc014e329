//! Touch detection from the voltages only, without an image.

use crate::estimate::noise::{ChannelNoise, NoiseSource};
use crate::pipeline::statistics::{Statistics, difference};
use crate::protocol::Protocol;
use serde::{Deserialize, Serialize};

/// Detects touched frames by the size of their difference from the baseline.
///
/// The statistic is the sum of squares of all differences in use, [without drift of the
/// sheet](super::matched_filter::MatchedFilter::statistic), each divided by the standard deviation of its noise and
/// limited. For untouched frames it has a scaled chi-squared distribution, as the noise of channels is not
/// independent: its mean and variance are those of the tare's frames. A frame is touched if it exceeds the quantile
/// that noise exceeds once in three million frames, seven hours at 120 frames per second (Wilson and Hilferty, 1931,
/// DOI 10.1073/pnas.17.12.684).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct TouchDetector {
    mean: f64,
    threshold: f64,
    /// Whether the last frame was touched.
    #[serde(rename = "alarm")]
    touched: bool,
}

/// The quantile of the standard normal distribution: `Q(z) = 1 / 3e6`.
const QUANTILE: f64 = 4.97;
/// Limit of a channel's difference in standard deviations: a single bad reading, or a step of the converter where the
/// noise is far less, is not a touch. A touch changes many channels.
const MAX: f64 = 5.0;
/// A touch ends below this fraction of the threshold's distance from the mean.
const RELEASE: f64 = 0.6;

impl TouchDetector {
    /// From untouched frames and the statistic of a difference with some noise, ohm; each half of them is compared with the mean and
    /// the noise of the other half, because frames fit the statistics that they are part of better than new frames do. Frames that
    /// are all equal show no noise: then the statistic is that of independent values of the noise that they are given.
    ///
    /// # Panics
    /// If there are fewer than four frames.
    pub(super) fn of(untouched: &[&[f64]], protocol: &Protocol, statistic: impl Fn(&[f64], &[f64]) -> f64) -> Self {
        let half = |first: usize| untouched.iter().copied().skip(first).step_by(2);
        let statistics = |own: usize| {
            let other: Vec<&[f64]> = half(1 - own).collect();
            let noise = ChannelNoise::of(&other, protocol).expect("a half of four frames");
            let mean = Statistics::of(other.into_iter()).mean;
            let of = |frame| statistic(&difference(frame, &mean), noise.sd_ohm());
            half(own).map(of).collect::<Vec<f64>>()
        };
        let noise = ChannelNoise::of(untouched, protocol).expect("four frames");
        if noise.source() == NoiseSource::Scatter {
            return Self::new(&[statistics(0), statistics(1)].concat());
        }
        let mean = statistic(noise.sd_ohm(), noise.sd_ohm());
        Self::with_moments(mean, 2.0 * mean)
    }

    /// From the statistics of untouched frames.
    ///
    /// # Panics
    /// If there are fewer than two frames.
    pub(super) fn new(untouched: &[f64]) -> Self {
        assert!(untouched.len() > 1, "a variance needs two values");
        let count = untouched.len() as f64;
        let mean = untouched.iter().sum::<f64>() / count;
        let variance = untouched.iter().map(|value| (value - mean).powi(2)).sum::<f64>() / (count - 1.0);
        // The variance of n frames has the relative standard error sqrt(2 / n): the true one may be that much larger.
        Self::with_moments(mean, variance * (1.0 + 2.0 * (2.0 / count).sqrt()))
    }

    /// From the mean and variance of the statistic of untouched frames.
    fn with_moments(mean: f64, variance: f64) -> Self {
        let freedom = (2.0 * mean * mean / variance.max(f64::MIN_POSITIVE)).max(1.0);
        let spread = (2.0 / (9.0 * freedom)).sqrt();
        let threshold = mean * (1.0 - spread * spread + QUANTILE * spread).powi(3);
        TouchDetector { mean, threshold, touched: false }
    }

    /// Whether a frame with this statistic would be touched.
    pub(super) fn exceeds(&self, statistic: f64) -> bool {
        let limit = if self.touched { self.mean + RELEASE * (self.threshold - self.mean) } else { self.threshold };
        statistic > limit
    }

    /// Ends the touch: the next frame is touched if it exceeds the threshold of the first one.
    pub(super) fn end_touch(&mut self) {
        self.touched = false;
    }

    /// Whether the next frame, with this statistic, is touched.
    pub(super) fn update(&mut self, statistic: f64) -> bool {
        self.touched = self.exceeds(statistic);
        self.touched
    }
}

/// The statistic of a difference: the sum of its bounded squares over the variances of the noise.
pub(super) fn statistic(difference: &[f64], noise_ohm: &[f64], masked: &[bool]) -> f64 {
    let channels = difference.iter().zip(noise_ohm).zip(masked);
    let square = |difference: &f64, noise: &f64| (difference / noise).powi(2).min(MAX * MAX);
    channels.filter(|(_, masked)| !**masked).map(|((difference, noise), _)| square(difference, noise)).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use dermis_sim::random::{sample_rng, standard_normal};

    #[test]
    fn noise_is_never_a_touch_in_50_000_frames_and_a_touch_is_detected_at_once() {
        let mut rng = sample_rng(7, 0);
        // Half of the channels share their noise, like those of one current.
        let mut draw = |touch: f64| {
            let common = standard_normal(&mut rng);
            let values = (0..200).map(|at| {
                let own = standard_normal(&mut rng);
                touch + if at % 2 == 0 { own } else { (common + own) * 0.5f64.sqrt() }
            });
            values.map(|value| value * value).sum::<f64>()
        };
        let untouched: Vec<f64> = (0..100).map(|_| draw(0.0)).collect();
        let mut detector = TouchDetector::new(&untouched);
        assert_eq!((0..50_000).filter(|_| detector.update(draw(0.0))).count(), 0);
        assert!(detector.update(draw(4.0)));
        assert!(!detector.update(draw(0.0)));
    }

    /// Rounding is no touch of a skin whose frames are all equal, as those of a model.
    #[test]
    fn equal_frames_say_nothing_of_the_noise() {
        let protocol = Protocol::adjacent_undriven(16).unwrap();
        let count = protocol.channel_count();
        let frame = vec![1.0; count];
        let noise = ChannelNoise::of(&[frame.as_slice(); 8], &protocol).unwrap();
        let of = |difference: &[f64], noise: &[f64]| statistic(difference, noise, &vec![false; count]);
        let mut detector = TouchDetector::of(&[frame.as_slice(); 8], &protocol, of);
        let plus = |part: f64| frame.iter().map(|value| part * value).collect::<Vec<f64>>();
        assert!(!detector.update(of(&plus(0.0), noise.sd_ohm())) && !detector.update(of(&plus(1e-15), noise.sd_ohm())));
        assert!(detector.update(of(&plus(0.1), noise.sd_ohm())));
    }

    #[test]
    fn a_single_bad_reading_is_no_touch() {
        let protocol = Protocol::adjacent_undriven(16).unwrap();
        let count = protocol.channel_count();
        let mut rng = sample_rng(8, 0);
        let mut frame = || (0..count).map(|_| standard_normal(&mut rng)).collect::<Vec<f64>>();
        let untouched: Vec<Vec<f64>> = (0..100).map(|_| frame()).collect();
        let untouched: Vec<&[f64]> = untouched.iter().map(Vec::as_slice).collect();
        let mut detector = TouchDetector::of(&untouched, &protocol, |difference, noise| {
            statistic(difference, noise, &vec![false; count])
        });
        let (one, many) = (frame(), frame().iter().map(|value| value + 4.0).collect::<Vec<f64>>());
        let bad: Vec<f64> = one.iter().enumerate().map(|(at, value)| if at == 7 { 1e6 } else { *value }).collect();
        assert!(!detector.update(statistic(&bad, &vec![1.0; count], &vec![false; count])));
        assert!(detector.update(statistic(&many, &vec![1.0; count], &vec![false; count])));
    }
}
