//! Measured drive currents: from voltages to the ohms of a frame.

use crate::frame::table::read_values;
use crate::frame::{Frame, TableError};
use crate::protocol::Protocol;
use std::path::Path;

/// The measured currents of the drives of a protocol, in the order of [`Protocol::drives`], A.
///
/// ```
/// use dermis::frame::{DriveCurrents, Frame};
/// use dermis::protocol::Protocol;
///
/// let protocol = Protocol::adjacent(4)?; // 4 drives, 3 channels of each
/// let path = std::env::temp_dir().join(format!("dermis-currents-{}.csv", std::process::id()));
/// std::fs::write(&path, "0.001,0.001,0.002,0.001\n")?;
/// let currents = DriveCurrents::read(&path, &protocol, 1)?;
/// let frames = currents.frames_per_ampere(&protocol, vec![Frame(vec![0.5; 12])]); // V
/// assert_eq!((frames[0][0], frames[0][6]), (500.0, 250.0)); // ohm
/// # std::fs::remove_file(path)?;
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct DriveCurrents {
    /// One row for all frames, or one per frame.
    rows: Vec<Vec<f64>>,
}

impl DriveCurrents {
    /// Reads a table (CSV, NPY or NPZ) with a column per drive: one row for all frames, or one per frame. A header and
    /// row numbers are dropped as in [`read_frames`](crate::frame::read_frames).
    ///
    /// # Errors
    /// As [`read_table`](crate::frame::read_table); another number of rows or columns; a current that is zero or not
    /// finite.
    pub fn read(path: &Path, protocol: &Protocol, frame_count: usize) -> Result<Self, TableError> {
        let drives = protocol.drives().0.len();
        let table = read_values(path, "currents", drives, "drives of this protocol")?;
        if table.rows.len() != 1 && table.rows.len() != frame_count {
            let message = format!(
                "{} rows of currents, but {frame_count} frames: give one row for all frames, or one per frame",
                table.rows.len()
            );
            return Err(TableError::File { path: path.to_path_buf(), message });
        }
        for (values, &row) in table.rows.iter().zip(&table.file_rows) {
            if let Some(drive) = values.iter().position(|current| !(current.is_finite() && *current != 0.0)) {
                let message =
                    format!("the current of drive {drive} is {}: it must be finite and not zero, in A", values[drive]);
                return Err(TableError::Cell { path: path.to_path_buf(), row, column: Some(drive + 1), message });
            }
        }
        Ok(DriveCurrents { rows: table.rows })
    }

    /// Frames of voltages (V) divided by the currents of their drives: ohm.
    ///
    /// # Panics
    /// With more than one row of currents, and another number of frames.
    pub fn frames_per_ampere(&self, protocol: &Protocol, frames: Vec<Frame>) -> Vec<Frame> {
        assert!(self.rows.len() == 1 || self.rows.len() == frames.len(), "a row of currents for each frame");
        let (_, drive_of) = protocol.drives();
        let divide = |(index, mut frame): (usize, Frame)| {
            let currents = &self.rows[if self.rows.len() == 1 { 0 } else { index }];
            frame.iter_mut().zip(&drive_of).for_each(|(value, &drive)| *value /= currents[drive]);
            frame
        };
        frames.into_iter().enumerate().map(divide).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str, frames: usize) -> Result<DriveCurrents, String> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("currents.csv");
        std::fs::write(&path, text).unwrap();
        DriveCurrents::read(&path, &Protocol::adjacent(4).unwrap(), frames).map_err(|error| error.to_string())
    }

    #[test]
    fn each_frame_is_divided_by_its_currents() {
        let protocol = Protocol::adjacent(4).unwrap();
        let currents = read("d0,d1,d2,d3\n1,2,4,8\n2,2,2,2\n", 2).unwrap();
        let frames = currents.frames_per_ampere(&protocol, vec![Frame(vec![8.0; 12]); 2]);
        assert_eq!(frames[0].0, [8.0, 8.0, 8.0, 4.0, 4.0, 4.0, 2.0, 2.0, 2.0, 1.0, 1.0, 1.0]);
        assert_eq!(frames[1].0, [4.0; 12]);
    }

    #[test]
    fn wrong_currents_are_named() {
        assert!(read("1,2,3\n", 5).unwrap_err().contains("3"), "three of four drives");
        assert!(read("1,1,1,1\n1,1,1,1\n", 5).unwrap_err().contains("2 rows of currents, but 5 frames"));
        assert!(read("1,0,1,1\n", 5).unwrap_err().contains("the current of drive 1 is 0"));
        assert!(read("1,1,NaN,1\n", 5).unwrap_err().contains("the current of drive 2 is NaN"));
    }
}
