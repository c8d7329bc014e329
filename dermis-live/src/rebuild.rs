//! A method made anew without the channels that are left out, and the noise of its images, on any thread.

use crate::LiveError;
use crate::skin::{LiveSkin, NamedMethod};
use dermis::detect::ImageNoise;
use dermis::frame::Frame;
use dermis::reconstruct::image_noise;
use std::sync::Arc;

/// A method to be made without some channels, on any thread.
#[derive(Debug, Clone)]
pub struct Rebuilding {
    pub(crate) skin: Arc<LiveSkin>,
    pub(crate) name: String,
    pub(crate) without: Vec<usize>,
    pub(crate) untouched: Vec<Vec<f64>>,
}

/// A method made without some channels, and the noise of its images.
#[derive(Debug, Clone)]
pub struct Rebuilt {
    pub(crate) method: NamedMethod,
    pub(crate) without: Vec<usize>,
    pub(crate) noise: Option<ImageNoise>,
}

impl Rebuilding {
    /// Makes it.
    ///
    /// # Errors
    /// Too few channels left.
    pub fn run(self) -> Result<Rebuilt, LiveError> {
        let Rebuilding { skin, name, without, untouched } = self;
        let method = skin.without(&name, &without)?;
        let noise = noise_of(&method, &untouched, &without)?;
        Ok(Rebuilt { method, without, noise })
    }
}

/// The noise of a method's images, from untouched frames of which some channels are left out.
pub(crate) fn noise_of(
    method: &NamedMethod,
    untouched: &[Vec<f64>],
    without: &[usize],
) -> Result<Option<ImageNoise>, LiveError> {
    let heard = |frame: &Vec<f64>| {
        let mut frame = frame.clone();
        without.iter().for_each(|&channel| frame[channel] = 0.0);
        Frame(frame)
    };
    let untouched: Vec<Frame> = untouched.iter().map(heard).collect();
    Ok(image_noise(method.method.as_ref(), &untouched)?)
}
