//! What a lasting change of the values is: a touch, the end of one that was there at the tare, or drift.

use crate::estimate::least_squares::{Equations, Normal};
use crate::forward::Matrix;
use crate::linalg::add_scaled;
use crate::pipeline::baseline::ChannelNoise;
use crate::skin::Skin;

/// The end of a touch explains at least this part of what noise does not explain of a difference, and this many times as much
/// as a touch: a touch is wider than the pixel it is compared with, and the skin differs from its model.
const ENDED: f64 = 0.25;
const MORE: f64 = 3.0;
/// Drift explains at least this part of a difference.
const DRIFT: f64 = 0.9;
/// Drift changes the whole skin: it leaves at most this part of what the pixels within some part of the electrodes' spacing of the
/// likeliest touch leave, of which so many are used.
const LEFT: f64 = 0.25;
const NEAR: f64 = 0.6;
const MAX_NEAR: usize = 40;
/// Damping of the fits, relative.
const RIDGE: f64 = 1e-6;
/// Places at which touches are tried, at most.
const MAX_PLACES: usize = 1000;

/// What explains a difference best.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Cause {
    /// A touch, or nothing of these.
    Touch,
    /// The end of a touch that was there when the baseline was measured.
    Ended,
    /// Drift of the coating and the contacts; its values, ohm.
    Drift(Vec<f64>),
}

/// What explains a difference from the baseline best: one small touch, one that has ended, or drift by its modes (modes x
/// channels, ohm).
///
/// # Errors
/// A skin whose forward problem cannot be solved.
pub(super) fn cause(
    skin: &Skin,
    modes: &Matrix,
    difference: &[f64],
    ChannelNoise { sd_ohm, masked }: ChannelNoise<'_>,
) -> crate::Result<Cause> {
    let used: Vec<usize> =
        (0..difference.len()).filter(|&c| !masked[c] && sd_ohm[c].is_finite() && sd_ohm[c] > 0.0).collect();
    let over_noise =
        |value: &dyn Fn(usize) -> f64| used.iter().map(|&channel| value(channel) / sd_ohm[channel]).collect();
    let values: Vec<f64> = over_noise(&|channel| difference[channel]);
    let all: f64 = values.iter().map(|value| value * value).sum();
    let explained = |of: &dyn Fn(usize, usize) -> f64, count: usize| {
        let columns: Vec<Vec<f64>> = (0..count).map(|column| over_noise(&|channel| of(column, channel))).collect();
        let columns: Vec<&[f64]> = columns.iter().map(Vec::as_slice).collect();
        let mut normal = Normal::new(&columns, &values);
        // Where no driven electrode is measured, no value depends on the contacts.
        let largest = (0..count).map(|unknown| normal.matrix.at(unknown, unknown)).fold(0.0, f64::max);
        (0..count).for_each(|unknown| normal.add_prior(unknown, RIDGE * largest, 0.0));
        let amounts = normal.step(0.0).unwrap_or_else(|_| vec![0.0; count]);
        let part: f64 = amounts.iter().zip(&normal.right).map(|(amount, right)| amount * right).sum();
        (part, amounts)
    };
    let (by_drift, amounts) = explained(&|mode, channel| modes.at(mode, channel), modes.rows);
    let [(by_touch, place), (by_end, _)] = touches(skin, &used, &values, sd_ohm)?;
    if by_drift > DRIFT * all && by_drift > by_touch {
        // At an electrode a touch is much like a change of its contact, but the skin near it explains it, too.
        let (jacobian, pixels) = (&skin.linearised()?.jacobian, skin.pixels());
        let spacing_m = (pixels.areas.iter().sum::<f64>() / skin.design().electrodes.len() as f64).sqrt();
        let distance_m = |pixel: usize| pixels.surface.distance_m(pixels.centres_m[pixel], pixels.centres_m[place]);
        let is_near = |pixel: &usize| distance_m(*pixel) <= NEAR * spacing_m;
        let near: Vec<usize> = (0..pixels.len()).filter(is_near).collect();
        let near: Vec<usize> = near.iter().copied().step_by(near.len().div_ceil(MAX_NEAR).max(1)).collect();
        let (by_near, _) = explained(&|index, channel| jacobian.at(channel, near[index]), near.len());
        if all - by_drift < LEFT * (all - by_near) {
            let mut drift = vec![0.0; difference.len()];
            amounts.iter().enumerate().for_each(|(mode, amount)| add_scaled(&mut drift, *amount, modes.row(mode)));
            return Ok(Cause::Drift(drift));
        }
    }
    // The noise of a value has a square of 1.
    if by_end > ENDED * (all - used.len() as f64) && by_end > MORE * by_touch {
        return Ok(Cause::Ended);
    }
    Ok(Cause::Touch)
}

/// The most of the sum of squares of some values that a touch of one pixel explains, with the pixel, and that the end of one
/// does.
fn touches(skin: &Skin, used: &[usize], values: &[f64], sd_ohm: &[f64]) -> crate::Result<[(f64, usize); 2]> {
    let jacobian = &skin.linearised()?.jacobian;
    let sign = skin.design().sheet.touch.sign();
    let places: Vec<usize> = (0..jacobian.columns).step_by(jacobian.columns.div_ceil(MAX_PLACES)).collect();
    let (mut products, mut squares) = (vec![0.0; places.len()], vec![0.0; places.len()]);
    for (&channel, value) in used.iter().zip(values) {
        let row = jacobian.row(channel);
        for ((&place, product), square) in places.iter().zip(&mut products).zip(&mut squares) {
            let effect = sign * row[place] / sd_ohm[channel];
            *product += effect * value;
            *square += effect * effect;
        }
    }
    let mut most = [(0.0, 0); 2];
    for ((&place, product), square) in places.iter().zip(&products).zip(&squares).filter(|(_, square)| **square > 0.0) {
        let (side, part) = (usize::from(*product < 0.0), product * product / square);
        if part > most[side].0 {
            most[side] = (part, place);
        }
    }
    Ok(most)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pipeline::drift::DriftFitter;
    use dermis_sim::random::{sample_rng, standard_normal};

    #[test]
    fn touches_their_ends_and_drift_are_told_apart() {
        for name in ["cylinder30", "skin16", "tank16"] {
            let skin = Skin::load(name).unwrap();
            let fitter = DriftFitter::new(skin.clone()).unwrap();
            let linear = skin.linearised().unwrap();
            let count = linear.rest_frame.len();
            let sd_ohm = vec![1e-3 * skin.design().protocol.undriven_rms(&linear.rest_frame); count];
            let masked = vec![false; count];
            let mut rng = sample_rng(9, 0);
            let mut judge = |value: &dyn Fn(usize) -> f64| {
                let difference: Vec<f64> =
                    (0..count).map(|channel| value(channel) + sd_ohm[channel] * standard_normal(&mut rng)).collect();
                let noise = ChannelNoise { sd_ohm: &sd_ohm, masked: &masked };
                cause(&skin, fitter.modes(), &difference, noise).unwrap()
            };
            let sign = skin.design().sheet.touch.sign();
            // At the rim of a disk, between two electrodes, the end of a touch is much like a touch beside it.
            let distance_m =
                |pixel: usize| skin.pixels().centres_m[pixel][..2].iter().fold(0.0_f64, |of, x| of.hypot(*x));
            let radius_m = (0..skin.pixels().len()).map(distance_m).fold(0.0, f64::max);
            let is_at_rim = |pixel: usize| name != "cylinder30" && distance_m(pixel) > 0.9 * radius_m;
            for pixel in (7..linear.jacobian.columns).step_by(linear.jacobian.columns / 12) {
                let largest = (0..count).map(|c| linear.jacobian.at(c, pixel).abs()).fold(0.0, f64::max);
                let strength = sign * 100.0 * sd_ohm[0] / largest;
                let of = |channel: usize| strength * linear.jacobian.at(channel, pixel);
                assert_eq!(judge(&of), Cause::Touch, "{name}, pixel {pixel}");
                let is_touch = judge(&|channel| -of(channel)) == Cause::Touch;
                assert!(!is_touch || is_at_rim(pixel), "{name}, end at pixel {pixel}");
            }
            for part in [-0.1, 0.03, 0.1] {
                let drifted = |channel: usize| part * linear.rest_frame[channel];
                let Cause::Drift(drift) = judge(&drifted) else { panic!("{name}: drift") };
                let left = (0..count).map(|channel| (drift[channel] - drifted(channel)).abs()).fold(0.0, f64::max);
                assert!(left < 4.0 * sd_ohm[0], "{name}: {left}");
            }
        }
    }
}
