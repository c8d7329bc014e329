//! Errors of live skins.

use std::path::PathBuf;
use thiserror::Error;

/// A live skin that cannot be read, recorded or published.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum LiveError {
    /// The skin itself: its design, model or method.
    #[error(transparent)]
    Dermis(#[from] dermis::Error),
    /// A method that does not exist or cannot be prepared.
    #[error(transparent)]
    Method(Box<dermis::method::MethodError>),
    /// A pipeline that cannot be made, or a frame or command that it refuses.
    #[error(transparent)]
    Pipeline(Box<dermis::pipeline::PipelineError>),
    /// A protocol too large for the wire.
    #[error(transparent)]
    Scan(#[from] crate::device::TooLarge),
    /// A device that cannot be reached.
    #[error("cannot reach the device at {address}: {message}")]
    Unreachable {
        /// Its address.
        address: String,
        /// Why, and the fix.
        message: String,
    },
    /// Nothing is at the address of a device: a host that refuses the connection, a port that does not exist.
    #[error("cannot reach the device at {address}: {message}")]
    Absent {
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
        /// What the device says that it is, if it says that it is of another design.
        identity: Option<DeviceIdentity>,
    },
    /// A device that was lost.
    #[error("the device at {address} was lost: {message}")]
    Lost {
        /// Its address.
        address: String,
        /// Why.
        message: String,
    },
    /// An input that has come to its end.
    #[error("the input {address} has ended")]
    Ended {
        /// Its address.
        address: String,
    },
    /// A recording that cannot be read or written.
    #[error(transparent)]
    Record(#[from] crate::recording::RecordError),
    /// An invalid argument.
    #[error("{0}")]
    Given(String),
    /// A file that cannot be read or written.
    #[error("{}: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// The system error.
        source: std::io::Error,
    },
}

/// Which skin a device says that it reads.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct DeviceIdentity {
    /// The identifier of the skin.
    pub design_sha256: [u8; 32],
    /// Its serial number.
    pub serial: u32,
}

/// Errors of other crates, boxed: their size would enlarge every result of this crate.
macro_rules! boxed {
    ($($variant:ident($error:ty)),*) => {
        $(impl From<$error> for LiveError {
            fn from(error: $error) -> Self {
                LiveError::$variant(Box::new(error))
            }
        })*
    };
}

boxed!(Method(dermis::method::MethodError), Pipeline(dermis::pipeline::PipelineError));
