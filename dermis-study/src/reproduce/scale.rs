//! How large a reproduction is.

use dermis_sim::evaluate::BenchmarkOptions;
use dermis_sim::experiment::Sizes;
use serde::Serialize;

/// How large a reproduction is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Scale {
    /// One twin and a few dozen presses, in seconds: to see the page, not for its figures.
    Glance,
    /// Two twins, the whole grid and a third of all else; at most five minutes on two cores.
    Quick,
    /// Ten twins, every press of the paper and more.
    Paper,
}

/// First seed of the twins that are reported; no choice of any kind looks at them.
pub const REPORTED_SEED: u64 = 1001;
/// First seed of the twins on which choices are made.
pub const CHOOSING_SEED: u64 = 2001;

impl Scale {
    /// Twins that are reported.
    pub fn twins(self) -> u64 {
        match self {
            Scale::Glance => 1,
            Scale::Quick => 2,
            Scale::Paper => 10,
        }
    }

    /// Twins that choices are made on.
    pub fn choosing_twins(self) -> u64 {
        match self {
            Scale::Glance | Scale::Quick => 1,
            Scale::Paper => 3,
        }
    }

    /// Presses on each of them.
    pub fn choosing_presses(self) -> usize {
        match self {
            Scale::Glance => 20,
            Scale::Quick => 300,
            Scale::Paper => 900,
        }
    }

    /// Every so manyth pixel is pressed for maps. 37 has no divisor in common with the shipped pictures, so
    /// that all columns have their turn.
    pub fn grid_step(self) -> usize {
        match self {
            Scale::Glance => 37,
            Scale::Quick | Scale::Paper => 1,
        }
    }

    /// Presses on each twin of a design and its controls.
    pub fn structure_presses(self) -> usize {
        match self {
            Scale::Glance => 25,
            Scale::Quick | Scale::Paper => 900,
        }
    }

    /// Untouched frames from which the noise of images is estimated.
    pub fn untouched(self) -> u64 {
        match self {
            Scale::Glance => 50,
            Scale::Quick => 500,
            Scale::Paper => 1000,
        }
    }

    /// Gaussian touches, fresh ones, of which it is measured what images leave unexplained.
    pub fn explained(self) -> u64 {
        match self {
            Scale::Glance => 32,
            Scale::Quick => 640,
            Scale::Paper => 4000,
        }
    }

    /// How large the result of each twin is.
    pub fn result(self) -> BenchmarkOptions {
        let whole = Sizes::default();
        match self {
            Scale::Glance => {
                let sizes = Sizes { grid_step: 37, random: 10, separations_m: vec![0.04, 0.08], pairs: 3, fours: 4 };
                BenchmarkOptions { sizes, untouched: 60, force_step: 450, places: 2, ..BenchmarkOptions::default() }
            }
            Scale::Quick => {
                let sizes = Sizes { random: 300, pairs: 60, fours: 200, ..whole };
                BenchmarkOptions { sizes, untouched: 4000, force_step: 7, places: 20, ..BenchmarkOptions::default() }
            }
            Scale::Paper => BenchmarkOptions::default(),
        }
    }
}
