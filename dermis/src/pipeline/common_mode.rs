//! Common-mode offsets: all values of a frame are shifted by one voltage.

use crate::pipeline::error::PipelineError;
use crate::skin::Skin;
use crate::stats::{rms, upper_median};

/// Presses shift the values more alike than pixels of the linear model do, by up to this factor.
const PRESS: f64 = 2.0;
/// On a skin whose touches shift the values as much alike as this, offsets cannot be told from touches.
const MAX_ALIKE: f64 = 0.9;
/// Least limit: errors of the model, noise.
const MIN_LIMIT: f64 = 0.25;

/// Tells common-mode offsets from touches.
///
/// The measure is the median of a frame's differences from the baseline over their root mean square: 1 for an offset
/// without noise. The limit is twice the largest that a change of the skin has in its linear model, of the whole coating
/// or of a pixel, but at most halfway between that and 1.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct CommonMode {
    limit: Option<f64>,
}

impl CommonMode {
    /// For a skin.
    pub(super) fn of(skin: &Skin) -> Result<Self, PipelineError> {
        let jacobian = &skin.linearised()?.jacobian;
        let column =
            |pixel: usize| (0..jacobian.rows).map(|channel| jacobian.row(channel)[pixel]).collect::<Vec<f64>>();
        let coating = (0..jacobian.rows).map(|channel| jacobian.row(channel).iter().sum()).collect::<Vec<f64>>();
        let largest = (0..jacobian.columns).map(|pixel| PRESS * shift(&column(pixel))).fold(shift(&coating), f64::max);
        let limit = (2.0 * largest).min(0.5 * (1.0 + largest)).max(MIN_LIMIT);
        Ok(CommonMode { limit: (largest < MAX_ALIKE).then_some(limit) })
    }

    /// Whether the difference of a touched frame from the baseline is an offset, in the channels that are not masked.
    pub(super) fn is_offset(&self, difference: &[f64], masked: &[bool]) -> bool {
        let used = difference.iter().zip(masked).filter(|(_, masked)| !**masked).map(|(value, _)| *value);
        let used: Vec<f64> = used.collect();
        self.limit.is_some_and(|limit| shift(&used) > limit)
    }
}

/// The size of the median over the root mean square; 0 if all values are 0.
fn shift(values: &[f64]) -> f64 {
    let size = rms(values.iter().copied());
    let median = upper_median(values).unwrap_or(0.0);
    if size > 0.0 { median.abs() / size } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn offsets_are_told_from_changes_of_the_skin() {
        for (name, is_checked) in [("cylinder30", true), ("skin16", false), ("tank16", false)] {
            let skin = Skin::load(name).unwrap();
            let check = CommonMode::of(&skin).unwrap();
            let linear = skin.linearised().unwrap();
            let jacobian = &linear.jacobian;
            let sound = vec![false; jacobian.rows];
            let largest = linear.rest_frame.iter().fold(0.0, |largest: f64, value| largest.max(value.abs()));
            assert_eq!(check.limit.is_some(), is_checked, "{name}: {check:?}");
            assert_eq!(check.is_offset(&vec![0.01 * largest; jacobian.rows], &sound), is_checked);
            for pixel in (0..jacobian.columns).step_by(7) {
                let touch: Vec<f64> =
                    (0..jacobian.rows).map(|channel| jacobian.row(channel)[pixel]).collect::<Vec<f64>>();
                assert!(!check.is_offset(&touch, &sound), "{name}, pixel {pixel}");
            }
        }
    }

    #[test]
    fn masked_channels_do_not_count() {
        let check = CommonMode { limit: Some(0.5) };
        let difference = [1.0, -1.0, 1.0, -1.0, 0.0];
        assert!(!check.is_offset(&difference, &[false; 5]));
        assert!(check.is_offset(&difference, &[false, true, false, true, true]));
        assert!(!check.is_offset(&[0.0; 5], &[false; 5]));
    }
}
