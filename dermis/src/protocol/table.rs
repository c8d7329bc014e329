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

impl Protocol {
    /// A protocol from a channel table, a CSV file with the columns
    /// `channel,drive_source,drive_sink,measure_plus,measure_minus` and a row per value of a frame, or from a scan
    /// table, whose columns are `slot,drive_source,drive_sink,measure_plus,measure_minus,channel`, and more that are not read.
    ///
    /// # Errors
    /// A file that cannot be read; the errors of [`parse_csv`](Self::parse_csv).
    pub fn load(path: &Path, electrode_count: usize) -> Result<Self, ProtocolError> {
        let name = path.display().to_string();
        let unreadable = |error: std::io::Error| ProtocolError::Table {
            path: name.clone(),
            line: 1,
            message: format!("cannot read the channel table: {error}"),
        };
        let text = read_text_at_most(path, LARGEST_TABLE).map_err(unreadable)?;
        Self::parse_csv(&text, &name, electrode_count)
    }

    /// A protocol from the text of a channel table or a scan table; errors contain `path`. Of a scan table, readings
    /// without a measurement (of the drive's current) are left out, and the channels may be in any order.
    ///
    /// # Errors
    /// A wrong header, a row of another length, a field that is not a number, channels or slots out of order, a channel
    /// that is missing or there twice (each with its line); a protocol that [`new`](Self::new) refuses.
    pub fn parse_csv(text: &str, path: &str, electrode_count: usize) -> Result<Self, ProtocolError> {
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
        let channels = if is(&CHANNEL_COLUMNS) {
            channel_rows(rows).map_err(wrong)?
        } else if header.split(',').map(str::trim).take(SCAN_COLUMNS.len()).eq(SCAN_COLUMNS) {
            scan_rows(rows, header.split(',').count()).map_err(wrong)?
        } else {
            let [channels, scan] = [CHANNEL_COLUMNS.join(","), SCAN_COLUMNS.join(",")];
            let message = format!("the header is `{header}`, but it must be `{channels}`, or `{scan}` of a scan table");
            return Err(wrong((1, message)));
        };
        Self::new(electrode_count, channels)
    }
}

/// A line and what is wrong with it.
type Wrong = (usize, String);

/// The numbers of a row.
fn numbers(line: usize, fields: &[&str]) -> Result<Vec<usize>, Wrong> {
    let number =
        |text: &&str| text.parse().map_err(|_| (line, format!("`{text}` is no electrode's number (0, 1, 2, ...)")));
    fields.iter().map(number).collect()
}

/// The fields of a row of some columns.
fn fields(line: usize, row: &str, columns: usize) -> Result<Vec<&str>, Wrong> {
    let fields: Vec<&str> = row.split(',').map(str::trim).collect();
    match fields.len() {
        count if count == columns => Ok(fields),
        count => Err((line, format!("{count} values, but there are {columns} columns"))),
    }
}

/// The rows of a channel table.
fn channel_rows<'a>(rows: impl Iterator<Item = (usize, &'a str)>) -> Result<Vec<Channel>, Wrong> {
    let mut channels = Vec::new();
    for (line, row) in rows {
        let numbers = numbers(line, &fields(line, row, CHANNEL_COLUMNS.len())?)?;
        if numbers[0] != channels.len() {
            return Err((line, format!("channel {}, but {} comes next", numbers[0], channels.len())));
        }
        channels.push(Channel { drive: [numbers[1], numbers[2]], measure: [numbers[3], numbers[4]] });
    }
    Ok(channels)
}

/// The rows of a scan table.
fn scan_rows<'a>(rows: impl Iterator<Item = (usize, &'a str)>, columns: usize) -> Result<Vec<Channel>, Wrong> {
    let mut found: Vec<(usize, usize, Channel)> = Vec::new();
    for (next, (line, row)) in rows.enumerate() {
        let fields = &fields(line, row, columns)?[..SCAN_COLUMNS.len()];
        let first = numbers(line, &fields[..3])?;
        if first[0] != next {
            return Err((line, format!("slot {}, but {next} comes next", first[0])));
        }
        if fields[3..].iter().all(|field| field.is_empty()) {
            continue;
        }
        let rest = numbers(line, &fields[3..])?;
        found.push((rest[2], line, Channel { drive: [first[1], first[2]], measure: [rest[0], rest[1]] }));
    }
    found.sort_by_key(|(channel, line, _)| (*channel, *line));
    if let Some((next, (channel, line, _))) = found.iter().enumerate().find(|(next, (channel, ..))| channel != next) {
        let message = match channel < &next {
            true => format!("channel {channel} is there twice"),
            false => format!("channel {channel}, but channel {next} is missing"),
        };
        return Err((*line, message));
    }
    Ok(found.into_iter().map(|(.., channel)| channel).collect())
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
