//! Scores of contacts against the ground truth.
//!
//! Ground truth and estimate are matched one to one by the smallest total distance along the surface; a pair farther
//! apart than the [gate](dermis::contact::GATE_M) is a miss and a false positive. See `docs/conventions.md`.
//!
//! ```
//! use dermis::contact::Contact;
//! use dermis::geom::Surface;
//! use dermis_sim::evaluate::match_contacts;
//!
//! let at = |x_m: f64| Contact::truth([x_m, 0.0, 0.0], [0.0, 0.0, 1.0], 1.0);
//! let matched = match_contacts(&[at(0.0), at(0.1)], &[at(0.003), at(0.5)], &Surface::Plane);
//! assert_eq!((matched.pairs[0].0, matched.pairs[0].1), (0, 0));
//! assert_eq!((matched.missed, matched.false_positives), (vec![1], vec![1]));
//! ```

mod align;
mod benchmark;
mod calibration_run;
mod characterise;
mod explained;
mod matching;
mod presses;
mod score;
mod tank;
#[cfg(test)]
mod tests;

pub use align::Alignment;
pub use benchmark::{
    Benchmark, BenchmarkBound, BenchmarkOptions, BenchmarkResult, BenchmarkSummary, Covered, DrawnSkin,
    FORCES_PER_POSITION, FamiliesResult, FamiliesSummary, FamilyScore, ForceScore, FourScore, benchmark,
    benchmark_families,
};
pub use calibration_run::CalibrationRun;
pub use characterise::{Characteristics, characterise};
pub use explained::GainFit;
pub use matching::{Match, match_contacts, matched_presses};
pub use presses::{AlignMethod, AlignOptions, Aligned, PressEstimates, Screen};
pub use score::{Score, resolves_two, score, score_contacts};
pub use tank::{FoundObject, Material, TankObject, find_objects};

use dermis::text::counted;
use thiserror::Error;

/// A score that cannot be computed.
#[derive(Debug, Error, PartialEq)]
#[non_exhaustive]
pub enum EvaluateError {
    /// A ground truth that does not fit the frames.
    #[error("{0}")]
    Truth(String),
    /// Lists that must have the same number of frames.
    #[error("{images} images, but the truth has {truths} frames: there must be one image a frame")]
    Count {
        /// Number of images.
        images: usize,
        /// Number of frames of the ground truth.
        truths: usize,
    },
    /// Too few different presses for alignment.
    #[error("{presses} presses to align by at {places} places: at least 3 places are needed")]
    TooFewPresses {
        /// Number of presses for alignment.
        presses: usize,
        /// Number of different positions among them.
        places: usize,
    },
    /// A press for alignment that was not recorded.
    #[error("press {press} is to be aligned by, but only {presses} were recorded: align by fewer")]
    NoSuchPress {
        /// Index of the press.
        press: usize,
        /// Number of all presses.
        presses: usize,
    },
    /// No press left to score.
    #[error("{align} presses to align by leave none of the {presses} to score: align by fewer")]
    NothingToScore {
        /// Number of presses for alignment.
        align: usize,
        /// Number of all presses.
        presses: usize,
    },
    /// Too few detected touches for a calibration of positions.
    #[error("only {} matched with a touch: too few for a calibration", counted(*found, "contact"))]
    TooFewFound {
        /// Number of touches that were detected.
        found: usize,
    },
    /// All electrodes of the skin as dead electrodes.
    #[error("{dead} dead electrodes leave none of {electrodes} that works: ask for fewer")]
    NoElectrodeLeft {
        /// Number of dead electrodes.
        dead: usize,
        /// Number of electrodes of the skin.
        electrodes: usize,
    },
    /// Estimates that are all at one position, so that the scale is not determined.
    #[error("the estimates of the presses to align by all lie at one place")]
    NoScale,
    /// Alignment on a surface that is not flat.
    #[error("presses in a robot's frame can be aligned with flat skins only")]
    NotFlat,
    /// A press with an invalid position.
    #[error("press {press} is at {position:?}: it must be finite")]
    Press {
        /// Index of the press.
        press: usize,
        /// The given position.
        position: [f64; 3],
    },
}
