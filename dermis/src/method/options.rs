//! Options of a method.

use crate::frame::Frame;
use crate::method::MethodError;
use crate::reconstruct::{Alpha, Difference};
use crate::skin::Skin;

/// Options of a method. The defaults are valid for every method; an option that a method does not have is an error.
#[derive(Debug, Clone, PartialEq)]
pub struct MethodOptions {
    /// Regularization parameter of a linear method.
    pub alpha: Alpha,
    /// Exponent of the NOSER prior: 0 is the Tikhonov prior, 1 the original NOSER (Cheney et al. 1990, DOI
    /// 10.1002/ima.1850020203).
    pub noser_exponent: f64,
    /// Scaling of the channels of a linear method.
    pub difference: Difference,
    /// Channels that are excluded.
    pub excluded: Vec<usize>,
    /// Standard deviation of the noise of each channel, in any common unit, for one-step methods and `gauss-newton`;
    /// empty where all are equal.
    pub channel_sd: Vec<f64>,
    /// Measured differences, ohm, for the rules of alpha that use data ([`Alpha::LCurve`], [`Alpha::Gcv`]).
    pub examples: Vec<Frame>,
    /// The measured frame of the untouched skin, ohm, to which `gauss-newton` scales its model, and by which one-step methods
    /// divide normalised differences; other methods do not depend on it.
    pub baseline: Option<Frame>,
}

impl Default for MethodOptions {
    fn default() -> Self {
        MethodOptions {
            alpha: Alpha::Auto,
            noser_exponent: 0.5,
            difference: Difference::Plain,
            excluded: Vec::new(),
            channel_sd: Vec::new(),
            examples: Vec::new(),
            baseline: None,
        }
    }
}

impl MethodOptions {
    /// Refuses channels that the skin does not have.
    pub(super) fn check(&self, skin: &Skin) -> Result<(), MethodError> {
        let channel_count = skin.design().protocol.channel_count();
        match self.excluded.iter().find(|&&channel| channel >= channel_count) {
            None => Ok(()),
            Some(channel) => {
                let last = channel_count - 1;
                Err(MethodError::option(
                    "a method",
                    format!("cannot leave channel {channel} out: the channels are 0 to {last}"),
                ))
            }
        }
    }

    /// Refuses options that only linear methods have.
    ///
    /// # Errors
    /// An alpha or a scaling of channels that is not the default.
    pub fn check_not_linear(&self, method: &str) -> Result<(), MethodError> {
        if self.alpha != Alpha::Auto {
            return Err(MethodError::option(method, "has no regularization parameter: leave alpha out"));
        }
        self.check_equal_weights(method)
    }

    /// Refuses a scaling or weighting of channels.
    pub(super) fn check_equal_weights(&self, method: &str) -> Result<(), MethodError> {
        if self.difference != Difference::Plain {
            return Err(MethodError::option(
                method,
                "takes plain differences only: leave the weighting of channels out",
            ));
        }
        if !self.channel_sd.is_empty() {
            return Err(MethodError::option(method, "does not weight channels by their noise: leave it out"));
        }
        Ok(())
    }
}
