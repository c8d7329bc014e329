//! Recordings: one MCAP file for ROS tools, Foxglove and Rerun, with all data that a replay needs.
//!
//! A [`Recorder`] writes frames as they arrive; [`Recording`] reads a file, complete or truncated; [`recover`] repairs
//! a truncated recording; `convert` converts one to tables. The format is described in `docs/recording.md`.

#[cfg(feature = "convert")]
mod convert;
mod event;
#[cfg(feature = "convert")]
mod npz;
mod parts;
mod playback;
mod read;
mod recover;
mod replay;
mod session;
mod sink;
mod source;
mod walk;
mod write;

#[cfg(feature = "convert")]
pub use convert::{Converted, convert};
pub use event::Event;
pub use parts::RecordingLimits;
pub(crate) use playback::Playback;
pub use read::{Recorded, Recording};
pub use recover::{RecoveryReport, recover, recover_into};
pub use replay::{Player, Replay, Replayed};
pub use session::Session;
pub use sink::{RecordingSink, RecordingStatus};
pub use write::{Recorder, Written};

use std::path::{Path, PathBuf};
use thiserror::Error;

/// An error of a recording: the file, the place, the fix.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum RecordError {
    /// A file or folder of that name exists already.
    #[error("{}: exists already; give another name, or move it away first", path.display())]
    Exists {
        /// The file or folder.
        path: PathBuf,
    },
    /// The disk is full.
    #[error(
        "{}: the disk is full; make room, then record into another file. What was recorded until then is kept: `dermis recover` makes it whole",
        path.display()
    )]
    DiskFull {
        /// The file.
        path: PathBuf,
    },
    /// The disk is almost full.
    #[error(
        "{}: the disk has only {left_mib} MiB left. The recording is complete up to here; make room, then record into another file",
        path.display()
    )]
    AlmostFull {
        /// The file.
        path: PathBuf,
        /// Free space, MiB.
        left_mib: u64,
    },
    /// A file that cannot be created, read or written.
    #[error("{}: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// The system error.
        source: std::io::Error,
    },
    /// A file of another format, or a file that is too short.
    #[error("{}: no MCAP recording: {why}", path.display())]
    NoRecording {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        why: String,
    },
    /// A recording of another program, or one that lacks something.
    #[error("{}: {why}", path.display())]
    Lacks {
        /// The file.
        path: PathBuf,
        /// What is missing, and the fix.
        why: String,
    },
    /// Invalid data.
    #[error("{}, byte {at}: {why}", path.display())]
    Damaged {
        /// The file.
        path: PathBuf,
        /// Byte position.
        at: u64,
        /// What is wrong.
        why: String,
    },
}

impl RecordError {
    fn io(path: &Path, source: std::io::Error) -> Self {
        let path = path.to_path_buf();
        match source.kind() {
            std::io::ErrorKind::StorageFull => RecordError::DiskFull { path },
            std::io::ErrorKind::AlreadyExists => RecordError::Exists { path },
            _ => RecordError::Io { path, source },
        }
    }

    /// An error of the MCAP writer. Everything but system errors is an internal fault.
    fn mcap(path: &Path, error: mcap::McapError) -> Self {
        match error {
            mcap::McapError::Io(source) => Self::io(path, source),
            other => Self::io(path, std::io::Error::other(other)),
        }
    }

    fn lacks(path: &Path, why: impl Into<String>) -> Self {
        RecordError::Lacks { path: path.to_path_buf(), why: why.into() }
    }
}

#[cfg(test)]
mod tests;
