//! Virtual experiments: presses on a twin, recorded as delivered by its instrument.
//!
//! Frames are consecutive in the time of the [`Twin`]: first the untouched ones, whose mean is the baseline, then one
//! for every press, at the interval of the presses and without averaging.
//!
//! ```
//! use dermis::geom::Surface;
//! use dermis_sim::experiment::truth;
//! use dermis_sim::twin::Press;
//!
//! let press = Press { centre_m: [0.01, 0.02, 0.0], force_n: 2.0, tip_radius_m: 0.005 };
//! let contacts = truth(&Surface::Plane, &[press]);
//! assert_eq!((contacts[0].position_m, contacts[0].force_n), ([0.01, 0.02, 0.0], 2.0));
//! ```

mod files;
mod objects;
mod paper;
mod presses;

pub use files::{ExperimentSummary, SetSummary};
pub use objects::{Family, Objects};
pub use paper::{PaperExperiment, Sets, Sizes};
use presses::MAX_DRAWS;
pub use presses::{PressSet, Presses};

use crate::twin::{Press, Twin};
use dermis::contact::Contact;
use dermis::frame::{Frame, mean};
use dermis::geom::Surface;
use rayon::prelude::*;

/// Number of untouched frames before the first press.
pub const UNTOUCHED_FRAMES: u64 = 100;

/// The frames of an experiment.
#[derive(Debug, Clone, PartialEq)]
pub struct Recording {
    /// The untouched frames before the first press, ohm.
    pub untouched: Vec<Frame>,
    /// Their mean.
    pub baseline: Frame,
    /// A frame for each entry of the list of presses, ohm.
    pub frames: Vec<Frame>,
    /// Number of the twin's first frame after those of this recording.
    pub next_index: u64,
}

impl Recording {
    /// The same without its last frame, and that frame as a separate recording; `None` without a frame.
    pub fn split_last(&self) -> Option<(Recording, Recording)> {
        let (last, rest) = self.frames.split_last()?;
        let with = |frames: Vec<Frame>| Recording { frames, ..self.clone() };
        Some((with(rest.to_vec()), with(vec![last.clone()])))
    }
}

/// Records one frame for each entry of `presses`, which contains all presses of that frame, from the twin's frame
/// `first_index` on. `on_frame` is called after every frame, from several threads; the result does not depend on their
/// number.
///
/// # Errors
/// Presses that the twin cannot simulate.
pub fn record(
    twin: &Twin,
    presses: &[Vec<Press>],
    first_index: u64,
    on_frame: impl Fn() + Sync,
) -> crate::Result<Recording> {
    let untouched = (0..UNTOUCHED_FRAMES).map(|index| twin.frame(&[], first_index + index));
    let untouched = untouched.collect::<crate::Result<Vec<Frame>>>()?;
    let baseline = mean(&untouched).expect("there are untouched frames");
    let options = twin.options();
    let step = (options.press.interval_s * options.electronics.frame_rate_hz).round().max(1.0) as u64;
    let first_press = first_index + UNTOUCHED_FRAMES;
    let frame = |(number, presses): (usize, &Vec<Press>)| {
        let frame = twin.frame(presses, first_press + number as u64 * step);
        on_frame();
        frame
    };
    let frames = presses.par_iter().enumerate().map(frame).collect::<crate::Result<Vec<Frame>>>()?;
    Ok(Recording { untouched, baseline, frames, next_index: first_press + presses.len() as u64 * step })
}

/// The presses of a frame as ground truth.
pub fn truth(surface: &Surface, presses: &[Press]) -> Vec<Contact> {
    let contact = |(id, press): (usize, &Press)| {
        let normal = surface.normal(press.centre_m).unwrap_or([f64::NAN; 3]);
        Contact { id: id as u64, ..Contact::truth(press.centre_m, normal, press.force_n) }
    };
    presses.iter().enumerate().map(contact).collect()
}

#[cfg(test)]
mod tests;
