//! Errors of datasets.

use std::path::PathBuf;
use thiserror::Error;

/// A dataset that cannot be generated, read or continued.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum DatasetError {
    /// A number that is invalid for a dataset.
    #[error("{what} is {value}: it must be {must}")]
    OutOfRange {
        /// The name of the number.
        what: &'static str,
        /// Its value.
        value: f64,
        /// The allowed values.
        must: String,
    },
    /// A physics that no training may use.
    #[error(
        "`touch.patch.patches.{field}` is for digital twins alone: networks are measured on its physics because no \
         training has seen it (leave the field out)"
    )]
    KeptForEvaluation {
        /// The field of the patches.
        field: &'static str,
    },
    /// A shard whose index is not below the number of shards.
    #[error("shard {index} of {count}: with {count} shards their numbers are 0 to {}", count.saturating_sub(1))]
    Shard {
        /// Its number.
        index: u64,
        /// The number of shards.
        count: u64,
    },
    /// A folder that contains another dataset than the requested one.
    #[error(
        "{} holds another dataset: its `{field}` is {there}, not {asked}; continue it with the settings that it was begun with, or use \
         another folder", path.display()
    )]
    Mismatch {
        /// The record of the dataset in the folder.
        path: PathBuf,
        /// The first field that differs.
        field: String,
        /// Its value in the folder.
        there: String,
        /// The requested value.
        asked: String,
    },
    /// A folder without the record of a dataset.
    #[error("{} is not there: the folder holds no dataset of `dermis simulate`", path.display())]
    NoRecord {
        /// The record that is missing.
        path: PathBuf,
    },
    /// A dataset without a manifest.
    #[error("the dataset in {0} is not finished: `dermis simulate --finish {0}` does it", folder.display())]
    Unfinished {
        /// Its folder.
        folder: PathBuf,
    },
    /// A file with contents that do not match its name, or a damaged one.
    #[error("{}: {message}", path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// What is wrong, and the fix.
        message: String,
    },
    /// Files that another process is generating.
    #[error(
        "{} is being made by another process, which holds its lock{}: wait for it, or give each process a shard of its \
         own", path.display(), others(.count)
    )]
    Busy {
        /// The first of them.
        path: PathBuf,
        /// Their number.
        count: u64,
    },
    /// Files that have not been generated yet.
    #[error("{count} of {of} files are missing, the first is {}: run the shards that make them", path.display())]
    Missing {
        /// The first of them.
        path: PathBuf,
        /// The number of missing files.
        count: u64,
        /// The total number of files.
        of: u64,
    },
    /// A disk that is too small.
    #[error(
        "{} has room for {available_bytes} bytes, but {needed_bytes} are needed: make room, or take fewer samples or \
         another disk", folder.display()
    )]
    Space {
        /// The folder of the dataset.
        folder: PathBuf,
        /// The free space.
        available_bytes: u64,
        /// The size of the dataset; the maximum integer if it is larger.
        needed_bytes: u64,
    },
    /// A file or folder that cannot be created, read or written.
    #[error("{}: {source}", path.display())]
    Io {
        /// The file or folder.
        path: PathBuf,
        /// The error of the operating system.
        source: std::io::Error,
    },
}

fn others(count: &u64) -> String {
    match count {
        0 | 1 => String::new(),
        count => format!(", and so are {} others", count - 1),
    }
}
