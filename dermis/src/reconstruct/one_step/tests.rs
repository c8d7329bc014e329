use super::*;
use crate::reconstruct::testing::small;

fn given(alpha: f64) -> OneStepOptions {
    OneStepOptions { alpha: Alpha::Given(alpha), ..OneStepOptions::default() }
}

/// An excluded channel has no weight, and the matrix of the others is the same as if it did not exist.
#[test]
fn an_excluded_channel_is_as_if_it_were_not_there() {
    let (model, pixels) = small(12, 20);
    let options = OneStepOptions { excluded: vec![3, 7], ..given(0.1) };
    let with = OneStep::from_linearised(&model, Arc::clone(&pixels), &options).unwrap();
    let kept: Vec<usize> = (0..12).filter(|channel| !options.excluded.contains(channel)).collect();
    let fewer = Linearised {
        jacobian: Matrix {
            rows: 10,
            columns: 20,
            values: kept.iter().flat_map(|&channel| model.jacobian.row(channel)).copied().collect(),
        },
        rest_frame: kept.iter().map(|&channel| model.rest_frame[channel]).collect(),
        ..model.clone()
    };
    let without = OneStep::from_linearised(&fewer, pixels, &given(0.1)).unwrap();
    for pixel in 0..20 {
        let (with, without) = (with.matrix.row(pixel), without.matrix.row(pixel));
        assert_eq!((with[3], with[7]), (0.0, 0.0));
        for (at, &channel) in kept.iter().enumerate() {
            assert!((with[channel] - without[at]).abs() <= 1e-12 * without[at].abs().max(1e-3));
        }
    }
}

/// A channel with half of the others' noise counts as much as four equal channels: their mean has half of the noise.
#[test]
fn a_channel_with_half_the_noise_is_worth_four() {
    const CHANNEL: usize = 3;
    let (model, pixels) = small(12, 20);
    let mut channel_sd = vec![7.0; 12];
    channel_sd[CHANNEL] = 3.5;
    let options = OneStepOptions { channel_sd, prior: Prior::Laplace, ..given(0.1) };
    let weighted = OneStep::from_linearised(&model, Arc::clone(&pixels), &options).unwrap();
    let channels: Vec<usize> = (0..12).chain([CHANNEL; 3]).collect();
    let repeated = Linearised {
        jacobian: Matrix {
            rows: channels.len(),
            columns: 20,
            values: channels.iter().flat_map(|&channel| model.jacobian.row(channel)).copied().collect(),
        },
        rest_frame: channels.iter().map(|&channel| model.rest_frame[channel]).collect(),
        ..model.clone()
    };
    let equal = OneStepOptions { prior: Prior::Laplace, ..given(0.1) };
    let repeated = OneStep::from_linearised(&repeated, pixels, &equal).unwrap();
    for pixel in 0..20 {
        let (weighted, repeated) = (weighted.matrix.row(pixel), repeated.matrix.row(pixel));
        for (channel, weighted) in weighted.iter().enumerate() {
            let sum: f64 = channels.iter().zip(repeated).filter(|(c, _)| **c == channel).map(|(_, value)| value).sum();
            // The prior is nearly singular: rounding is amplified.
            assert!((weighted - sum).abs() <= 1e-8 * sum.abs().max(1e-3), "channel {channel}: {weighted}, {sum}");
        }
    }
}

/// Alpha is dimensionless: a sheet of ten times the resistance gives the same image for the same relative change.
#[test]
fn alpha_does_not_depend_on_units() {
    let (model, pixels) = small(12, 20);
    let mut scaled = model.clone();
    scaled.jacobian.values.iter_mut().for_each(|value| *value *= 10.0);
    for prior in [Prior::Tikhonov, Prior::default(), Prior::Laplace] {
        let options = OneStepOptions { prior, ..given(0.1) };
        let a = OneStep::from_linearised(&model, Arc::clone(&pixels), &options).unwrap();
        let b = OneStep::from_linearised(&scaled, Arc::clone(&pixels), &options).unwrap();
        for (a, b) in a.matrix.values.iter().zip(&b.matrix.values) {
            assert!((a - 10.0 * b).abs() < 1e-9 * a.abs().max(1e-2), "{a} {b}");
        }
    }
}

/// Images are positive where touched, for both signs of the conductance change.
#[test]
fn a_touch_is_positive_either_way() {
    let (model, pixels) = small(12, 20);
    let difference: Vec<f64> = (0..12).map(|channel| 0.01 * model.jacobian.at(channel, 9)).collect();
    for touch in [TouchEffect::ConductanceRises, TouchEffect::ConductanceFalls] {
        let options = OneStepOptions { touch, ..given(0.1) };
        let one_step = OneStep::from_linearised(&model, Arc::clone(&pixels), &options).unwrap();
        let mut image = vec![0.0; 20];
        let measured: Vec<f64> = difference.iter().map(|value| value * touch.sign()).collect();
        one_step.reconstruct_into(&measured, &mut image).unwrap();
        assert!(image[9] > 0.0);
    }
}

/// The weighted normalised difference changes only the prior; the unweighted one weights channels by their untouched
/// value.
#[test]
fn normalised_differences_weigh_channels_as_documented() {
    let (model, pixels) = small(12, 20);
    let with = |difference, prior| {
        let options = OneStepOptions { difference, prior, ..given(0.1) };
        OneStep::from_linearised(&model, Arc::clone(&pixels), &options).unwrap().matrix.values
    };
    assert_eq!(with(Difference::Plain, Prior::Tikhonov), with(Difference::Normalised, Prior::Tikhonov));
    assert_ne!(with(Difference::Plain, Prior::default()), with(Difference::Normalised, Prior::default()));
    let mut divided = model.clone();
    for channel in 0..12 {
        let value = model.rest_frame[channel];
        divided.jacobian.row_mut(channel).iter_mut().for_each(|entry| *entry /= value);
    }
    let plain = OneStep::from_linearised(&divided, Arc::clone(&pixels), &given(0.1)).unwrap().matrix;
    let even = with(Difference::NormalisedEven, Prior::default());
    for (at, &value) in even.iter().enumerate() {
        let expected = plain.values[at] / model.rest_frame[at % 12];
        assert!((value - expected).abs() < 1e-12 * expected.abs().max(1.0));
    }
}

/// Gains of the channels are not in an image of normalised differences, as in EIDORS and pyEIT.
#[test]
fn normalised_differences_are_divided_by_the_measured_values() {
    let (model, pixels) = small(12, 20);
    let gain = |channel: usize| 2.0 + 0.1 * channel as f64;
    let of = |difference, baseline| {
        let options = OneStepOptions { difference, baseline, ..given(0.1) };
        OneStep::from_linearised(&model, Arc::clone(&pixels), &options).unwrap()
    };
    let change: Vec<f64> = (0..12).map(|channel| (1.7 * channel as f64).sin()).collect();
    let measured: Vec<f64> = change.iter().enumerate().map(|(channel, value)| gain(channel) * value).collect();
    let baseline: Vec<f64> = (0..12).map(|channel| gain(channel) * model.rest_frame[channel]).collect();
    for difference in [Difference::Normalised, Difference::NormalisedEven] {
        let image = |one_step: OneStep, frame: &[f64]| {
            let mut image = vec![0.0; 20];
            one_step.reconstruct_into(frame, &mut image).unwrap();
            image
        };
        let without = image(of(difference, None), &change);
        let with = image(of(difference, Some(Frame(baseline.clone()))), &measured);
        assert!(without.iter().zip(&with).all(|(a, b)| (a - b).abs() < 1e-12 * a.abs().max(1e-3)));
    }
    let options =
        OneStepOptions { difference: Difference::Normalised, baseline: Some(Frame(vec![0.0; 12])), ..given(0.1) };
    let error = OneStep::from_linearised(&model, Arc::clone(&pixels), &options).unwrap_err().to_string();
    assert!(error.contains("untouched value of channel 0, 0"), "{error}");
}

#[test]
fn bad_input_is_an_error() {
    let (model, pixels) = small(12, 20);
    let fails = |model: &Linearised, options: &OneStepOptions| {
        OneStep::from_linearised(model, Arc::clone(&pixels), options).unwrap_err().to_string()
    };
    let all = OneStepOptions { excluded: (0..12).collect(), ..given(0.1) };
    assert!(fails(&model, &all).contains("every channel is left out"));
    let beyond = OneStepOptions { excluded: vec![12], ..given(0.1) };
    assert!(fails(&model, &beyond).contains("channel 12"));
    let exponent = OneStepOptions { prior: Prior::Noser { exponent: f64::NAN }, ..given(0.1) };
    assert!(fails(&model, &exponent).contains("exponent"));
    let mut broken = model.clone();
    *broken.jacobian.at_mut(2, 5) = f64::NAN;
    assert!(fails(&broken, &given(0.1)).contains("channel 2, pixel 5"));
    let silent = Linearised { rest_frame: vec![0.0; 12], ..model.clone() };
    let normalised = OneStepOptions { difference: Difference::Normalised, ..given(0.1) };
    assert!(fails(&silent, &normalised).contains("untouched value of channel 0"));
    let short = Linearised { rest_conductivity: vec![1.0; 19], ..model.clone() };
    assert!(fails(&short, &given(0.1)).contains("rest conductivity"));

    let one_step = OneStep::from_linearised(&model, Arc::clone(&pixels), &given(0.1)).unwrap();
    let run = |difference: &[f64], count: usize| one_step.reconstruct_into(difference, &mut vec![0.0; count]);
    assert!(matches!(run(&[0.0; 11], 20), Err(ReconstructError::FrameLength { got: 11, expected: 12 })));
    assert!(matches!(run(&[0.0; 12], 19), Err(ReconstructError::ImageLength { got: 19, expected: 20 })));
    assert!(matches!(run(&[f64::INFINITY; 12], 20), Err(ReconstructError::NotFinite { channel: 0, .. })));
}
