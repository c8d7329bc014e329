//! Errors of emulated devices.

use dermis_live::LiveError;
use thiserror::Error;

/// A device that cannot be emulated.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum EmulateError {
    /// The skin itself: its design or model.
    #[error(transparent)]
    Dermis(#[from] dermis::Error),
    /// A twin that cannot be built or pressed.
    #[error(transparent)]
    Sim(Box<dermis_sim::Error>),
    /// A pipeline or device that fails.
    #[error(transparent)]
    Live(Box<LiveError>),
    /// An invalid argument.
    #[error("{0}")]
    Given(String),
}

impl From<dermis_sim::Error> for EmulateError {
    fn from(error: dermis_sim::Error) -> Self {
        EmulateError::Sim(Box::new(error))
    }
}

/// Errors of a pipeline and its device.
macro_rules! live {
    ($($error:ty),*) => {
        $(impl From<$error> for EmulateError {
            fn from(error: $error) -> Self {
                EmulateError::Live(Box::new(error.into()))
            }
        })*
    };
}

live!(LiveError, dermis::pipeline::PipelineError, dermis_live::device::TooLarge);
