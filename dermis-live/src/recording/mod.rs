//! Recordings: one MCAP file that ROS tools, Foxglove and Rerun open, and that holds all that a replay needs.
//!
//! A [`Recorder`] writes one as frames come; [`Recording`] reads it back, finished or not; [`recover`] makes a whole file of
//! what an interrupted one holds; [`convert`] makes tables of it. What lies where is told in `docs/recording.md`.

mod convert;
mod event;
mod npz;
mod read;
mod recover;
mod replay;
mod session;
mod sink;
mod walk;
mod write;

pub use convert::{Converted, convert};
pub use event::Event;
pub use read::{Recorded, Recording};
pub use recover::{Recovered, recover, recover_into};
pub use replay::{Player, Replay, Replayed};
pub use session::Session;
pub use sink::{RecordingSink, RecordingStatus};
pub use write::{Recorder, Written};

use std::path::{Path, PathBuf};
use thiserror::Error;

/// What went wrong with a recording: the file, the place, what to do.
#[derive(Debug, Error)]
pub enum RecordError {
    /// Something of that name is there already.
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
    /// A file that cannot be made, read or written.
    #[error("{}: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// The file is something else, or too short to be anything.
    #[error("{}: no MCAP recording: {why}", path.display())]
    NoRecording {
        /// The file.
        path: PathBuf,
        /// What it is instead.
        why: String,
    },
    /// A recording, but not one of Dermis, or one that lacks something.
    #[error("{}: {why}", path.display())]
    Lacks {
        /// The file.
        path: PathBuf,
        /// What it lacks, and what to do.
        why: String,
    },
    /// Bytes that do not say what they should.
    #[error("{}, byte {at}: {why}", path.display())]
    Damaged {
        /// The file.
        path: PathBuf,
        /// Where.
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

    /// What the writer of MCAP files said. All but the system's answers are mistakes of ours.
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
