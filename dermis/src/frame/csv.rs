//! Numbers as comma-separated text.

use crate::frame::TableError;
use crate::frame::table::MAX_VALUES;
use std::io::Write;
use std::path::Path;

/// A CSV file's header, if it has one, and its rows of numbers with the line of each.
pub(super) struct Rows {
    pub(crate) header: Option<Vec<String>>,
    pub(crate) rows: Vec<(usize, Vec<f64>)>,
}

/// Reads rows of numbers, separated by commas or by semicolons (then with decimal points or commas).
///
/// The first row is a header if none of its fields is a number, if its first field is not a number and the others
/// number the columns (0, 1, 2, ... or 1, 2, 3, ...), or if it numbers exactly `columns` columns, as pandas writes
/// them. A byte-order mark, carriage returns and empty lines at the end are ignored. An empty field is `NaN` where
/// `columns` are known, else an error.
pub(super) fn parse(text: &[u8], path: &Path, columns: Option<usize>) -> Result<Rows, TableError> {
    let text = std::str::from_utf8(text).map_err(|error| TableError::File {
        path: path.to_path_buf(),
        message: format!("not UTF-8 text (byte {}); write CSV, NPY or NPZ", error.valid_up_to()),
    })?;
    let text = text.strip_prefix('\u{feff}').unwrap_or(text).trim_end();
    let separator = if text.lines().next().is_some_and(|line| line.contains(';')) { ';' } else { ',' };
    check_size(text, separator).map_err(|message| TableError::File { path: path.to_path_buf(), message })?;
    let mut header = None;
    let mut rows = Vec::new();
    for (index, line) in text.lines().enumerate() {
        if index == 0 && is_header(line, separator, columns) {
            header = Some(line.split(separator).map(name).collect());
            continue;
        }
        rows.push((index + 1, row(line, index + 1, separator, columns.is_some(), path)?));
    }
    Ok(Rows { header, rows })
}

/// Memory of a row besides its values, in values.
const ROW_VALUES: usize = 8;
/// Most columns of a table: a value for each cell of the largest mesh.
const MAX_COLUMNS: usize = 10_000_000;

/// Refuses a text whose numbers would take too much memory, before any is read.
fn check_size(text: &str, separator: char) -> Result<(), String> {
    let mut values = 0;
    for line in text.lines() {
        let columns = 1 + line.bytes().filter(|&byte| byte == separator as u8).count();
        if columns > MAX_COLUMNS {
            return Err(format!("a line has {columns} values: at most {MAX_COLUMNS} are read"));
        }
        values += columns + ROW_VALUES;
    }
    if values > MAX_VALUES {
        return Err(format!(
            "the table has too many values: at most {MAX_VALUES} are read, and a row counts as {ROW_VALUES}"
        ));
    }
    Ok(())
}

/// Whether the first line of a file names or numbers the columns; see [`parse`].
pub(super) fn is_header(line: &str, separator: char, columns: Option<usize>) -> bool {
    let fields = split(line, separator);
    if fields.iter().any(|field| holds_several_numbers(field)) {
        return false;
    }
    let fields: Vec<Option<f64>> = fields.into_iter().map(|field| number(field, separator)).collect();
    match fields.as_slice() {
        [None, rest @ ..] => {
            rest.iter().all(Option::is_none) || counts(rest.iter().map(|field| field.unwrap_or(f64::NAN)))
        }
        all => columns == Some(all.len()) && counts(all.iter().map(|field| field.unwrap_or(f64::NAN))),
    }
}

/// The fields of a line; with a space as separator, they are separated by any white space.
pub(super) fn split(line: &str, separator: char) -> Vec<&str> {
    if separator == ' ' { line.split_whitespace().collect() } else { line.split(separator).collect() }
}

/// The name in a field of a header.
pub(super) fn name(field: &str) -> String {
    field.trim().trim_matches('"').to_string()
}

/// Whether values count up from 0 or from 1; false for a single value.
pub(super) fn counts(values: impl ExactSizeIterator<Item = f64>) -> bool {
    let mut first = None;
    let enough = values.len() > 1;
    enough
        && values.enumerate().all(|(index, value)| {
            let first = *first.get_or_insert(value);
            (first == 0.0 || first == 1.0) && value == first + index as f64
        })
}

fn row(line: &str, row: usize, separator: char, gaps: bool, path: &Path) -> Result<Vec<f64>, TableError> {
    numbers(line, separator, gaps).map_err(|(column, message)| {
        let path = path.to_path_buf();
        TableError::Cell { path, row, column, message }
    })
}

/// The numbers of a line, or what is wrong with it: the 1-based column, if a single value is, and a message. With
/// `gaps`, a field without a value is `NaN`.
pub(super) fn numbers(line: &str, separator: char, gaps: bool) -> Result<Vec<f64>, (Option<usize>, String)> {
    if line.trim().is_empty() {
        return Err((None, "an empty line between rows".into()));
    }
    let value = |(index, field): (usize, &str)| {
        let known = number(field, separator).or_else(|| (gaps && field.trim().is_empty()).then_some(f64::NAN));
        known.ok_or_else(|| match field.trim() {
            "" => (Some(index + 1), "no value".to_string()),
            text if holds_several_numbers(text) => {
                (None, "the values are separated by spaces or tabs; separate them by commas".to_string())
            }
            text => (Some(index + 1), format!("`{}` is not a number", shortened(text))),
        })
    };
    match separator {
        ' ' => line.split_whitespace().enumerate().map(value).collect(),
        _ => line.split(separator).enumerate().map(value).collect(),
    }
}

/// Whether a field is a row of numbers with spaces or tabs between them.
fn holds_several_numbers(field: &str) -> bool {
    field.split_whitespace().count() > 1 && field.split_whitespace().all(|word| word.parse::<f64>().is_ok())
}

/// The number in a field. A comma is a decimal point only if the separator is a semicolon.
fn number(field: &str, separator: char) -> Option<f64> {
    let field = field.trim().trim_matches('"');
    if separator == ';' && field.contains(',') { field.replacen(',', ".", 1).parse() } else { field.parse() }.ok()
}

/// The beginning of a text, for a message.
fn shortened(text: &str) -> String {
    const MAX: usize = 30;
    match text.char_indices().nth(MAX) {
        Some((end, _)) => format!("{}...", &text[..end]),
        None => text.to_string(),
    }
}

/// Writes rows of numbers, each with the shortest text that reads back as the same number.
pub(super) fn write(writer: &mut dyn Write, values: &[f64], columns: usize) -> std::io::Result<()> {
    for row in values.chunks(columns.max(1)) {
        for (index, value) in row.iter().enumerate() {
            let comma = if index == 0 { "" } else { "," };
            write!(writer, "{comma}{value:?}")?;
        }
        writeln!(writer)?;
    }
    Ok(())
}
