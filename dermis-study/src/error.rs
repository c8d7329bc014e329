//! The error type of the crate.

use std::path::PathBuf;
use thiserror::Error as ThisError;

/// A result with the crate's [`enum@Error`].
pub type Result<T, E = Error> = std::result::Result<T, E>;

/// Errors of a study.
#[derive(Debug, ThisError)]
#[non_exhaustive]
pub enum Error {
    /// A design, a mesh, a forward problem, a reconstruction or a table that cannot be used.
    #[error(transparent)]
    Dermis(Box<dermis::Error>),
    /// A twin, a touch or a score that cannot be computed.
    #[error(transparent)]
    Sim(Box<dermis_sim::Error>),
    /// A network that cannot be used.
    #[error(transparent)]
    Learn(#[from] Box<dermis_learn::LearnError>),
    /// A method that cannot be prepared.
    #[error(transparent)]
    Method(#[from] dermis::method::MethodError),
    /// A picture that cannot be drawn.
    #[error(transparent)]
    Plot(#[from] dermis_plot::PlotError),
    /// An output folder that cannot be created.
    #[error("the folder {} cannot be made: {source}", folder.display())]
    Folder {
        /// The folder.
        folder: PathBuf,
        /// The system error.
        source: std::io::Error,
    },
    /// Two networks with the same name: results are listed by name.
    #[error("two of the networks are called `{0}`")]
    SameName(String),
    /// An internal fault.
    #[error("{0}")]
    Internal(String),
}

impl Error {
    /// The fix, if the message does not contain it.
    pub fn fix(&self) -> Option<&'static str> {
        match self {
            Error::Folder { .. } => Some("choose another place with -o"),
            Error::SameName(_) => Some("name another in one's card.json, or compare them one at a time"),
            _ => None,
        }
    }
}

impl From<dermis_learn::LearnError> for Error {
    fn from(error: dermis_learn::LearnError) -> Self {
        Box::new(error).into()
    }
}

/// Errors of the crates below and of their modules.
macro_rules! from_below {
    ($($variant:ident: $($error:ty),*;)*) => {
        $($(impl From<$error> for Error {
            fn from(error: $error) -> Self {
                Error::$variant(Box::new(error.into()))
            }
        })*)*
    };
}

from_below!(
    Dermis: dermis::Error, dermis::design::DesignError, dermis::frame::TableError, dermis::mesh::MeshError,
        dermis::forward::ForwardError, dermis::reconstruct::ReconstructError;
    Sim: dermis_sim::Error, dermis_sim::touch::TouchError, dermis_sim::twin::TwinError,
        dermis_sim::dataset::DatasetError, dermis_sim::evaluate::EvaluateError;
);
