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
        channel_sd: &[f64],
    ) -> Result<Self, ReconstructError> {
        if difference == Difference::NormalisedEven && !channel_sd.is_empty() {
            let message =
                "equal weights of normalised differences and the noise of the channels are two weightings: give one";
            return Err(ReconstructError::Parameter(message.into()));
        }
        let Channels { kept, scale, prior_scale } = Self::equally_noisy(model, difference, excluded)?;
        let weights = noise_weights(&kept, channel_sd, model.channel_count())?;
        let scale = scale.iter().zip(weights).map(|(scale, weight)| scale * weight).collect();
        Ok(Channels { kept, scale, prior_scale })
    }

    fn equally_noisy(model: &Linearised, difference: Difference, excluded: &[usize]) -> Result<Self, ReconstructError> {
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
            if value != 0.0 && value.is_finite() { Ok(1.0 / value) } else { Err(no_normal(channel, value)) }
        };
        let inverses = kept.iter().map(inverse).collect::<Result<Vec<_>, _>>()?;
        let even = difference == Difference::NormalisedEven;
        Ok(Channels { scale: if even { inverses.clone() } else { ones }, prior_scale: inverses, kept })
    }

    /// Changes the matrix for differences that are normalised by the model's values to one for those by measured values.
    ///
    /// # Errors
    /// A baseline of another length, with a value of 0 in a channel in use.
    pub(crate) fn divide_by(
        &self,
        baseline: &[f64],
        model: &Linearised,
        matrix: &mut Matrix,
    ) -> Result<(), ReconstructError> {
        if baseline.len() != model.channel_count() {
            return Err(ReconstructError::FrameLength { got: baseline.len(), expected: model.channel_count() });
        }
        for &channel in &self.kept {
            let value = baseline[channel];
            if value == 0.0 || !value.is_finite() {
                return Err(no_normal(channel, value));
            }
            (0..matrix.rows).for_each(|pixel| *matrix.at_mut(pixel, channel) *= model.rest_frame[channel] / value);
        }
        Ok(())
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

/// The error of a normalised difference of a channel whose untouched value is 0.
fn no_normal(channel: usize, value: f64) -> ReconstructError {
    let message = format!("a normalised difference divides by the untouched value of channel {channel}, {value}");
    ReconstructError::Parameter(message)
}

/// Factors of channels in use that make their noise equal: the inverse of each standard deviation, relative to the
/// geometric mean, so that alpha keeps its meaning. All 1 where none are given.
fn noise_weights(kept: &[usize], channel_sd: &[f64], count: usize) -> Result<Vec<f64>, ReconstructError> {
    if channel_sd.is_empty() {
        return Ok(vec![1.0; kept.len()]);
    }
    if channel_sd.len() != count {
        let message = format!("{} standard deviations for {count} channels: give one for each", channel_sd.len());
        return Err(ReconstructError::Parameter(message));
    }
    if let Some(&channel) =
        kept.iter().find(|&&channel| !(channel_sd[channel] > 0.0 && channel_sd[channel].is_finite()))
    {
        let message = format!(
            "the standard deviation of channel {channel} is {}: it must be positive, or the channel left out",
            channel_sd[channel]
        );
        return Err(ReconstructError::Parameter(message));
    }
    let mean_log = kept.iter().map(|&channel| channel_sd[channel].ln()).sum::<f64>() / kept.len() as f64;
    Ok(kept.iter().map(|&channel| mean_log.exp() / channel_sd[channel]).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn weights_make_the_noise_of_the_channels_in_use_equal() {
        assert_eq!(noise_weights(&[0, 2], &[], 4).unwrap(), [1.0, 1.0]);
        let sd = [1.0, 0.0, 4.0, 2.0];
        let weights = noise_weights(&[0, 2, 3], &sd, 4).unwrap();
        let noise: Vec<f64> = weights.iter().zip([0, 2, 3]).map(|(weight, channel)| weight * sd[channel]).collect();
        assert!(noise.iter().all(|noise| (noise - 2.0).abs() < 1e-12), "the geometric mean: {noise:?}");
    }

    #[test]
    fn deviations_that_are_no_noise_are_refused() {
        let message = |sd: &[f64]| noise_weights(&[0, 1], sd, 2).unwrap_err().to_string();
        assert!(message(&[1.0, 0.0]).contains("channel 1 is 0"), "{}", message(&[1.0, 0.0]));
        assert!(message(&[f64::NAN, 1.0]).contains("channel 0 is NaN"));
        assert!(message(&[1.0]).contains("1 standard deviations for 2 channels"));
    }
}
