use super::*;
use crate::protocol::Protocol;

/// Standard normal numbers by Box and Muller from a linear congruential generator (Knuth's MMIX).
struct Normals(u64);

impl Normals {
    fn uniform(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        ((self.0 >> 11) as f64 + 0.5) / (1u64 << 53) as f64
    }

    fn next(&mut self) -> f64 {
        (-2.0 * self.uniform().ln()).sqrt() * (std::f64::consts::TAU * self.uniform()).cos()
    }
}

fn protocol() -> Protocol {
    Protocol::adjacent(16).unwrap()
}

/// Frames of values about 10 with the given deviations.
fn frames(count: usize, sd: impl Fn(usize) -> f64, seed: u64) -> Vec<Vec<f64>> {
    let mut normals = Normals(seed);
    let length = protocol().channel_count();
    (0..count).map(|_| (0..length).map(|channel| 10.0 + sd(channel) * normals.next()).collect()).collect()
}

/// Root mean square of the logarithm of the estimated over the true deviations.
fn error(noise: &ChannelNoise, sd: impl Fn(usize) -> f64) -> f64 {
    rms(noise.sd_ohm().iter().enumerate().map(|(channel, found)| (found / sd(channel)).ln()))
}

#[test]
fn equal_channels_share_their_variance_even_in_two_frames() {
    // 208 and 32 channels of one freedom each: the pooled variance of the smaller group has the relative error sqrt(2 / 32).
    for (count, most) in [(2, 0.15), (5, 0.07), (20, 0.04), (100, 0.02)] {
        let noise = ChannelNoise::of(&frames(count, |_| 0.02, 7), &protocol()).unwrap();
        let found = error(&noise, |_| 0.02);
        println!("{count} frames of equal channels: {found:.4}");
        assert!(found < most && noise.source() == NoiseSource::Scatter, "{count} frames: {found}");
    }
}

#[test]
fn different_channels_keep_their_own_with_many_frames() {
    // All above the floor.
    let sd = |channel: usize| 0.02 * 2f64.powf((channel as f64 * 2.4).sin());
    for (count, most) in [(5, 0.354), (100, 0.078)] {
        let noise = ChannelNoise::of(&frames(count, sd, 3), &protocol()).unwrap();
        let found = error(&noise, sd);
        println!("{count} frames of channels between 0.01 and 0.04: {found:.4}");
        // The deviation of n frames alone has the relative error 1 / sqrt(2 (n - 1)): 0.354, which shrinking
        // improves, and 0.071, within a tenth.
        assert!(found < most, "{count} frames: {found}");
    }
}

#[test]
fn a_touch_among_the_frames_hardly_changes_the_noise() {
    let clean = frames(20, |_| 0.02, 5);
    let mut touched = clean.clone();
    for frame in &mut touched[6..8] {
        // A touch of 50 deviations in a third of the channels.
        (0..frame.len()).filter(|channel| channel % 3 == 0).for_each(|channel| frame[channel] += 1.0);
    }
    let noise = ChannelNoise::of(&touched, &protocol()).unwrap();
    let found = error(&noise, |_| 0.02);
    println!("two of 20 frames touched: {found:.4}");
    assert!(found < 0.06, "{found}");
    let plain = rms(touched.iter().map(|frame| frame[0] - 10.1));
    assert!(plain > 10.0 * 0.02, "without weights the noise would be {plain}");
}

#[test]
fn one_frame_has_the_noise_of_its_reciprocal_channels_or_an_assumed_one() {
    let noise = ChannelNoise::of(&frames(1, |_| 0.02, 9), &protocol()).unwrap();
    let found = error(&noise, |_| 0.02);
    println!("one frame: {found:.3}");
    assert!(noise.source() == NoiseSource::Reciprocity && found < 0.3, "{found}");
    for (count, value) in [(3, 10.0), (5, 5.1), (20, 0.3)] {
        let still = ChannelNoise::of(&vec![vec![value; protocol().channel_count()]; count], &protocol()).unwrap();
        assert_eq!(still.source(), NoiseSource::Assumed);
        assert!(still.sd_ohm().iter().all(|sd| (sd / value - 1e-3).abs() < 1e-12), "60 dB");
    }
    assert!(ChannelNoise::of::<Vec<f64>>(&[], &protocol()).is_none());
}

#[test]
fn a_channel_without_scatter_is_at_the_floor_and_one_without_a_value_is_unknown() {
    let mut frames = frames(50, |_| 0.02, 2);
    frames.iter_mut().for_each(|frame| frame[4] = 10.0);
    frames[3][5] = f64::NAN;
    let noise = ChannelNoise::of(&frames, &protocol()).unwrap();
    assert!((0.45..1.01).contains(&(noise.sd_ohm()[4] / 0.02)), "{}", noise.sd_ohm()[4]);
    let mut others = noise.clone();
    (others.sd_ohm[4], others.sd_ohm[5]) = (0.02, 0.02);
    assert!(error(&others, |_| 0.02) < 0.05, "the others are as without it: {}", error(&others, |_| 0.02));
    assert!(noise.sd_ohm()[5].is_nan() && noise.by_group_ohm().iter().all(|sd| (sd / 0.02 - 1.0).abs() < 0.05));
    assert!((noise.sd_of_mean_ohm()[0] - noise.sd_ohm()[0] / 50f64.sqrt()).abs() < 1e-15);
}

/// The noise of one current: all channels of a frame have the same factor.
#[test]
fn a_noise_that_all_channels_share_is_no_touch() {
    let mut normals = Normals(11);
    let count = protocol().channel_count();
    let frames: Vec<Vec<f64>> = (0..100).map(|_| vec![10.0 + 0.02 * normals.next(); count]).collect();
    let found = ChannelNoise::of(&frames, &protocol()).unwrap().sd_ohm()[0];
    println!("noise shared by all channels: {:.3} of the true one", found / 0.02);
    // The deviation of 100 frames has the relative error 0.07.
    assert!((found / 0.02 - 1.0).abs() < 0.15, "{found}");
}

#[test]
fn the_gamma_functions_have_their_values() {
    // Abramowitz and Stegun, table 6.1: psi(1) = -0.5772156649, psi'(1) = pi^2 / 6, psi'(1/2) = pi^2 / 2.
    assert!((digamma(1.0) + 0.577_215_664_901_5).abs() < 1e-10);
    let square = std::f64::consts::PI.powi(2);
    assert!((trigamma(1.0) - square / 6.0).abs() < 1e-10 && (trigamma(0.5) - square / 2.0).abs() < 1e-9);
    for x in [1e-3, 0.4, 3.0, 2e4] {
        assert!((trigamma_inverse(trigamma(x)) / x - 1.0).abs() < 1e-7, "{x}");
    }
}

/// Values that a converter rounds: what the noise states is the error of the mean and of the difference of a frame with other
/// values from it, whether the noise is smaller than the step or not.
#[test]
fn the_error_of_a_converter_counts_where_noise_is_smaller_than_its_step() {
    let length = protocol().channel_count();
    for part in [0.02, 0.1, 0.2, 0.4, 1.0] {
        let (mut normals, step) = (Normals(17), 0.3);
        let values: Vec<f64> = (0..length).map(|_| 10.0 + 100.0 * step * normals.uniform()).collect();
        let change: Vec<f64> = (0..length).map(|_| 20.0 * step * normals.uniform()).collect();
        let mut frame = |factor: f64| -> Vec<f64> {
            let read = |(value, change): (&f64, &f64)| value + factor * change + part * step * normals.next();
            values.iter().zip(&change).map(read).map(|value| (value / step).round() * step).collect()
        };
        let untouched: Vec<Vec<f64>> = (0..100).map(|_| frame(0.0)).collect();
        let noise = ChannelNoise::of(&untouched, &protocol()).unwrap();
        let mean = mean_of(&untouched.iter().map(Vec::as_slice).collect::<Vec<_>>(), &[1.0; 100]);
        let touched = frame(1.0);
        let of_mean = rms(mean.iter().zip(&values).map(|(mean, value)| mean - value));
        let of_difference = rms((0..length).map(|channel| touched[channel] - mean[channel] - change[channel]));
        let stated = [noise.sd_of_mean_ohm(), noise.sd_of_difference_ohm()].map(rms);
        println!(
            "noise of {part} steps: stated over true {:.2}, {:.2}",
            stated[0] / of_mean,
            stated[1] / of_difference
        );
        // Below a thirtieth of the noise of a frame the error of the mean changes nothing.
        assert!((0.8..1.5).contains(&(stated[0] / of_mean)) || stated[0].max(of_mean) < 0.2 * stated[1], "{part}");
        assert!((0.85..1.15).contains(&(stated[1] / of_difference)), "{part}: {stated:?} {of_difference}");
        assert!(part == 0.2 || noise.is_hidden(0) == (part < 0.2), "{part}");
    }
}
