//! Tables of numbers in CSV, NPY and NPZ files.

use crate::files::{ending, read_at_most};
use crate::frame::complex::Part;
use crate::frame::write_whole;
use crate::frame::{Frame, TableError, csv, names, npy, npz};
use crate::stats::upper_median;
use std::path::Path;

/// Rows of numbers, all of the same length.
#[derive(Debug, Clone, PartialEq)]
pub struct Table {
    /// The names of the columns, if the file has a header.
    pub header: Option<Vec<String>>,
    /// The rows.
    pub rows: Vec<Vec<f64>>,
    /// 1-based row number in the file (header included) of each row.
    pub(crate) file_rows: Vec<usize>,
}

/// Reads a table: CSV, NPY or NPZ, recognised by their first bytes. In an NPZ file of several arrays the one called
/// `array` is read. Values may be `NaN` or infinite.
///
/// # Errors
/// A file that cannot be read, is empty, or contains anything other than rows of numbers of equal length (with row and
/// column).
pub fn read_table(path: &Path, array: &str) -> Result<Table, TableError> {
    read_rows(path, array, None, None).map(|(table, _)| table)
}

/// [`read_table`] with a known number of columns: a first row of a CSV file that numbers them is a header. Also whether
/// any value is complex: of these the `part` is read.
pub(super) fn read_rows(
    path: &Path,
    array: &str,
    columns: Option<usize>,
    part: Option<Part>,
) -> Result<(Table, bool), TableError> {
    let bytes = contents(path)?;
    let (table, is_complex) = parse_table(&bytes, path, array, columns, part)?;
    if table.rows.is_empty() {
        return Err(file_error(path, "the file is empty: it holds no row of numbers"));
    }
    let columns = table.rows[0].len();
    for (row, &file_row) in table.rows.iter().zip(&table.file_rows) {
        if row.len() != columns {
            return Err(count_error(path, file_row, row.len(), columns, "the rows before", ""));
        }
    }
    Ok((table, is_complex))
}

/// Reads rows of `columns` values each. A first column of row numbers or times is dropped.
///
/// # Errors
/// As [`read_table`]; rows of another length.
pub(super) fn read_values(path: &Path, array: &str, columns: usize, what: &str) -> Result<Table, TableError> {
    let (table, _) = read_rows(path, array, Some(columns), None)?;
    if table.rows[0].len() == 1 && table.rows.len() == columns && columns > 1 {
        return Err(file_error(path, format!("one value in each of {columns} rows: write them in one row")));
    }
    let table = names::without_times(table, columns).map_err(|message| file_error(path, message))?;
    with_columns(table, path, columns, what)
}

/// A table of rows of `columns` values each, without a first column of row numbers or times that has no name.
pub(super) fn with_columns(mut table: Table, path: &Path, columns: usize, what: &str) -> Result<Table, TableError> {
    if table.rows[0].len() == columns + 1 {
        drop_first_column(&mut table, path, what)?;
    }
    for (row, &file_row) in table.rows.iter().zip(&table.file_rows) {
        if row.len() != columns {
            return Err(count_error(path, file_row, row.len(), columns, what, fix_of(row, columns)));
        }
    }
    Ok(table)
}

/// Drops the first column if it contains row numbers or times: by counting from 0 or 1, or without a name by rising steadily,
/// where the last column does not. Any other rising first column is an error.
fn drop_first_column(table: &mut Table, path: &Path, what: &str) -> Result<(), TableError> {
    let first: Vec<f64> = table.rows.iter().map(|row| row[0]).collect();
    let name =
        table.header.as_ref().filter(|header| header.len() == table.rows[0].len()).and_then(|header| header.first());
    let last: Vec<f64> = table.rows.iter().filter_map(|row| row.last().copied()).collect();
    if csv::counts(first.iter().copied()) || (name.is_none() && are_times(&first) && !are_times(&last)) {
        table.rows.iter_mut().for_each(|row| _ = row.remove(0));
        table.header.iter_mut().for_each(|header| _ = header.remove(0));
        return Ok(());
    }
    if first.is_sorted_by(|a, b| a < b) {
        let name = name.map(|name| format!(" `{name}`")).unwrap_or_default();
        let message = format!(
            "{what} have {} values, and the row has one more: if the first column{name} has times, call it time_s in a header; \
             if not, remove what is no channel",
            table.rows[0].len() - 1
        );
        return Err(TableError::Cell { path: path.to_path_buf(), row: table.file_rows[0], column: Some(1), message });
    }
    Ok(())
}

/// Fewer values may rise by chance.
const MIN_TIMES: usize = 5;
/// Largest step of times over the median step. Noise and drift have steps of both signs and of any size.
const MAX_STEP: f64 = 3.0;

/// Whether the values of a column without a name are times: they rise in steps of about the same length.
pub(super) fn are_times(values: &[f64]) -> bool {
    let steps: Vec<f64> = values.windows(2).map(|pair| pair[1] - pair[0]).collect();
    let Some(median) = upper_median(&steps).filter(|_| values.len() >= MIN_TIMES) else { return false };
    steps.iter().all(|&step| step > 0.0 && step <= MAX_STEP * median)
}

/// [`read_rows`] from bytes; the rows may differ in length.
fn parse_table(
    bytes: &[u8],
    path: &Path,
    array: &str,
    columns: Option<usize>,
    part: Option<Part>,
) -> Result<(Table, bool), TableError> {
    let array = if npy::is_npz(bytes) {
        npz::read_npz(bytes, array, part)
    } else if npy::is_npy(bytes) {
        npy::read_npy(bytes, part)
    } else {
        let csv::Rows { header, rows, is_complex } = csv::parse(bytes, path, columns, part)?;
        let (file_rows, rows) = rows.into_iter().unzip();
        return Ok((Table { header, rows, file_rows }, is_complex));
    };
    let npy::Array { shape, values, is_complex } = array.map_err(|message| file_error(path, message))?;
    let columns = match shape.as_slice() {
        [columns] => *columns,
        [_, columns @ ..] if !columns.is_empty() => columns.iter().product(),
        _ => return Err(file_error(path, format!("an array of shape {shape:?}, but rows x columns are needed"))),
    };
    let rows: Vec<Vec<f64>> = values.chunks(columns.max(1)).map(<[f64]>::to_vec).collect();
    Ok((Table { header: None, file_rows: (1..=rows.len()).collect(), rows }, is_complex))
}

/// Reads an array of any shape from an NPY or NPZ file (of several arrays in an NPZ file the one called `array`),
/// row-major, with its shape. A table of numbers (CSV) has the shape rows x columns.
///
/// # Errors
/// As [`read_table`].
pub fn read_array(path: &Path, array: &str) -> Result<(Vec<usize>, Vec<f64>), TableError> {
    let bytes = contents(path)?;
    let read = if npy::is_npz(&bytes) {
        npz::read_npz(&bytes, array, None)
    } else if npy::is_npy(&bytes) {
        npy::read_npy(&bytes, None)
    } else {
        let table = read_table(path, array)?;
        return Ok((vec![table.rows.len(), table.rows[0].len()], table.rows.concat()));
    };
    let npy::Array { shape, values, .. } = read.map_err(|message| file_error(path, message))?;
    Ok((shape, values))
}

/// Largest file of a table, also where it is compressed, bytes.
pub(super) const LARGEST_FILE: u64 = 256 << 20;
/// Most values of a table: as numbers they have as many bytes as the largest file.
pub(super) const MAX_VALUES: usize = LARGEST_FILE as usize / size_of::<f64>();

fn contents(path: &Path) -> Result<Vec<u8>, TableError> {
    read_at_most(path, LARGEST_FILE).map_err(|source| TableError::Io { path: path.to_path_buf(), source })
}

pub(super) fn file_error(path: &Path, message: impl Into<String>) -> TableError {
    TableError::File { path: path.to_path_buf(), message: message.into() }
}

/// The error of a row with too few or too many values.
fn count_error(path: &Path, row: usize, got: usize, expected: usize, what: &str, fix: &str) -> TableError {
    let amount = if got < expected { "too few" } else { "too many" };
    let message = format!("{amount} values: {got}, but {what} have {expected}{fix}");
    TableError::Cell { path: path.to_path_buf(), row, column: None, message }
}

/// What most often helps where a row has too many values.
fn fix_of(values: &[f64], expected: usize) -> &'static str {
    let got = values.len();
    let is_whole = values.iter().all(|value| value.fract() == 0.0);
    match got {
        _ if is_whole && 2 * got > 3 * expected => {
            "; all are whole numbers: numbers with decimal commas need semicolons between them, or quotes; if real and imaginary \
             parts alternate, choose one with --part"
        }
        _ if got == 2 * expected => {
            "; if magnitudes and phases, or real and imaginary parts, alternate, choose one with --part"
        }
        // Row numbers, times and a temperature.
        _ if (1..=3).contains(&got.saturating_sub(expected)) => {
            "; name columns of row numbers `frame` and of times `time_s` in a header, and remove what is no channel"
        }
        _ => "",
    }
}

/// Reads conductivity maps, one per row with a value per cell in the order of the mesh (S on surfaces, S/m in volumes).
/// A header and row numbers are dropped as in [`read_frames`](super::read_frames).
///
/// # Errors
/// As [`read_table`]; rows that do not have a value for every cell; a value that is not positive and finite.
pub fn read_conductivities(path: &Path, cell_count: usize) -> Result<Vec<Vec<f64>>, TableError> {
    let table = read_values(path, "conductivity", cell_count, "maps of this mesh")?;
    for (row, &file_row) in table.rows.iter().zip(&table.file_rows) {
        if let Some(cell) = row.iter().position(|value| !(*value > 0.0 && value.is_finite())) {
            let message = format!("the conductivity of cell {cell} is {}: it must be positive and finite", row[cell]);
            let column = Some(cell + 1);
            return Err(TableError::Cell { path: path.to_path_buf(), row: file_row, column, message });
        }
    }
    Ok(table.rows)
}

/// Writes an array in row-major order, completely or not at all: NPY or NPZ (float64; the array is called `name`) by
/// the file's extension, else CSV with one row per first index.
///
/// # Errors
/// A path that cannot be written, a full disk.
///
/// # Panics
/// If the shape does not match the number of values.
pub fn write_array(path: &Path, name: &str, shape: &[usize], values: &[f64]) -> Result<(), TableError> {
    assert_eq!(shape.iter().product::<usize>(), values.len(), "shape {shape:?}");
    write_whole(path, |writer| match ending(path).as_str() {
        "npy" => npy::write_npy(writer, shape, values),
        "npz" => npz::write_npz(writer, name, shape, values),
        _ => csv::write_csv(writer, values, shape.iter().skip(1).product()),
    })
}

/// Writes frames, one per row: NPY, NPZ or CSV by the file's extension.
///
/// # Errors
/// As [`write_array`].
///
/// # Panics
/// If the frames differ in length.
pub fn write_frames(path: &Path, frames: &[Frame]) -> Result<(), TableError> {
    let columns = frames.first().map_or(0, |frame| frame.len());
    let values: Vec<f64> = frames.iter().flat_map(|frame| frame.iter().copied()).collect();
    write_array(path, "frames", &[frames.len(), columns], &values)
}
