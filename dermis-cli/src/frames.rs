//! The frames that a command is given, and what was touched since.

use crate::failure::{Failure, Outcome};
use clap::Args;
use dermis::frame::{Frame, mean, read_frames};
use dermis::protocol::Protocol;
use std::path::PathBuf;

/// Where frames come from.
#[derive(Debug, Args)]
pub struct FrameArguments {
    /// Frames, a row each (CSV, NPY or NPZ; ohm).
    #[arg(long, value_name = "FILE")]
    pub frames: PathBuf,
    /// Untouched frames, a row each; their mean is taken off.
    #[arg(long, value_name = "FILE", required_unless_present = "difference", conflicts_with = "difference")]
    pub baseline: Option<PathBuf>,
    /// The frames are differences from the untouched skin already.
    #[arg(long)]
    pub difference: bool,
}

/// Differences from the untouched skin, and what is known of their noise.
#[derive(Debug, Default)]
pub struct Differences {
    /// A difference for each frame, ohm.
    pub frames: Vec<Frame>,
    /// The untouched frames, each less their mean; empty where the frames were differences already.
    pub untouched: Vec<Frame>,
}

impl FrameArguments {
    /// Reads the frames and takes the baseline off.
    pub fn read(&self, protocol: &Protocol) -> Outcome<Differences> {
        let frames = read_frames(&self.frames, protocol)?;
        let Some(path) = &self.baseline else { return Ok(Differences { frames, untouched: Vec::new() }) };
        let untouched = read_frames(path, protocol)?;
        let rest =
            mean(&untouched).ok_or_else(|| Failure::given(format!("{} holds no frame", path.display()), None))?;
        let less_rest = |frames: &[Frame]| frames.iter().map(|frame| frame - &rest).collect();
        Ok(Differences { frames: less_rest(&frames), untouched: less_rest(&untouched) })
    }
}

impl Differences {
    /// Standard deviation of a difference's noise, one number for all channels, from how the untouched frames scatter;
    /// `None` with fewer than two of them.
    ///
    /// A difference holds the noise of one frame and of the baseline's mean: `s sqrt(1 + 1/n)`.
    pub fn noise_ohm(&self) -> Option<f64> {
        let count = self.untouched.len();
        if count < 2 {
            return None;
        }
        let squares: f64 = self.untouched.iter().flat_map(|frame| frame.iter()).map(|value| value * value).sum();
        let variance = squares / ((count - 1) * self.untouched[0].len()) as f64;
        Some((variance * (1.0 + 1.0 / count as f64)).sqrt())
    }
}
