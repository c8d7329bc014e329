//! Frames in the order of recording, with late channels moved to their rows.

use crate::error::CalibrateError;
use crate::ridge::Regression;
use crate::units::ChannelUnits;
use faer::Mat;
use serde::{Deserialize, Serialize};

/// Ridge of the regression that completes frames, as a part of the number of frames.
const RIDGE: f64 = 0.05;

/// Moves late channels to their rows. The rows at the ends lack some channels afterwards; their values are predicted
/// from the other channels.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct Realignment {
    /// Rows by which each channel is late.
    lags: Vec<i32>,
    completion: Vec<Completion>,
}

/// The prediction of a late channel from the channels in time.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct Completion {
    channel: usize,
    weights: Vec<f64>,
    offset: f64,
}

impl Realignment {
    /// Learns from the rows of a recording, in units of the channels, how to complete rows.
    pub(crate) fn new(lags: Vec<i32>, values: &[Vec<f64>]) -> Result<Self, CalibrateError> {
        let mut realignment = Realignment { lags, completion: Vec::new() };
        let late: Vec<usize> = (0..realignment.lags.len()).filter(|&channel| realignment.lags[channel] != 0).collect();
        if late.is_empty() {
            return Ok(realignment);
        }
        let in_time = realignment.in_time();
        let rows: Vec<Vec<f64>> = (0..values.len()).filter_map(|row| realignment.shifted(values, row)).collect();
        let input = Mat::from_fn(rows.len(), in_time.len(), |i, j| rows[i][in_time[j]]);
        let target = Mat::from_fn(rows.len(), late.len(), |i, j| rows[i][late[j]]);
        let regression = Regression::fit(&input, &target, RIDGE)
            .ok_or_else(|| CalibrateError::Fit("the channels in time predict no late channel".into()))?;
        for (j, &channel) in late.iter().enumerate() {
            let weights = regression.weights.col(j).iter().copied().collect();
            realignment.completion.push(Completion { channel, weights, offset: regression.offsets[j] });
        }
        Ok(realignment)
    }

    /// The rows by which each channel is late.
    pub(crate) fn lags(&self) -> &[i32] {
        &self.lags
    }

    /// Whether it belongs to so many channels.
    pub(crate) fn fits(&self, channels: usize) -> bool {
        let in_time = self.in_time().len();
        let fits = |late: &Completion| late.channel < channels && late.weights.len() == in_time;
        self.lags.len() == channels && self.completion.len() == channels - in_time && self.completion.iter().all(fits)
    }

    fn in_time(&self) -> Vec<usize> {
        (0..self.lags.len()).filter(|&channel| self.lags[channel] == 0).collect()
    }

    /// A row with its late channels; `None` where they are outside the recording.
    fn shifted(&self, values: &[Vec<f64>], row: usize) -> Option<Vec<f64>> {
        let value = |(channel, lag): (usize, &i32)| {
            let at = usize::try_from(row as i64 + i64::from(*lag)).ok()?;
            values.get(at).map(|other| other[channel])
        };
        self.lags.iter().enumerate().map(value).collect()
    }

    /// All rows, realigned and complete.
    pub(crate) fn apply(&self, values: &[Vec<f64>]) -> Vec<Vec<f64>> {
        let row = |row: usize| self.shifted(values, row).unwrap_or_else(|| self.complete(values[row].clone()));
        (0..values.len()).map(row).collect()
    }

    /// A single row, with its late channels predicted from the others.
    pub(crate) fn complete(&self, mut values: Vec<f64>) -> Vec<f64> {
        let in_time = self.in_time();
        for Completion { channel, weights, offset } in &self.completion {
            let sum: f64 = weights.iter().zip(&in_time).map(|(weight, &other)| weight * values[other]).sum();
            values[*channel] = offset + sum;
        }
        values
    }
}

/// Frames in units of the channels.
pub(crate) fn in_units(frames: &[impl AsRef<[f64]>], units: &ChannelUnits) -> Vec<Vec<f64>> {
    frames.iter().map(|frame| units.apply(frame.as_ref())).collect()
}
