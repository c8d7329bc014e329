//! Differences from the untouched frame of the model, where no untouched frame was measured.

use crate::estimate::scale::robust;
use crate::fit::{FitError, factor};
use crate::frame::{Frame, mean, without_signs};
use crate::protocol::Protocol;

/// Frames as differences from the model's untouched frame.
#[derive(Debug, Clone, PartialEq)]
pub struct ModelDifferences {
    /// Each frame divided by the scale, minus the model's untouched frame, ohm; 0 in channels that are left out.
    pub frames: Vec<Frame>,
    /// The scale: ohm of the frames per ohm of the model.
    pub scale: f64,
}

/// The differences of frames from the untouched frame of a model, ohm, after division by one scale for all of them.
///
/// The scale minimises the sum of the absolute differences of their mean from the model, so that a touch, which changes
/// a few channels, hardly changes it. Whatever else the real skin and the model differ in remains in the differences,
/// and shows in the images as if it were touched: [fit](crate::fit::fit) the design first.
///
/// # Errors
/// No frame; frames that are unlike the model.
///
/// # Panics
/// If the frames differ in length from the model's.
pub fn model_differences(
    protocol: &Protocol,
    untouched: &[f64],
    frames: &[Frame],
    left_out: &[usize],
) -> Result<ModelDifferences, FitError> {
    let mut model = Frame(untouched.to_vec());
    protocol.drop_signs(&mut model);
    let frames = without_signs(protocol, frames);
    let measured = mean(&frames).ok_or(FitError::NoFrame)?;
    let used: Vec<usize> = (0..model.len()).filter(|channel| !left_out.contains(channel)).collect();
    factor(&measured, &model, &used)?;
    let scale = robust(&measured, &model, used.iter().copied());
    let difference = |frame: &Frame| {
        let mut difference = Frame(vec![0.0; model.len()]);
        used.iter().for_each(|&channel| difference[channel] = frame[channel] / scale - model[channel]);
        difference
    };
    Ok(ModelDifferences { frames: frames.iter().map(difference).collect(), scale })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_scale_is_taken_out_and_a_touch_remains() {
        let protocol = Protocol::adjacent(4).unwrap();
        let model: Vec<f64> = (0..12).map(|channel| [5.0, -2.0, 1.0][channel % 3]).collect();
        let mut frame = Frame(model.iter().map(|value| 1.7 * value).collect());
        frame[4] += 0.34;
        frame[9] = f64::NAN;
        let found = model_differences(&protocol, &model, std::slice::from_ref(&frame), &[9]);
        // A channel that is left out has no value where its frames were read.
        assert!(found.is_ok());
        let ModelDifferences { frames, scale } = found.unwrap();
        assert!((scale - 1.7).abs() < 1e-12, "{scale}");
        for (channel, value) in frames[0].iter().enumerate() {
            let expected = if channel == 4 { 0.2 } else { 0.0 };
            assert!((value - expected).abs() < 1e-12, "{channel}: {value}");
        }
        let amplitudes = protocol.clone().with_amplitude_only(true);
        let without_sign = model_differences(&amplitudes, &model, std::slice::from_ref(&frame), &[9]).unwrap();
        assert!((without_sign.frames[0][4] + 0.2).abs() < 1e-12, "{:?}", without_sign.frames[0]);
        let turned = Frame(frame.iter().map(|value| -value).collect());
        let error = model_differences(&protocol, &model, &[turned], &[9]).unwrap_err();
        assert!(matches!(error, FitError::Unlike { agreement } if agreement < 0.0), "{error}");
        assert_eq!(model_differences(&protocol, &model, &[], &[]), Err(FitError::NoFrame));
    }
}
