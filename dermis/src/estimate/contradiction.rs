//! Spikes of single channels, which the reciprocal channels of one frame tell.

use crate::frame::reciprocal;
use crate::protocol::Protocol;
use crate::stats::rms;
use std::borrow::Cow;

/// Two channels contradict each other beyond this many standard deviations of their difference, as in the checks of a live
/// instrument.
const SPIKE_SD: f64 = 8.0;
/// With more contradictions than this part of the pairs it is not single channels that are wrong.
const MAX_SPIKES: f64 = 0.1;

/// What the reciprocal channels of a frame say about its noise.
///
/// By the reciprocity theorem no change of a passive skin, a touch or drift, changes two reciprocal channels differently:
/// their difference is noise of this frame alone, such as spikes of single channels, however large it is in other frames.
#[derive(Debug, Clone, PartialEq)]
pub struct Contradiction {
    /// Two channels, the sign of the second relative to the first, and the inverse variance of their difference.
    pairs: Vec<(usize, usize, f64, f64)>,
}

impl Contradiction {
    /// For channels whose noise has these standard deviations, ohm; a channel without a finite and positive one is left
    /// out.
    ///
    /// # Panics
    /// If there are fewer deviations than channels.
    pub fn new(protocol: &Protocol, sd_ohm: &[f64]) -> Self {
        let is_usable = |channel: usize| sd_ohm[channel].is_finite() && sd_ohm[channel] > 0.0;
        let weight = |own: usize, other: usize| 1.0 / (sd_ohm[own].powi(2) + sd_ohm[other].powi(2));
        let of = |(own, reciprocal): (usize, Vec<(usize, f64)>)| {
            let later = move |(other, _): &(usize, f64)| *other > own && is_usable(own) && is_usable(*other);
            reciprocal.into_iter().filter(later).map(move |(other, sign)| (own, other, sign, weight(own, other)))
        };
        Contradiction { pairs: reciprocal(protocol).into_iter().enumerate().flat_map(of).collect() }
    }

    /// A difference (ohm) without spikes. Of two reciprocal channels that contradict each other by more than noise, and by more
    /// than half of the larger change and of the root mean square of all changes, the larger one has the value of the other:
    /// a touch changes both alike, a spike only one. If more than a tenth of the pairs contradict each other, nothing is
    /// changed: then it is not single channels that are wrong.
    ///
    /// # Panics
    /// If the difference has fewer values than there are channels.
    pub fn without_spikes<'a>(&self, difference: &'a [f64]) -> Cow<'a, [f64]> {
        let known =
            || self.pairs.iter().filter(|(own, other, ..)| difference[*own] != 0.0 && difference[*other] != 0.0);
        let half_rms = 0.5 * rms(difference.iter().copied());
        let contradicts = |&&(own, other, sign, weight): &&(usize, usize, f64, f64)| {
            let apart = (difference[own] - sign * difference[other]).abs();
            let larger = difference[own].abs().max(difference[other].abs());
            apart * weight.sqrt() > SPIKE_SD && apart > half_rms.max(0.5 * larger)
        };
        let count = known().filter(contradicts).count();
        if count == 0 || count as f64 > MAX_SPIKES * known().count() as f64 {
            return Cow::Borrowed(difference);
        }
        let mut repaired = difference.to_vec();
        for &(own, other, sign, _) in known().filter(contradicts) {
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
        let contradiction = Contradiction::new(protocol, &vec![1.0; count]);
        assert_eq!(contradiction.pairs.len(), count / 2);
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
            let repaired = contradiction.without_spikes(&spiked);
            assert!(sum(&repaired) < 1.1 * sum(&noise), "{} of {}", sum(&repaired), sum(&noise));
            let touched: Vec<f64> = (0..count).map(|channel| touch(channel) + noise[channel]).collect();
            assert!(matches!(contradiction.without_spikes(&touched), Cow::Borrowed(_)));
            spiked.iter_mut().step_by(3).for_each(|value| *value += 20.0);
            assert!(matches!(contradiction.without_spikes(&spiked), Cow::Borrowed(_)));
        }
    }
}
