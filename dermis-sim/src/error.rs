//! The crate's error: one variant per module.

use thiserror::Error as ThisError;

/// Shorthand for a result with the crate's [`enum@Error`].
pub type Result<T, E = Error> = std::result::Result<T, E>;

/// The errors of this crate, by module.
#[derive(Debug, ThisError)]
#[non_exhaustive]
pub enum Error {
    /// An error of the sensing library: a design, a mesh, a forward problem, a reconstruction, a table of numbers.
    #[error(transparent)]
    Dermis(dermis::Error),
    /// A touch or a noise that cannot be simulated.
    #[error(transparent)]
    Touch(#[from] crate::touch::TouchError),
    /// A twin that cannot be built, or a press that it cannot simulate.
    #[error(transparent)]
    Twin(#[from] crate::twin::TwinError),
    /// A dataset that cannot be generated, read or resumed.
    #[error(transparent)]
    Dataset(Box<crate::dataset::DatasetError>),
    /// Bounds that do not exist.
    #[error(transparent)]
    Bound(#[from] crate::bound::BoundError),
    /// A score that cannot be computed.
    #[error(transparent)]
    Evaluate(#[from] crate::evaluate::EvaluateError),
    /// A design that cannot be optimised.
    #[error(transparent)]
    Optimise(#[from] crate::optimise::OptimiseError),
}

impl Error {
    /// What to do, where the message does not say it.
    pub fn fix(&self) -> Option<String> {
        match self {
            Error::Bound(error) => Some(error.fix()),
            Error::Optimise(error) => error.fix().map(String::from),
            Error::Evaluate(crate::evaluate::EvaluateError::TooFewFound { .. }) => {
                Some("ask for more --samples".into())
            }
            _ => None,
        }
    }
}

// Boxed: its paths and values would make every result of the crate larger.
impl From<crate::dataset::DatasetError> for Error {
    fn from(error: crate::dataset::DatasetError) -> Self {
        Error::Dataset(Box::new(error))
    }
}

/// Errors of `dermis` and of its modules.
macro_rules! from_dermis {
    ($($error:ty),*) => {
        $(impl From<$error> for Error {
            fn from(error: $error) -> Self {
                Error::Dermis(error.into())
            }
        })*
    };
}

from_dermis!(
    dermis::Error,
    dermis::design::DesignError,
    dermis::protocol::ProtocolError,
    dermis::frame::TableError,
    dermis::mesh::MeshError,
    dermis::forward::ForwardError,
    dermis::reconstruct::ReconstructError
);
