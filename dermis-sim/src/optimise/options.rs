//! What is optimised, and how.

use super::places::PlaceRules;
use crate::bound::BoundOptions;
use dermis::geom::Point3;
use serde::{Deserialize, Serialize};

/// What is made small.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Objective {
    /// The bound at the worst place. In the search the generalised mean with the exponent 16: the sum of powers is smooth
    /// and hardly more than its largest term.
    Worst,
    /// The mean bound.
    Mean,
}

impl Objective {
    pub(super) fn exponent(self) -> i32 {
        match self {
            Objective::Worst => 16,
            Objective::Mean => 1,
        }
    }
}

/// What is optimised, and how.
#[derive(Debug, Clone, PartialEq)]
pub struct OptimiseOptions {
    /// Where electrodes may lie.
    pub rules: PlaceRules,
    /// What is made small.
    pub objective: Objective,
    /// The press, and its force.
    pub bound: BoundOptions,
    /// Moves of a start for each electrode.
    pub moves: usize,
    /// Seed of the starts.
    pub seed: u64,
}

impl Default for OptimiseOptions {
    /// For the worst place, with 200 moves of each electrode.
    fn default() -> Self {
        OptimiseOptions {
            rules: PlaceRules::default(),
            objective: Objective::Worst,
            bound: BoundOptions::default(),
            moves: 200,
            seed: 1,
        }
    }
}

/// The layout that a start ends at.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct Start {
    /// Its index: it depends on this and the seed alone.
    pub(super) index: usize,
    /// The objective in the fast model, m.
    pub(super) objective_m: f64,
    /// Centres of the electrodes in the order of their numbers, m.
    pub(super) electrodes_m: Vec<Point3>,
}
