//! Coverage of the 95 % regions of positions.

use crate::evaluate::match_contacts;
use dermis::contact::{Contact, REGION_95_SD};
use dermis::geom::Surface;
use serde::Serialize;

/// The fraction of the true positions within the 95 % region of their contact's position, of all matched ones; `NaN` if
/// there are none.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Covered {
    /// Of single touches, both sets.
    pub single: f64,
    /// Of two touches that were both detected, at all distances.
    pub two: f64,
    /// Of two touches that were detected as one: the nearer of them.
    pub two_as_one: f64,
    /// Of four touches that were all detected.
    pub four: f64,
}

/// The fraction of the true positions in the 95 % region of their contact, over those frames with the given number of
/// missed touches.
pub(super) fn covered<'a>(
    surface: &Surface,
    frames: impl Iterator<Item = (&'a Vec<Contact>, &'a Vec<Contact>)>,
    missed: usize,
) -> f64 {
    let (mut inside, mut all) = (0usize, 0usize);
    for (contacts, touches) in frames {
        let found = match_contacts(touches, contacts, surface);
        for (_, contact, distance_m) in found.pairs.into_iter().filter(|_| found.missed.len() == missed) {
            inside += usize::from(distance_m <= REGION_95_SD * contacts[contact].sd_m);
            all += 1;
        }
    }
    inside as f64 / all as f64
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::{sample_rng, standard_normal};

    #[test]
    fn an_honest_deviation_covers_95_of_100() {
        let mut rng = sample_rng(4, 0);
        let mut frame = |stated: f64| {
            let at = [0.002 * standard_normal(&mut rng), 0.002 * standard_normal(&mut rng), 0.0];
            let touch = Contact::truth([0.0; 3], [0.0, 0.0, 1.0], 1.0);
            (vec![Contact { position_m: at, sd_m: stated, ..touch }], vec![touch])
        };
        let mut part = |stated: f64| {
            let frames: Vec<_> = (0..20_000).map(|_| frame(stated)).collect();
            covered(&Surface::Plane, frames.iter().map(|(contacts, touches)| (contacts, touches)), 0)
        };
        // One standard error of the fraction is 0.0015; at half the deviation 1 - exp(-5.991 / 8) are covered.
        assert!((part(0.002) - 0.95).abs() < 0.006);
        assert!((part(0.001) - 0.527).abs() < 0.015);
        assert!(covered(&Surface::Plane, std::iter::empty(), 0).is_nan());
    }
}
