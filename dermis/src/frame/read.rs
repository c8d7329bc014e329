//! Files of frames.

use crate::frame::complex::Part;
use crate::frame::table::{file_error, read_rows, with_columns};
use crate::frame::{Frame, Table, TableError, arrangement, names};
use crate::protocol::Protocol;
use std::ops::RangeInclusive;
use std::path::Path;

/// What instruments send in place of a value (SCPI-99, volume 1, section 7.2): infinity is 9.9e37, no number 9.91e37; the
/// magnitude of two of them.
const OVERLOADS: RangeInclusive<f64> = 9.89e37..=1.41e38;
/// The name of the array of untouched frames.
pub(super) const BASELINE: &str = "baseline";

/// How a file of frames is read.
#[derive(Debug, Clone, Copy, Default)]
pub struct ReadOptions<'a> {
    /// Channels that are left out: their values may be missing, `NaN` or infinite, and are 0 in the frames.
    pub left_out: &'a [usize],
    /// The part of complex values. They may also be pairs of columns: magnitude and phase, or real and imaginary part. The first
    /// of each pair is then read, and with [`Part::Imaginary`] the second.
    pub part: Option<Part>,
    /// Whether they are of the untouched skin: of several arrays in an NPZ file the one called `baseline` is read, not `frames`.
    pub untouched: bool,
    /// Whether frames with values that are missing, `NaN` or infinite are kept, with these values. Otherwise they are errors.
    pub keep_incomplete: bool,
}

/// Reads frames (or differences of frames) of a protocol, ohm, one per row.
///
/// A header, a first column of frame numbers or times, and columns that it names as these, are dropped. Frames may also be
/// columns, a row for each channel; or have one drive in each row, so that an array is frames x drives x measures; or they have the voltages between all
/// neighbouring electrodes for every drive, whose sum is zero, of which the protocol's channels are taken. Columns that are
/// named by their electrodes (`v_0_1_2_3`) or channels (`ch12`), in a header, a comment above the first row or before each value,
/// may have any order. 9.9e37 and 9.91e37, which instruments send
/// at an overload, are no values.
///
/// # Errors
/// As [`read_table`](crate::frame::read_table); rows that do not have a value for every channel; a value that is missing, `NaN`
/// or infinite; columns whose names are out of order and say nothing else; rows that are frames as columns as well as drives.
pub fn read_frames(path: &Path, protocol: &Protocol) -> Result<Vec<Frame>, TableError> {
    read_frames_without(path, protocol, &[])
}

/// [`read_frames`] without some channels: their values may be missing, `NaN` or infinite, and are 0 in the frames.
///
/// # Errors
/// As [`read_frames`] for the other channels.
pub fn read_frames_without(path: &Path, protocol: &Protocol, left_out: &[usize]) -> Result<Vec<Frame>, TableError> {
    read_frames_with(path, protocol, &ReadOptions { left_out, ..ReadOptions::default() })
}

/// [`read_frames`] with options.
///
/// # Errors
/// As [`read_frames`] for the channels that are not left out; a part of values that are not complex.
pub fn read_frames_with(path: &Path, protocol: &Protocol, options: &ReadOptions<'_>) -> Result<Vec<Frame>, TableError> {
    let channel_count = protocol.channel_count();
    let array = if options.untouched { BASELINE } else { "frames" };
    let (mut table, is_complex) = read_rows(path, array, Some(channel_count), options.part)?;
    let values = table.rows.iter_mut().flatten();
    values.filter(|value| OVERLOADS.contains(&value.abs())).for_each(|value| *value = f64::NAN);
    let pairs = |table: Table| match options.part.filter(|_| !is_complex) {
        Some(part) => part_of_pairs(table, part, channel_count),
        None => Ok(table),
    };
    let table = names::without_times(table, channel_count)
        .and_then(pairs)
        .and_then(|table| names::in_order(table, protocol))
        .and_then(|table| arrangement::frames_in_rows(table, protocol));
    let table = table.map_err(|message| file_error(path, message))?;
    let table = with_columns(table, path, channel_count, "frames of this protocol")?;
    let mut frames = Vec::with_capacity(table.rows.len());
    for (mut values, row) in table.rows.into_iter().zip(table.file_rows) {
        for &channel in options.left_out {
            values.get_mut(channel).into_iter().for_each(|value| *value = 0.0);
        }
        let missing = values.iter().position(|value| !value.is_finite());
        if let Some(channel) = missing.filter(|_| !options.keep_incomplete) {
            let message = format!("channel {channel} is {}: mend the frame, or leave the channel out", values[channel]);
            return Err(TableError::Cell { path: path.to_path_buf(), row, column: None, message });
        }
        frames.push(Frame(values));
    }
    Ok(frames)
}

/// A part of pairs of columns.
fn part_of_pairs(table: Table, part: Part, channel_count: usize) -> Result<Table, String> {
    if table.rows[0].len().saturating_sub(channel_count) < 2 && table.rows[0].len() >= channel_count {
        return Err(format!("it has no complex values, and frames of {channel_count} values: leave --part out"));
    }
    if table.rows[0].len() < channel_count && table.rows.len() == channel_count {
        return Err("it has no complex values, and a frame in each column: write a frame in each row".into());
    }
    part.of_pairs(table)
}
