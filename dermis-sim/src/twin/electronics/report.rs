//! Contribution of each part of the instrument to the error of a frame.

use super::{Electronics, Stage};
use dermis::forward::ElectrodeNetwork;
use serde::{Deserialize, Serialize};
use std::ops::Range;

/// One part of the error of a frame's values, over all values that share no electrode with their drive.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct ErrorPart {
    /// Root mean square, ohm.
    pub rms_ohm: f64,
    /// Root mean square relative to that of the same values of the untouched skin.
    pub relative: f64,
}

/// The error of a frame's values, split by cause, in the order of the signal path; each part is the change of the
/// values when it is switched on after those before it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ElectronicsReport {
    /// Number of frames of the report.
    pub frames: usize,
    /// Root mean square of the untouched values that share no electrode with their drive, ohm.
    pub signal_ohm: f64,
    /// Lines that have not settled when they are read.
    pub settling: ErrorPart,
    /// Mains hum.
    pub hum: ErrorPart,
    /// Error of the gain.
    pub gain: ErrorPart,
    /// White noise.
    pub noise: ErrorPart,
    /// Steps of the converter, and readings out of its range.
    pub quantisation: ErrorPart,
    /// Total.
    pub total: ErrorPart,
    /// Number of readings out of the converter's range, of all frames together.
    pub saturated_readings: usize,
}

impl Electronics {
    /// Splits the error of some frames of a skin.
    ///
    /// # Panics
    /// If there are no frames.
    pub fn report(&self, network: &ElectrodeNetwork, indices: Range<u64>) -> ElectronicsReport {
        assert!(!indices.is_empty(), "a report needs a frame");
        let stages = [Stage::Ideal, Stage::Settling, Stage::Hum, Stage::Gain, Stage::Noise, Stage::Quantisation];
        let mut squares = [0.0; 6];
        let (mut saturated_readings, mut frames) = (0, 0);
        for index in indices {
            let passed = stages.map(|stage| self.through(network, index, stage));
            let values = [0, 1, 2, 3, 4, 5].map(|stage: usize| self.values(&passed[stage]));
            let mut add = |slot: usize, a: usize, b: usize| {
                let rms = self.protocol.undriven_rms(&(&values[b] - &values[a]));
                squares[slot] += rms * rms;
            };
            (0..5).for_each(|stage| add(stage, stage, stage + 1));
            add(5, 0, 5);
            saturated_readings += passed[5].saturated;
            frames += 1;
        }
        let [settling, hum, gain, noise, quantisation, total] = squares.map(|sum| {
            let rms_ohm = (sum / frames as f64).sqrt();
            ErrorPart { rms_ohm, relative: rms_ohm / self.signal_ohm }
        });
        let signal_ohm = self.signal_ohm;
        ElectronicsReport { frames, signal_ohm, settling, hum, gain, noise, quantisation, total, saturated_readings }
    }
}
