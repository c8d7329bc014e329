//! A method for a skin with broken channels.

use crate::contact::Contact;
use crate::detect::DetectOptions;
use crate::forward::Matrix;
use crate::frame::Frame;
use crate::image::PixelSpace;
use crate::reconstruct::{Linearised, OneStep, OneStepOptions, Prior, Quantity, Reconstruct, ReconstructError};
use std::ops::Deref;
use std::sync::Arc;

/// A method for a skin with broken channels that cannot be prepared again without them, such as a network.
///
/// The values of the broken channels are predicted from the others: the one-step image of these, `x = B d`, changes the
/// broken ones by `J x`, the most likely values under that image's prior. A linear method with the same prior gives the
/// same image as if it were prepared again.
#[derive(Debug, Clone)]
pub struct WithoutChannels<P> {
    /// A pointer to the method.
    method: P,
    broken: Vec<usize>,
    /// From a difference to the broken channels, broken x channels; zero in the columns of the broken ones.
    fill: Matrix,
    matrix: Option<Matrix>,
}

impl<P: Deref<Target: Reconstruct>> WithoutChannels<P> {
    /// The method without some channels of the skin with the given linear model.
    ///
    /// # Errors
    /// A channel that does not exist, too few channels left, a method of another skin.
    pub fn new(method: P, model: &Linearised, broken: Vec<usize>) -> Result<Self, ReconstructError> {
        let fill = fill(method.pixels(), model, &broken)?;
        let mut matrix = method.matrix().cloned();
        if let Some(matrix) = &mut matrix {
            let columns = matrix.columns;
            for row in matrix.values.chunks_exact_mut(columns) {
                let weights: Vec<f64> = broken.iter().map(|&channel| std::mem::take(&mut row[channel])).collect();
                for (weight, fill) in weights.iter().zip(fill.values.chunks_exact(columns)) {
                    row.iter_mut().zip(fill).for_each(|(value, fill)| *value += weight * fill);
                }
            }
        }
        Ok(WithoutChannels { method, broken, fill, matrix })
    }
}

/// From a difference to the broken channels, by the one-step image of the others.
fn fill(pixels: &Arc<PixelSpace>, model: &Linearised, broken: &[usize]) -> Result<Matrix, ReconstructError> {
    let options = OneStepOptions { prior: Prior::Laplace, excluded: broken.to_vec(), ..OneStepOptions::default() };
    let one_step = OneStep::from_linearised(model, Arc::clone(pixels), &options)?;
    let image = one_step.matrix().expect("a one-step method is a matrix");
    let mut fill = Matrix::zeros(broken.len(), image.columns);
    for (&channel, row) in broken.iter().zip(fill.values.chunks_exact_mut(image.columns)) {
        for (change, pixel) in model.jacobian.row(channel).iter().zip(image.values.chunks_exact(image.columns)) {
            row.iter_mut().zip(pixel).for_each(|(value, pixel)| *value += change * pixel);
        }
    }
    Ok(fill)
}

impl<P> WithoutChannels<P> {
    /// A difference with predicted values of the broken channels, whatever theirs are.
    fn complete(&self, difference: &[f64]) -> Result<Vec<f64>, ReconstructError> {
        let (got, expected) = (difference.len(), self.fill.columns);
        if got != expected {
            return Err(ReconstructError::FrameLength { got, expected });
        }
        let mut completed = difference.to_vec();
        self.broken.iter().for_each(|&channel| completed[channel] = 0.0);
        let mut predicted = vec![0.0; self.broken.len()];
        self.fill.product_into(&completed, &mut predicted);
        self.broken.iter().zip(predicted).for_each(|(&channel, predicted)| completed[channel] = predicted);
        Ok(completed)
    }
}

impl<P: Deref<Target: Reconstruct> + Send + Sync> Reconstruct for WithoutChannels<P> {
    fn name(&self) -> String {
        self.method.name()
    }

    fn pixels(&self) -> &Arc<PixelSpace> {
        self.method.pixels()
    }

    /// As the wrapped method; the difference is copied if there are broken channels.
    fn reconstruct_into(&self, difference: &[f64], values: &mut [f64]) -> Result<(), ReconstructError> {
        self.method.reconstruct_into(&self.complete(difference)?, values)
    }

    fn contacts(&self, difference: &[f64]) -> Result<Option<Vec<Contact>>, ReconstructError> {
        self.method.contacts(&self.complete(difference)?)
    }

    fn correct(&self, difference: &[f64], contacts: &mut Vec<Contact>) {
        if let Ok(completed) = self.complete(difference) {
            self.method.correct(&completed, contacts);
        }
    }

    fn is_adaptable(&self) -> bool {
        self.method.is_adaptable()
    }

    fn adapted(&self, rest: &Frame, untouched: &[Frame]) -> Result<Option<Arc<dyn Reconstruct>>, ReconstructError> {
        // A channel that does not vary is not used.
        let still = |frame: &Frame| {
            let mut frame = frame.clone();
            self.broken.iter().for_each(|&channel| frame[channel] = 0.0);
            frame
        };
        let untouched: Vec<Frame> = untouched.iter().map(still).collect();
        let adapted = self.method.adapted(&still(rest), &untouched)?;
        Ok(adapted.map(|method| {
            let (broken, fill, matrix) = (self.broken.clone(), self.fill.clone(), self.matrix.clone());
            Arc::new(WithoutChannels { method, broken, fill, matrix }) as Arc<dyn Reconstruct>
        }))
    }

    fn warning(&self) -> Option<&str> {
        self.method.warning()
    }

    fn novelty(&self, difference: &[f64]) -> Option<f64> {
        self.method.novelty(&self.complete(difference).ok()?)
    }

    fn matrix(&self) -> Option<&Matrix> {
        self.matrix.as_ref()
    }

    fn quantity(&self) -> Quantity {
        self.method.quantity()
    }

    fn detection(&self) -> DetectOptions {
        self.method.detection()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::design::SkinDesign;
    use crate::forward::ForwardModel;
    use crate::mesh::Mesh;
    use crate::reconstruct::Alpha;

    const BROKEN: [usize; 3] = [3, 500, 501];

    fn skin() -> (Linearised, Arc<PixelSpace>) {
        let mut design = SkinDesign::shipped("cylinder30").unwrap();
        design.mesh = design.mesh.scaled(2.0);
        let forward = ForwardModel::new(&design, &Mesh::generate(&design).unwrap()).unwrap();
        let pixels = Arc::new(PixelSpace::for_design(&design, forward.mesh()).unwrap());
        (Linearised::new(&forward, &pixels).unwrap(), pixels)
    }

    fn difference(broken: f64) -> Vec<f64> {
        (0..870).map(|channel| if BROKEN.contains(&channel) { broken } else { f64::from(channel as u32 % 7) }).collect()
    }

    fn image(method: &dyn Reconstruct, broken: f64) -> Vec<f64> {
        let mut values = vec![0.0; 900];
        method.reconstruct_into(&difference(broken), &mut values).unwrap();
        values
    }

    #[test]
    fn what_a_broken_channel_says_makes_no_difference() {
        let (model, pixels) = skin();
        let method = OneStep::from_linearised(&model, pixels, &OneStepOptions::default()).unwrap();
        let polarity_blind = WithoutChannels::new(&method, &model, BROKEN.to_vec()).unwrap();
        assert_eq!(image(&polarity_blind, 1e6), image(&polarity_blind, 0.0));
        assert_ne!(image(&method, 1.0), image(&method, 0.0));
        // The matrix must agree with the reconstruction.
        let matrix = polarity_blind.matrix().unwrap();
        let product: f64 = matrix.values[..870].iter().zip(difference(1e6)).map(|(a, b)| a * b).sum();
        assert!((product - image(&polarity_blind, 1e6)[0]).abs() < 1e-9 * product.abs());
        assert_eq!(image(&polarity_blind, f64::NAN), image(&polarity_blind, 0.0));
        assert!(polarity_blind.reconstruct_into(&[0.0], &mut [0.0]).is_err());
        assert!(polarity_blind.contacts(&[0.0]).is_err());
        assert_eq!(polarity_blind.novelty(&[0.0]), None);
        assert!(WithoutChannels::new(&method, &model, vec![870]).is_err());
        let whole = WithoutChannels::new(&method, &model, Vec::new()).unwrap();
        assert_eq!(image(&whole, 1.0), image(&method, 1.0));
    }

    #[test]
    fn a_linear_method_with_the_same_prior_equals_one_prepared_without_the_channels() {
        let (model, pixels) = skin();
        let laplace = OneStepOptions { prior: Prior::Laplace, ..OneStepOptions::default() };
        let without = OneStepOptions { excluded: BROKEN.to_vec(), ..laplace.clone() };
        let anew = OneStep::from_linearised(&model, Arc::clone(&pixels), &without).unwrap();
        // Alpha is relative to the Jacobian of the channels in use: the prior must have the same weight in both.
        let unit = |options: &OneStepOptions| {
            let options = OneStepOptions { alpha: Alpha::Given(1.0), ..options.clone() };
            OneStep::from_linearised(&model, Arc::clone(&pixels), &options).unwrap().hyperparameter()
        };
        let alpha = Alpha::Given(anew.hyperparameter() / unit(&laplace));
        let whole = OneStep::from_linearised(&model, pixels, &OneStepOptions { alpha, ..laplace }).unwrap();
        let filled = image(&WithoutChannels::new(&whole, &model, BROKEN.to_vec()).unwrap(), 0.0);
        let expected = image(&anew, 0.0);
        let size = expected.iter().map(|value| value.abs()).fold(0.0, f64::max);
        let off = filled.iter().zip(&expected).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        assert!(off < 1e-9 * size, "{off} of {size}");
        assert!(image(&whole, 0.0).iter().zip(&expected).any(|(a, b)| (a - b).abs() > 1e-6 * size));
    }
}
