//! Errors of training, loading and using networks.

use std::path::{Path, PathBuf};
use thiserror::Error;

/// A network that cannot be trained, loaded or used.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum LearnError {
    /// An error of the sensing library: a design, a mesh, a reconstruction.
    #[error(transparent)]
    Dermis(#[from] dermis::Error),
    /// A dataset, a twin or a touch that cannot be used.
    #[cfg(feature = "train")]
    #[error(transparent)]
    Sim(Box<dermis_sim::Error>),
    /// An invalid option of training.
    #[error("{what} is {value}: it must be {must}")]
    OutOfRange {
        /// The name of the number.
        what: &'static str,
        /// Its value.
        value: f64,
        /// The allowed values.
        must: &'static str,
    },
    /// A dataset that does not fit the others or the design.
    #[error("{}: {message}", folder.display())]
    Data {
        /// The dataset's folder.
        folder: PathBuf,
        /// What is wrong, and the fix.
        message: String,
    },
    /// A value in a dataset that is not finite.
    #[error("sample {sample} of {} has a value that is not finite: `dermis simulate --verify` lists damaged files", folder.display())]
    NotFinite {
        /// The dataset's folder.
        folder: PathBuf,
        /// Number of the sample.
        sample: u64,
    },
    /// A loss that is not finite.
    #[error("the loss of epoch {epoch} is not finite: take a smaller --rate; the last checkpoint is kept")]
    Diverged {
        /// Number of the epoch, from 1.
        epoch: usize,
    },
    /// An invalid model or checkpoint.
    #[error("{}: {message}", path.display())]
    Model {
        /// The file.
        path: PathBuf,
        /// What is wrong, and the fix.
        message: String,
    },
    /// A file that cannot be read or written.
    #[error("{}: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// The error of the operating system.
        source: std::io::Error,
    },
}

impl LearnError {
    pub(crate) fn model(path: &Path, message: impl Into<String>) -> Self {
        LearnError::Model { path: path.to_path_buf(), message: message.into() }
    }

    pub(crate) fn io(path: &Path, source: std::io::Error) -> Self {
        LearnError::Io { path: path.to_path_buf(), source }
    }
}

#[cfg(feature = "train")]
// Boxed: its paths and values would make every result of the crate larger.
impl From<dermis_sim::Error> for LearnError {
    fn from(error: dermis_sim::Error) -> Self {
        LearnError::Sim(Box::new(error))
    }
}

#[cfg(feature = "train")]
impl From<dermis_sim::dataset::DatasetError> for LearnError {
    fn from(error: dermis_sim::dataset::DatasetError) -> Self {
        dermis_sim::Error::from(error).into()
    }
}
