//! Contacts against the truth.
//!
//! Truth and estimate are matched one to one by the smallest total distance along the surface; a pair farther apart
//! than the [gate](dermis::detect::GATE_M) is a miss and a false positive. See `docs/conventions.md`.
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
mod explained;
mod matching;
mod presses;
mod score;
mod tank;
#[cfg(test)]
mod tests;

pub use align::Alignment;
pub use benchmark::{
    Benchmark, BenchmarkOptions, BenchmarkResult, Covered, FALSE_CONTACTS_A_FRAME, FORCES_A_PLACE, ForceScore,
    FourScore,
};
pub use calibration_run::{CalibrationRun, NOISE_DB};
pub use explained::GainFit;
pub use matching::{Match, match_contacts};
pub use presses::{AlignMethod, AlignOptions, Aligned, PressEstimates, Screen};
pub use score::{Score, resolves_two, score};
pub use tank::{FoundObject, Material, TankObject, find_objects};

use thiserror::Error;

/// A score that cannot be computed.
#[derive(Debug, Error, PartialEq)]
pub enum EvaluateError {
    /// A truth that does not fit the frames.
    #[error("{0}")]
    Truth(String),
    /// Lists that should go together frame by frame.
    #[error("{images} images, but the truth has {truths} frames: there must be one image a frame")]
    Count {
        /// Number of images.
        images: usize,
        /// Number of frames of the truth.
        truths: usize,
    },
    /// Presses that tell too little to align by.
    #[error("{presses} presses to align by at {places} places: at least 3 places are needed")]
    TooFewPresses {
        /// Presses to align by.
        presses: usize,
        /// Different places among them.
        places: usize,
    },
    /// A press to align by that was not recorded.
    #[error("press {press} is to be aligned by, but only {presses} were recorded: align by fewer")]
    NoSuchPress {
        /// Index of the press.
        press: usize,
        /// All presses.
        presses: usize,
    },
    /// No press left to score.
    #[error("{align} presses to align by leave none of the {presses} to score: align by fewer")]
    NothingToScore {
        /// Presses to align by.
        align: usize,
        /// All presses.
        presses: usize,
    },
    /// As many dead electrodes as there are.
    #[error("{dead} dead electrodes leave none of {electrodes} that works: ask for fewer")]
    NoElectrodeLeft {
        /// Electrodes that are dead.
        dead: usize,
        /// Electrodes of the skin.
        electrodes: usize,
    },
    /// Estimates that all lie at one place, so that they tell no scale.
    #[error("the estimates of the presses to align by all lie at one place")]
    NoScale,
    /// Alignment on a surface that is not flat.
    #[error("presses in a robot's frame can be aligned with flat skins only")]
    NotFlat,
    /// A press that is no place.
    #[error("press {press} is at {position:?}: it must be finite")]
    Press {
        /// Index of the press.
        press: usize,
        /// What was given.
        position: [f64; 3],
    },
}
