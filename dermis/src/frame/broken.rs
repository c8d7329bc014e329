//! Detection of broken channels in frames of the untouched skin.

use crate::frame::{Frame, mean, quantities};
use crate::protocol::Protocol;
use crate::stats::{rms, sorted, upper_median};

/// A channel is broken if its noise is this many times that of the median channel: for some channels, range switching
/// of the converter gives four times the noise, a drive without current about a thousand times.
const TOO_NOISY: f64 = 30.0;
/// Reciprocal channels contradict each other if they are this many times as far apart as noise and the median pair: errors of
/// gain reach a few times that of the median.
const TOO_FAR_APART: f64 = 10.0;
/// Noise below this part of the values, or of the largest noise, is an error of arithmetic.
const ROUNDING: f64 = 1e-9;
/// Values that are on the steps of a converter lie at so many levels at most, and between these is nearly all of their range.
const LEVELS: usize = 4;
const BETWEEN_LEVELS: f64 = 0.95;

/// The channels with far more noise than others in frames of an untouched skin, or with values that are not finite,
/// ascending: for example the channels of a drive through a disconnected electrode. Values that change from one step of the
/// converter to the next, where others stay on theirs, are no noise. Empty for fewer than two frames.
///
/// # Panics
/// If the frames differ in length.
pub fn broken_channels(untouched: &[Frame]) -> Vec<usize> {
    let Some(mean) = mean(untouched).filter(|_| untouched.len() > 1) else { return Vec::new() };
    let sd = deviations(untouched, &mean);
    let largest = sd.iter().copied().filter(|sd| sd.is_finite()).fold(0.0, f64::max);
    let scattered: Vec<f64> = sd.iter().copied().filter(|sd| sd.is_finite() && *sd > ROUNDING * largest).collect();
    // Without noise no channel can be judged.
    let median = upper_median(&scattered).unwrap_or(f64::INFINITY);
    let is_stepped = |channel: usize| is_stepped(untouched.iter().map(|frame| frame[channel]));
    let is_broken =
        |channel: usize| !sd[channel].is_finite() || (sd[channel] > TOO_NOISY * median && !is_stepped(channel));
    (0..sd.len()).filter(|&channel| is_broken(channel)).collect()
}

/// Whether values are at a few levels.
fn is_stepped(values: impl Iterator<Item = f64>) -> bool {
    let values = sorted(values);
    let [Some(first), Some(last)] = [values.first(), values.last()] else { return false };
    let least = (1.0 - BETWEEN_LEVELS) * (last - first);
    let gaps: Vec<f64> = values.windows(2).map(|pair| pair[1] - pair[0]).filter(|gap| *gap > least).collect();
    gaps.len() < LEVELS && gaps.iter().sum::<f64>() > BETWEEN_LEVELS * (last - first)
}

/// The channels that differ from their reciprocal ones far more than noise explains and than other pairs do, absolutely and
/// relative to their values, ascending: one of a pair is saturated, or read before it has settled. From the mean of untouched
/// frames, and these frames or their deviations from it; empty without noise.
///
/// # Panics
/// If the mean has another length than the protocol or the frames.
pub fn contradicting_channels(rest: &Frame, untouched: &[Frame], protocol: &Protocol) -> Vec<usize> {
    assert_eq!(rest.len(), protocol.channel_count(), "a frame of the protocol");
    let Some(mean) = mean(untouched).filter(|_| untouched.len() > 1) else { return Vec::new() };
    let median = |values: Vec<f64>| upper_median(&values).unwrap_or(0.0);
    let noise_of_mean = median(deviations(untouched, &mean)) / (untouched.len() as f64).sqrt();
    if noise_of_mean <= ROUNDING * rms(rest.iter().copied()) {
        return Vec::new();
    }
    let pair = |group: Vec<(usize, f64)>| {
        let values: Vec<f64> = group.iter().map(|&(channel, sign)| sign * rest[channel]).collect();
        let [least, most] = [f64::min, f64::max].map(|of| values.iter().copied().reduce(of).unwrap_or(f64::NAN));
        Pair { apart: most - least, size: least.abs().max(most.abs()), group }
    };
    let groups = quantities(protocol).into_iter().filter(|group| group.len() > 1);
    let pairs: Vec<Pair> = groups.map(pair).filter(|pair| pair.apart.is_finite() && pair.size > 0.0).collect();
    let usual = noise_of_mean.max(median(pairs.iter().map(|pair| pair.apart).collect()));
    let usual_part = median(pairs.iter().map(|pair| pair.apart / pair.size).collect());
    let is_far = |pair: &&Pair| pair.apart > TOO_FAR_APART * usual.max(usual_part * pair.size);
    let far = pairs.iter().filter(is_far).flat_map(|pair| &pair.group);
    let mut channels: Vec<usize> = far.map(|&(channel, _)| channel).collect();
    channels.sort_unstable();
    channels
}

/// Channels that measure the same quantity, and how far apart they are.
struct Pair {
    apart: f64,
    size: f64,
    group: Vec<(usize, f64)>,
}

/// The standard deviation of each channel.
fn deviations(frames: &[Frame], mean: &Frame) -> Vec<f64> {
    let square = |channel: usize| frames.iter().map(|frame| (frame[channel] - mean[channel]).powi(2)).sum::<f64>();
    (0..mean.len()).map(|channel| (square(channel) / frames.len() as f64).sqrt()).collect()
}

/// The electrodes that carry no current, ascending: most channels of each of their drives are unusable. Where two electrodes
/// are driven with each other alone, it is both of them.
pub fn disconnected_electrodes(protocol: &Protocol, is_usable: impl Fn(usize) -> bool) -> Vec<usize> {
    let (drives, drive_of) = protocol.drives();
    let mut counts = vec![[0usize; 2]; drives.len()];
    for (channel, &drive) in drive_of.iter().enumerate() {
        counts[drive][usize::from(is_usable(channel))] += 1;
    }
    let has_current = |drive: usize| counts[drive][1] >= counts[drive][0];
    let is_disconnected = |electrode: &usize| {
        let mut own = (0..drives.len()).filter(|&drive| drives[drive].contains(electrode)).peekable();
        own.peek().is_some() && !own.any(has_current)
    };
    (0..protocol.electrode_count()).filter(is_disconnected).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    #[test]
    fn channels_far_noisier_than_others_are_broken() {
        let mut rng = ChaCha8Rng::seed_from_u64(2);
        let mut frame = || Frame((0..40).map(|k| [1.0, 4.0, 1e3][k % 20 / 9] * rng.random::<f64>()).collect());
        let mut frames: Vec<Frame> = (0..50).map(|_| frame()).collect();
        assert_eq!(broken_channels(&frames), vec![18, 19, 38, 39]);
        frames[3][0] = f64::NAN;
        assert_eq!(broken_channels(&frames), vec![0, 18, 19, 38, 39]);
        assert!(broken_channels(&frames[..1]).is_empty() && broken_channels(&[]).is_empty());
        assert!(broken_channels(&vec![Frame(vec![1.0, 2.0]); 5]).is_empty());
    }

    /// Most values stay on a step, some change by one now and then, and all by the last digit of the current. Of eight frames of
    /// noise, one channel in a thousand is at a few levels by chance.
    #[test]
    fn a_value_between_two_steps_of_the_converter_is_not_broken() {
        let mut rng = ChaCha8Rng::seed_from_u64(4);
        let mut frame = |noise: f64| {
            let current = 1.0 + 1e-5 * f64::from(u8::from(rng.random::<f64>() < 0.3));
            let mut value = |k: u32| (f64::from(k) * 0.137 / 0.3 + noise * rng.random::<f64>()).round() * 0.3 / current;
            Frame((0..40).map(&mut value).collect())
        };
        for noise in [0.05, 0.2] {
            let frames: Vec<Frame> = (0..50).map(|_| frame(noise)).collect();
            let changing =
                (0..40).filter(|&k| frames.iter().any(|frame| (frame[k] - frames[0][k]).abs() > 0.1)).count();
            assert!((1..30).contains(&changing), "{changing}");
            assert!(broken_channels(&frames).is_empty());
        }
        let few = (0..1000).filter(|_| is_stepped((0..8).map(|_| rng.random::<f64>()))).count();
        assert!(few < 10, "{few}");
    }

    /// One value of a pair is clipped by 4 %: both are named. Without noise, or where all pairs differ, nothing is.
    #[test]
    fn a_saturated_channel_contradicts_its_reciprocal_one() {
        let protocol = Protocol::adjacent(8).unwrap();
        let of_quantity: Vec<f64> = {
            let mut values = vec![0.0; protocol.channel_count()];
            for (number, group) in quantities(&protocol).iter().enumerate() {
                group.iter().for_each(|&(channel, sign)| values[channel] = sign * (10.0 + number as f64));
            }
            values
        };
        let clipped = (0..of_quantity.len()).max_by(|a, b| of_quantity[*a].total_cmp(&of_quantity[*b])).unwrap();
        let pair =
            quantities(&protocol).into_iter().find(|group| group.iter().any(|(one, _)| *one == clipped)).unwrap();
        let mut expected: Vec<usize> = pair.into_iter().map(|(channel, _)| channel).collect();
        expected.sort_unstable();
        let mut rng = ChaCha8Rng::seed_from_u64(3);
        let mut frames = |noise: f64, by_channel: f64, clip: f64| -> Vec<Frame> {
            let value = |(channel, value): (usize, &f64), random: f64| {
                let value = value + by_channel * (channel % 7) as f64 + noise * random;
                if channel == clipped { value * clip } else { value }
            };
            let mut frame = || Frame(of_quantity.iter().enumerate().map(|one| value(one, rng.random())).collect());
            (0..20).map(|_| frame()).collect()
        };
        let found = |frames: &[Frame]| contradicting_channels(&mean(frames).unwrap(), frames, &protocol);
        assert_eq!(found(&frames(0.02, 0.0, 0.96)), expected);
        for none in [frames(0.02, 0.0, 1.0), frames(0.0, 0.0, 0.96), frames(0.02, 0.5, 0.96)] {
            assert!(found(&none).is_empty());
        }
    }

    #[test]
    fn an_electrode_whose_drives_have_no_current_is_disconnected() {
        let protocol = Protocol::adjacent(8).unwrap();
        let channels = protocol.channels();
        for electrode in 0..8 {
            let driven = |channel: usize| channels[channel].drive.contains(&electrode);
            // A single broken channel elsewhere, and one that looks usable, change nothing.
            let [other, own] = [false, true].map(|own| (0..channels.len()).find(|&channel| driven(channel) == own));
            let is_usable = |channel| Some(channel) != other && (Some(channel) == own || !driven(channel));
            assert_eq!(disconnected_electrodes(&protocol, is_usable), [electrode]);
        }
        assert!(disconnected_electrodes(&protocol, |_| true).is_empty());
    }
}
