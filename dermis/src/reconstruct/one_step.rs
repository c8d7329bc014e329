//! The one-step linear reconstruction (the paper's Eqs. 8-10): one matrix, one product a frame.

use crate::design::TouchEffect;
use crate::forward::{ForwardModel, Matrix};
use crate::frame::Frame;
use crate::image::PixelSpace;
use crate::reconstruct::alpha::{self, Alpha};
use crate::reconstruct::linearised::Linearised;
use crate::reconstruct::prior::Prior;
use crate::reconstruct::system::System;
use crate::reconstruct::{Reconstruct, ReconstructError, check_lengths};
use faer::{Mat, MatRef};
use std::sync::Arc;

/// How the differences of the channels are weighed against each other.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Difference {
    /// As they are, ohm: the noise is alike in every channel.
    #[default]
    Plain,
    /// Divided by the untouched values, and weighted by their squares: the noise is alike in every channel in ohm, and
    /// only a prior made from the Jacobian feels the division. This is EIDORS's normalised difference.
    Normalised,
    /// Divided by the untouched values, and none is trusted more than another: the noise of a channel is proportional
    /// to its untouched value.
    NormalisedEven,
}

/// How a one-step reconstruction is made.
#[derive(Debug, Clone)]
pub struct OneStepOptions {
    /// What an image is expected to look like.
    pub prior: Prior,
    /// How strongly the prior counts.
    pub alpha: Alpha,
    /// How the channels are weighed against each other.
    pub difference: Difference,
    /// Channels that are left out, because they are known to be bad; their columns of the matrix are zero.
    pub excluded: Vec<usize>,
    /// Which way a touch turns the conductance: images are positive where touched.
    pub touch: TouchEffect,
    /// Standard deviation of a value's noise, ohm, for [`Alpha::Auto`]; `None` takes 50 dB below the untouched frame.
    pub noise_ohm: Option<f64>,
    /// Pixels of the small target for which a noise figure is computed; none takes the pixel that the electrodes see
    /// least, with its neighbours.
    pub target: Vec<usize>,
    /// Measured differences, for the rules that look at data ([`Alpha::LCurve`], [`Alpha::Gcv`]). No label is needed.
    pub examples: Vec<Frame>,
}

impl Default for OneStepOptions {
    fn default() -> Self {
        OneStepOptions {
            prior: Prior::default(),
            alpha: Alpha::Auto,
            difference: Difference::Plain,
            excluded: Vec::new(),
            touch: TouchEffect::ConductanceRises,
            noise_ohm: None,
            target: Vec::new(),
            examples: Vec::new(),
        }
    }
}

/// The one-step reconstruction.
///
/// ```text
/// x = (J'W J + alpha^2 c R)^-1 J'W d,    c = trace(J'W J) / trace(R)
/// ```
///
/// J is the derivative of the frame by the relative change of the pixels' conductance, d the difference and W the weight of
/// the channels. With [`Alpha::Absolute`] c is one and J the derivative by the conductance itself.
#[derive(Debug, Clone)]
pub struct OneStep {
    pixels: Arc<PixelSpace>,
    prior: Prior,
    matrix: Matrix,
    alpha: f64,
    hyperparameter: f64,
}

impl OneStep {
    /// The reconstruction for a skin.
    ///
    /// # Errors
    /// Options out of their range, a problem that has no unique solution, a forward problem that cannot be solved.
    pub fn new(forward: &ForwardModel, pixels: Arc<PixelSpace>, options: &OneStepOptions) -> crate::Result<Self> {
        Ok(Self::from_linearised(&Linearised::new(forward, &pixels)?, pixels, options)?)
    }

    /// The reconstruction from a linear model that is at hand already.
    ///
    /// # Errors
    /// Options out of their range, lists that do not fit, a problem that has no unique solution.
    pub fn from_linearised(
        model: &Linearised,
        pixels: Arc<PixelSpace>,
        options: &OneStepOptions,
    ) -> Result<Self, ReconstructError> {
        model.validate(&pixels)?;
        let channels = Channels::new(model, options)?;
        let absolute = matches!(options.alpha, Alpha::Absolute(_));
        let penalty = {
            let for_prior = channels.jacobian(model, &channels.prior_scale, absolute);
            options.prior.matrix(for_prior.as_ref(), &pixels)?
        };
        let system = System::new(channels.jacobian(model, &channels.scale, absolute), penalty)?;
        let scale = if absolute { 1.0 } else { system.scale()? };
        let alpha = alpha::choose(&system, scale, &channels, &pixels, options)?;
        let inverse = system.inverse(alpha * alpha * scale)?;
        let matrix = channels.spread(inverse.as_ref(), model, absolute, options.touch.sign());
        if let Some(at) = matrix.values.iter().position(|value| !value.is_finite()) {
            let message =
                format!("the reconstruction matrix is {} at pixel {}", matrix.values[at], at / matrix.columns);
            return Err(ReconstructError::Singular(message));
        }
        Ok(OneStep { pixels, prior: options.prior, matrix, alpha, hyperparameter: alpha * scale.sqrt() })
    }

    /// The alpha in use: as given, or as chosen. Without a unit, but for [`Alpha::Absolute`].
    pub fn alpha(&self) -> f64 {
        self.alpha
    }

    /// What multiplies the square root of the prior: `alpha sqrt(c)`.
    pub fn hyperparameter(&self) -> f64 {
        self.hyperparameter
    }
}

impl Reconstruct for OneStep {
    fn name(&self) -> String {
        format!("one-step {}", self.prior.name())
    }

    fn pixels(&self) -> &Arc<PixelSpace> {
        &self.pixels
    }

    fn reconstruct_into(&self, difference: &[f64], values: &mut [f64]) -> Result<(), ReconstructError> {
        check_lengths(difference, self.matrix.columns, values, self.matrix.rows)?;
        self.matrix.product_into(difference, values);
        Ok(())
    }

    fn matrix(&self) -> Option<&Matrix> {
        Some(&self.matrix)
    }
}

/// The channels in use and what their differences are multiplied by.
pub(crate) struct Channels {
    /// Index of each channel in use.
    pub(crate) kept: Vec<usize>,
    /// Factor of each channel in use in the data term: the square root of its weight over its normalisation.
    pub(crate) scale: Vec<f64>,
    /// Factor of each channel in use in the Jacobian from which the prior is made: its normalisation alone.
    pub(crate) prior_scale: Vec<f64>,
}

impl Channels {
    fn new(model: &Linearised, options: &OneStepOptions) -> Result<Self, ReconstructError> {
        let count = model.channel_count();
        if let Some(&channel) = options.excluded.iter().find(|&&channel| channel >= count) {
            let message = format!("channel {channel} is to be left out, but the frame has {count} values");
            return Err(ReconstructError::Parameter(message));
        }
        let mut keep = vec![true; count];
        options.excluded.iter().for_each(|&channel| keep[channel] = false);
        let kept: Vec<usize> = (0..count).filter(|&channel| keep[channel]).collect();
        if kept.is_empty() {
            return Err(ReconstructError::Parameter("every channel is left out: keep some".into()));
        }
        let ones = vec![1.0; kept.len()];
        if options.difference == Difference::Plain {
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
        let even = options.difference == Difference::NormalisedEven;
        Ok(Channels { scale: if even { inverses.clone() } else { ones }, prior_scale: inverses, kept })
    }

    /// The Jacobian's rows of the channels in use, each by its factor.
    fn jacobian(&self, model: &Linearised, scale: &[f64], absolute: bool) -> Mat<f64> {
        let Matrix { rows, columns, ref values } = model.jacobian;
        let full = MatRef::from_row_major_slice(values, rows, columns);
        Mat::from_fn(self.kept.len(), columns, |row, pixel| {
            let value = full[(self.kept[row], pixel)] * scale[row];
            if absolute { value / model.rest_conductivity[pixel] } else { value }
        })
    }

    /// The matrix for whole frames in ohm, giving relative changes that are positive where touched.
    fn spread(&self, inverse: MatRef<'_, f64>, model: &Linearised, absolute: bool, sign: f64) -> Matrix {
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

#[cfg(test)]
mod tests;
