//! Differences of frames from the untouched skin.

use crate::frame::{Frame, mean};
use std::f64::consts::FRAC_1_SQRT_2;

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
    /// Deviations of the untouched frames, as large as their noise; empty if they are not known. From
    /// [`new`](Self::new): the untouched frames minus their mean.
    pub untouched: Vec<Frame>,
    /// The mean of the untouched frames, ohm; `None` if they are not known.
    pub baseline: Option<Frame>,
    /// Whether something is wrong with all frames, as `Plausibility` finds: no contact is then more
    /// probable than not.
    pub is_doubtful: bool,
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
        Differences { frames, untouched, baseline: Some(rest), is_doubtful: false }
    }

    /// Frames minus the untouched frames of the same rows, ohm: a skin that drifts between presses is recorded up and down.
    /// The deviations are the differences of successive untouched frames over the root of 2, which have the variance of the
    /// noise and leave out slow drift (von Neumann 1941, DOI 10.1214/aoms/1177731677).
    ///
    /// ```
    /// use dermis::frame::{Differences, Frame};
    ///
    /// let [up, down] = [[1.0, 1.5], [1.2, 1.9]].map(|rows| rows.map(|value| Frame(vec![value])).to_vec());
    /// let differences = Differences::paired(down, up);
    /// assert!((differences.frames[1][0] - 0.4).abs() < 1e-15);
    /// ```
    ///
    /// # Panics
    /// If the numbers of frames differ, or their lengths.
    pub fn paired(frames: Vec<Frame>, untouched: Vec<Frame>) -> Self {
        assert_eq!(frames.len(), untouched.len(), "an untouched frame for each frame");
        let step = |pair: &[Frame]| Frame((&pair[1] - &pair[0]).iter().map(|change| change * FRAC_1_SQRT_2).collect());
        Differences {
            frames: frames.iter().zip(&untouched).map(|(frame, rest)| frame - rest).collect(),
            baseline: mean(&untouched),
            untouched: untouched.windows(2).map(step).collect(),
            is_doubtful: false,
        }
    }

    /// The untouched frames, ohm; empty if they are not known.
    pub fn rest(&self) -> Vec<Frame> {
        let Some(rest) = &self.baseline else { return Vec::new() };
        let whole = |difference: &Frame| Frame(difference.iter().zip(rest.iter()).map(|(a, b)| a + b).collect());
        self.untouched.iter().map(whole).collect()
    }
}
