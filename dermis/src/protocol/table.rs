//! Channel tables: a protocol as a CSV file.

use crate::protocol::{Channel, Protocol, ProtocolError};
use std::path::Path;

/// The columns of a channel table.
const COLUMNS: [&str; 5] = ["channel", "drive_source", "drive_sink", "measure_plus", "measure_minus"];

impl Protocol {
    /// A protocol from a channel table, a CSV file with the columns
    /// `channel,drive_source,drive_sink,measure_plus,measure_minus` and a row per value of a frame.
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
        let text = std::fs::read_to_string(path).map_err(unreadable)?;
        Self::parse_csv(&text, &name, electrode_count)
    }

    /// A protocol from the text of a channel table; errors contain `path`.
    ///
    /// # Errors
    /// A wrong header, a row of another length, a field that is not a number, channels out of order (each with its
    /// line); a protocol that [`new`](Self::new) refuses.
    pub fn parse_csv(text: &str, path: &str, electrode_count: usize) -> Result<Self, ProtocolError> {
        let wrong =
            |line: usize, message: String| ProtocolError::Table { path: path.to_string(), line: line as u64, message };
        let text = text.strip_prefix('\u{feff}').unwrap_or(text);
        let mut lines = text.lines().enumerate().map(|(index, line)| (index + 1, line.trim()));
        let header = lines.next().map_or("", |(_, header)| header);
        if header.split(',').map(str::trim).ne(COLUMNS) {
            return Err(wrong(1, format!("the header is `{header}`, but it must be `{}`", COLUMNS.join(","))));
        }
        let mut channels = Vec::new();
        for (line, row) in lines.filter(|(_, row)| !row.is_empty()) {
            let numbers = row
                .split(',')
                .map(|text| text.trim().parse::<usize>().map_err(|_| text.trim()))
                .collect::<Result<Vec<_>, _>>()
                .map_err(|text| wrong(line, format!("`{text}` is no electrode's number (0, 1, 2, ...)")))?;
            let &[channel, source, sink, plus, minus] = numbers.as_slice() else {
                return Err(wrong(line, format!("{} values, but there are 5 columns", numbers.len())));
            };
            if channel != channels.len() {
                return Err(wrong(line, format!("channel {channel}, but {} comes next", channels.len())));
            }
            channels.push(Channel { drive: [source, sink], measure: [plus, minus] });
        }
        Self::new(electrode_count, channels)
    }
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
}
