//! What the reciprocal channels of one frame tell: spikes of single channels, and its noise.

use crate::frame::reciprocal;
use crate::protocol::Protocol;
use crate::stats::{rms, upper_median};
use std::borrow::Cow;

/// Two reciprocal channels contradict each other beyond this many standard deviations of their difference in the frame, ...
pub(crate) const UNLIKE_NOISES: f64 = 8.0;
/// ... if it also exceeds this part of the larger of the two changes and of the root mean square change of all channels. (A
/// touch that moves between the two measurements, and the errors of a real tank, are smaller.)
const UNLIKE_CHANGE: f64 = 0.5;
/// More pairs at once are no fault of single channels: a drive of the paper's skin is in 7 % of them.
pub(crate) const MAX_UNLIKE: f64 = 0.1;

/// Whether the changes of two reciprocal channels contradict each other, beyond a limit for their noise; the second one with
/// the sign of the first. By the reciprocity theorem a touch or drift changes both alike. All in ohm; `usual` is the root mean
/// square change of all channels.
pub(crate) fn contradict([a, b]: [f64; 2], limit: f64, usual: f64) -> bool {
    (a - b).abs() > limit.max(UNLIKE_CHANGE * a.abs().max(b.abs()).max(usual))
}

/// Reciprocal channels may disagree by this part of the larger of their changes without noise: gains differ, and touches move between
/// the two measurements (4 to 14 % in recordings of a real tank).
const UNLIKE_PART: f64 = 0.15;
/// The median of what two values of noise disagree by beyond that, over the standard deviation of their difference, ...
const NOISE_MEDIAN: f64 = 0.564;
/// ... and the standard deviation of that of `n` pairs, relative to it and times the root of `n`.
const MEDIAN_SD: f64 = 1.28;
/// A median counts as that of the known noise up to this many of its standard deviations above it.
const USUAL_SD: f64 = 3.0;

/// The pairs of reciprocal channels, with the noise of their differences.
#[derive(Debug, Clone, PartialEq)]
pub struct ReciprocalPairs {
    pairs: Vec<Pair>,
    /// Whether most pairs agree in the untouched frame: then they do in others, but for noise.
    agree: bool,
}

#[derive(Debug, Clone, Copy, PartialEq)]
struct Pair {
    channels: [usize; 2],
    /// The sign of the second channel relative to the first.
    sign: f64,
    /// Standard deviation of the difference of their noise, ohm.
    sd_ohm: f64,
}

impl Pair {
    /// The changes of both, with the sign of the first, if both are known.
    fn changes(&self, difference: &[f64]) -> Option<[f64; 2]> {
        let [own, other] = self.channels.map(|channel| difference[channel]);
        (own != 0.0 && other != 0.0).then_some([own, self.sign * other])
    }
}

impl ReciprocalPairs {
    /// For channels whose noise has these standard deviations, ohm; a channel without a finite and positive one is left
    /// out.
    ///
    /// # Panics
    /// If there are fewer deviations than channels.
    pub fn new(protocol: &Protocol, sd_ohm: &[f64]) -> Self {
        let is_usable = |channel: usize| sd_ohm[channel].is_finite() && sd_ohm[channel] > 0.0;
        let pair = |own: usize, other: usize, sign| Pair {
            channels: [own, other],
            sign,
            sd_ohm: sd_ohm[own].hypot(sd_ohm[other]),
        };
        let of = |(own, reciprocal): (usize, Vec<(usize, f64)>)| {
            let later = move |(other, _): &(usize, f64)| *other > own && is_usable(own) && is_usable(*other);
            reciprocal.into_iter().filter(later).map(move |(other, sign)| pair(own, other, sign))
        };
        let pairs = reciprocal(protocol).into_iter().enumerate().flat_map(of).collect();
        ReciprocalPairs { pairs, agree: false }
    }

    /// The same for a skin with this untouched frame, ohm: only where most reciprocal channels agree in it do they tell the noise of
    /// others. Instruments that report amplitudes often break reciprocity.
    ///
    /// # Panics
    /// If the frame has fewer values than there are channels.
    #[must_use]
    pub fn with_rest(self, rest_ohm: &[f64]) -> Self {
        let changes = self.pairs.iter().filter_map(|pair| pair.changes(rest_ohm));
        let unlike: Vec<f64> = changes.map(|[a, b]| (a - b).abs() / a.abs().max(b.abs())).collect();
        ReciprocalPairs { agree: upper_median(&unlike).is_some_and(|unlike| unlike <= UNLIKE_PART), ..self }
    }

    /// A difference (ohm) without spikes. Of two reciprocal channels that contradict each other by more than noise, and by more
    /// than half of the larger change and of the root mean square of all changes, the larger one has the value of the other:
    /// a touch changes both alike, a spike only one. If more than a tenth of the pairs contradict each other, nothing is
    /// changed: then it is not single channels that are wrong. A value of exactly 0 is that of a channel that is masked, and
    /// says nothing.
    ///
    /// # Panics
    /// If the difference has fewer values than there are channels.
    pub fn without_spikes<'a>(&self, difference: &'a [f64]) -> Cow<'a, [f64]> {
        let usual = rms(difference.iter().copied());
        let noises = UNLIKE_NOISES * self.noise_ratio(difference);
        let known = || self.pairs.iter().filter_map(|pair| Some((pair, pair.changes(difference)?)));
        let are_unlike = |(pair, changes): &(&Pair, [f64; 2])| contradict(*changes, noises * pair.sd_ohm, usual);
        let unlike: Vec<_> = known().filter(are_unlike).collect();
        if unlike.is_empty() || unlike.len() as f64 > MAX_UNLIKE * known().count() as f64 {
            return Cow::Borrowed(difference);
        }
        let mut repaired = difference.to_vec();
        for (Pair { channels: [own, other], sign, .. }, [first, second]) in unlike {
            match first.abs() > second.abs() {
                true => repaired[*own] = second,
                false => repaired[*other] = sign * first,
            }
        }
        Cow::Owned(repaired)
    }

    /// The noise of a difference (ohm) over that of the channels, by the median disagreement of reciprocal channels: 1 unless it is
    /// larger than chance, and what touches leave, make it, and where the untouched frame is [not known](Self::with_rest) to agree. A
    /// touch or drift changes both alike.
    ///
    /// # Panics
    /// If the difference has fewer values than there are channels.
    pub fn noise_ratio(&self, difference: &[f64]) -> f64 {
        if !self.agree {
            return 1.0;
        }
        let beyond = |pair: &Pair| {
            let [own, other] = pair.changes(difference)?;
            Some(((own - other).abs() - UNLIKE_PART * own.abs().max(other.abs())) / pair.sd_ohm)
        };
        let disagreements: Vec<f64> = self.pairs.iter().filter_map(beyond).collect();
        let ratio = upper_median(&disagreements).map_or(1.0, |median| median / NOISE_MEDIAN);
        let usual = 1.0 + USUAL_SD * MEDIAN_SD / (disagreements.len() as f64).sqrt();
        if ratio > usual { ratio } else { 1.0 }
    }

    /// Whether a difference (ohm) with this [ratio](Self::noise_ratio) of noise is noise alone: it is larger than that of the channels,
    /// and what reciprocal channels have in common is not larger than what they differ by, but for chance. The ratio of the two
    /// sums of squares is then that of the F distribution, of standard deviation `2 / sqrt(pairs)` around 1.
    ///
    /// # Panics
    /// If the difference has fewer values than there are channels.
    pub fn is_noise_alone(&self, difference: &[f64], noise_ratio: f64) -> bool {
        if noise_ratio == 1.0 {
            return false;
        }
        let known = || self.pairs.iter().filter_map(|pair| Some((pair.changes(difference)?, pair.sd_ohm)));
        let common: f64 = known().map(|([a, b], sd_ohm)| ((a + b) / sd_ohm).powi(2)).sum();
        let apart: f64 = known().map(|([a, b], sd_ohm)| ((a - b) / sd_ohm).powi(2)).sum();
        common <= (1.0 + USUAL_SD * 2.0 / (known().count() as f64).sqrt()) * apart
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::design::SkinDesign;
    use crate::forward::ForwardModel;
    use crate::mesh::Mesh;
    use dermis_sim::random::{sample_rng, standard_normal};

    #[test]
    fn spikes_and_noise_are_told_from_touches() {
        let design = SkinDesign::shipped("cylinder30").unwrap();
        let model = ForwardModel::new(&design, &Mesh::generate(&design).unwrap()).unwrap();
        let (protocol, rest) = (&design.protocol, model.rest_conductivity());
        let untouched = model.solve(rest).unwrap();
        let count = protocol.channel_count();
        let unknown = ReciprocalPairs::new(protocol, &vec![1.0; count]);
        let pairs = unknown.clone().with_rest(&untouched);
        let broken: Vec<f64> = (0..count).map(|channel| untouched[channel] * (1.0 + (channel % 5) as f64)).collect();
        let broken = unknown.clone().with_rest(&broken);
        assert_eq!(pairs.pairs.len(), count / 2);
        let mut rng = sample_rng(3, 0);
        for cell in (0..rest.len()).step_by(rest.len() / 12) {
            let mut touched = rest.to_vec();
            touched[cell] *= 10.0;
            let change = &model.solve(&touched).unwrap() - &untouched;
            let largest = change.iter().fold(0.0, |largest: f64, value| largest.max(value.abs()));
            let touch = |channel: usize| 1000.0 / largest * change[channel];
            // Of the touch, spikes that are far smaller than it remain.
            let sum = |values: &[f64]| values.iter().map(|value| value * value).sum::<f64>();
            let noise: Vec<f64> = (0..count).map(|_| standard_normal(&mut rng)).collect();
            let mut spiked = noise.clone();
            (0..29).for_each(|spike| spiked[30 * spike] += 20.0);
            let repaired = pairs.without_spikes(&spiked);
            assert!(sum(&repaired) < 1.1 * sum(&noise), "{} of {}", sum(&repaired), sum(&noise));
            let with_noise = |ratio: f64| -> Vec<f64> {
                (0..count).map(|channel| touch(channel) + ratio * noise[channel]).collect()
            };
            let touched = with_noise(1.0);
            assert_eq!(pairs.noise_ratio(&touched), 1.0);
            // Where the touch is larger than the noise it hides a part of it.
            let noisy: Vec<f64> = noise.iter().map(|value| 3.0 * value).collect();
            let [alone, beside] = [&noisy, &with_noise(3.0)].map(|frame| pairs.noise_ratio(frame));
            assert_eq!([&unknown, &broken].map(|pairs| pairs.noise_ratio(&noisy)), [1.0; 2]);
            assert!((2.5..3.5).contains(&alone) && (1.0..3.5).contains(&beside), "{alone}, {beside}");
            let is_noise = |frame: &[f64]| pairs.is_noise_alone(frame, pairs.noise_ratio(frame));
            assert!(is_noise(&noisy) && !is_noise(&noise));
            let noisier: Vec<f64> = noise.iter().map(|value| 4.0 * value).collect();
            assert!(matches!(pairs.without_spikes(&noisier), Cow::Borrowed(_)), "wide noise is no spike");
            assert!(![1.0, 3.0].iter().any(|ratio| is_noise(&with_noise(*ratio))));
            // The channels of an instrument have gains of their own.
            let gain = |channel: usize| 1.0 + 0.03 * noise[(channel * 7) % count];
            let strong: Vec<f64> = (0..count).map(|c| gain(c) * 10.0 * touch(c) + noise[c]).collect();
            assert_eq!(pairs.noise_ratio(&strong), 1.0);
            assert!(matches!(pairs.without_spikes(&touched), Cow::Borrowed(_)));
            spiked.iter_mut().step_by(3).for_each(|value| *value += 20.0);
            assert!(matches!(pairs.without_spikes(&spiked), Cow::Borrowed(_)));
        }
    }
}
