//! The baseline of channels that come back.

use serde::{Deserialize, Serialize};

/// Fewest frames of a trial for a mean.
const MIN_FRAMES: u32 = 4;

/// Means of the values of channels on trial, over untouched frames. They are the new baseline of a channel that comes
/// back, because a contact that was mended is not as it was.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub(super) struct TrialMeans {
    mean_ohm: Vec<f64>,
    frames: Vec<u32>,
}

impl TrialMeans {
    /// For a number of channels.
    pub(super) fn new(channel_count: usize) -> Self {
        TrialMeans { mean_ohm: vec![0.0; channel_count], frames: vec![0; channel_count] }
    }

    /// Whether it has this number of channels.
    pub(super) fn fits(&self, channel_count: usize) -> bool {
        [self.mean_ohm.len(), self.frames.len()] == [channel_count; 2]
    }

    /// Takes a frame in which some channels are on trial, and writes the mean of those that have come back to the
    /// baseline. `masked`: channels that are not in use; `blocked`: those of them that are not on
    /// trial, or whose trial a touch disturbs.
    pub(super) fn update(
        &mut self,
        values_ohm: &[f64],
        [masked, blocked]: [&[bool]; 2],
        untouched: bool,
        baseline_ohm: &mut [f64],
    ) {
        for (channel, value) in values_ohm.iter().enumerate() {
            let (mean, frames) = (&mut self.mean_ohm[channel], &mut self.frames[channel]);
            if !masked[channel] {
                if *frames >= MIN_FRAMES {
                    baseline_ohm[channel] = *mean;
                }
                *frames = 0;
            } else if blocked[channel] || !untouched {
                *frames = 0;
            } else {
                *frames += 1;
                *mean += (value - *mean) / f64::from(*frames);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_channel_comes_back_with_the_mean_of_its_trial() {
        let mut trials = TrialMeans::new(2);
        let mut baseline = [1.0, 2.0];
        let mut frame = |value: f64, masked: bool, blocked: bool, untouched: bool| {
            trials.update(&[value, 2.5], [&[masked, false], &[blocked, false]], untouched, &mut baseline);
            baseline
        };
        frame(1e9, true, true, true);
        for at in 0..10 {
            frame(3.0 + f64::from(at % 2), true, false, true);
        }
        frame(9.0, true, false, false);
        for at in 0..10 {
            frame(4.0 + f64::from(at % 2), true, false, true);
        }
        assert_eq!(frame(7.0, false, false, true), [4.5, 2.0], "frames before a touch do not count");
        assert_eq!(frame(8.0, false, false, true), [4.5, 2.0]);
    }
}
