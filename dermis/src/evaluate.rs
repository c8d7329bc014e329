//! Contacts against the truth.

use thiserror::Error;

/// A score that cannot be computed.
#[derive(Debug, Error)]
pub enum EvaluateError {
    /// A truth that does not fit the frames.
    #[error("{0}")]
    Truth(String),
}
