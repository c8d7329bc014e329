//! From a frame's difference to an image.

mod alpha;
mod channels;
mod gauss_newton;
mod greit;
mod linearised;
mod merit;
mod noise_figure;
mod one_step;
mod prior;
mod sensitivity;
mod system;
#[cfg(test)]
mod testing;
mod total_variation;
mod without_channels;

pub use alpha::{Alpha, AlphaRule};
pub use channels::Difference;
pub use gauss_newton::{GaussNewton, GaussNewtonOptions, Solution};
pub use greit::{Greit, GreitOptions};
pub use linearised::Linearised;
pub use merit::{FiguresOfMerit, figures_of_merit};
pub use noise_figure::noise_figure;
pub use one_step::{OneStep, OneStepOptions};
pub use prior::{Prior, default_prior};
pub use total_variation::{TotalVariation, TotalVariationOptions};
pub use without_channels::WithoutChannels;

use crate::detect::{DetectOptions, ImageNoise};
use crate::frame::Frame;
use crate::image::{Image, PixelSpace};
use rayon::prelude::*;
use std::ops::Deref;
use std::sync::Arc;
use thiserror::Error;

/// A reconstruction that cannot be set up or carried out.
#[derive(Debug, Error)]
pub enum ReconstructError {
    /// A difference of another length than the protocol's.
    #[error("the frame has {got} values, but the protocol has {expected}")]
    FrameLength {
        /// Values in the frame.
        got: usize,
        /// Channels of the protocol.
        expected: usize,
    },
    /// An image of another length than the list of pixels.
    #[error("the image has {got} values, but there are {expected} pixels")]
    ImageLength {
        /// Values in the image.
        got: usize,
        /// Number of pixels.
        expected: usize,
    },
    /// A value that is not a number, or infinite.
    #[error("channel {channel} of the frame is {value}: leave the channel out or mend the frame")]
    NotFinite {
        /// Index of the channel.
        channel: usize,
        /// Its value.
        value: f64,
    },
    /// A parameter out of its range.
    #[error("{0}")]
    Parameter(String),
    /// An equation that cannot be solved.
    #[error("{0}")]
    Singular(String),
}

/// A way from the difference of a frame and its baseline to an image. Every method, linear or learned, is one.
pub trait Reconstruct: Send + Sync {
    /// Short name for tables: "one-step NOSER".
    fn name(&self) -> String;

    /// The pixels of the images it makes.
    fn pixels(&self) -> &Arc<PixelSpace>;

    /// The image of a difference (frame minus baseline, ohm), into `values`, one per pixel: relative change of
    /// conductance, positive where touched. Allocates nothing on methods that precompute.
    ///
    /// # Errors
    /// A difference or an output of the wrong length; an iteration that fails.
    fn reconstruct_into(&self, difference: &[f64], values: &mut [f64]) -> Result<(), ReconstructError>;

    /// The image of a difference (frame minus baseline, ohm).
    ///
    /// # Errors
    /// As [`reconstruct_into`](Self::reconstruct_into).
    fn reconstruct(&self, difference: &Frame) -> Result<Image, ReconstructError> {
        let mut values = vec![0.0; self.pixels().len()];
        self.reconstruct_into(difference, &mut values)?;
        Ok(Image { space: Arc::clone(self.pixels()), values })
    }

    /// The linear map from a difference to the image, pixels x channels, where the method is one; it tells how noise
    /// in the frame spreads over the image.
    fn matrix(&self) -> Option<&crate::forward::Matrix> {
        None
    }

    /// What the values of its images are.
    fn quantity(&self) -> Quantity {
        Quantity::Change
    }

    /// How contacts are found in its images. The default is that of linear images, with their side lobes.
    fn detection(&self) -> DetectOptions {
        DetectOptions::default()
    }
}

/// A pointer to a method is one.
impl<P: Deref<Target: Reconstruct> + Send + Sync> Reconstruct for P {
    fn name(&self) -> String {
        (**self).name()
    }

    fn pixels(&self) -> &Arc<PixelSpace> {
        (**self).pixels()
    }

    fn reconstruct_into(&self, difference: &[f64], values: &mut [f64]) -> Result<(), ReconstructError> {
        (**self).reconstruct_into(difference, values)
    }

    fn matrix(&self) -> Option<&crate::forward::Matrix> {
        (**self).matrix()
    }

    fn quantity(&self) -> Quantity {
        (**self).quantity()
    }

    fn detection(&self) -> DetectOptions {
        (**self).detection()
    }
}

/// What the values of an image are.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Quantity {
    /// Relative change of conductance, positive where touched.
    Change,
    /// The size of the touch whose middle lies there, as the method's training measured it: newtons of presses.
    Touch,
}

/// Fewest untouched frames from which the noise of images is measured: its standard deviation is then known to a quarter
/// (1 / sqrt(2 n)).
pub const FEWEST_UNTOUCHED_FRAMES: usize = 8;

/// The noise of a method's images, from differences of untouched frames from their mean, ohm: by the method's matrix from the root
/// mean square of each channel, or else from the images of those frames. `None` with fewer than [`FEWEST_UNTOUCHED_FRAMES`].
///
/// Every command and the live pipeline measure the noise by this rule.
///
/// # Errors
/// A method that fails on a frame.
pub fn image_noise(method: &dyn Reconstruct, untouched: &[Frame]) -> Result<Option<ImageNoise>, ReconstructError> {
    if untouched.len() < FEWEST_UNTOUCHED_FRAMES {
        return Ok(None);
    }
    let Some(matrix) = method.matrix() else {
        let images = untouched.par_iter().map(|frame| method.reconstruct(frame)).collect::<Result<Vec<_>, _>>()?;
        return Ok(ImageNoise::from_untouched(&images));
    };
    let square = |channel: usize| untouched.iter().map(|frame| frame[channel] * frame[channel]).sum::<f64>();
    let sd = |channel: usize| (square(channel) / untouched.len() as f64).sqrt();
    Ok(Some(ImageNoise::from_matrix(matrix, &(0..matrix.columns).map(sd).collect::<Vec<f64>>())))
}

/// Checks a difference and the image it is to become.
///
/// # Errors
/// Another length than the channels' or the pixels', a value that is not finite.
pub fn check_lengths(
    difference: &[f64],
    channels: usize,
    values: &[f64],
    pixels: usize,
) -> Result<(), ReconstructError> {
    if difference.len() != channels {
        return Err(ReconstructError::FrameLength { got: difference.len(), expected: channels });
    }
    if values.len() != pixels {
        return Err(ReconstructError::ImageLength { got: values.len(), expected: pixels });
    }
    check_finite(difference)
}

/// Checks that a difference holds nothing but numbers.
pub(crate) fn check_finite(difference: &[f64]) -> Result<(), ReconstructError> {
    match difference.iter().position(|value| !value.is_finite()) {
        Some(channel) => Err(ReconstructError::NotFinite { channel, value: difference[channel] }),
        None => Ok(()),
    }
}
