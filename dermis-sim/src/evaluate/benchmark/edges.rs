//! Localisation at the rims and at the seam, where errors are largest.

use crate::elementary::unrolled;
use crate::evaluate::match_contacts;
use dermis::contact::Contact;
use dermis::design::Body;
use dermis::geom::{Point3, Surface};

/// Width of a rim, and of a seam to both sides, m.
const RIM_M: f64 = 0.02;
const SEAM_M: f64 = 0.015;

/// Whether a position is within 20 mm of an end or 15 mm of the seam.
pub(super) fn is_at_edge(body: &Body, place: Point3) -> bool {
    let chart = unrolled(&body.surface());
    let at_seam = chart.period_m().is_some() && chart.unroll(place)[0].abs() <= SEAM_M;
    at_seam || body.edge_distance_m(place).is_some_and(|distance_m| distance_m <= RIM_M)
}

/// Distances of contacts from their touches in frames with a touch at a position for which `counts` returns true, m.
pub(super) fn distances_m<'a>(
    surface: &Surface,
    frames: impl Iterator<Item = (&'a Vec<Contact>, &'a Vec<Contact>)>,
    counts: impl Fn(Point3) -> bool,
) -> Vec<f64> {
    frames
        .filter(|(_, touches)| touches.iter().any(|touch| counts(touch.position_m)))
        .flat_map(|(contacts, touches)| match_contacts(touches, contacts, surface).pairs)
        .map(|pair| pair.2)
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rims_and_the_seam_have_the_widths_of_the_conventions() {
        let body = Body::Cylinder { length_m: 0.3, diameter_m: 0.1 };
        let surface = body.surface();
        let at = |z_m: f64, arc_m: f64| is_at_edge(&body, surface.at(z_m, arc_m / 0.05).expect("a cylinder"));
        assert!(at(0.0199, 0.1) && at(0.2801, 0.1) && !at(0.0201, 0.1) && !at(0.2799, 0.1));
        assert!(at(0.15, 0.0149) && at(0.15, -0.0149) && !at(0.15, 0.0151) && !at(0.15, -0.0151));
    }
}
