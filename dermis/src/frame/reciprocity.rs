//! Reciprocal channels, and whether they agree.

use crate::frame::Frame;
use crate::protocol::{Channel, Protocol};
use crate::stats::{ranks, upper_median};
use std::collections::HashMap;

/// Minimum number of frames: the rank correlation of unrelated values is then below a third in nine of ten cases.
const FRAMES_AT_LEAST: usize = 20;

/// Amplitude ratio of two reciprocal channels from which the weaker one counts as not measured.
const LOUDER: f64 = 2.0;

/// Which channels of some differences are reliable, and their scale; no labels are needed.
///
/// The reciprocal channels of a channel measure the same quantity between the same pairs of electrodes: with the drive or the measure
/// reversed, or with drive and measure exchanged (reciprocity). Over many frames a channel and its reciprocal channels must rise and
/// fall together: a channel is excluded if its rank correlation (Spearman 1904) is positive with fewer than half of its
/// reciprocal channels. If two channels disagree, both are excluded, as it is unknown which one is wrong.
#[derive(Debug, Clone, PartialEq)]
pub struct Screening {
    /// Channels that disagree with their reciprocal channels, ascending.
    pub disagreeing: Vec<usize>,
    /// The robust standard deviation of each channel: 1.4826 times the median of the absolute values, in their unit.
    pub(crate) sd: Vec<f64>,
}

impl Screening {
    /// Screens differences of one protocol; with fewer than 20 of them no channel is excluded.
    ///
    /// # Panics
    /// If the length of a difference differs from the protocol.
    pub fn of(differences: &[Frame], protocol: &Protocol) -> Self {
        let count = protocol.channel_count();
        assert!(differences.iter().all(|frame| frame.len() == count), "differences of the protocol");
        let column = |channel: usize| differences.iter().map(|frame| frame[channel]).collect::<Vec<f64>>();
        let sizes = |channel: usize| column(channel).into_iter().map(f64::abs).collect::<Vec<f64>>();
        let sd = (0..count).map(|channel| 1.4826 * upper_median(&sizes(channel)).unwrap_or(0.0)).collect();
        if differences.len() < FRAMES_AT_LEAST {
            return Screening { disagreeing: Vec::new(), sd };
        }
        let ranks: Vec<Vec<f64>> = (0..count).map(|channel| centred_ranks(&column(channel))).collect();
        let together = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
        let disagrees = |channel: usize, reciprocal: &[(usize, f64)]| {
            let agrees = |&&(partner, sign): &&(usize, f64)| sign * together(&ranks[channel], &ranks[partner]) > 0.0;
            2 * reciprocal.iter().filter(agrees).count() < reciprocal.len()
        };
        let reciprocal = reciprocal(protocol).into_iter().enumerate().filter(|(_, reciprocal)| !reciprocal.is_empty());
        let disagreeing =
            reciprocal.filter(|(channel, reciprocal)| disagrees(*channel, reciprocal)).map(|(channel, _)| channel);
        Screening { disagreeing: disagreeing.collect(), sd }
    }

    /// Channels of an instrument that reports amplitudes and measures voltages of only one sign (`polarity_blind`),
    /// ascending: all those whose value has the other sign on the model's untouched skin. With the drive reversed the
    /// same voltage has the other sign, so one of two such reciprocal channels hardly changes compared with the other: if one of them
    /// has twice the amplitude, the stronger one must have the same sign in four of five cases. Empty if signs are
    /// reported, or if the amplitudes of reciprocal channels are similar.
    ///
    /// # Panics
    /// If the length of the untouched frame differs from the protocol.
    pub fn polarity_blind(&self, protocol: &Protocol, untouched: &Frame) -> Vec<usize> {
        assert_eq!(untouched.len(), protocol.channel_count(), "a frame of the protocol");
        if !protocol.amplitude_only() {
            return Vec::new();
        }
        let positive = |channel: usize| untouched[channel] > 0.0;
        let (mut pairs, mut louder) = (0, [0, 0]);
        for (channel, reciprocal) in reciprocal(protocol).into_iter().enumerate() {
            for (partner, _) in reciprocal.into_iter().filter(|&(partner, _)| positive(channel) != positive(partner)) {
                pairs += 1;
                if self.sd[channel] >= LOUDER * self.sd[partner] {
                    louder[usize::from(positive(channel))] += 1;
                }
            }
        }
        // Every pair was counted from both ends; most pairs must give a result, and the results must agree.
        let decided = louder[0] + louder[1];
        let one_sign = 4 * decided >= pairs && 5 * louder[0].max(louder[1]) >= 4 * decided && decided > 0;
        let blind_to_positive = louder[0] > louder[1];
        (0..untouched.len()).filter(|&channel| one_sign && positive(channel) == blind_to_positive).collect()
    }

    /// A difference with its outliers limited to some robust standard deviations of their channel. A channel with more
    /// than half of its values zero is not changed, as its scale is unknown.
    pub fn cut(&self, difference: &Frame, limit_sd: f64) -> Frame {
        let cut = |(&value, &sd): (&f64, &f64)| match sd * limit_sd {
            limit if limit > 0.0 => value.clamp(-limit, limit),
            _ => value,
        };
        Frame(difference.iter().zip(&self.sd).map(cut).collect())
    }
}

/// For each channel the others that measure the same quantity, with the relative sign (always +1 if the instrument
/// reports amplitudes).
pub fn reciprocal(protocol: &Protocol) -> Vec<Vec<(usize, f64)>> {
    let keys: Vec<([usize; 4], f64)> = protocol.channels().iter().map(key).collect();
    let mut groups: HashMap<[usize; 4], Vec<usize>> = HashMap::new();
    for (channel, (key, _)) in keys.iter().enumerate() {
        groups.entry(*key).or_default().push(channel);
    }
    let sign = |a: usize, b: usize| if protocol.amplitude_only() { 1.0 } else { keys[a].1 * keys[b].1 };
    let others = |channel: usize| {
        let group = &groups[&keys[channel].0];
        group.iter().filter(|&&other| other != channel).map(|&other| (other, sign(channel, other))).collect()
    };
    (0..keys.len()).map(others).collect()
}

/// The quantities of a protocol, each with the channels that measure it and their signs relative to the first one: a
/// channel and its reciprocal ones.
pub fn quantities(protocol: &Protocol) -> Vec<Vec<(usize, f64)>> {
    let reciprocal = reciprocal(protocol);
    let own = reciprocal
        .into_iter()
        .enumerate()
        .filter(|(channel, reciprocal)| reciprocal.iter().all(|(other, _)| other > channel));
    own.map(|(channel, reciprocal)| std::iter::once((channel, 1.0)).chain(reciprocal).collect()).collect()
}

/// A key that is equal for channels that measure the same quantity up to a sign, and that sign.
fn key(channel: &Channel) -> ([usize; 4], f64) {
    let mut sign = 1.0;
    let mut pairs = [channel.drive, channel.measure].map(|[a, b]| {
        if a > b {
            sign = -sign;
        }
        [a.min(b), a.max(b)]
    });
    pairs.sort_unstable();
    ([pairs[0][0], pairs[0][1], pairs[1][0], pairs[1][1]], sign)
}

/// The ranks of some values less their mean; equal values share the mean of their ranks.
fn centred_ranks(values: &[f64]) -> Vec<f64> {
    let middle = (values.len() as f64 - 1.0) / 2.0;
    ranks(values).into_iter().map(|rank| rank - middle).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Drives 0 -> 2 and 2 -> 0 of a skin of four electrodes, each measured between 1 and 3, and a channel without a
    /// reciprocal channel.
    fn protocol() -> Protocol {
        let channel = |drive, measure| Channel { drive, measure };
        let channels =
            vec![channel([0, 2], [1, 3]), channel([2, 0], [1, 3]), channel([1, 3], [0, 2]), channel([0, 1], [2, 3])];
        Protocol::new(4, channels).unwrap()
    }

    #[test]
    fn twins_are_reversed_or_reciprocal_and_know_their_sign() {
        let found = reciprocal(&protocol());
        assert_eq!(found[0], vec![(1, -1.0), (2, 1.0)]);
        assert_eq!(found[1], vec![(0, -1.0), (2, -1.0)]);
        assert!(found[3].is_empty());
        let blind = reciprocal(&protocol().with_amplitude_only(true));
        assert_eq!(blind[1], vec![(0, 1.0), (2, 1.0)]);
        // By reciprocity each of the paper's 870 values has exactly one reciprocal channel.
        assert!(reciprocal(&Protocol::adjacent(30).unwrap()).iter().all(|reciprocal| reciprocal.len() == 1));
    }

    #[test]
    fn a_channel_that_goes_against_its_twins_is_left_out() {
        let wave = |k: usize, phase: f64| (0.7 * k as f64 + phase).sin();
        let frames: Vec<Frame> =
            (0..60).map(|k| Frame(vec![wave(k, 0.0), wave(k, 0.0), wave(k, 0.1), wave(k, 2.0)])).collect();
        // Channel 1 should be minus channel 0 and minus channel 2.
        assert_eq!(Screening::of(&frames, &protocol()).disagreeing, vec![1]);
        assert!(Screening::of(&frames, &protocol().with_amplitude_only(true)).disagreeing.is_empty());
        assert!(Screening::of(&frames[..10], &protocol()).disagreeing.is_empty());
    }

    #[test]
    fn the_sign_whose_channels_hardly_change_is_polarity_blind() {
        let screening = |sd: [f64; 4]| Screening { disagreeing: Vec::new(), sd: sd.to_vec() };
        let untouched = Frame(vec![-1.0, 1.0, -2.0, -1.0]);
        let blind = protocol().with_amplitude_only(true);
        // Channel 1 has the drive of channel 0 reversed; channel 2 exchanges drive and measure; channel 3 has no reciprocal channel.
        assert_eq!(screening([1.0, 0.3, 1.2, 1.0]).polarity_blind(&blind, &untouched), vec![1]);
        assert_eq!(screening([0.3, 1.0, 0.4, 1.0]).polarity_blind(&blind, &untouched), vec![0, 2, 3]);
        let none: Vec<usize> = Vec::new();
        assert_eq!(screening([1.0, 0.9, 1.2, 1.0]).polarity_blind(&blind, &untouched), none);
        // One pair supports it, the other contradicts it.
        assert_eq!(screening([1.0, 0.3, 0.1, 1.0]).polarity_blind(&blind, &untouched), none);
        assert_eq!(screening([1.0, 0.3, 1.2, 1.0]).polarity_blind(&protocol(), &untouched), none);
    }

    #[test]
    fn an_outlier_is_cut_at_three_robust_deviations() {
        let mut frames: Vec<Frame> = (0..41).map(|k| Frame(vec![k as f64 - 20.0; 4])).collect();
        frames[0][2] = -1e6;
        let screening = Screening::of(&frames, &protocol());
        let limit = 3.0 * 1.4826 * 10.0;
        assert!((screening.cut(&frames[0], 3.0)[2] + limit).abs() < 1e-9, "{:?}", screening.sd);
        assert_eq!(screening.cut(&frames[0], f64::INFINITY), frames[0]);
        assert_eq!(screening.cut(&frames[5], 3.0)[1], -15.0);
        let silent = Screening { disagreeing: Vec::new(), sd: vec![0.0; 4] };
        assert_eq!(
            (silent.cut(&frames[0], 3.0), silent.cut(&frames[0], f64::INFINITY)),
            (frames[0].clone(), frames[0].clone())
        );
    }

    #[test]
    fn equal_values_share_their_rank() {
        assert_eq!(centred_ranks(&[5.0, 1.0, 5.0, 9.0]), vec![0.0, -1.5, 0.0, 1.5]);
    }
}
