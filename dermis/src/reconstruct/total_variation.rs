//! Total variation: piecewise constant images with sharp edges.

mod admm;
mod gradients;

use crate::design::TouchEffect;
use crate::frame::Frame;
use crate::image::PixelSpace;
use crate::reconstruct::channels::{Channels, Difference};
use crate::reconstruct::linearised::Linearised;
use crate::reconstruct::{MIN_UNTOUCHED_FRAMES, Reconstruct, ReconstructError, alpha, check_lengths};
use admm::{Admm, Minimum};
use gradients::Gradients;
use std::sync::Arc;

/// The least weight, as a part of that above which no single pixel differs in the images of the untouched frames. On 60 presses
/// each on the twins `lab` of `skin16` and `cylinder30`, seed 3, errors with 0.1, 0.2 and 0.4 are 1.34, 1.27, 1.24 mm and 2.29, 2.17,
/// 2.54 mm, and none is missed; with 0, 46 are missed on `skin16`.
const OF_NOISE: f64 = 0.2;

/// Options of a total-variation image.
#[derive(Debug, Clone)]
pub struct TotalVariationOptions {
    /// The weight of the variation, as a fraction of the weight above which no single pixel differs from a uniform
    /// image. Once the method is [adapted](Reconstruct::adapted) to untouched frames, it is at least a fifth of the weight above
    /// which none differs in the image of any of them: little is left of noise then.
    pub alpha: f64,
    /// Channels that are excluded.
    pub excluded: Vec<usize>,
    /// The sign of the conductance change under touch: images are positive where touched.
    pub touch: TouchEffect,
    /// Maximum number of iterations.
    pub max_iterations: usize,
    /// The iteration ends when the objective is within this fraction of its minimum, by the duality gap.
    pub tolerance: f64,
}

impl Default for TotalVariationOptions {
    /// `docs/decisions/total-variation.md` compares values of alpha.
    fn default() -> Self {
        TotalVariationOptions {
            alpha: 0.002,
            excluded: Vec::new(),
            touch: TouchEffect::ConductanceRises,
            max_iterations: 1000,
            tolerance: 1e-3,
        }
    }
}

/// The total-variation image of the linear model.
///
/// ```text
/// x = argmin 1/2 |J x - d|^2 + lambda TV(x),    TV(x) = sum over pixels p of A_p |grad x|_p
/// |grad x|_p^2 = 1/2 sum over the neighbours q of p of (A_pq / A_p) ((x_p - x_q) / d_pq)^2
/// ```
///
/// with the areas `A_p`, the mean area `A_pq` of two pixels and the distance `d_pq` of their centres: the isotropic
/// variation of a weighted graph (Elmoataz, Lezoray and Bougleux 2008, DOI 10.1109/TIP.2008.924284), which on a grid
/// treats all four directions alike. Minimised by the alternating direction method of multipliers until the duality gap
/// is small.
#[derive(Debug, Clone)]
pub struct TotalVariation {
    pixels: Arc<PixelSpace>,
    channels: Channels,
    channel_count: usize,
    jacobian: faer::Mat<f64>,
    gradients: Gradients,
    admm: Admm,
    options: TotalVariationOptions,
    /// The weight that suppresses noise; 0 where it is not known.
    least_weight: f64,
}

impl TotalVariation {
    /// The reconstruction from a linear model.
    ///
    /// # Errors
    /// Options out of their range, lists that do not match, pixels joined to no other that no channel sees.
    pub fn from_linearised(
        model: &Linearised,
        pixels: Arc<PixelSpace>,
        options: &TotalVariationOptions,
    ) -> Result<Self, ReconstructError> {
        model.validate(&pixels)?;
        alpha::positive("alpha", options.alpha)?;
        alpha::positive("the tolerance", options.tolerance)?;
        let channels = Channels::new(model, Difference::Plain, &options.excluded, &[])?;
        let jacobian = channels.jacobian(model, &channels.scale, false);
        let gradients = Gradients::new(&pixels)?;
        let admm = Admm::new(jacobian.as_ref(), gradients.clone(), &pixels.neighbours)?;
        let (options, channel_count) = (options.clone(), model.channel_count());
        Ok(TotalVariation { pixels, channels, channel_count, jacobian, gradients, admm, options, least_weight: 0.0 })
    }

    /// `TV(x)`, m2.
    pub fn variation(&self, image: &[f64]) -> f64 {
        let mut field = vec![0.0; self.gradients.len()];
        self.gradients.apply_into(image, &mut field);
        self.gradients.norms(&field).sum()
    }

    /// `|J x - d|`, ohm.
    pub fn misfit(&self, image: &[f64], difference: &[f64]) -> f64 {
        let explained = &self.jacobian * faer::ColRef::from_slice(image);
        let data = self.channels.gather(difference);
        data.iter().zip(explained.iter()).map(|(d, e)| (d - e).powi(2)).sum::<f64>().sqrt()
    }

    /// `lambda` for a difference: alpha times the weight above which no single pixel differs from a uniform image, or that of
    /// noise if it is larger.
    ///
    /// # Errors
    /// A difference of the wrong length or with a value that is not finite.
    pub fn weight(&self, difference: &[f64]) -> Result<f64, ReconstructError> {
        check_lengths(difference, self.channel_count, &[], 0)?;
        Ok(self.weight_of(&self.admm.coordinates(&self.channels.gather(difference))))
    }

    fn weight_of(&self, data: &[f64]) -> f64 {
        (self.options.alpha * self.steepest(data)).max(self.least_weight)
    }

    /// The weight above which no single pixel differs from a uniform image.
    fn steepest(&self, data: &[f64]) -> f64 {
        let pull = self.admm.pull(&self.admm.residual(data, &self.admm.flat(data)));
        let steepest =
            pull.iter().zip(self.gradients.of_single_pixels()).map(|(pull, variation)| pull.abs() / variation);
        steepest.filter(|value| value.is_finite()).fold(0.0, f64::max)
    }

    fn minimise(&self, difference: &[f64]) -> Minimum {
        let data = self.admm.coordinates(&self.channels.gather(difference));
        self.admm.minimise(&data, self.weight_of(&data), self.options.tolerance, self.options.max_iterations)
    }
}

impl Reconstruct for TotalVariation {
    fn name(&self) -> String {
        "total variation".into()
    }

    fn pixels(&self) -> &Arc<PixelSpace> {
        &self.pixels
    }

    fn reconstruct_into(&self, difference: &[f64], values: &mut [f64]) -> Result<(), ReconstructError> {
        check_lengths(difference, self.channel_count, values, self.pixels.len())?;
        let image = self.minimise(difference).image;
        let sign = self.options.touch.sign();
        values.iter_mut().zip(&image).for_each(|(value, x)| *value = sign * x);
        Ok(())
    }

    fn is_adaptable(&self) -> bool {
        true
    }

    fn adapted(&self, _rest: &Frame, untouched: &[Frame]) -> Result<Option<Arc<dyn Reconstruct>>, ReconstructError> {
        if untouched.len() < MIN_UNTOUCHED_FRAMES {
            return Ok(None);
        }
        let weight = |frame: &Frame| {
            check_lengths(frame, self.channel_count, &[], 0)?;
            Ok(self.steepest(&self.admm.coordinates(&self.channels.gather(frame))))
        };
        let weights = untouched.iter().map(weight).collect::<Result<Vec<f64>, ReconstructError>>()?;
        let least_weight = OF_NOISE * weights.into_iter().fold(0.0, f64::max);
        Ok(Some(Arc::new(TotalVariation { least_weight, ..self.clone() })))
    }
}

#[cfg(test)]
mod tests;
