//! What can go wrong live.

use std::path::PathBuf;
use thiserror::Error;

/// A live skin that cannot be read, recorded or published.
#[derive(Debug, Error)]
pub enum LiveError {
    /// The skin itself: its design, model or method.
    #[error(transparent)]
    Dermis(#[from] dermis::Error),
    /// A twin that cannot be built or pressed.
    #[error(transparent)]
    Sim(#[from] dermis_sim::Error),
    /// A network.
    #[error(transparent)]
    Learn(Box<dermis_learn::LearnError>),
    /// A protocol too large for the wire.
    #[error(transparent)]
    Scan(#[from] crate::scan::TooLarge),
    /// A method that there is not.
    #[error("no method is called `{name}`: there are {}", known.join(", "))]
    NoSuchMethod {
        /// What was asked for.
        name: String,
        /// What there is.
        known: Vec<String>,
    },
    /// A device that cannot be reached.
    #[error("cannot reach the device at {address}: {message}")]
    Unreachable {
        /// Its address.
        address: String,
        /// Why, and the fix.
        message: String,
    },
    /// A device that is refused.
    #[error("the device at {address} is refused: {message}")]
    Refused {
        /// Its address.
        address: String,
        /// Why, and the fix.
        message: String,
    },
    /// A device that was lost.
    #[error("the device at {address} was lost: {message}")]
    Lost {
        /// Its address.
        address: String,
        /// How.
        message: String,
    },
    /// A recording that cannot be read or written.
    #[error(transparent)]
    Record(#[from] crate::record::RecordError),
    /// An argument that cannot be.
    #[error("{0}")]
    Given(String),
    /// A file that cannot be read or written.
    #[error("{}: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
}

impl From<dermis::reconstruct::ReconstructError> for LiveError {
    fn from(error: dermis::reconstruct::ReconstructError) -> Self {
        LiveError::Dermis(error.into())
    }
}

// Boxed: it would make every result of the crate larger.
impl From<dermis_learn::LearnError> for LiveError {
    fn from(error: dermis_learn::LearnError) -> Self {
        LiveError::Learn(Box::new(error))
    }
}
