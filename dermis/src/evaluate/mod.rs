//! Contacts against the truth.
//!
//! Truth and estimate are matched one to one by the smallest total distance along the surface; a pair farther apart
//! than the [gate](crate::detect::GATE_M) is a miss and a ghost. See `docs/conventions.md`.

mod matching;
mod score;
mod statistics;
#[cfg(test)]
mod tests;

pub use matching::{Match, match_contacts};
pub use score::{Score, resolves_two, score};
pub use statistics::Summary;

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
}
