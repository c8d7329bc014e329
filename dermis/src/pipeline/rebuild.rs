//! The method prepared again, without the masked channels and for the untouched skin, and the noise of its images.

use crate::detect::ImageNoise;
use crate::frame::{Differences, Frame};
use crate::method::{Method, MethodSet};
use crate::pipeline::degradation::Cost;
use crate::pipeline::error::PipelineError;
use crate::protocol::Protocol;
use crate::reconstruct::image_noise;
use std::sync::Arc;

/// A job that prepares a method without some channels, adapted to the untouched skin. It may run on any thread.
#[derive(Debug, Clone)]
pub struct RebuildJob {
    pub(super) methods: Arc<MethodSet>,
    pub(super) name: String,
    pub(super) masked: Vec<usize>,
    pub(super) untouched: Vec<Vec<f64>>,
    /// The mean of the tare's frames to which the method is adapted, if it is.
    pub(super) rest_ohm: Option<Vec<f64>>,
    pub(super) noise_ohm: Vec<f64>,
}

/// The result of a [`RebuildJob`].
#[derive(Debug, Clone)]
pub struct RebuiltMethod {
    pub(super) method: Method,
    pub(super) masked: Vec<usize>,
    pub(super) rest_ohm: Option<Vec<f64>>,
    pub(super) noise: Option<ImageNoise>,
    pub(super) cost: Option<Cost>,
}

impl RebuildJob {
    /// Whether the method will be adapted to a tare.
    pub fn is_adapted(&self) -> bool {
        self.rest_ohm.is_some()
    }

    /// Prepares the method.
    ///
    /// # Errors
    /// Too few channels left.
    pub fn run(self) -> Result<RebuiltMethod, PipelineError> {
        let RebuildJob { methods, name, masked, untouched, rest_ohm, noise_ohm } = self;
        let mut method = methods.method(&name)?.without_channels(methods.skin(), &masked)?;
        if let Some(rest_ohm) = &rest_ohm {
            let untouched = untouched.iter().map(|frame| Frame(frame.clone())).collect();
            let baseline = Some(Frame(rest_ohm.clone()));
            method = method.adapted(&Differences { untouched, baseline, ..Differences::default() })?;
        }
        let noise = noise_without(&method, &untouched, &masked, &methods.skin().design().protocol)?;
        let is_known = !masked.is_empty() && !noise_ohm.is_empty();
        let cost = is_known.then(|| Cost::of(methods.skin(), &noise_ohm, &masked)).transpose()?;
        Ok(RebuiltMethod { method, masked, rest_ohm, noise, cost })
    }
}

/// The noise of a method's images, from differences of untouched frames in which some channels are masked.
pub(super) fn noise_without(
    method: &Method,
    untouched: &[Vec<f64>],
    masked: &[usize],
    protocol: &Protocol,
) -> Result<Option<ImageNoise>, PipelineError> {
    let without_masked = |frame: &Vec<f64>| {
        let mut frame = frame.clone();
        masked.iter().for_each(|&channel| frame[channel] = 0.0);
        Frame(frame)
    };
    let untouched: Vec<Frame> = untouched.iter().map(without_masked).collect();
    Ok(image_noise(method.reconstruct().as_ref(), &untouched, protocol)?)
}
