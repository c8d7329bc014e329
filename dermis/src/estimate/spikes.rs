//! Spikes of single channels, which the reciprocal channels of one frame tell.

use crate::frame::reciprocal;
use crate::protocol::Protocol;
use crate::stats::rms;
use std::borrow::Cow;

/// Two reciprocal channels contradict each other beyond this many standard deviations of their difference, ...
pub(crate) const UNLIKE_NOISES: f64 = 8.0;
/// ... if it also exceeds this part of the larger of the two changes and of the root mean square change of all channels. (A
/// touch that moves between the two measurements, and the errors of a real tank, are smaller.)
const UNLIKE_CHANGE: f64 = 0.5;
/// More pairs at once are no fault of single channels: a drive of the paper's skin is in 7 % of them.
pub(crate) const MAX_UNLIKE: f64 = 0.1;

/// Whether the changes of two reciprocal channels contradict each other, beyond a limit for their noise; the second one with
/// the sign of the first. By the reciprocity theorem a touch or drift changes both alike. All in ohm; `usual` is the root mean
/// square change of all channels.
pub(crate) fn contradict([a, b]: [f64; 2], limit: f64, usual: f64) -> bool {
    (a - b).abs() > limit.max(UNLIKE_CHANGE * a.abs().max(b.abs()).max(usual))
}

/// Takes spikes of single channels out of differences.
#[derive(Debug, Clone, PartialEq)]
pub struct SpikeFilter {
    /// Two channels, the sign of the second relative to the first, and the limit of their difference, ohm.
    pairs: Vec<(usize, usize, f64, f64)>,
}

impl SpikeFilter {
    /// For channels whose noise has these standard deviations, ohm; a channel without a finite and positive one is left
    /// out.
    ///
    /// # Panics
    /// If there are fewer deviations than channels.
    pub fn new(protocol: &Protocol, sd_ohm: &[f64]) -> Self {
        let is_usable = |channel: usize| sd_ohm[channel].is_finite() && sd_ohm[channel] > 0.0;
        let limit = |own: usize, other: usize| UNLIKE_NOISES * sd_ohm[own].hypot(sd_ohm[other]);
        let of = |(own, reciprocal): (usize, Vec<(usize, f64)>)| {
            let later = move |(other, _): &(usize, f64)| *other > own && is_usable(own) && is_usable(*other);
            reciprocal.into_iter().filter(later).map(move |(other, sign)| (own, other, sign, limit(own, other)))
        };
        SpikeFilter { pairs: reciprocal(protocol).into_iter().enumerate().flat_map(of).collect() }
    }

    /// A difference (ohm) without spikes. Of two reciprocal channels that contradict each other by more than noise, and by more
    /// than half of the larger change and of the root mean square of all changes, the larger one has the value of the other:
    /// a touch changes both alike, a spike only one. If more than a tenth of the pairs contradict each other, nothing is
    /// changed: then it is not single channels that are wrong. A value of exactly 0 is that of a channel that is masked, and
    /// says nothing.
    ///
    /// # Panics
    /// If the difference has fewer values than there are channels.
    pub fn apply<'a>(&self, difference: &'a [f64]) -> Cow<'a, [f64]> {
        let known =
            || self.pairs.iter().filter(|(own, other, ..)| difference[*own] != 0.0 && difference[*other] != 0.0);
        let usual = rms(difference.iter().copied());
        let are_unlike = |&&(own, other, sign, limit): &&(usize, usize, f64, f64)| {
            contradict([difference[own], sign * difference[other]], limit, usual)
        };
        let unlike: Vec<_> = known().filter(are_unlike).collect();
        if unlike.is_empty() || unlike.len() as f64 > MAX_UNLIKE * known().count() as f64 {
            return Cow::Borrowed(difference);
        }
        let mut repaired = difference.to_vec();
        for &(own, other, sign, _) in unlike {
            match repaired[own].abs() > repaired[other].abs() {
                true => repaired[own] = sign * repaired[other],
                false => repaired[other] = sign * repaired[own],
            }
        }
        Cow::Owned(repaired)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::design::SkinDesign;
    use crate::forward::ForwardModel;
    use crate::mesh::Mesh;
    use dermis_sim::random::{sample_rng, standard_normal};

    #[test]
    fn spikes_are_taken_out_and_touches_are_not() {
        let design = SkinDesign::shipped("cylinder30").unwrap();
        let model = ForwardModel::new(&design, &Mesh::generate(&design).unwrap()).unwrap();
        let (protocol, rest) = (&design.protocol, model.rest_conductivity());
        let untouched = model.solve(rest).unwrap();
        let count = protocol.channel_count();
        let filter = SpikeFilter::new(protocol, &vec![1.0; count]);
        assert_eq!(filter.pairs.len(), count / 2);
        let mut rng = sample_rng(3, 0);
        for cell in (0..rest.len()).step_by(rest.len() / 12) {
            let mut touched = rest.to_vec();
            touched[cell] *= 10.0;
            let change = &model.solve(&touched).unwrap() - &untouched;
            let largest = change.iter().fold(0.0, |largest: f64, value| largest.max(value.abs()));
            let touch = |channel: usize| 1000.0 / largest * change[channel];
            // Of the touch, spikes that are far smaller than it remain.
            let sum = |values: &[f64]| values.iter().map(|value| value * value).sum::<f64>();
            let noise: Vec<f64> = (0..count).map(|_| standard_normal(&mut rng)).collect();
            let mut spiked = noise.clone();
            (0..29).for_each(|spike| spiked[30 * spike] += 20.0);
            let repaired = filter.apply(&spiked);
            assert!(sum(&repaired) < 1.1 * sum(&noise), "{} of {}", sum(&repaired), sum(&noise));
            let touched: Vec<f64> = (0..count).map(|channel| touch(channel) + noise[channel]).collect();
            assert!(matches!(filter.apply(&touched), Cow::Borrowed(_)));
            spiked.iter_mut().step_by(3).for_each(|value| *value += 20.0);
            assert!(matches!(filter.apply(&spiked), Cow::Borrowed(_)));
        }
    }
}
