//! Frames of voltages, baselines, and tables of them.

mod arrangement;
mod broken;
mod complex;
mod csv;
mod currents;
mod differences;
mod lines;
mod names;
mod npy;
#[cfg_attr(not(feature = "npz"), path = "no_npz.rs")]
mod npz;
mod presses;
mod read;
mod reciprocity;
mod table;
mod text;
mod truth;

pub use broken::{broken_channels, contradicting_channels, disconnected_electrodes};
pub use complex::Part;
pub use csv::write_csv;
pub use currents::DriveCurrents;
pub use differences::Differences;
pub use lines::{FrameLine, FrameLines, LineError};
pub use names::column_order;
pub use npy::npy_header;
pub use presses::{EvaluatedPress, PressEstimate, write_presses};
pub use read::{ReadOptions, read_frames, read_frames_with, read_frames_without};
pub use reciprocity::{Screening, quantities, reciprocal};
pub use table::{Table, read_array, read_conductivities, read_table, write_array, write_frames};
pub use truth::{Truth, frames_after_last_touch, read_places, read_truth, write_truth};

use crate::protocol::Protocol;
use serde::{Deserialize, Serialize};
use std::io::Write;
use std::ops::{Deref, DerefMut, Sub};
use std::path::{Path, PathBuf};
use thiserror::Error;

#[cfg(test)]
mod tests;

/// Writes a file as [`files::write_whole`](crate::files::write_whole) does.
///
/// # Errors
/// The same, with the path.
pub fn write_whole(path: &Path, fill: impl FnOnce(&mut dyn Write) -> std::io::Result<()>) -> Result<(), TableError> {
    crate::files::write_whole(path, fill).map_err(|source| TableError::Io { path: path.to_path_buf(), source })
}

/// A table of numbers that cannot be read or written: the file, the row and column, and the problem.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum TableError {
    /// A file that cannot be opened, read or written.
    #[error("{}: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// The error of the operating system.
        source: std::io::Error,
    },
    /// A wrong value or row.
    #[error("{}, row {row}{}: {message}", path.display(), column.map(|c| format!(", column {c}")).unwrap_or_default())]
    Cell {
        /// The file.
        path: PathBuf,
        /// 1-based row of the file, its header included.
        row: usize,
        /// 1-based column, if a single value is wrong.
        column: Option<usize>,
        /// What is wrong, and the fix.
        message: String,
    },
    /// A file that is wrong as a whole.
    #[error("{}: {message}", path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// What is wrong, and the fix.
        message: String,
    },
}

/// Frames without the signs of their values where the instrument reports amplitudes alone.
pub(crate) fn without_signs(protocol: &Protocol, frames: &[Frame]) -> Vec<Frame> {
    let mut frames = frames.to_vec();
    frames.iter_mut().for_each(|frame| protocol.drop_signs(frame));
    frames
}

/// The values of one frame, or of a difference of two, in the order of the protocol's channels; ohm.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Frame(pub Vec<f64>);

impl Deref for Frame {
    type Target = [f64];
    fn deref(&self) -> &[f64] {
        &self.0
    }
}

impl DerefMut for Frame {
    fn deref_mut(&mut self) -> &mut [f64] {
        &mut self.0
    }
}

impl AsRef<[f64]> for Frame {
    fn as_ref(&self) -> &[f64] {
        &self.0
    }
}

impl Sub for &Frame {
    type Output = Frame;
    /// The difference of each value.
    ///
    /// # Panics
    /// If the frames differ in length.
    fn sub(self, other: &Frame) -> Frame {
        assert_eq!(self.len(), other.len(), "frames of different protocols");
        Frame(self.iter().zip(other.iter()).map(|(a, b)| a - b).collect())
    }
}

/// The mean of some frames of equal length; `None` without a frame.
pub fn mean(frames: &[Frame]) -> Option<Frame> {
    let first = frames.first()?;
    let mut sum = vec![0.0; first.len()];
    for frame in frames {
        for (total, value) in sum.iter_mut().zip(frame.iter()) {
            *total += value;
        }
    }
    Some(Frame(sum.into_iter().map(|total| total / frames.len() as f64).collect()))
}
