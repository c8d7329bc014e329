//! The input frames of a command, as differences from the untouched skin.

use crate::console::Progress;
use crate::failure::{Failure, Outcome};
use clap::Args;
use dermis::fit::model_differences;
use dermis::frame::{Frame, mean, read_frames_without};
use dermis::image::Image;
use dermis::method::Method;
use dermis::skin::Skin;
use rayon::prelude::*;
use std::path::PathBuf;

/// The value of `--baseline` for the model's own untouched frame; a file of that name is `./model`.
const MODEL: &str = "model";

/// Where frames come from.
#[derive(Debug, Args)]
pub struct FrameArguments {
    /// Frames, one per row (CSV, NPY or NPZ; ohm).
    #[arg(long, value_name = "FILE")]
    pub frames: PathBuf,
    /// Untouched frames, one per row; their mean is the baseline. From 8 of them on, the noise is measured from their
    /// scatter. `model` is the untouched frame of the design, scaled to the frames: see `dermis fit`.
    #[arg(long, value_name = "FILE|model", required_unless_present = "difference", conflicts_with = "difference")]
    pub baseline: Option<PathBuf>,
    /// The frames are differences from the untouched skin.
    #[arg(long)]
    pub difference: bool,
}

/// Differences from the untouched skin.
#[derive(Debug, Default)]
pub struct Differences {
    /// The difference of each frame, ohm.
    pub frames: Vec<Frame>,
    /// The untouched frames minus their mean, ohm; empty where differences were given.
    pub untouched: Vec<Frame>,
}

impl FrameArguments {
    /// Reads the frames and subtracts the baseline. Channels that are left out need no values and are 0.
    pub fn read(&self, skin: &Skin, left_out: &[usize]) -> Outcome<Differences> {
        let protocol = &skin.design().protocol;
        let frames = read_frames_without(&self.frames, protocol, left_out)?;
        let Some(path) = &self.baseline else { return Ok(Differences { frames, untouched: Vec::new() }) };
        if path.as_os_str() == MODEL {
            let model = skin.forward().solve(skin.forward().rest_conductivity())?;
            let frames = model_differences(protocol, &model, &frames, left_out)?.frames;
            return Ok(Differences { frames, untouched: Vec::new() });
        }
        let untouched = read_frames_without(path, protocol, left_out)?;
        let rest =
            mean(&untouched).ok_or_else(|| Failure::given(format!("{} holds no frame", path.display()), None))?;
        let minus_rest = |frames: &[Frame]| frames.iter().map(|frame| frame - &rest).collect();
        Ok(Differences { frames: minus_rest(&frames), untouched: minus_rest(&untouched) })
    }
}

/// The image of each difference.
pub fn images(method: &Method, differences: &[Frame]) -> Outcome<Vec<Image>> {
    let progress = Progress::new("reconstructing", differences.len());
    let image = |difference| {
        let image = method.image(difference);
        progress.step();
        image
    };
    Ok(differences.par_iter().map(image).collect::<Result<Vec<_>, _>>()?)
}
