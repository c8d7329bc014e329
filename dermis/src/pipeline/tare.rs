//! The tare: which frames make the baseline, and whether they can be frames of the untouched skin.

use crate::estimate::noise::{ChannelNoise, NoiseSource};
use crate::finding::{Finding, FindingKind};
use crate::forward::Matrix;
use crate::frame::Frame;
use crate::pipeline::drift::{OF_SHEET, modes_of};
use crate::pipeline::frame::Measurement;
use crate::pipeline::matched_filter::MatchedFilter;
use crate::pipeline::touch_detector::statistic;
use crate::plausibility::Plausibility;
use crate::skin::Skin;
use crate::stats::{rms, upper_median};

/// A frame whose mean square deviation from the median frame is this many times what the changes from frame to frame explain has
/// moved; so has one that the test for weak touches feels, in either direction: the median may be the touched one.
const MOVED: f64 = 3.0;
/// With more touched frames than this part of a tare, the median may be touched, too: the tare takes longer.
const MAX_MOVED: f64 = 0.2;
/// Of an instrument that was frozen in a tare more frames in a row than this part of it are equal. By chance, where noise is far below
/// a step of the converter, it takes a chance of 0.9 for two to be equal that so many of 100 are once in 100 tares.
const MAX_EQUAL: f64 = 0.5;
/// Frames beside a touched one are left out: a touch begins and ends in them.
const BESIDE: usize = 2;
/// After a refusal, this part of the frames is replaced by new ones.
const REPLACED: usize = 4;

/// Frames of a tare that make a baseline.
pub(super) struct Tared {
    pub frames: Vec<Measurement>,
    /// What is to be said of them.
    pub doubt: Option<Finding>,
}

/// Why frames of a tare make no baseline.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Refusal {
    /// The skin is touched, or its values change.
    Moving {
        /// How many frames moved.
        frames: usize,
        /// Of so many.
        of: usize,
        /// Deviation of the values over that of their noise from frame to frame, of the median channel.
        swing: f64,
    },
    /// Most frames are equal.
    Frozen,
    /// They are not those of the design.
    Unlike(Box<Finding>),
}

impl Refusal {
    /// In words, with the fix.
    pub(super) fn text(&self) -> String {
        match self {
            Refusal::Moving { frames, of, swing } => format!(
                "no tare yet: {frames} of {of} frames differ from the others, by {swing:.1} times the noise. Leave the skin untouched \
                 until the tare ends; if nothing touches it, look for hum: a cable that is not shielded, a ground, a supply"
            ),
            Refusal::Frozen => {
                "no tare: the frames are the same, as those of a frozen instrument. Check it; accept frames of a simulation \
                 without noise with --force"
                    .into()
            }
            Refusal::Unlike(found) => format!("no tare: {}; {}", found.evidence, found.fix),
        }
    }

    /// The frames that are kept for the next try.
    pub(super) fn kept(mut frames: Vec<Measurement>) -> Vec<Measurement> {
        frames.drain(..frames.len().div_ceil(REPLACED));
        frames
    }
}

/// Judges the frames of a tare without some channels. `is_forced` accepts equal frames and frames unlike the model.
pub(super) fn judge(
    frames: Vec<Measurement>,
    left_out: &[usize],
    skin: &Skin,
    modes: &Matrix,
    is_forced: bool,
) -> crate::Result<Result<Tared, (Refusal, Vec<Measurement>)>> {
    let protocol = &skin.design().protocol;
    let model = skin.untouched()?;
    let values: Vec<&[f64]> = frames.iter().map(|frame| frame.values_ohm.as_slice()).collect();
    let median: Vec<f64> = (0..model.len())
        .map(|channel| upper_median(&values.iter().map(|values| values[channel]).collect::<Vec<f64>>()).unwrap_or(0.0))
        .collect();
    let median = Frame(median);
    // Broken channels are found by their own checks: they hardly count in the comparison.
    let found = Plausibility::new(protocol, model, left_out).of_baseline(&median);
    match found.as_ref().filter(|found| found.is_fault()) {
        Some(found) if !is_forced || found.kind == FindingKind::Dead => {
            return Ok(Err((Refusal::Unlike(Box::new(found.clone())), frames)));
        }
        _ => {}
    }
    let mut equal = values.chunk_by(|a, b| a == b).map(<[_]>::len);
    if !is_forced && equal.any(|count| count as f64 > MAX_EQUAL * values.len() as f64) {
        return Ok(Err((Refusal::Frozen, frames)));
    }
    let moved = moved(&values, &median, skin, &modes_of(modes, &median))?;
    let count = moved.iter().filter(|moved| **moved).count();
    if count as f64 > MAX_MOVED * frames.len() as f64 {
        let swing = swing(&values, &median);
        return Ok(Err((Refusal::Moving { frames: count, of: frames.len(), swing }, frames)));
    }
    let is_near_moved = |frame: usize| {
        let near = frame.saturating_sub(BESIDE)..(frame + BESIDE + 1).min(moved.len());
        count > 0 && moved[near].contains(&true)
    };
    let is_near: Vec<bool> = (0..frames.len()).map(is_near_moved).collect();
    let kept: Vec<&[f64]> =
        values.iter().zip(&is_near).filter(|(_, is_near)| !**is_near).map(|(values, _)| *values).collect();
    let tells_noise = ChannelNoise::of(&kept, protocol).is_some_and(|noise| noise.source() != NoiseSource::Assumed);
    if !is_forced && !tells_noise {
        return Ok(Err((Refusal::Frozen, frames)));
    }
    let kept = frames.into_iter().zip(is_near).filter(|(_, is_near)| !is_near).map(|(frame, _)| frame);
    Ok(Ok(Tared { frames: kept.collect(), doubt: found }))
}

/// The deviation of the values from the median frame over that of successive frames, of the median channel.
fn swing(values: &[&[f64]], median: &Frame) -> f64 {
    let ratio = |channel: usize| {
        let about = rms(values.iter().map(|values| values[channel] - median[channel]));
        let following = rms(values.windows(2).map(|pair| (pair[1][channel] - pair[0][channel]) / 2f64.sqrt()));
        about / following
    };
    upper_median(&(0..median.len()).map(ratio).filter(|ratio| ratio.is_finite()).collect::<Vec<f64>>()).unwrap_or(0.0)
}

/// Which frames differ from the median of all by more than successive frames from each other.
fn moved(values: &[&[f64]], median: &Frame, skin: &Skin, modes: &Matrix) -> crate::Result<Vec<bool>> {
    let step =
        |pair: &[&[f64]]| -> Vec<f64> { pair[1].iter().zip(pair[0]).map(|(a, b)| (a - b) / 2f64.sqrt()).collect() };
    let steps: Vec<Vec<f64>> = values.windows(2).map(step).collect();
    let noise = ChannelNoise::of(&steps, &skin.design().protocol);
    let Some(noise) = noise.filter(|noise| noise.source() == NoiseSource::Scatter) else {
        return Ok(vec![false; values.len()]);
    };
    let filter = MatchedFilter::new(skin, modes, OF_SHEET, noise.sd_ohm(), &steps)?;
    let unmasked = vec![false; median.len()];
    let square = |values: &[f64]| statistic(values, noise.sd_ohm(), &unmasked);
    let usual = upper_median(&steps.iter().map(|step| square(step)).collect::<Vec<f64>>()).unwrap_or(0.0);
    let has_moved = |values: &&[f64]| {
        let difference: Vec<f64> = values.iter().zip(median.iter()).map(|(a, b)| a - b).collect();
        square(&difference) > MOVED * usual
            || filter.outputs(&filter.whitened(&difference)).into_iter().any(|output| filter.exceeds(output, false))
    };
    Ok(values.iter().map(has_moved).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pipeline::drift::DriftFitter;
    use dermis_sim::random::{sample_rng, standard_normal};

    /// Frames of a skin with noise, with a touch of some size between two frames.
    fn frames(skin: &Skin, touch: f64, [from, to]: [usize; 2], seed: u64) -> Vec<Measurement> {
        let linear = skin.linearised().unwrap();
        let mut rng = sample_rng(seed, 0);
        let size = skin.design().protocol.undriven_rms(&linear.rest_frame);
        let frame = |index: usize| {
            let is_touched = index >= from && index < to;
            let value = |channel: usize| {
                let touch = if is_touched { touch * linear.jacobian.at(channel, 400) } else { 0.0 };
                linear.rest_frame[channel] + touch + 0.003 * size * standard_normal(&mut rng)
            };
            Measurement { values_ohm: (0..linear.rest_frame.len()).map(value).collect(), ..Measurement::default() }
        };
        let mut frame = frame;
        (0..100).map(&mut frame).collect()
    }

    #[test]
    fn taps_are_left_out_and_long_ones_wait() {
        let skin = Skin::load("cylinder30").unwrap();
        let fitter = DriftFitter::new(skin.clone()).unwrap();
        let judged = |touch: f64, span: [usize; 2]| {
            judge(frames(&skin, touch, span, 5), &[], &skin, fitter.modes(), false).unwrap()
        };
        for touch in [0.5, 50.0] {
            let untouched = judged(0.0, [0, 0]).map_err(|(refusal, _)| refusal).unwrap();
            assert_eq!((untouched.frames.len(), untouched.doubt), (100, None));
            for length in [2, 5, 12, 20] {
                for from in [0, 37, 100 - length] {
                    let tared = judged(touch, [from, from + length]).map_err(|(refusal, _)| refusal).unwrap();
                    assert!(tared.frames.len() + length + 2 * BESIDE >= 100 && tared.frames.len() <= 100 - length);
                }
            }
            for length in [21, 30, 60, 79] {
                let (refusal, frames) = judged(touch, [10, 10 + length]).err().expect("a touch");
                assert!(matches!(refusal, Refusal::Moving { .. }), "{refusal:?}");
                assert_eq!(Refusal::kept(frames).len(), 75);
            }
        }
    }

    #[test]
    fn dead_frozen_and_foreign_frames_are_refused() {
        let skin = Skin::load("cylinder30").unwrap();
        let fitter = DriftFitter::new(skin.clone()).unwrap();
        let model = &skin.linearised().unwrap().rest_frame;
        let sound = frames(&skin, 0.0, [0, 0], 6);
        let sound_at = |index: usize, channel: usize| sound[index].values_ohm[channel];
        let refusal = |value: &dyn Fn(usize, usize) -> f64, is_forced: bool| {
            let frame = |index: usize| Measurement {
                values_ohm: (0..model.len()).map(|channel| value(index, channel)).collect(),
                ..Measurement::default()
            };
            judge((0..100).map(frame).collect(), &[], &skin, fitter.modes(), is_forced)
                .unwrap()
                .err()
                .map(|(refusal, _)| refusal)
        };
        for is_forced in [false, true] {
            let Some(Refusal::Unlike(found)) = refusal(&|_, _| 0.0, is_forced) else { panic!("zeros") };
            assert_eq!(found.kind, FindingKind::Dead);
        }
        assert_eq!(refusal(&|_, channel| sound[0].values_ohm[channel], false), Some(Refusal::Frozen));
        assert_eq!(refusal(&|_, channel| sound[0].values_ohm[channel], true), None);
        // It has frozen in the tare, or shows a touch and no noise.
        let frozen_from = |from: usize| move |index: usize, channel: usize| sound_at(index.min(from), channel);
        assert_eq!(refusal(&frozen_from(12), false), Some(Refusal::Frozen));
        let touched = |index: usize, channel: usize| sound_at(index / 60, channel);
        assert_eq!(refusal(&touched, false), Some(Refusal::Frozen));
        let noise = |index: usize, channel: usize| sound[index].values_ohm[channel] - model[channel];
        assert!(matches!(refusal(&noise, false), Some(Refusal::Unlike(_))));
        let late = |index: usize, channel: usize| sound[index].values_ohm[(channel + 1) % model.len()];
        let Some(Refusal::Unlike(found)) = refusal(&late, false) else { panic!("a value late") };
        assert_eq!(found.kind, FindingKind::Order);
    }
}
