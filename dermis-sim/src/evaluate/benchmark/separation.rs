//! Two simultaneous touches, by their distance; four far apart.

use super::FourScore;
use crate::evaluate::{match_contacts, resolves_two};
use dermis::contact::Contact;
use dermis::geom::Surface;
use dermis::stats::Summary;

/// All four touches count as detected if each contact is within this distance of its touch, m.
const NEAR_M: f64 = 0.015;

/// For each distance of two touches the fraction that was resolved.
pub(super) fn two_resolved(
    surface: &Surface,
    contacts: &[Vec<Contact>],
    truths: &[Vec<Contact>],
    separations_m: &[f64],
) -> Vec<(f64, f64)> {
    let mut steps: Vec<(f64, usize, usize)> = Vec::new();
    for ((contacts, touches), &separation_m) in contacts.iter().zip(truths).zip(separations_m) {
        let [a, b] = touches[..] else { continue };
        let resolved = usize::from(resolves_two(&[a, b], contacts, surface));
        match steps.last_mut() {
            Some(step) if step.0 == separation_m => (step.1, step.2) = (step.1 + resolved, step.2 + 1),
            _ => steps.push((separation_m, resolved, 1)),
        }
    }
    steps.into_iter().map(|(separation_m, resolved, count)| (separation_m, resolved as f64 / count as f64)).collect()
}

/// The smallest distance such that at least 90 % are resolved at this and every greater distance, m; `NaN` if there is
/// none.
pub(super) fn resolved_from_m(two_resolved: &[(f64, f64)]) -> f64 {
    let good = two_resolved.iter().rev().take_while(|(_, part)| *part >= 0.9);
    good.last().map_or(f64::NAN, |(separation_m, _)| *separation_m)
}

/// The share at a tested distance (m), `NaN` at any other.
pub(super) fn resolved_at(two_resolved: &[(f64, f64)], separation_m: f64) -> f64 {
    let tried = two_resolved.iter().find(|(tried_m, _)| (tried_m - separation_m).abs() < 1e-6);
    tried.map_or(f64::NAN, |(_, part)| *part)
}

pub(super) fn four(surface: &Surface, contacts: &[Vec<Contact>], truths: &[Vec<Contact>]) -> FourScore {
    let (mut all, mut misses, mut false_positives, mut distances) = (0, 0, 0, Vec::new());
    for (contacts, touches) in contacts.iter().zip(truths) {
        let found = match_contacts(touches, contacts, surface);
        let near = found.pairs.len() == touches.len() && found.pairs.iter().all(|pair| pair.2 <= NEAR_M);
        all += usize::from(near && found.false_positives.is_empty());
        misses += found.missed.len();
        false_positives += found.false_positives.len();
        distances.extend(found.pairs.iter().map(|pair| pair.2));
    }
    // Not a number without a frame.
    let all_found = all as f64 / contacts.len() as f64;
    FourScore { frames: contacts.len(), all_found, localisation_m: Summary::of(&distances), misses, false_positives }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pairs_count_as_resolved_from_where_all_greater_distances_are() {
        let from = |parts: &[f64]| {
            let steps = parts.iter().enumerate().map(|(k, part)| (0.01 * (k + 1) as f64, *part));
            resolved_from_m(&steps.collect::<Vec<_>>())
        };
        assert!((from(&[0.95, 0.5, 0.9, 1.0]) - 0.03).abs() < 1e-12);
        assert!(from(&[1.0, 0.5]).is_nan() && from(&[]).is_nan());
    }

    #[test]
    fn four_count_as_found_when_each_is_near_and_nothing_else_is_there() {
        let touch = |x: f64| Contact::truth([x, 0.0, 0.0], [0.0, 0.0, 1.0], 1.0);
        let touches: Vec<Contact> = (0..4).map(|k| touch(0.1 * f64::from(k))).collect();
        let moved = |by: f64| touches.iter().map(|t| touch(t.position_m[0] + by)).collect::<Vec<_>>();
        let with_ghost = moved(0.0).into_iter().chain([touch(0.9)]).collect();
        let frames = [moved(0.014), moved(0.016), with_ghost, moved(0.0)[..3].to_vec()];
        let score = four(&Surface::Plane, &frames, &vec![touches.clone(); 4]);
        assert_eq!((score.frames, score.all_found, score.misses, score.false_positives), (4, 0.25, 1, 1));
    }
}
