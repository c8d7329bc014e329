//! Numbers as comma-separated text.

use crate::frame::TableError;
use std::io::Write;
use std::path::Path;

/// A CSV file's header, if it has one, and its rows of numbers with the line of each.
pub(super) struct Rows {
    pub header: Option<Vec<String>>,
    pub rows: Vec<(usize, Vec<f64>)>,
}

/// Reads rows of numbers. The first row is a header where none of its fields is a number. A byte-order mark, carriage
/// returns and empty lines at the end do no harm.
pub(super) fn parse(text: &[u8], path: &Path) -> Result<Rows, TableError> {
    let text = std::str::from_utf8(text).map_err(|error| TableError::File {
        path: path.to_path_buf(),
        message: format!("not UTF-8 text (byte {}); write CSV, NPY or NPZ", error.valid_up_to()),
    })?;
    let text = text.strip_prefix('\u{feff}').unwrap_or(text).trim_end();
    let mut header = None;
    let mut rows = Vec::new();
    for (index, line) in text.lines().enumerate() {
        let fields = line.split(',').map(str::trim);
        if index == 0 && fields.clone().all(|field| number(field).is_none()) {
            header = Some(fields.map(|field| field.trim_matches('"').to_string()).collect());
            continue;
        }
        rows.push((index + 1, row(line, index + 1, path)?));
    }
    Ok(Rows { header, rows })
}

fn row(line: &str, row: usize, path: &Path) -> Result<Vec<f64>, TableError> {
    let cell =
        |column: Option<usize>, message: String| TableError::Cell { path: path.to_path_buf(), row, column, message };
    if line.trim().is_empty() {
        return Err(cell(None, "an empty line between rows".into()));
    }
    let value = |(index, field): (usize, &str)| {
        number(field.trim()).ok_or_else(|| {
            let message = match field.trim() {
                "" => "no value".to_string(),
                text => format!("`{}` is no number", shortened(text)),
            };
            cell(Some(index + 1), message)
        })
    };
    line.split(',').enumerate().map(value).collect()
}

fn number(field: &str) -> Option<f64> {
    field.trim_matches('"').parse().ok()
}

/// The beginning of a text, for a message.
fn shortened(text: &str) -> String {
    const MOST: usize = 30;
    match text.char_indices().nth(MOST) {
        Some((end, _)) => format!("{}...", &text[..end]),
        None => text.to_string(),
    }
}

/// Writes rows of numbers, each with the fewest digits that read back the same.
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
