//! The errors of a pipeline.

use crate::method::MethodError;
use crate::reconstruct::ReconstructError;
use thiserror::Error;

/// A pipeline that cannot be created, or a frame or command that it refuses.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum PipelineError {
    /// A method that does not exist or cannot be prepared.
    #[error(transparent)]
    Method(Box<MethodError>),
    /// A computation that failed.
    #[error(transparent)]
    Dermis(Box<crate::Error>),
    /// A setting out of its range.
    #[error("{0}")]
    Setting(String),
    /// A state of another skin.
    #[error("the stored state is of another skin than this one of {channel_count} channels: tare again")]
    State {
        /// Channels of this skin.
        channel_count: usize,
    },
    /// A frame that does not fit the skin, or that has values that are not finite.
    #[error("frame {sequence}: {message}")]
    Frame {
        /// The number of the frame.
        sequence: u64,
        /// What is wrong with it, and the fix.
        message: String,
    },
}

impl From<ReconstructError> for PipelineError {
    fn from(error: ReconstructError) -> Self {
        crate::Error::from(error).into()
    }
}

// Boxed: their paths and values would make every result of the pipeline larger.
impl From<crate::Error> for PipelineError {
    fn from(error: crate::Error) -> Self {
        PipelineError::Dermis(Box::new(error))
    }
}

impl From<MethodError> for PipelineError {
    fn from(error: MethodError) -> Self {
        PipelineError::Method(Box::new(error))
    }
}
