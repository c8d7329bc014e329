//! Assignment of contacts to true touches.

use dermis::contact::{Contact, GATE_M};
use dermis::frame::{EvaluatedPress, PressEstimate};
use dermis::geom::Surface;
use dermis::linalg::smallest_total;

/// The one-to-one match of the contacts detected in a frame with its true touches.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Match {
    /// Index of the touch, index of the contact and their distance along the surface, m.
    pub pairs: Vec<(usize, usize, f64)>,
    /// Touches without a contact within the gate.
    pub missed: Vec<usize>,
    /// Contacts without their own touch within the gate.
    pub false_positives: Vec<usize>,
}

/// Matches contacts and touches one to one by the smallest total distance along the surface; then a pair farther apart
/// than the [gate](GATE_M) counts as a miss and a false positive.
pub fn match_contacts(touches: &[Contact], contacts: &[Contact], surface: &Surface) -> Match {
    let distance =
        |touch: usize, contact: usize| surface.distance_m(touches[touch].position_m, contacts[contact].position_m);
    let mut found = Match::default();
    let (mut touch_met, mut contact_met) = (vec![false; touches.len()], vec![false; contacts.len()]);
    for (touch, contact) in smallest_total(touches.len(), contacts.len(), &distance) {
        let distance_m = distance(touch, contact);
        if distance_m <= GATE_M {
            found.pairs.push((touch, contact, distance_m));
            touch_met[touch] = true;
            contact_met[contact] = true;
        }
    }
    found.pairs.sort_by_key(|pair| pair.0);
    found.missed = (0..touches.len()).filter(|&touch| !touch_met[touch]).collect();
    found.false_positives = (0..contacts.len()).filter(|&contact| !contact_met[contact]).collect();
    found
}

/// The touches of a frame with the contacts that [`match_contacts`] finds for them; `row` is that of the frame.
pub fn matched_presses(
    row: usize,
    touches: &[Contact],
    contacts: &[Contact],
    surface: &Surface,
) -> Vec<EvaluatedPress> {
    let pairs = match_contacts(touches, contacts, surface).pairs;
    let press = |(touch, truth): (usize, &Contact)| {
        let pair = pairs.iter().find(|pair| pair.0 == touch);
        let estimate = pair.map(|&(_, contact, error_m)| PressEstimate::new(contacts[contact], error_m));
        EvaluatedPress { row, truth: *truth, estimate }
    };
    touches.iter().enumerate().map(press).collect()
}
