//! Numbers as comma-separated text.

use crate::frame::TableError;
use crate::frame::complex::{Part, complex, without_part};
use crate::frame::names::{ColumnName, fitted};
use crate::frame::table::{MAX_VALUES, are_times};
use crate::frame::text::{decode, has_decimal_commas, values_of};
use std::io::Write;
use std::path::Path;

/// A CSV file's header, if it has one, and its rows of numbers with the line of each.
pub(super) struct Rows {
    pub header: Option<Vec<String>>,
    pub rows: Vec<(usize, Vec<f64>)>,
    /// Whether any value is complex.
    pub is_complex: bool,
}

/// Reads rows of numbers, separated by semicolons (then with decimal points or commas), by commas, by tabs, or by spaces. Empty
/// lines, comments, dates and times of day before the values and a separator at the end of every row are skipped.
///
/// The first row is a header if its fields are names, if its first field is a name and the others number the columns
/// (0, 1, 2, ... or 1, 2, 3, ...), or if it numbers exactly `columns` columns, as pandas writes them. Where `columns` are known,
/// names before the values (`ch0:1.5`) and names in the comment above the first row, one for each value, are a header too. A
/// byte-order mark and carriage returns are ignored. An empty field is `NaN` where `columns` are known, else an error.
/// Of complex numbers the `part` is read; a first column of real numbers alone stays as it is.
pub(super) fn parse(text: &[u8], path: &Path, columns: Option<usize>, part: Option<Part>) -> Result<Rows, TableError> {
    let of_file = |message: String| TableError::File { path: path.to_path_buf(), message };
    let text = &*decode(text).map_err(of_file)?;
    let numbered = text.lines().enumerate().map(|(index, line)| (index + 1, line.trim_end_matches([' ', '\r'])));
    let used = numbered.filter(|(_, line)| !is_skipped(line)).map(|(index, line)| (index, values_of(line)));
    let separator = separator(used.clone().take(2).map(|(_, (_, line))| line));
    check_size(text, separator).map_err(of_file)?;
    let mut before_values = "";
    let mut lines: Vec<(usize, &str)> = Vec::new();
    for (index, (before, line)) in used {
        before_values = before;
        lines.push((index, line));
    }
    let mut header = match lines.first() {
        Some((_, line)) if is_header(line, separator, columns) => Some(lines.remove(0).1),
        _ => None,
    };
    let fields = |line: &str| split(line, separator).len();
    // A last field with a name is a column.
    let is_named =
        |row: &str| header.is_some_and(|header| !header.ends_with(separator) && fields(header) == fields(row));
    if ends_empty(&lines, separator, columns) && !lines.first().is_some_and(|(_, row)| is_named(row)) {
        lines.iter_mut().for_each(|(_, line)| *line = line.strip_suffix(separator).unwrap_or(line));
        header = header.map(|line| line.strip_suffix(separator).unwrap_or(line));
    }
    if part.is_some()
        && separator == ','
        && lines.first().is_some_and(|(_, line)| have_cut_decimals(&split(line, separator)))
    {
        let message =
            "the decimal commas stand between commas: separate the values by semicolons, or put them in quotes";
        return Err(of_file(message.into()));
    }
    let complex_count = part.map_or(0, |_| count_complex(&lines, separator));
    let is_real =
        |(_, line): &(usize, &str)| split(line, separator).first().is_some_and(|field| complex(field).is_none());
    let reading = Reading {
        separator,
        gaps: columns.is_some(),
        // Pairs of columns have no complex values.
        part: part.filter(|_| complex_count > 0),
        // Row numbers and times have no parts.
        first_is_real: lines.iter().all(is_real)
            && columns.is_none_or(|columns| lines.first().is_some_and(|(_, line)| fields(line) > columns)),
    };
    let rows: Result<_, TableError> =
        lines.iter().map(|&(index, line)| Ok((index, row(line, index, reading, path)?))).collect();
    if part.is_none() && rows.is_err() {
        let count = count_complex(&lines, separator);
        if count > 0 {
            return Err(TableError::File { path: path.to_path_buf(), message: without_part(count) });
        }
    }
    // The columns of dates and times have names, but no values.
    let without_values = match separator {
        ' ' => before_values.split_whitespace().count(),
        _ => before_values.matches(separator).count(),
    };
    let values = lines.first().map_or(usize::MAX, |(_, line)| fields(line));
    let unnamed = |header: &str| fields(header).saturating_sub(values).min(without_values);
    let mut header = header.map(|line| names(line, separator).split_off(unnamed(line)));
    if let Some(columns) = columns {
        let comment = || commented_header(text, &lines, separator, columns);
        header = names_in_cells(&lines, separator, path)?.or(header).or_else(comment);
    }
    let is_numbered = || are_row_names(&lines, separator, columns.is_some());
    let header = header.map(|header| fitted(header, values, is_numbered));
    Ok(Rows { header, rows: rows?, is_complex: complex_count > 0 })
}

/// The names in the comment above the first row, if they are as many as its values: `numpy.savetxt` writes headers as comments.
/// Row numbers and times before the channels need no name.
fn commented_header(text: &str, rows: &[(usize, &str)], separator: char, columns: usize) -> Option<Vec<String>> {
    let &(row, values) = rows.first()?;
    let values = split(values, separator).len();
    let above = text.lines().take(row - 1).filter(|line| !line.trim().is_empty()).last()?;
    let line = above.trim().trim_start_matches(['#', '%', '/']).trim_start_matches(' ');
    // It may have another separator than the values.
    let of_names = self::separator(std::iter::once(line));
    let mut header = fitted(names(line, of_names), values, || false);
    if !is_skipped(above) || !is_header(line, of_names, Some(columns)) || header.len() != values {
        return None;
    }
    if values == columns + 1 && ColumnName::of(&header[0]) == ColumnName::Other && have_row_numbers(rows, separator) {
        header[0].clear();
    }
    Some(header)
}

/// The names before the values, which are those of each row, if all but the first value have one.
///
/// # Errors
/// A row with other names than the first.
fn names_in_cells(lines: &[(usize, &str)], separator: char, path: &Path) -> Result<Option<Vec<String>>, TableError> {
    let names = |line: &str| -> Option<Vec<String>> {
        // Most files have no names, and need not be split again.
        let fields = if line.contains(':') { split(line, separator) } else { return None };
        let name = |field: &&str| named_value(field).map(|(name, _)| name.trim().to_string()).unwrap_or_default();
        let names: Vec<String> = fields.iter().map(name).collect();
        (names.len() > 1 && !names[1..].iter().any(String::is_empty)).then_some(names)
    };
    let first = lines.first().and_then(|(_, line)| names(line));
    match lines.iter().find(|(_, line)| names(line) != first) {
        Some(&(row, _)) => {
            let message =
                "its values have other names than those of the first row: write each value below its name".into();
            Err(TableError::Cell { path: path.to_path_buf(), row, column: None, message })
        }
        None => Ok(first),
    }
}

/// Whether the first fields of rows are their names: in quotes, as R writes them, or in frames row numbers or times.
fn are_row_names(rows: &[(usize, &str)], separator: char, are_frames: bool) -> bool {
    let is_quoted = |field: Option<&&str>| field.is_some_and(|field| field.trim().starts_with('"'));
    let is_named = |(_, row): &(usize, &str)| {
        let fields = split(row, separator);
        is_quoted(fields.first()) && !is_quoted(fields.last())
    };
    rows.iter().all(is_named) || (are_frames && have_row_numbers(rows, separator))
}

/// Whether the first fields of rows are row numbers or times.
fn have_row_numbers(rows: &[(usize, &str)], separator: char) -> bool {
    let number_of_row =
        |(_, row): &(usize, &str)| split(row, separator).first().and_then(|field| number(field, separator));
    let numbers: Vec<f64> = rows.iter().map(|row| number_of_row(row).unwrap_or(f64::NAN)).collect();
    counts(numbers.iter().copied()) || are_times(&numbers) || matches!(numbers[..], [0.0 | 1.0])
}

/// Whether fields are the parts before and after decimal commas: whole numbers, some with a 0 before other digits.
fn have_cut_decimals(fields: &[&str]) -> bool {
    let is_whole = |field: &&str| field.trim().trim_start_matches('-').bytes().all(|byte| byte.is_ascii_digit());
    let has_zero = |field: &&str| field.trim().len() > 1 && field.trim().starts_with('0');
    fields.iter().all(is_whole) && fields.iter().any(has_zero)
}

/// How the fields of lines are read.
#[derive(Debug, Clone, Copy)]
pub(super) struct Reading {
    pub separator: char,
    /// A field without a value is `NaN`, else an error.
    pub gaps: bool,
    /// The part of complex values; without it they are errors.
    pub part: Option<Part>,
    /// The first field has no parts.
    pub first_is_real: bool,
}

fn count_complex(lines: &[(usize, &str)], separator: char) -> usize {
    lines.iter().flat_map(|(_, line)| split(line, separator)).filter(|field| complex(field).is_some()).count()
}

/// Whether a line is empty or a comment.
pub(super) fn is_skipped(line: &str) -> bool {
    let line = line.trim_start();
    line.is_empty() || ["#", "%", "//"].iter().any(|comment| line.starts_with(comment))
}

/// What separates the fields of some lines: a semicolon, a comma, a tab, a pipe sign, or (a space) white space.
pub(super) fn separator<'a>(lines: impl Iterator<Item = &'a str> + Clone) -> char {
    let has_decimal_commas =
        !lines.clone().any(|line| line.contains(';')) && lines.clone().last().is_some_and(has_decimal_commas);
    let first = if has_decimal_commas { '\t' } else { ',' };
    let is_used = |separator: &char| match separator {
        // Names may have it too, as in `0-1|2-3`; those of the columns are in the line before.
        '|' => lines.clone().last().is_some_and(|line| line.contains('|')),
        separator => lines.clone().any(|line| line.contains(*separator)),
    };
    [';', first, '\t', '|'].into_iter().find(is_used).unwrap_or(' ')
}

/// Whether every row has a separator at its end, and not an empty last field: the row has more fields than there are columns,
/// row numbers counted.
fn ends_empty(rows: &[(usize, &str)], separator: char, columns: Option<usize>) -> bool {
    let Some((_, first)) = rows.first() else { return false };
    if separator == ' ' || !rows.iter().all(|(_, row)| row.ends_with(separator)) {
        return false;
    }
    let has_numbers = have_row_numbers(rows, separator);
    columns.is_none_or(|columns| first.split(separator).count() > columns + usize::from(has_numbers))
}

/// Memory of a row besides its values, in values.
const ROW_VALUES: usize = 8;
/// Most columns of a table: a value for each cell of the largest mesh.
const MAX_COLUMNS: usize = 10_000_000;

/// Refuses a text whose numbers would take too much memory, before any is read.
fn check_size(text: &str, separator: char) -> Result<(), String> {
    let mut values = 0;
    for line in text.lines() {
        let is_separator =
            |byte: &u8| if separator == ' ' { byte.is_ascii_whitespace() } else { *byte == separator as u8 };
        let columns = 1 + line.as_bytes().iter().filter(|byte| is_separator(byte)).count();
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

/// A row of at least so many values that are the numbers of the columns in another order is a header: no frame has such values by
/// chance.
const MIN_SORTED: usize = 30;

/// Whether the first line of a file names or numbers the columns; see [`parse`].
pub(super) fn is_header(line: &str, separator: char, columns: Option<usize>) -> bool {
    let fields = split(line, separator);
    let is_value = |field: &&str| holds_several_numbers(field) || complex(field).is_some() || is_unreadable(field);
    if fields.iter().any(is_value) {
        return false;
    }
    let has_names = fields.iter().any(|field| is_name(field));
    let fields: Vec<Option<f64>> = fields.into_iter().map(|field| number(field, separator)).collect();
    match fields.as_slice() {
        [None, rest @ ..] => {
            has_names && rest.iter().all(Option::is_none) || counts(rest.iter().map(|field| field.unwrap_or(f64::NAN)))
        }
        all => {
            let mut numbers: Vec<f64> = all.iter().map(|field| field.unwrap_or(f64::NAN)).collect();
            // Programs sort names as text: 0, 1, 10, 100.
            if numbers.len() >= MIN_SORTED {
                numbers.sort_by(f64::total_cmp);
            }
            columns == Some(numbers.len()) && counts(numbers.into_iter())
        }
    }
}

/// The fields of a line; with a space as separator, they are separated by any white space.
pub(super) fn split(line: &str, separator: char) -> Vec<&str> {
    if separator == ' ' {
        return line.split_whitespace().collect();
    }
    // A single quote is an inch, or a mistake.
    let has_quoted = line.matches('"').count().is_multiple_of(2);
    let mut is_quoted = false;
    let ends = |character: char| {
        is_quoted ^= has_quoted && character == '"';
        character == separator && !is_quoted
    };
    line.split(ends).collect()
}

/// The names in the fields of a header.
pub(super) fn names(line: &str, separator: char) -> Vec<String> {
    split(line, separator).into_iter().map(|field| field.trim().trim_matches('"').to_string()).collect()
}

/// Whether a field may be a name: it has a letter or digit, and does not begin with a decimal number, as `1.5 mV` does.
fn is_name(field: &str) -> bool {
    let plain = field.trim().trim_start_matches(['"', '-', '+']);
    let decimals =
        plain.split_once('.').filter(|(whole, _)| whole.parse::<u64>().is_ok()).map(|(_, decimals)| decimals);
    field.contains(char::is_alphanumeric)
        && !decimals.is_some_and(|rest| rest.starts_with(|c: char| c.is_ascii_digit()))
}

/// What instruments and programs write in place of a value.
const NO_VALUES: [&str; 14] = [
    "ovld",
    "ovl",
    "ol",
    "o.l",
    "over",
    "overload",
    "overflow",
    "overrange",
    "na",
    "n/a",
    "null",
    "none",
    "err",
    "error",
];

/// Whether a field is a value that cannot be read: none, or a number with another minus sign, exponent or separator.
fn is_unreadable(field: &str) -> bool {
    let plain = field.trim().trim_matches('"').to_lowercase();
    let number = plain.replace(['\u{2212}', '\u{2013}'], "-").replace('d', "e");
    let is_number = number.split('|').all(|part| part.trim().parse::<f64>().is_ok());
    NO_VALUES.contains(&plain.trim_start_matches(['+', '-', '<', '>'])) || (is_number && plain.parse::<f64>().is_err())
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

fn row(line: &str, row: usize, reading: Reading, path: &Path) -> Result<Vec<f64>, TableError> {
    numbers(line, reading).map_err(|(column, message)| {
        let path = path.to_path_buf();
        TableError::Cell { path, row, column, message }
    })
}

/// The numbers of a line, or what is wrong with it: the 1-based column, if a single value is, and a message.
pub(super) fn numbers(line: &str, reading: Reading) -> Result<Vec<f64>, (Option<usize>, String)> {
    let Reading { separator, gaps, part, first_is_real } = reading;
    let value = |(index, field): (usize, &str)| {
        let of_part = |part: Part| match (complex(field), first_is_real && index == 0) {
            (Some(parts), _) => Some(part.of(parts)),
            (None, true) => number(field, separator),
            (None, false) => number(field, separator).map(|real| part.of([real, 0.0])),
        };
        let known = part.map_or_else(|| number(field, separator), of_part);
        let known = known.or_else(|| (gaps && field.trim().is_empty()).then_some(f64::NAN));
        known.ok_or_else(|| match field.trim() {
            "" => (Some(index + 1), "no value".to_string()),
            text if holds_several_numbers(text) => {
                (None, "some values are separated by spaces or tabs; separate all of them by commas".to_string())
            }
            text if complex(text).is_some() => {
                let text = shortened(text);
                (Some(index + 1), format!("`{text}` is a complex number: write its real part or its magnitude"))
            }
            text => {
                let fix =
                    if is_unreadable(text) { ": write it as -1.5e+02, or NaN where there is no value" } else { "" };
                (Some(index + 1), format!("`{}` is not a number{fix}", shortened(text)))
            }
        })
    };
    split(line, separator).into_iter().enumerate().map(value).collect()
}

/// Whether a field is a row of numbers with spaces or tabs between them.
fn holds_several_numbers(field: &str) -> bool {
    field.split_whitespace().count() > 1 && field.split_whitespace().all(|word| word.parse::<f64>().is_ok())
}

/// The name and the value in a field like `ch0:1.5`; `V0:1` is a name.
fn named_value(field: &str) -> Option<(&str, &str)> {
    let parts = field.trim().trim_matches('"').split_once(':');
    parts.filter(|(name, value)| name.starts_with(|first: char| first.is_alphabetic()) && value.contains('.'))
}

/// The number in a field, without the name before it. A comma is a decimal point where it is no separator,
/// and in quotes.
fn number(field: &str, separator: char) -> Option<f64> {
    let field = field.trim();
    let plain = field.trim_matches('"');
    let plain = named_value(field).map_or(plain, |(_, value)| value.trim());
    let has_comma = plain.contains(',') && (separator != ',' || field.starts_with('"'));
    if has_comma { plain.replacen(',', ".", 1).parse() } else { plain.parse() }.ok()
}

/// The beginning of a text, for a message.
fn shortened(text: &str) -> String {
    const MAX: usize = 30;
    match text.char_indices().nth(MAX) {
        Some((end, _)) => format!("{}...", &text[..end]),
        None => text.to_string(),
    }
}

/// Writes rows of numbers as CSV, each number with the shortest text that reads back as the same number.
///
/// # Errors
/// Those of the writer.
pub fn write_csv(writer: &mut dyn Write, values: &[f64], columns: usize) -> std::io::Result<()> {
    for row in values.chunks(columns.max(1)) {
        for (index, value) in row.iter().enumerate() {
            let comma = if index == 0 { "" } else { "," };
            write!(writer, "{comma}{value:?}")?;
        }
        writeln!(writer)?;
    }
    Ok(())
}
