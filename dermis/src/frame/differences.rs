//! Differences of frames from the untouched skin.

use crate::frame::{Frame, mean};

/// Differences of frames from the untouched skin, ohm.
///
/// ```
/// use dermis::frame::{Differences, Frame};
///
/// let differences = Differences::new(vec![Frame(vec![3.0])], vec![Frame(vec![0.9]), Frame(vec![1.1])]);
/// assert_eq!(differences.frames, [Frame(vec![2.0])]);
/// assert!((differences.untouched[1][0] - 0.1).abs() < 1e-15);
/// ```
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Differences {
    /// The difference of each frame.
    pub frames: Vec<Frame>,
    /// The untouched frames minus their mean; empty if they are not known.
    pub untouched: Vec<Frame>,
    /// The mean of the untouched frames, ohm; `None` if they are not known.
    pub baseline: Option<Frame>,
}

impl Differences {
    /// Frames minus the mean of untouched frames, ohm. Without untouched frames, `frames` are differences already.
    ///
    /// # Panics
    /// If the frames differ in length.
    pub fn new(frames: Vec<Frame>, untouched: Vec<Frame>) -> Self {
        let Some(rest) = mean(&untouched) else {
            return Differences { frames, ..Differences::default() };
        };
        let minus_rest = |frames: &[Frame]| frames.iter().map(|frame| frame - &rest).collect();
        let (frames, untouched) = (minus_rest(&frames), minus_rest(&untouched));
        Differences { frames, untouched, baseline: Some(rest) }
    }

    /// The untouched frames, ohm; empty if they are not known.
    pub fn rest(&self) -> Vec<Frame> {
        let Some(rest) = &self.baseline else { return Vec::new() };
        let whole = |difference: &Frame| Frame(difference.iter().zip(rest.iter()).map(|(a, b)| a + b).collect());
        self.untouched.iter().map(whole).collect()
    }
}
