//! Channel tables: a protocol as a CSV file.

use crate::files::read_text_at_most;
use crate::protocol::{Channel, Protocol, ProtocolError};
use std::path::Path;

/// Largest file of a channel table, bytes: a million channels of the most electrodes take a quarter of it.
const LARGEST_TABLE: u64 = 128 << 20;

/// The columns of a channel table.
pub(crate) const CHANNEL_COLUMNS: [&str; 5] =
    ["channel", "drive_source", "drive_sink", "measure_plus", "measure_minus"];

/// The columns of a scan table, in which readings have slots and may be no channel: `dermis scan-table` writes it for
/// firmware. Further columns are its own.
pub const SCAN_COLUMNS: [&str; 6] =
    ["slot", CHANNEL_COLUMNS[1], CHANNEL_COLUMNS[2], CHANNEL_COLUMNS[3], CHANNEL_COLUMNS[4], CHANNEL_COLUMNS[0]];

/// The columns of a table of quadripoles, as geophysics writes them: current enters at a and leaves at b, m is plus, n minus.
const QUADRIPOLE_COLUMNS: [&str; 4] = ["a", "b", "m", "n"];

impl Protocol {
    /// A protocol from a channel table, a CSV file with the columns
    /// `channel,drive_source,drive_sink,measure_plus,measure_minus` and a row per value of a frame, or from a scan
    /// table, whose columns are `slot,drive_source,drive_sink,measure_plus,measure_minus,channel`, and more that are not read.
    ///
    /// # Errors
    /// A file that cannot be read; the errors of [`parse_csv`](Self::parse_csv).
    pub fn load(path: &Path, electrode_count: usize) -> Result<Self, ProtocolError> {
        Self::load_numbered(path, electrode_count, None)
    }

    /// As [`load`](Self::load), from a table whose first electrode has a number of its own, usually 1. The table may also have
    /// the columns `a`, `b`, `m` and `n` of geophysics, in any order and among others that are not read, separated by
    /// commas, semicolons, tabs or spaces.
    ///
    /// # Errors
    /// A file that cannot be read; the errors of [`parse_csv`](Self::parse_csv); columns a, b, m, n without
    /// `first_electrode`.
    pub fn load_numbered(
        path: &Path,
        electrode_count: usize,
        first_electrode: Option<usize>,
    ) -> Result<Self, ProtocolError> {
        let name = path.display().to_string();
        let unreadable = |error: std::io::Error| ProtocolError::Table {
            path: name.clone(),
            line: 1,
            message: format!("cannot read the channel table: {error}"),
        };
        let text = read_text_at_most(path, LARGEST_TABLE).map_err(unreadable)?;
        Self::parse_csv_numbered(&text, &name, electrode_count, first_electrode)
    }

    /// A protocol from the text of a channel table or a scan table; errors contain `path`. Of a scan table, readings
    /// without a measurement (of the drive's current) are left out, and the channels may be in any order.
    ///
    /// # Errors
    /// A wrong header, a row of another length, a field that is not a number, channels or slots out of order, a channel
    /// that is missing or there twice (each with its line); a protocol that [`new`](Self::new) refuses.
    pub fn parse_csv(text: &str, path: &str, electrode_count: usize) -> Result<Self, ProtocolError> {
        Self::parse_csv_numbered(text, path, electrode_count, None)
    }

    /// As [`parse_csv`](Self::parse_csv), with the tables of [`load_numbered`](Self::load_numbered).
    ///
    /// # Errors
    /// Those of [`parse_csv`](Self::parse_csv); columns a, b, m, n without `first_electrode`.
    pub fn parse_csv_numbered(
        text: &str,
        path: &str,
        electrode_count: usize,
        first_electrode: Option<usize>,
    ) -> Result<Self, ProtocolError> {
        let wrong = |(line, message): (usize, String)| ProtocolError::Table {
            path: path.to_string(),
            line: line as u64,
            message,
        };
        let text = text.strip_prefix('\u{feff}').unwrap_or(text);
        let mut lines = text.lines().enumerate().map(|(index, line)| (index + 1, line.trim()));
        let header = lines.next().map_or("", |(_, header)| header);
        let is = |columns: &[&str]| header.split(',').map(str::trim).eq(columns.iter().copied());
        let rows = lines.filter(|(_, row)| !row.is_empty());
        let first = first_electrode.unwrap_or(0);
        let rows = if is(&CHANNEL_COLUMNS) {
            channel_rows(rows, first)
        } else if header.split(',').map(str::trim).take(SCAN_COLUMNS.len()).eq(SCAN_COLUMNS) {
            scan_rows(rows, header.split(',').count())
        } else if let Some(columns) = quadripole_columns(header) {
            quadripole_rows(rows, columns, first_electrode)
        } else {
            let [channels, scan] = [CHANNEL_COLUMNS.join(","), SCAN_COLUMNS.join(",")];
            let message = format!(
                "the header is `{header}`, but it must be `{channels}`, or `{scan}` of a scan table, or have the columns \
                 a, b, m and n"
            );
            Err((1, message))
        };
        let channels = rows.and_then(|rows| numbered(&rows, electrode_count, first)).map_err(wrong)?;
        Self::new(electrode_count, channels)
    }
}

/// A line and what is wrong with it.
type Wrong = (usize, String);

/// A line, and the electrodes of its drive and measure pair as it numbers them.
type Row = (usize, [usize; 4]);

/// The channels of rows whose electrodes count from `first`.
pub(crate) fn numbered(rows: &[Row], electrode_count: usize, first: usize) -> Result<Vec<Channel>, Wrong> {
    let all = || rows.iter().flat_map(|(_, electrodes)| electrodes);
    let channel = |&(line, electrodes): &Row| {
        if let Some(wrong) = electrodes.into_iter().find(|&number| number < first || number - first >= electrode_count)
        {
            let last = (first + electrode_count).saturating_sub(1);
            let fix = match wrong {
                // Only a table that counts from 1 has the last number and no 0.
                wrong if first == 0 && wrong == electrode_count && all().all(|&number| number > 0) => {
                    " (if the table counts from 1, write `first_electrode = 1` in [protocol])"
                }
                wrong if wrong < first => {
                    " (a pole at infinity cannot be: the current leaves the sheet at an electrode)"
                }
                _ => "",
            };
            return Err((line, format!("names electrode {wrong}, but the skin has electrodes {first} to {last}{fix}")));
        }
        let [source, sink, plus, minus] = electrodes.map(|number| number - first);
        Ok(Channel { drive: [source, sink], measure: [plus, minus] })
    };
    rows.iter().map(channel).collect()
}

/// The numbers of a row.
fn numbers<const N: usize>(line: usize, fields: [&str; N]) -> Result<[usize; N], Wrong> {
    let mut numbers = [0; N];
    for (number, text) in numbers.iter_mut().zip(fields) {
        *number = text.parse().map_err(|_| (line, format!("`{text}` is no electrode's number (0, 1, 2, ...)")))?;
    }
    Ok(numbers)
}

/// The fields of a row of some columns.
fn fields(line: usize, fields: Vec<&str>, columns: usize) -> Result<Vec<&str>, Wrong> {
    match fields.len() {
        count if count == columns => Ok(fields),
        count => Err((line, format!("{count} values, but there are {columns} columns"))),
    }
}

/// The fields between commas.
fn between_commas(row: &str) -> Vec<&str> {
    row.split(',').map(str::trim).collect()
}

/// The rows of a channel table. Its channels count from 0, or as its electrodes.
fn channel_rows<'a>(rows: impl Iterator<Item = (usize, &'a str)>, first: usize) -> Result<Vec<Row>, Wrong> {
    let mut channels: Vec<Row> = Vec::new();
    let mut from = 0;
    for (line, row) in rows {
        let fields = fields(line, between_commas(row), CHANNEL_COLUMNS.len())?;
        let [channel, electrodes @ ..] = numbers(line, [0, 1, 2, 3, 4].map(|column| fields[column]))?;
        if channels.is_empty() && channel == first {
            from = first;
        }
        let next = from + channels.len();
        if channel != next {
            return Err((line, format!("channel {channel}, but {next} comes next")));
        }
        channels.push((line, electrodes));
    }
    Ok(channels)
}

/// The number of columns of a table of quadripoles, and those of a, b, m and n.
type Quadripoles = (usize, [usize; 4]);

/// The fields of a row with one of the separators of quadripoles.
fn separated(row: &str) -> Vec<&str> {
    match [';', '\t', ','].into_iter().find(|&separator| row.contains(separator)) {
        Some(separator) => row.split(separator).map(str::trim).collect(),
        None => row.split_whitespace().collect(),
    }
}

/// The columns of a header that names a, b, m and n, once each.
fn quadripole_columns(header: &str) -> Option<Quadripoles> {
    let names = separated(header.trim_start_matches('#').trim_start());
    let mut columns = [0; 4];
    for (column, wanted) in columns.iter_mut().zip(QUADRIPOLE_COLUMNS) {
        let is_wanted = |name: &&str| name.trim_matches('"').eq_ignore_ascii_case(wanted);
        *column = names.iter().position(is_wanted)?;
        names[*column + 1..].iter().all(|name| !is_wanted(name)).then_some(())?;
    }
    Some((names.len(), columns))
}

/// The rows of a table of quadripoles.
fn quadripole_rows<'a>(
    rows: impl Iterator<Item = (usize, &'a str)>,
    (count, columns): Quadripoles,
    first_electrode: Option<usize>,
) -> Result<Vec<Row>, Wrong> {
    if first_electrode.is_none() {
        let message = "the electrodes of columns a, b, m, n count from 0 or from 1: write `first_electrode = 1` or \
                       `first_electrode = 0` in [protocol]";
        return Err((1, message.into()));
    }
    let row = |(line, row)| {
        let fields = fields(line, separated(row), count)?;
        Ok((line, numbers(line, columns.map(|column| fields[column]))?))
    };
    rows.map(row).collect()
}

/// The rows of a scan table, in the order of their channels.
fn scan_rows<'a>(rows: impl Iterator<Item = (usize, &'a str)>, columns: usize) -> Result<Vec<Row>, Wrong> {
    let mut found: Vec<(usize, Row)> = Vec::new();
    for (next, (line, row)) in rows.enumerate() {
        let fields = fields(line, between_commas(row), columns)?;
        let [slot, source, sink] = numbers(line, [0, 1, 2].map(|column| fields[column]))?;
        if slot != next {
            return Err((line, format!("slot {slot}, but {next} comes next")));
        }
        let rest = [3, 4, 5].map(|column| fields[column]);
        if rest == ["", "", ""] {
            continue;
        }
        let [plus, minus, channel] = numbers(line, rest)?;
        found.push((channel, (line, [source, sink, plus, minus])));
    }
    found.sort_by_key(|&(channel, (line, _))| (channel, line));
    if let Some((next, (channel, (line, _)))) = found.iter().enumerate().find(|(next, (channel, _))| channel != next) {
        let message = match channel < &next {
            true => format!("channel {channel} is there twice"),
            false => format!("channel {channel}, but channel {next} is missing"),
        };
        return Err((*line, message));
    }
    Ok(found.into_iter().map(|(_, row)| row).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_table_written_and_read_is_the_same_protocol() {
        let protocol = Protocol::opposite(16).unwrap();
        let text = protocol.to_csv().replace('\n', "\r\n");
        assert_eq!(Protocol::parse_csv(&format!("\u{feff}{text}"), "t.csv", 16).unwrap(), protocol);
    }

    #[test]
    fn errors_of_a_table_contain_the_line() {
        let header = "channel,drive_source,drive_sink,measure_plus,measure_minus\n";
        let message = |rows: &str| Protocol::parse_csv(&format!("{header}{rows}"), "t.csv", 8).unwrap_err().to_string();
        assert!(message("0,0,1,2,3\n1,0,1,2\n").starts_with("t.csv, line 3: 4 values"));
        assert!(message("0,0,1,2,x\n").contains("line 2: `x`"));
        assert!(message("1,0,1,2,3\n").contains("channel 1, but 0 comes next"));
        assert!(message("0,0,1,2,8\n").contains("names electrode 8"));
        assert!(message("0,5,5,2,3\n").contains("drives electrode 5 against itself"));
        assert!(message("").contains("no channel"));
        assert!(Protocol::parse_csv("0,0,1,2,3\n", "t.csv", 8).unwrap_err().to_string().contains("header"));
    }

    #[test]
    fn tables_that_count_from_one_are_read_and_suggested() {
        let header = "channel,drive_source,drive_sink,measure_plus,measure_minus\n";
        let read = |text: &str, first| Protocol::parse_csv_numbered(text, "t.csv", 8, first);
        for rows in ["1,1,2,3,4\n2,2,3,4,8\n", "0,1,2,3,4\n1,2,3,4,8\n"] {
            let protocol = read(&format!("{header}{rows}"), Some(1)).unwrap();
            assert_eq!(protocol.channels()[1], Channel { drive: [1, 2], measure: [3, 7] }, "{rows}");
        }
        let message = |rows: &str, first| read(&format!("{header}{rows}"), first).unwrap_err().to_string();
        let error = message("0,1,2,3,4\n1,2,3,4,8\n", None);
        assert!(
            error.starts_with("t.csv, line 3: names electrode 8, but the skin has electrodes 0 to 7 (if"),
            "{error}"
        );
        assert!(error.contains("write `first_electrode = 1` in [protocol]"), "{error}");
        assert!(!message("0,0,2,3,4\n1,2,3,4,8\n", None).contains("first_electrode"), "a table with a 0");
        assert!(message("1,1,2,3,9\n", Some(1)).contains("electrode 9, but the skin has electrodes 1 to 8"));
        assert!(message("1,1,2,3,4\n3,1,2,3,4\n", Some(1)).contains("channel 3, but 2 comes next"));
    }

    #[test]
    fn quadripoles_are_read_by_the_names_of_their_columns() {
        let read = |text: &str, first| Protocol::parse_csv_numbered(text, "t.csv", 8, first);
        let expected = Channel { drive: [0, 3], measure: [1, 2] };
        for text in
            ["A,B,M,N,R\n1,4,2,3,0.5\n", "# a b m n\n1 4 2 3\n", "m;n;a;b\r\n2;3;1;4\r\n", "n\ta\tm\tb\n3\t1\t2\t4"]
        {
            assert_eq!(read(text, Some(1)).unwrap().channels(), [expected], "{text}");
        }
        assert_eq!(read("a,b,m,n\n0,3,1,2\n", Some(0)).unwrap().channels(), [expected]);
        let message = |text: &str, first| read(text, first).unwrap_err().to_string();
        assert!(
            message("a,b,m,n\n1,4,2,3\n", None)
                .contains("t.csv, line 1: the electrodes of columns a, b, m, n count from")
        );
        assert!(
            message("a,b,m,n\n1,0,2,3\n", Some(1))
                .contains("line 2: names electrode 0, but the skin has electrodes 1 to 8 (a pole")
        );
        assert!(message("a,b,m,n\n1,-1,2,3\n", Some(0)).contains("line 2: `-1` is no electrode's number"));
        assert!(message("a,b,m,n\n1,2,3\n", Some(1)).contains("line 2: 3 values, but there are 4 columns"));
        assert!(message("a,b,m,m\n1,2,3,4\n", Some(1)).contains("the header is `a,b,m,m`"));
    }

    #[test]
    fn the_slots_of_a_scan_table_are_checked_and_currents_left_out() {
        let header = SCAN_COLUMNS.join(",");
        let parse = |rows: &str| Protocol::parse_csv(&format!("{header}\n{rows}"), "t.csv", 8);
        // Drives are scanned one after the other, although their channels take turns.
        let protocol = parse("0,0,1,,,\n1,0,1,2,3,0\n2,0,1,3,4,2\n3,1,2,,,\n4,1,2,3,4,1\n").unwrap();
        let expected = "0,0,1,2,3\n1,1,2,3,4\n2,0,1,3,4\n";
        assert_eq!(protocol.to_csv(), format!("{}\n{expected}", CHANNEL_COLUMNS.join(",")));
        let message = |rows: &str| parse(rows).unwrap_err().to_string();
        assert!(message("0,0,1,2,3,0\n2,0,1,3,4,1\n").starts_with("t.csv, line 3: slot 2, but 1 comes next"));
        assert!(message("0,0,1,2,3,0\n1,0,1,3,4,0\n").starts_with("t.csv, line 3: channel 0 is there twice"));
        assert!(message("0,0,1,2,3,0\n1,0,1,3,4,2\n").contains("line 3: channel 2, but channel 1 is missing"));
        assert!(message("0,0,1,2,,0\n").contains("line 2: ``"));
        assert!(message("0,0,1,2,3\n").contains("line 2: 5 values, but there are 6 columns"));
        assert!(message("0,0,1,,,\n").contains("no channel"));
    }
}
