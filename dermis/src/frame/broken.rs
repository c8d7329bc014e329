//! Detection of broken channels in frames of the untouched skin.

use crate::frame::{Frame, mean};
use crate::protocol::Protocol;
use crate::stats::upper_median;

/// A channel is broken if its noise is this many times that of the median channel: for some channels, range switching
/// of the converter gives four times the noise, a drive without current about a thousand times.
const TOO_NOISY: f64 = 30.0;

/// The channels with far more noise than others in frames of an untouched skin, or with values that are not finite,
/// ascending: for example the channels of a drive through a disconnected electrode. Empty for fewer than two frames.
///
/// # Panics
/// If the frames differ in length.
pub fn broken_channels(untouched: &[Frame]) -> Vec<usize> {
    let Some(mean) = mean(untouched).filter(|_| untouched.len() > 1) else { return Vec::new() };
    let square = |channel: usize| untouched.iter().map(|frame| (frame[channel] - mean[channel]).powi(2)).sum::<f64>();
    let sd: Vec<f64> = (0..mean.len()).map(|channel| (square(channel) / untouched.len() as f64).sqrt()).collect();
    let finite: Vec<f64> = sd.iter().copied().filter(|sd| sd.is_finite()).collect();
    let median = upper_median(&finite).unwrap_or(0.0);
    // Without noise no channel can be judged.
    let is_broken = |sd: f64| !sd.is_finite() || (median > 0.0 && sd > TOO_NOISY * median);
    (0..sd.len()).filter(|&channel| is_broken(sd[channel])).collect()
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
