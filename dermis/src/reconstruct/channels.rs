//! Selection and weights of the channels of a frame.

use crate::forward::Matrix;
use crate::reconstruct::ReconstructError;
use crate::reconstruct::linearised::Linearised;
use faer::{Mat, MatRef};

/// How the differences of the channels are weighted.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Difference {
    /// No scaling, ohm: the noise is equal in every channel.
    #[default]
    Plain,
    /// Divided by the untouched values, and weighted by their squares: the noise in ohm is equal in every channel, and
    /// the division affects only a prior made from the Jacobian. This is EIDORS's normalised difference.
    Normalised,
    /// Divided by the untouched values, with equal weights: the noise of a channel is proportional to its untouched
    /// value.
    NormalisedEven,
}

/// The channels in use and their factors.
#[derive(Debug, Clone)]
pub(crate) struct Channels {
    /// Index of each channel in use.
    pub(crate) kept: Vec<usize>,
    /// Factor of each channel in use in the data term: the square root of its weight over its normalisation.
    pub(crate) scale: Vec<f64>,
    /// Factor of each channel in use in the Jacobian from which the prior is made: only its normalisation.
    pub(crate) prior_scale: Vec<f64>,
}

impl Channels {
    pub(crate) fn new(
        model: &Linearised,
        difference: Difference,
        excluded: &[usize],
    ) -> Result<Self, ReconstructError> {
        let count = model.channel_count();
        if let Some(&channel) = excluded.iter().find(|&&channel| channel >= count) {
            let message = format!("channel {channel} is to be left out, but the frame has {count} values");
            return Err(ReconstructError::Parameter(message));
        }
        let mut keep = vec![true; count];
        excluded.iter().for_each(|&channel| keep[channel] = false);
        let kept: Vec<usize> = (0..count).filter(|&channel| keep[channel]).collect();
        if kept.is_empty() {
            return Err(ReconstructError::Parameter("every channel is left out: keep some".into()));
        }
        let ones = vec![1.0; kept.len()];
        if difference == Difference::Plain {
            return Ok(Channels { kept, scale: ones.clone(), prior_scale: ones });
        }
        let inverse = |&channel: &usize| {
            let value = model.rest_frame[channel];
            if value != 0.0 && value.is_finite() {
                Ok(1.0 / value)
            } else {
                let message =
                    format!("a normalised difference divides by the untouched value of channel {channel}, {value}");
                Err(ReconstructError::Parameter(message))
            }
        };
        let inverses = kept.iter().map(inverse).collect::<Result<Vec<_>, _>>()?;
        let even = difference == Difference::NormalisedEven;
        Ok(Channels { scale: if even { inverses.clone() } else { ones }, prior_scale: inverses, kept })
    }

    /// The values of a whole frame in the channels in use, each times its factor.
    pub(crate) fn gather(&self, frame: &[f64]) -> Vec<f64> {
        self.kept.iter().zip(&self.scale).map(|(&channel, scale)| scale * frame[channel]).collect()
    }

    /// The Jacobian's rows of the channels in use, each times its factor.
    pub(crate) fn jacobian(&self, model: &Linearised, scale: &[f64], absolute: bool) -> Mat<f64> {
        let mut jacobian = self.rows(&model.jacobian, scale);
        if absolute {
            for (pixel, conductivity) in model.rest_conductivity.iter().enumerate() {
                jacobian.col_mut(pixel).iter_mut().for_each(|value| *value /= conductivity);
            }
        }
        jacobian
    }

    /// The rows of a matrix for the channels in use, each times its factor.
    pub(crate) fn rows(&self, matrix: &Matrix, scale: &[f64]) -> Mat<f64> {
        let full = MatRef::from_row_major_slice(&matrix.values, matrix.rows, matrix.columns);
        Mat::from_fn(self.kept.len(), matrix.columns, |row, pixel| full[(self.kept[row], pixel)] * scale[row])
    }

    /// The matrix for whole frames in ohm; the results are relative changes, positive where touched.
    pub(crate) fn spread(&self, inverse: MatRef<'_, f64>, model: &Linearised, absolute: bool, sign: f64) -> Matrix {
        let (rows, columns) = (inverse.nrows(), model.channel_count());
        let mut values = vec![0.0; rows * columns];
        for (pixel, row) in values.chunks_exact_mut(columns).enumerate() {
            let unit = if absolute { sign / model.rest_conductivity[pixel] } else { sign };
            for (at, (&channel, scale)) in self.kept.iter().zip(&self.scale).enumerate() {
                row[channel] = unit * scale * inverse[(pixel, at)];
            }
        }
        Matrix { rows, columns, values }
    }
}
