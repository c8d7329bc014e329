//! Errors: a design that cannot be made, a folder that cannot be written.

use dermis::design::DesignError;
use dermis::mesh::MeshError;
use std::path::PathBuf;
use thiserror::Error;

/// What a workshop cannot make, or a folder that cannot be written.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum FabricateError {
    /// A design whose table `[fabrication]` does not fit it.
    #[error(transparent)]
    Design(#[from] DesignError),
    /// A body that cannot be read.
    #[error(transparent)]
    Mesh(#[from] MeshError),
    /// A skin that cannot be solved.
    #[error(transparent)]
    Dermis(#[from] dermis::Error),
    /// Electronics that cannot read a skin.
    #[error(transparent)]
    Electronics(#[from] dermis_sim::Error),
    /// A part that cannot be made.
    #[error("{message}")]
    Part {
        /// What is wrong, with the electrode, the place and the numbers.
        message: String,
        /// How to fix it.
        fix: String,
    },
    /// A folder that exists.
    #[error("{} exists already", path.display())]
    Exists {
        /// The folder.
        path: PathBuf,
        /// How to go on.
        fix: &'static str,
    },
    /// A folder that cannot be written.
    #[error("{} cannot be written: {source}", path.display())]
    Io {
        /// The folder.
        path: PathBuf,
        /// The error of the system.
        source: std::io::Error,
    },
    /// A bug of this crate.
    #[error("{0}")]
    Internal(String),
}

impl FabricateError {
    pub(crate) fn part(message: impl Into<String>, fix: impl Into<String>) -> Self {
        FabricateError::Part { message: message.into(), fix: fix.into() }
    }

    /// How to fix it, if known.
    pub fn fix(&self) -> Option<&str> {
        match self {
            FabricateError::Part { fix, .. } => Some(fix),
            FabricateError::Exists { fix, .. } => Some(fix),
            FabricateError::Design(error) => error.fix.as_deref(),
            _ => None,
        }
    }
}
