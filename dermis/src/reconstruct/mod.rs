//! Reconstruction of images from frame differences.

mod alpha;
mod channels;
mod contacts;
mod gauss_newton;
mod greit;
mod linearised;
mod merit;
mod noise_figure;
mod one_step;
mod prior;
mod refined;
mod sensitivity;
mod system;
#[cfg(test)]
mod testing;
mod total_variation;
mod without_channels;

pub use alpha::{Alpha, AlphaRule};
pub use channels::Difference;
pub use contacts::{Detection, Search};
pub use gauss_newton::{GaussNewton, GaussNewtonOptions, Solution, Unknowns};
pub use greit::{Greit, GreitOptions};
pub use linearised::Linearised;
pub use merit::{FiguresOfMerit, figures_of_merit};
pub use noise_figure::noise_figure;
pub use one_step::{OneStep, OneStepOptions};
pub use prior::{Prior, default_prior};
pub use refined::Refined;
pub use total_variation::{TotalVariation, TotalVariationOptions};
pub use without_channels::WithoutChannels;

use crate::contact::Contact;
use crate::detect::{DetectOptions, ImageNoise};
use crate::estimate::noise::ChannelNoise;
use crate::frame::{Frame, mean};
use crate::image::{Image, PixelSpace};
use crate::protocol::Protocol;
use rayon::prelude::*;
use std::sync::Arc;
use thiserror::Error;

/// A reconstruction that cannot be set up or carried out.
#[derive(Debug, Error)]
#[non_exhaustive]
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

/// A reconstruction of an image from the difference of a frame and its baseline. Every method, linear or learned,
/// implements it.
pub trait Reconstruct: Send + Sync {
    /// Short name for tables: "one-step NOSER".
    fn name(&self) -> String;

    /// The pixels of the images it makes.
    fn pixels(&self) -> &Arc<PixelSpace>;

    /// The image of a difference (frame minus baseline, ohm), written to `values`, one per pixel: relative change of
    /// conductance, positive where touched. Methods with precomputed matrices allocate no memory.
    ///
    /// # Errors
    /// A difference or an output of the wrong length; an iteration that fails.
    fn reconstruct_into(&self, difference: &[f64], values: &mut [f64]) -> Result<(), ReconstructError>;

    /// The image of a difference (frame minus baseline, ohm).
    ///
    /// # Errors
    /// As [`reconstruct_into`](Self::reconstruct_into).
    fn reconstruct(&self, difference: &Frame) -> Result<Image, ReconstructError> {
        let mut image = Image::zeros(self.pixels());
        self.reconstruct_into(difference, &mut image.values)?;
        Ok(image)
    }

    /// The linear map from a difference to the image, pixels x channels, if the method is linear; it gives the
    /// propagation of noise from the frame to the image.
    fn matrix(&self) -> Option<&crate::forward::Matrix> {
        None
    }

    /// The quantity of its image values.
    fn quantity(&self) -> Quantity {
        Quantity::Change
    }

    /// The contacts of a difference, if the method locates them itself; `None` if they are the peaks of its image.
    ///
    /// # Errors
    /// A difference of the wrong length, or with values that are not finite.
    fn contacts(&self, _difference: &[f64]) -> Result<Option<Vec<Contact>>, ReconstructError> {
        Ok(None)
    }

    /// Corrects the contacts that were detected in the image of a difference: a method that is calibrated on a real
    /// skin changes positions, forces and deviations; one that refines them may also remove contacts, and add contacts
    /// with new ids at the end. The default leaves them as they are.
    fn correct(&self, _difference: &[f64], _contacts: &mut Vec<Contact>) {}

    /// Whether the method can be [adapted](Self::adapted) to untouched frames.
    fn is_adaptable(&self) -> bool {
        false
    }

    /// The method adapted to the untouched skin, from the mean of its untouched frames and their differences from it, ohm;
    /// `None` for a method that does not depend on them, or with too few frames.
    ///
    /// # Errors
    /// Frames of the wrong length, a forward problem that cannot be solved.
    fn adapted(&self, _rest: &Frame, _untouched: &[Frame]) -> Result<Option<Arc<dyn Reconstruct>>, ReconstructError> {
        Ok(None)
    }

    /// Why the method does less than it could on the skin to which it is [adapted](Self::adapted); `None` if it does not.
    fn warning(&self) -> Option<&str> {
        None
    }

    /// How unlike the presses of its calibration the difference of a touched frame is: the mean square of its residual
    /// over the one that 99 % of the calibration's presses do not exceed. `None` for methods without a calibration, and
    /// where the frame is untouched.
    fn novelty(&self, _difference: &[f64]) -> Option<f64> {
        None
    }

    /// Detection options for its images. The default is that of linear images, with their side lobes.
    fn detection(&self) -> DetectOptions {
        DetectOptions::default()
    }
}

/// The quantity of image values.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Quantity {
    /// Relative change of conductance, positive where touched.
    Change,
    /// The size of the touch centred at the pixel, in the unit of the training: newtons for presses.
    Touch,
    /// The posterior density of the position of a touch, relative to its largest value.
    Density,
}

/// Minimum number of untouched frames for measuring the noise of images by themselves: the relative standard error of the
/// standard deviation is then a quarter (1 / sqrt(2 n)).
pub const MIN_UNTOUCHED_FRAMES: usize = 8;

/// Fewer frames tell the noise of all channels, not that of each: the noise that is the same in all values of a drive, as that of
/// its current, is larger in large values.
const OF_FEW_FRAMES: f64 = 1.5;

/// Frames that are drawn where the untouched ones are fewer.
const DRAWN_FRAMES: u64 = 64;

/// The noise of a method's images of differences from the mean of untouched frames, from these or their differences from one
/// frame, ohm: by the method's matrix from the [noise of the channels](ChannelNoise); without a matrix from the images of
/// those frames, or with fewer than [`MIN_UNTOUCHED_FRAMES`] of frames drawn with that noise. `None` without a frame.
///
/// Every command and the live pipeline measure the noise by this rule.
///
/// # Errors
/// A method that fails on a frame.
pub fn image_noise(
    method: &dyn Reconstruct,
    untouched: &[Frame],
    protocol: &Protocol,
) -> Result<Option<ImageNoise>, ReconstructError> {
    match ChannelNoise::of(untouched, protocol) {
        Some(noise) => image_noise_of(method, &noise, untouched),
        None => Ok(None),
    }
}

/// The same of a known noise of the channels.
///
/// # Errors
/// As [`image_noise`].
pub(crate) fn image_noise_of(
    method: &dyn Reconstruct,
    noise: &ChannelNoise,
    untouched: &[Frame],
) -> Result<Option<ImageNoise>, ReconstructError> {
    let Some(rest) = mean(untouched) else { return Ok(None) };
    let mut sd_ohm = noise.sd_of_difference_ohm();
    let is_few = untouched.len() < MIN_UNTOUCHED_FRAMES;
    if is_few {
        sd_ohm.iter_mut().for_each(|sd| *sd *= OF_FEW_FRAMES);
    }
    if let Some(matrix) = method.matrix() {
        return Ok(Some(ImageNoise::from_matrix(matrix, &sd_ohm)));
    }
    let frames: Vec<Frame> = match is_few {
        true => (0..DRAWN_FRAMES).map(|frame| drawn(&sd_ohm, frame)).collect(),
        false => untouched.iter().map(|frame| frame - &rest).collect(),
    };
    let images = frames.par_iter().map(|frame| method.reconstruct(frame)).collect::<Result<Vec<_>, _>>()?;
    let noise = ImageNoise::from_untouched(&images);
    Ok(if is_few { noise.map(|noise| noise.above_peaks(&images)) } else { noise })
}

/// A frame of noise: each value is the sum of four even ones (the mixing function of SplitMix64; Steele, Lea and Flood, 2014, DOI
/// 10.1145/2660193.2660195).
fn drawn(sd_ohm: &[f64], frame: u64) -> Frame {
    let normal = |channel: usize| {
        let mut bits = (frame << 32 | channel as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        bits = (bits ^ bits >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        bits = (bits ^ bits >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
        bits ^= bits >> 31;
        let even = |part: u64| (bits >> (16 * part) & 0xffff) as f64 / 65536.0 - 0.5;
        // The variance of each is 1/12.
        3f64.sqrt() * (0..4).map(even).sum::<f64>()
    };
    Frame(sd_ohm.iter().enumerate().map(|(channel, sd)| normal(channel) * sd).collect())
}

/// Checks a difference and its image.
///
/// # Errors
/// A length that differs from the number of channels or pixels, a value that is not finite.
pub fn check_lengths(
    difference: &[f64],
    channels: usize,
    values: &[f64],
    pixels: usize,
) -> Result<(), ReconstructError> {
    if values.len() != pixels {
        return Err(ReconstructError::ImageLength { got: values.len(), expected: pixels });
    }
    check_difference(difference, channels)
}

/// Checks a difference.
///
/// # Errors
/// A length that differs from the number of channels, a value that is not finite.
pub fn check_difference(difference: &[f64], channels: usize) -> Result<(), ReconstructError> {
    if difference.len() != channels {
        return Err(ReconstructError::FrameLength { got: difference.len(), expected: channels });
    }
    check_finite(difference)
}

/// Checks that all values of a difference are finite.
pub(crate) fn check_finite(difference: &[f64]) -> Result<(), ReconstructError> {
    match difference.iter().position(|value| !value.is_finite()) {
        Some(channel) => Err(ReconstructError::NotFinite { channel, value: difference[channel] }),
        None => Ok(()),
    }
}
