//! The scale of the study.

use clap::ValueEnum;
use dermis_sim::evaluate::BenchmarkOptions;
use dermis_sim::experiment::Sizes;
use serde::Serialize;

/// The scale of the study.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, ValueEnum)]
#[serde(rename_all = "lowercase")]
pub(crate) enum Scale {
    /// One twin and a few dozen presses, in seconds: a preview of the page, not for its figures.
    Glance,
    /// Two twins, the whole grid and a third of everything else; at most five minutes on two cores.
    Quick,
    /// Ten twins, every press of the paper and more.
    Paper,
}

/// First seed of the reported twins; no selection uses them.
pub(crate) const REPORTED_SEED: u64 = 1001;
/// First seed of the twins for selections.
pub(crate) const CHOOSING_SEED: u64 = 2001;

impl Scale {
    /// Number of reported twins.
    pub(crate) fn twins(self) -> u64 {
        match self {
            Scale::Glance => 1,
            Scale::Quick => 2,
            Scale::Paper => 10,
        }
    }

    /// Number of twins for selections.
    pub(crate) fn choosing_twins(self) -> u64 {
        match self {
            Scale::Glance | Scale::Quick => 1,
            Scale::Paper => 3,
        }
    }

    /// Number of presses on each of them.
    pub(crate) fn choosing_presses(self) -> usize {
        match self {
            Scale::Glance => 20,
            Scale::Quick => 300,
            Scale::Paper => 900,
        }
    }

    /// Step of the pixels that are pressed for maps. 37 has no common divisor with the shipped image sizes, so that all
    /// columns are used.
    pub(crate) fn grid_step(self) -> usize {
        match self {
            Scale::Glance => 37,
            Scale::Quick | Scale::Paper => 1,
        }
    }

    /// Number of presses on each twin of a design and its controls.
    pub(crate) fn structure_presses(self) -> usize {
        match self {
            Scale::Glance => 25,
            Scale::Quick | Scale::Paper => 900,
        }
    }

    /// Number of untouched frames for the noise estimate of images.
    pub(crate) fn untouched(self) -> u64 {
        match self {
            Scale::Glance => 50,
            Scale::Quick => 500,
            Scale::Paper => 1000,
        }
    }

    /// Number of fresh Gaussian touches for the unexplained variance of images.
    pub(crate) fn explained(self) -> u64 {
        match self {
            Scale::Glance => 32,
            Scale::Quick => 640,
            Scale::Paper => 4000,
        }
    }

    /// Size of the benchmark of each twin.
    pub(crate) fn result(self) -> BenchmarkOptions {
        let whole = Sizes::default();
        match self {
            Scale::Glance => {
                let sizes =
                    Sizes { grid_step: 37, random: 10, separations_m: vec![0.04, 0.08], pairs: 3, fours: 4, ..whole };
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
