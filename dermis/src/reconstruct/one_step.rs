//! The one-step linear reconstruction (the paper's Eqs. 8-10): one matrix, one product per frame.

use crate::design::TouchEffect;
use crate::forward::{ForwardModel, Matrix};
use crate::frame::Frame;
use crate::image::PixelSpace;
use crate::linalg::DistinctColumns;
use crate::reconstruct::alpha::{self, Alpha, AlphaRule};
use crate::reconstruct::channels::{Channels, Difference};
use crate::reconstruct::linearised::Linearised;
use crate::reconstruct::prior::Prior;
use crate::reconstruct::system::System;
use crate::reconstruct::{Reconstruct, ReconstructError, check_lengths};
use std::sync::Arc;

/// Options of a one-step reconstruction.
#[derive(Debug, Clone)]
pub struct OneStepOptions {
    /// The prior of the image.
    pub prior: Prior,
    /// Regularization parameter.
    pub alpha: Alpha,
    /// How the channels are weighted.
    pub difference: Difference,
    /// Channels that are excluded because they are known to be bad; their columns of the matrix are zero.
    pub excluded: Vec<usize>,
    /// Standard deviation of the noise of each channel, in any common unit; empty where all are equal. A channel is
    /// weighted by the inverse of its variance.
    pub channel_sd: Vec<f64>,
    /// The sign of the conductance change under touch: images are positive where touched.
    pub touch: TouchEffect,
    /// Pixels of the small target for which a noise figure is computed; by default the pixel with the smallest
    /// sensitivity, with its neighbours.
    pub target: Vec<usize>,
    /// Measured differences, for the rules that use data ([`Alpha::LCurve`], [`Alpha::Gcv`]). No labels are needed.
    pub examples: Vec<Frame>,
    /// The measured frame of the untouched skin, ohm, by which a normalised difference is divided; the model's without it.
    pub baseline: Option<Frame>,
}

impl Default for OneStepOptions {
    fn default() -> Self {
        OneStepOptions {
            prior: Prior::default(),
            alpha: Alpha::Auto,
            difference: Difference::Plain,
            excluded: Vec::new(),
            channel_sd: Vec::new(),
            touch: TouchEffect::ConductanceRises,
            target: Vec::new(),
            examples: Vec::new(),
            baseline: None,
        }
    }
}

/// The one-step reconstruction.
///
/// ```text
/// x = (J'W J + alpha^2 c R)^-1 J'W d,    c = trace(J'W J) / trace(R)
/// ```
///
/// J is the derivative of the frame with respect to the relative change of the pixels' conductance, d the difference
/// and W the weight of the channels. With [`Alpha::Absolute`] c is one and J the derivative with respect to the
/// conductance itself.
#[derive(Debug, Clone)]
pub struct OneStep {
    pixels: Arc<PixelSpace>,
    prior: Prior,
    matrix: Matrix,
    /// The same with each distinct column once.
    distinct: (DistinctColumns, Matrix),
    alpha: f64,
    rule: AlphaRule,
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

    /// The reconstruction from an existing linear model.
    ///
    /// # Errors
    /// Options out of their range, lists that do not match, a problem that has no unique solution.
    pub fn from_linearised(
        model: &Linearised,
        pixels: Arc<PixelSpace>,
        options: &OneStepOptions,
    ) -> Result<Self, ReconstructError> {
        model.validate(&pixels)?;
        let channels = Channels::new(model, options.difference, &options.excluded, &options.channel_sd)?;
        let absolute = matches!(options.alpha, Alpha::Absolute(_));
        let penalty = {
            let for_prior = channels.jacobian(model, &channels.prior_scale, absolute);
            options.prior.matrix(for_prior.as_ref(), &pixels)?
        };
        let system = System::new(channels.jacobian(model, &channels.scale, absolute), penalty)?;
        let scale = if absolute { 1.0 } else { system.scale()? };
        let (alpha, rule) = alpha::choose(&system, scale, &channels, &pixels, options)?;
        let inverse = system.inverse(alpha * alpha * scale)?;
        let mut matrix = channels.spread(inverse.as_ref(), model, absolute, options.touch.sign());
        if let (Some(baseline), true) = (&options.baseline, options.difference != Difference::Plain) {
            channels.divide_by(baseline, model, &mut matrix)?;
        }
        if let Some(at) = matrix.values.iter().position(|value| !value.is_finite()) {
            let message =
                format!("the reconstruction matrix is {} at pixel {}", matrix.values[at], at / matrix.columns);
            return Err(ReconstructError::Singular(message));
        }
        Ok(OneStep {
            pixels,
            prior: options.prior,
            distinct: DistinctColumns::of(&matrix),
            matrix,
            alpha,
            rule,
            hyperparameter: alpha * scale.sqrt(),
        })
    }

    /// The alpha in use: as given, or as chosen. Dimensionless, except for [`Alpha::Absolute`].
    pub fn alpha(&self) -> f64 {
        self.alpha
    }

    /// The rule that chose alpha.
    pub fn alpha_rule(&self) -> AlphaRule {
        self.rule
    }

    /// The factor of the square root of the prior: `alpha sqrt(c)`.
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
        let (columns, matrix) = &self.distinct;
        matrix.product_into(&columns.sums(difference), values);
        Ok(())
    }

    fn matrix(&self) -> Option<&Matrix> {
        Some(&self.matrix)
    }
}

#[cfg(test)]
mod tests;
