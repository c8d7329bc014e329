//! The noise of each channel, from untouched frames.

use crate::frame::{Differences, Frame, reciprocal};
use crate::protocol::Protocol;
use crate::stats::{bisect, quantile, rms, sorted, upper_median};
use serde::Serialize;
use std::f64::consts::{PI, TAU};

/// The floor: least standard deviation of a channel over that of the median channel of its group. A channel whose value is
/// in the middle of a step of the converter shows no noise until the noise is large.
const FLOOR: f64 = 0.5;
/// The step of the converter is larger than this part of the largest gaps: a step of the current changes a value by less, and the
/// same step of the voltage is another one in ohm for each drive. The median in place of it gives 11 false contacts in 900
/// presses on the twin `harsh` at 80 dB, and this none.
const MOST_STEPS: f64 = 0.9;
/// A smaller part of the variance that the step hides does not count: that of noise of more than a fifth of the step.
const HIDDEN: f64 = 0.05;
/// Standard deviation where nothing tells it, over the root mean square of the values: 60 dB.
const ASSUMED: f64 = 1e-3;
/// With fewer frames a touched one cannot be told from the others.
const MIN_FOR_WEIGHTS: usize = 4;
/// Weights are computed this many times; after that they change by less than 1 %.
const PASSES: usize = 4;
/// Mean square deviation of a frame, over the median of all frames, from which on it counts less: three deviations of a noise
/// that all channels share, as that of one current.
const LARGE: f64 = 9.0;
/// Robust standard deviation of a normal distribution over the median of its absolute values.
const NORMAL_MEDIAN: f64 = 1.4826;

/// What the noise rests on.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum NoiseSource {
    /// The scatter of several frames.
    Scatter,
    /// The differences of reciprocal channels, of a single frame or of frames without scatter: not only noise.
    Reciprocity,
    /// The frames that contacts are found in: how reciprocal channels change, and how frames follow each other.
    Frames,
    /// Nothing: 60 dB.
    Assumed,
}

/// The noise of each channel of a frame.
///
/// The variance of a channel over few frames is uncertain, so it is shrunk towards those of its group: the channels that
/// read no voltage at a driven electrode, or those that do. How far follows from how much the variances of the group differ
/// beyond chance (empirical Bayes; Smyth, 2004, DOI 10.2202/1544-6115.1027, section 6.2): equal channels share one
/// variance, different ones with many frames keep their own. At least it is a quarter of the group's median.
///
/// A converter rounds to steps `q`, which adds an error of the variance `q^2 / 12` (Bennett, 1948, DOI
/// 10.1002/j.1538-7305.1948.tb01340.x). Noise that is smaller than the step does not show it: the value is the same in all
/// frames, or one of two. What is hidden follows from the mean variance of the group. It does not become less in the mean of
/// many frames. The step is the largest gap between the values of a channel, of nearly all channels.
///
/// A frame whose mean square deviation is far larger than the median of all frames, because it is touched, has a weight that
/// falls with its square (a redescending estimate of scale; Huber and Ronchetti, 2009, DOI 10.1002/9780470434697, section
/// 5.2), from a start by medians.
///
/// ```
/// use dermis::estimate::noise::ChannelNoise;
/// use dermis::protocol::Protocol;
///
/// let protocol = Protocol::adjacent(8)?;
/// let frame = |k: usize| (0..56).map(|c| 5.0 + 0.01 * ((7 * k * k + 13 * c * (k + 1)) as f64).sin()).collect::<Vec<f64>>();
/// let frames: Vec<Vec<f64>> = (0..20).map(frame).collect();
/// let noise = ChannelNoise::of(&frames, &protocol).expect("frames");
/// assert!(noise.sd_ohm().iter().all(|sd| (sd - 0.01 / 2f64.sqrt()).abs() < 1e-3)); // ohm
/// # Ok::<(), dermis::protocol::ProtocolError>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct ChannelNoise {
    sd_ohm: Vec<f64>,
    /// The part of it that is the same in all frames.
    hidden_ohm: Vec<f64>,
    frames: usize,
    source: NoiseSource,
    /// The channels that read no voltage at a driven electrode, and those that do.
    groups: [Vec<usize>; 2],
    /// What touched frames change of the mean of all frames.
    offset_ohm: Vec<f64>,
}

impl ChannelNoise {
    /// The noise of untouched frames, of several also by their differences from one frame; `None` without a frame.
    ///
    /// # Panics
    /// If a frame does not fit the protocol.
    pub fn of<F: AsRef<[f64]>>(untouched: &[F], protocol: &Protocol) -> Option<Self> {
        ChannelNoise::of_used(untouched, protocol, |_| true)
    }

    /// The same of some channels: the others are as those with a value that is not finite, and have no part in the noise.
    ///
    /// # Panics
    /// If a frame does not fit the protocol.
    pub fn of_used<F: AsRef<[f64]>>(
        untouched: &[F],
        protocol: &Protocol,
        is_used: impl Fn(usize) -> bool,
    ) -> Option<Self> {
        let frames: Vec<&[f64]> = untouched.iter().map(AsRef::as_ref).collect();
        let first = frames.first()?;
        assert!(frames.iter().all(|frame| frame.len() == protocol.channel_count()), "frames of the protocol");
        let is_finite = |channel: usize| is_used(channel) && frames.iter().all(|frame| frame[channel].is_finite());
        let finite: Vec<bool> = (0..first.len()).map(is_finite).collect();
        let groups = protocol.channels_by_drive().map(|group| group.into_iter().filter(|&one| finite[one]).collect());
        let mut noise = ChannelNoise {
            sd_ohm: vec![f64::NAN; first.len()],
            hidden_ohm: vec![0.0; first.len()],
            frames: frames.len(),
            source: NoiseSource::Scatter,
            groups,
            offset_ohm: Vec::new(),
        };
        let Moments { mean, variance, weights } = moments(&frames, &finite);
        let freedom = (weights.iter().sum::<f64>() - 1.0).max(1.0);
        let usual: Vec<&[f64]> =
            frames.iter().zip(&weights).filter(|(_, weight)| **weight >= 1.0).map(|(one, _)| *one).collect();
        noise.offset_ohm = mean_of(&frames, &vec![1.0; frames.len()]).iter().zip(&mean).map(|(a, b)| a - b).collect();
        let pooled =
            noise.groups.clone().map(|group| noise.shrink(&group, &variance, freedom, step_ohm(&usual, &group)));
        match pooled {
            [None, None] => noise.without_scatter(&mean, protocol),
            // A group without scatter has that of the other.
            [own, other] => {
                for (group, pooled) in [(0, own), (1, other)] {
                    if let (None, Some(sd)) = (pooled, own.or(other)) {
                        noise.set(group, sd, sd);
                    }
                }
            }
        }
        Some(noise)
    }

    /// The noise of the untouched frames of some differences. Where they do not scatter, it is rather that of the frames themselves,
    /// touched or not, if these show less: by the changes of reciprocal channels, which a touch changes alike, and by the changes
    /// from one frame to the next. Each of them is noise and something else, so that the least one is nearest to the noise.
    /// `None` without untouched frames.
    ///
    /// # Panics
    /// If a frame does not fit the protocol.
    pub fn of_differences(differences: &Differences, protocol: &Protocol) -> Option<Self> {
        ChannelNoise::of(&differences.rest(), protocol).map(|noise| noise.with_frames(&differences.frames, protocol))
    }

    fn with_frames(mut self, frames: &[Frame], protocol: &Protocol) -> Self {
        if self.source == NoiseSource::Scatter || frames.is_empty() {
            return self;
        }
        let partners = reciprocal(protocol);
        let steps: Vec<Vec<f64>> = frames
            .windows(2)
            .map(|pair| pair[1].iter().zip(pair[0].iter()).map(|(a, b)| (a - b) / 2f64.sqrt()).collect())
            .collect();
        for group in 0..2 {
            let channels = self.groups[group].clone();
            let reciprocal: Vec<f64> = frames.iter().map(|frame| disagreement(&partners, frame, &channels)).collect();
            // A difference has the noise of the single untouched frame, too.
            let reciprocal = upper_median(&reciprocal).unwrap_or(0.0) / 2f64.sqrt();
            let sizes = |step: &Vec<f64>| {
                upper_median(&channels.iter().map(|&channel| step[channel].abs()).collect::<Vec<f64>>()).unwrap_or(0.0)
            };
            let following = NORMAL_MEDIAN * upper_median(&steps.iter().map(sizes).collect::<Vec<f64>>()).unwrap_or(0.0);
            let own = self.by_group_ohm()[group];
            let least = [reciprocal, following].into_iter().filter(|sd| *sd > 0.0).fold(f64::INFINITY, f64::min);
            if least.is_finite() && (self.source == NoiseSource::Assumed || least < own) {
                self.set(group, least, 0.0);
                self.source = NoiseSource::Frames;
            }
        }
        self
    }

    /// The standard deviation of each channel of one frame, ohm; `NaN` for a channel with a value that is not finite.
    pub fn sd_ohm(&self) -> &[f64] {
        &self.sd_ohm
    }

    /// The same of the mean of the frames, with what touched ones change of it.
    pub fn sd_of_mean_ohm(&self) -> Vec<f64> {
        let of_mean = |((sd, hidden), offset): ((&f64, &f64), &f64)| {
            let shown = (sd * sd - hidden * hidden) / self.frames as f64;
            (shown + hidden * hidden + offset * offset).sqrt()
        };
        self.sd_ohm.iter().zip(&self.hidden_ohm).zip(&self.offset_ohm).map(of_mean).collect()
    }

    /// The same of the difference of one more frame from that mean; 0 for a channel with a value that is not finite.
    pub fn sd_of_difference_ohm(&self) -> Vec<f64> {
        let sd = |(sd, of_mean): (&f64, f64)| if sd.is_finite() { sd.hypot(of_mean) } else { 0.0 };
        self.sd_ohm.iter().zip(self.sd_of_mean_ohm()).map(sd).collect()
    }

    /// Whether the noise of a channel is smaller than the step of its converter: its value may be the same in all frames.
    pub fn is_hidden(&self, channel: usize) -> bool {
        self.hidden_ohm[channel] > 0.0
    }

    /// The deviation of the median channel of those that read no voltage at a driven electrode, and of those that do, ohm;
    /// `NaN` without such a channel.
    pub fn by_group_ohm(&self) -> [f64; 2] {
        let of = |group: &Vec<usize>| group.iter().map(|&channel| self.sd_ohm[channel]).collect::<Vec<f64>>();
        self.groups.each_ref().map(|group| upper_median(&of(group)).unwrap_or(f64::NAN))
    }

    /// What the noise rests on.
    pub fn source(&self) -> NoiseSource {
        self.source
    }

    /// Sets the deviation of a group, and the part of it that is the same in all frames.
    fn set(&mut self, group: usize, sd_ohm: f64, hidden_ohm: f64) {
        for &channel in &self.groups[group] {
            (self.sd_ohm[channel], self.hidden_ohm[channel]) = (sd_ohm, hidden_ohm);
        }
    }

    /// Sets the deviations of a group from its variances, and returns the median; `None` without scatter.
    fn shrink(&mut self, group: &[usize], variance: &[f64], freedom: f64, step_ohm: f64) -> Option<f64> {
        let scattered: Vec<f64> = group.iter().map(|&channel| variance[channel]).filter(|one| *one > 0.0).collect();
        if scattered.is_empty() {
            return None;
        }
        let (usual, weight) = prior(&scattered, freedom);
        let shrunk = |variance: f64| weight * usual + (1.0 - weight) * variance;
        let median = shrunk(upper_median(&scattered)?);
        let mean = group.iter().map(|&channel| variance[channel]).sum::<f64>() / group.len() as f64;
        let hidden = Some(hidden(mean, step_ohm)).filter(|hidden| *hidden > HIDDEN * (mean + hidden)).unwrap_or(0.0);
        // Where in a step a value is tells whether it varies, and not its error.
        let share = if hidden > 0.0 { 12.0 * hidden / (step_ohm * step_ohm) } else { 0.0 };
        for &channel in group {
            let own = shrunk(variance[channel]).max(FLOOR * FLOOR * median);
            self.sd_ohm[channel] = (share * mean + (1.0 - share) * own + hidden).sqrt();
            self.hidden_ohm[channel] = hidden.sqrt();
        }
        Some((median + hidden).sqrt())
    }

    /// The noise of frames that do not scatter, from their mean.
    fn without_scatter(&mut self, mean: &[f64], protocol: &Protocol) {
        let partners = reciprocal(protocol);
        let found = self.groups.each_ref().map(|group| disagreement(&partners, mean, group));
        self.source = NoiseSource::Reciprocity;
        let [own, other] = found.map(|sd| Some(sd).filter(|sd| *sd > 0.0));
        let fallback = own.or(other).unwrap_or_else(|| {
            self.source = NoiseSource::Assumed;
            let group = if self.groups[0].is_empty() { &self.groups[1] } else { &self.groups[0] };
            // Not zero where all values are.
            (ASSUMED * rms(group.iter().map(|&channel| mean[channel]))).max(f64::MIN_POSITIVE.sqrt())
        });
        for (group, sd) in [own, other].into_iter().enumerate() {
            let sd = sd.unwrap_or(fallback);
            self.set(group, sd, sd);
        }
    }
}

impl std::fmt::Display for ChannelNoise {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let parts = self.by_group_ohm().into_iter().zip(["", " at driven electrodes"]);
        let known: Vec<String> =
            parts.filter(|(sd, _)| !sd.is_nan()).map(|(sd, place)| format!("{sd:.3e} ohm{place}")).collect();
        let source = match self.source {
            NoiseSource::Scatter => "",
            NoiseSource::Reciprocity => ", from reciprocal channels alone",
            NoiseSource::Frames => ", from the frames themselves",
            NoiseSource::Assumed => ", unknown: 60 dB assumed",
        };
        write!(f, "noise of the channels {}{source}", known.join(" and "))
    }
}

/// Robust standard deviation of a value in some channels, from its differences to the reciprocal channels, limited to three
/// times their robust deviation; 0 where there are none.
pub fn disagreement(reciprocal: &[Vec<(usize, f64)>], values: &[f64], channels: &[usize]) -> f64 {
    let pairs = channels.iter().flat_map(|&own| reciprocal[own].iter().map(move |&(other, sign)| (own, other, sign)));
    let differences = pairs.map(|(own, other, sign)| (values[own] - sign * values[other]).abs() / 2f64.sqrt());
    let finite: Vec<f64> = differences.filter(|difference| difference.is_finite()).collect();
    // Of noise alone the limit leaves 99.5 % of the variance; a wrong pair counts no more than nine others.
    let limit = 3.0 * NORMAL_MEDIAN * upper_median(&finite).unwrap_or(0.0);
    Some(rms(finite.iter().map(|difference| difference.min(limit)))).filter(|sd| sd.is_finite()).unwrap_or(0.0)
}

/// The step of the converter: the largest gap between the values of a channel, of nearly all channels whose values differ. Where
/// noise is larger than the step it is about the noise, and hides nothing.
fn step_ohm(frames: &[&[f64]], group: &[usize]) -> f64 {
    let largest_gap = |&channel: &usize| {
        let values = sorted(frames.iter().map(|frame| frame[channel]));
        values.windows(2).map(|pair| pair[1] - pair[0]).fold(0.0, f64::max)
    };
    let gaps = sorted(group.iter().map(largest_gap).filter(|gap| *gap > 0.0));
    if gaps.is_empty() { 0.0 } else { quantile(&gaps, MOST_STEPS) }
}

/// The variance of the error by rounding that the values of one place do not show, from their mean variance over all places in a
/// step. Noise of `s` steps leaves of it `sum over k of exp(-(2 pi k s)^2) / (2 pi^2 k^2)` squares of the step (Widrow and
/// Kollar, 2008, DOI 10.1017/CBO9780511754661, section 6.3), and shows `s^2 + 1/12` less that.
fn hidden(variance: f64, step: f64) -> f64 {
    if step == 0.0 {
        return 0.0;
    }
    let term = |s: f64, k: f64| (-(TAU * k * s).powi(2)).exp() / (2.0 * (PI * k).powi(2));
    let left = |s: f64| (1..=50).map(|k| term(s, f64::from(k))).sum::<f64>();
    let shown = variance / (step * step);
    let noise = bisect([0.0, 1.0], 40, |s| s * s + 1.0 / 12.0 - left(s) >= shown);
    step * step * left(noise)
}

/// Weighted mean and variance of each channel, and the weights of the frames.
struct Moments {
    mean: Vec<f64>,
    variance: Vec<f64>,
    weights: Vec<f64>,
}

/// The moments of frames. Channels that are not finite have no weight.
fn moments(frames: &[&[f64]], finite: &[bool]) -> Moments {
    let count = frames.len() as f64;
    let mut weights = vec![1.0; frames.len()];
    if frames.len() >= MIN_FOR_WEIGHTS {
        let (mut middle, mut variance) = medians(frames);
        for _ in 0..PASSES {
            weights = self::weights(frames, finite, &middle, &variance);
            middle = mean_of(frames, &weights);
            variance = variance_of(frames, &weights, &middle);
        }
    }
    let mean = mean_of(frames, &weights);
    let mut variance = variance_of(frames, &weights, &mean);
    let unbiased = if frames.len() < 2 { 0.0 } else { count / (count - 1.0) };
    variance.iter_mut().for_each(|variance| *variance *= unbiased);
    Moments { mean, variance, weights }
}

/// The median of each channel, and its variance from the median of the absolute deviations.
fn medians(frames: &[&[f64]]) -> (Vec<f64>, Vec<f64>) {
    let of_channel = |channel: usize| {
        let mut values: Vec<f64> = frames.iter().map(|frame| frame[channel]).collect();
        let middle = upper_median(&values).unwrap_or_default();
        values.iter_mut().for_each(|value| *value = (*value - middle).abs());
        (middle, (NORMAL_MEDIAN * upper_median(&values).unwrap_or_default()).powi(2))
    };
    (0..frames[0].len()).map(of_channel).unzip()
}

/// The weighted mean of each channel: exact where its values are equal.
fn mean_of(frames: &[&[f64]], weights: &[f64]) -> Vec<f64> {
    let total: f64 = weights.iter().sum();
    let first = frames[0];
    let sums = weighted(frames, weights, |channel, value| (value - first[channel]) / total);
    first.iter().zip(sums).map(|(first, sum)| first + sum).collect()
}

/// The weighted mean of the squares of the deviations from some values.
fn variance_of(frames: &[&[f64]], weights: &[f64], from: &[f64]) -> Vec<f64> {
    let total: f64 = weights.iter().sum();
    weighted(frames, weights, |channel, value| (value - from[channel]).powi(2) / total)
}

/// The weighted sum of a function of each value.
fn weighted(frames: &[&[f64]], weights: &[f64], of: impl Fn(usize, f64) -> f64) -> Vec<f64> {
    let mut sums = vec![0.0; frames[0].len()];
    for (frame, weight) in frames.iter().zip(weights) {
        let terms = sums.iter_mut().zip(*frame).enumerate();
        terms.for_each(|(channel, (sum, &value))| *sum += weight * of(channel, value));
    }
    sums
}

/// 1 for a frame whose mean square deviation is not large against the median of all frames; for others the square of the
/// limit over it.
fn weights(frames: &[&[f64]], finite: &[bool], mean: &[f64], variance: &[f64]) -> Vec<f64> {
    let used: Vec<usize> = (0..mean.len()).filter(|&channel| finite[channel] && variance[channel] > 0.0).collect();
    let square = |frame: &&[f64]| {
        used.iter().map(|&channel| (frame[channel] - mean[channel]).powi(2) / variance[channel]).sum::<f64>()
    };
    let squares: Vec<f64> = frames.iter().map(square).collect();
    let limit = LARGE * upper_median(&squares).unwrap_or(0.0);
    squares.iter().map(|square| if *square > limit { (limit / square).powi(2) } else { 1.0 }).collect()
}

/// The usual variance of a group, and its weight beside a channel's own with some degrees of freedom.
///
/// If the variances of a group are distributed as `d0 s0^2 / chi^2(d0)`, their logarithms have the variance
/// `trigamma(d / 2) + trigamma(d0 / 2)`, which gives `d0`; the expectation of a variance is then that of `d0` degrees of
/// freedom with the value `s0^2` and `d` with its own.
fn prior(variances: &[f64], freedom: f64) -> (f64, f64) {
    let count = variances.len() as f64;
    let average = variances.iter().sum::<f64>() / count;
    let logs: Vec<f64> = variances.iter().map(|variance| variance.ln()).collect();
    let mean_log = logs.iter().sum::<f64>() / count;
    let excess = logs.iter().map(|log| (log - mean_log).powi(2)).sum::<f64>() / (count - 1.0) - trigamma(0.5 * freedom);
    // A single channel has no spread.
    if excess.is_nan() || excess <= 0.0 {
        return (average, 1.0);
    }
    let prior_freedom = 2.0 * trigamma_inverse(excess);
    let bias = |freedom: f64| digamma(0.5 * freedom) - (0.5 * freedom).ln();
    let usual = (mean_log - bias(freedom) + bias(prior_freedom)).exp();
    (usual, prior_freedom / (prior_freedom + freedom))
}

/// Arguments from which the asymptotic series of digamma and trigamma are accurate to 1e-10.
const ASYMPTOTIC: f64 = 10.0;

/// The logarithmic derivative of the gamma function (Abramowitz and Stegun, 1964, 6.3.5 and 6.3.18).
fn digamma(x: f64) -> f64 {
    if x < ASYMPTOTIC {
        return digamma(x + 1.0) - 1.0 / x;
    }
    let inverse = 1.0 / (x * x);
    x.ln() - 0.5 / x - inverse * (1.0 / 12.0 - inverse * (1.0 / 120.0 - inverse * (1.0 / 252.0 - inverse / 240.0)))
}

/// Its derivative (6.4.6 and 6.4.12).
fn trigamma(x: f64) -> f64 {
    if x < ASYMPTOTIC {
        return trigamma(x + 1.0) + 1.0 / (x * x);
    }
    let inverse = 1.0 / (x * x);
    (1.0 + 0.5 / x + inverse * (1.0 / 6.0 - inverse * (1.0 / 30.0 - inverse * (1.0 / 42.0 - inverse / 30.0)))) / x
}

/// The argument at which trigamma has a value, by halving: it falls from infinity to 0.
fn trigamma_inverse(value: f64) -> f64 {
    // trigamma(x) is between 1 / x and 1 / x + 1 / x^2.
    let [low, high] = [1.0 / value, 1.0 / value + 1.0 / value.sqrt()];
    bisect([low, high], 64, |x| trigamma(x) <= value)
}

#[cfg(test)]
mod tests;
