//! From a frame's difference to an image.

use crate::frame::Frame;
use crate::image::{Image, PixelSpace};
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
}
