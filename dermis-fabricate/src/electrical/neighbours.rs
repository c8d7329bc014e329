//! Resistances between neighbouring electrodes: what an ohmmeter shows between two wires before the cover hides them.

use crate::electrical::spread::{Sensitivities, Value};
use crate::error::FabricateError;
use dermis::design::SkinDesign;
use dermis::geom::Point3;
use dermis::mesh::Mesh;
use dermis::protocol::Channel;
use std::collections::BTreeSet;

/// Neighbours that each electrode is measured with: a contact is bad where both of its values are off, and two values tell
/// which of two electrodes it is.
const NEAREST: usize = 2;

/// Two neighbouring electrodes.
#[derive(Debug, Clone, PartialEq)]
pub struct Neighbours {
    /// The electrodes, the smaller number first.
    pub pair: [usize; 2],
    /// Their distance along the surface, m; straight through space on a body from a mesh file.
    pub distance_m: f64,
    /// The resistance between them, with both contacts, ohm.
    pub ohm: Value,
}

/// The resistances of a design between each electrode and the nearest ones.
///
/// # Errors
/// A design without a solution.
pub(super) fn neighbours(
    design: &SkinDesign,
    mesh: &Mesh,
    centres_m: &[Point3],
) -> Result<Vec<Neighbours>, FabricateError> {
    let surface = design.body.surface();
    let distance_m = |[a, b]: [usize; 2]| surface.distance_m(centres_m[a], centres_m[b]);
    let pairs = pairs(centres_m.len(), distance_m);
    if pairs.is_empty() {
        return Ok(Vec::new());
    }
    let channels = pairs.iter().map(|&pair| Channel { drive: pair, measure: pair }).collect();
    let found = Sensitivities::of(design, mesh, channels)?;
    let options = design.fabrication_options();
    let of = |(pair, skin): (&[usize; 2], &Sensitivities)| Neighbours {
        pair: *pair,
        distance_m: distance_m(*pair),
        ohm: skin.ohm(&options, 0.0),
    };
    Ok(pairs.iter().zip(&found).map(of).collect())
}

/// Each electrode with the nearest ones, in order; of equally near ones the smaller number.
fn pairs(count: usize, distance_m: impl Fn([usize; 2]) -> f64) -> Vec<[usize; 2]> {
    /// Distances that differ by rounding are equal, m.
    const ROUNDING_M: f64 = 1e-9;
    let mut pairs = BTreeSet::new();
    for one in 0..count {
        let mut others: Vec<(i64, usize)> = (0..count)
            .filter(|&other| other != one)
            .map(|other| ((distance_m([one, other]) / ROUNDING_M).round() as i64, other))
            .collect();
        others.sort_unstable();
        pairs.extend(others.iter().take(NEAREST).map(|&(_, other)| [one.min(other), one.max(other)]));
    }
    pairs.into_iter().collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::Fabrication;

    /// The paper's skin: rings of five are nearer (62.8 mm) than neighbouring rings (67.7 mm). The
    /// resistance between two electrodes is what is left of the netlist's admittances when all others are eliminated.
    #[test]
    fn the_papers_rings_have_the_resistances_of_the_network() {
        let made = Fabrication::new(&SkinDesign::shipped("cylinder30").unwrap()).unwrap();
        let electrical = made.electrical().unwrap();
        assert_eq!(electrical.neighbours.len(), 30);
        for one in &electrical.neighbours {
            let [a, b] = one.pair;
            assert!(a / 5 == b / 5 && (one.distance_m - 0.0628318).abs() < 1e-6, "{one:?}");
            let expected = two_point_ohm(&electrical.network.admittance, one.pair);
            assert!((one.ohm.nominal / expected - 1.0).abs() < 1e-6, "{one:?} {expected}");
            let [low, high] = one.ohm.limits();
            assert!(low > 0.0 && low < one.ohm.nominal && one.ohm.nominal < high, "{one:?}");
        }
        // On the rim current has half the sheet and half the contact: nearly twice the resistance.
        let ratio = electrical.neighbours[0].ohm.nominal / electrical.neighbours[10].ohm.nominal;
        assert!((1.5..2.0).contains(&ratio), "{ratio}");
    }

    /// The resistance between two nodes by Gaussian elimination of all others.
    fn two_point_ohm(admittance: &dermis::linalg::Matrix, [a, b]: [usize; 2]) -> f64 {
        let count = admittance.rows;
        let mut y: Vec<Vec<f64>> = (0..count).map(|i| (0..count).map(|j| admittance.at(i, j)).collect()).collect();
        for k in (0..count).filter(|&k| k != a && k != b) {
            let pivot = y[k].clone();
            for (_, row) in y.iter_mut().enumerate().filter(|(i, _)| *i != k) {
                let factor = row[k] / pivot[k];
                row.iter_mut().zip(&pivot).for_each(|(value, of_pivot)| *value -= factor * of_pivot);
            }
        }
        1.0 / y[a][a]
    }

    #[test]
    fn every_electrode_is_in_two_pairs() {
        for (name, expected) in [("skin16", 16), ("cylinder30", 30)] {
            let made = Fabrication::new(&SkinDesign::shipped(name).unwrap()).unwrap();
            let pairs = &made.electrical().unwrap().neighbours;
            let count = |one: usize| pairs.iter().filter(|other| other.pair.contains(&one)).count();
            assert!((0..made.electrodes.len()).all(|one| count(one) >= 2), "{name}");
            assert_eq!(pairs.len(), expected, "{name}");
        }
        assert_eq!(pairs(2, |_| 1.0), [[0, 1]]);
        assert_eq!(pairs(1, |_| 1.0), [[0; 2]; 0]);
    }
}
