//! Frames from lines of text, one after the other, as an instrument prints them.

use crate::frame::csv;
use crate::frame::names::{ColumnName, beside_channels, fitted, lacks_channels};
use crate::frame::text::values_of;
use thiserror::Error;

/// Reads frames from lines of text: a row of values in each, in the order of the protocol's channels.
///
/// The rules are those of [`read_frames`](crate::frame::read_frames), with these differences. Each line has its own separator,
/// headers may come again, each line is a frame, and a wrong line is an error of this line only. The first column, if there is
/// one more than the protocol has channels, is told by its first two values where it has no name.
///
/// ```
/// use dermis::frame::FrameLines;
///
/// let mut lines = FrameLines::new(2);
/// let mut frames = Vec::new();
/// for line in ["# bridge 3", "time_s,left,right", "0.00,1.5,2.5", "0.01,1.5,x", "0.02,1.6,2.4"] {
///     frames.extend(lines.take(line));
/// }
/// let frame = frames[0].as_ref().map(|frame| (frame.time_s, frame.values.as_slice()));
/// assert_eq!(frame, Ok((Some(0.0), &[1.5, 2.5][..])));
/// assert_eq!(frames[1].as_ref().unwrap_err().to_string(), "line 4, column 3: `x` is not a number");
/// assert_eq!(frames[2].as_ref().unwrap().line, 5);
/// ```
#[derive(Debug, Clone)]
pub struct FrameLines {
    channel_count: usize,
    line: u64,
    /// The names of the columns in the last header.
    header: Vec<String>,
    columns: Columns,
    any_frame: bool,
}

/// A frame in a line of text.
#[derive(Debug, Clone, PartialEq)]
pub struct FrameLine {
    /// The number of the line, from 1.
    pub line: u64,
    /// Its time, s, where the lines have times.
    pub time_s: Option<f64>,
    /// A value for each channel.
    pub values: Vec<f64>,
}

/// A line that is not a row of values.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[error("line {line}{}: {message}", column.map(|column| format!(", column {column}")).unwrap_or_default())]
pub struct LineError {
    /// The number of the line, from 1.
    pub line: u64,
    /// 1-based column, if a single value is wrong.
    pub column: Option<usize>,
    /// What is wrong.
    pub message: String,
}

/// Which columns are no channels.
#[derive(Debug, Clone, PartialEq)]
enum Columns {
    /// Not known before the first row.
    Unknown,
    /// A row with one value more waits for the next one.
    Waiting(u64, Vec<f64>),
    /// Those with times or row numbers, ascending, and the one with times.
    Known { beside: Vec<usize>, time: Option<usize> },
}

impl FrameLines {
    /// For frames of a protocol with some channels.
    pub fn new(channel_count: usize) -> Self {
        FrameLines { channel_count, line: 0, header: Vec::new(), columns: Columns::Unknown, any_frame: false }
    }

    /// Reads the next line: none, one or two frames or errors, as the second row of values may explain the first.
    pub fn take(&mut self, text: &str) -> Vec<Result<FrameLine, LineError>> {
        self.line += 1;
        let text = if self.line == 1 { text.trim_start_matches('\u{feff}') } else { text }.trim();
        if csv::is_skipped(text) {
            return Vec::new();
        }
        let (_, text) = values_of(text);
        let separator = csv::separator(std::iter::once(text));
        if self.skips_header(text, separator) {
            return Vec::new();
        }
        // Instruments that print a separator after every value.
        let fields = csv::split(text, separator).len();
        let text = match text.strip_suffix(separator) {
            Some(text) if fields > self.channel_count => text,
            _ => text,
        };
        let row = csv::numbers(text, csv::Reading { separator, gaps: false, part: None, first_is_real: false })
            .map_err(|(column, message)| self.error(column, message));
        let taken = match row.and_then(|row| self.checked(row)) {
            Ok(row) => self.frames(row),
            Err(error) => vec![Err(error)],
        };
        self.any_frame |= taken.iter().any(Result::is_ok);
        taken
    }

    /// The row that waits for the next one, where there is none.
    pub fn finish(&mut self) -> Option<FrameLine> {
        match std::mem::replace(&mut self.columns, Columns::Unknown) {
            Columns::Waiting(line, row) => {
                Some(FrameLine { line, time_s: None, values: row.into_iter().skip(1).collect() })
            }
            _ => None,
        }
    }

    /// Number of lines read.
    pub fn line_count(&self) -> u64 {
        self.line
    }

    fn error(&self, column: Option<usize>, message: String) -> LineError {
        LineError { line: self.line, column, message }
    }

    /// Whether a line is a header. Before the first frame, any line without a number is one.
    fn skips_header(&mut self, text: &str, separator: char) -> bool {
        let names = csv::names(text, separator);
        let is_header = if self.any_frame {
            names == self.header
        } else {
            csv::is_header(text, separator, Some(self.channel_count))
        };
        if is_header {
            self.header = names;
        }
        is_header
    }

    /// The names of the columns of a row, and which of them are no channels by these; none without a name for each value.
    fn named(&self, row: &[f64]) -> (Vec<String>, Vec<usize>) {
        let header = fitted(self.header.clone(), row.len(), || false);
        let beside = if header.len() == row.len() { beside_channels(&header) } else { Vec::new() };
        (header, beside)
    }

    /// A row with the right number of finite values.
    fn checked(&self, row: Vec<f64>) -> Result<Vec<f64>, LineError> {
        let beside = match &self.columns {
            Columns::Unknown => {
                let (header, beside) = self.named(&row);
                if let Some(message) = lacks_channels(&header, &beside, self.channel_count) {
                    return Err(self.error(None, message));
                }
                beside.len()
            }
            Columns::Waiting(..) => 1,
            Columns::Known { beside, .. } => beside.len(),
        };
        let least = self.channel_count + beside;
        let most = if self.columns == Columns::Unknown && beside == 0 { least + 1 } else { least };
        if !(least..=most).contains(&row.len()) {
            let amount = if row.len() < least { "too few" } else { "too many" };
            let extra = match beside {
                0 => String::new(),
                1 => " and a first column".to_string(),
                count => format!(" and {count} other columns"),
            };
            let message = format!("{amount} values: {}, but frames have {}{extra}", row.len(), self.channel_count);
            return Err(self.error(None, message));
        }
        match row.iter().position(|value| !value.is_finite()) {
            Some(column) => {
                let message = format!("the value is {}: it must be finite", row[column]);
                Err(self.error(Some(column + 1), message))
            }
            None => Ok(row),
        }
    }

    /// The frames that are known with this row.
    fn frames(&mut self, row: Vec<f64>) -> Vec<Result<FrameLine, LineError>> {
        match std::mem::replace(&mut self.columns, Columns::Unknown) {
            Columns::Unknown => match self.known(&row) {
                Ok(known) => self.columns = known,
                Err(error) => return vec![Err(error)],
            },
            Columns::Waiting(line, first) => return self.both(line, first, row),
            known => self.columns = known,
        }
        match self.columns {
            Columns::Waiting(..) => Vec::new(),
            _ => vec![Ok(self.frame(self.line, row))],
        }
    }

    /// What the columns are by the first row and their names.
    fn known(&self, row: &[f64]) -> Result<Columns, LineError> {
        let (header, beside) = self.named(row);
        let is = |kind: ColumnName| beside.iter().copied().find(|&column| ColumnName::of(&header[column]) == kind);
        let time = is(ColumnName::Seconds);
        if let Some(column) = is(ColumnName::OtherTimes).filter(|_| time.is_none()) {
            let name = &header[column];
            let message =
                format!("the times of the column `{name}` are not in seconds: send seconds, or leave them out");
            return Err(self.error(Some(column + 1), message));
        }
        let is_known = row.len() == self.channel_count + beside.len();
        Ok(if is_known { Columns::Known { beside, time } } else { Columns::Waiting(self.line, row.to_vec()) })
    }

    /// The first two rows, whose first column has no name.
    fn both(&mut self, line: u64, first: Vec<f64>, second: Vec<f64>) -> Vec<Result<FrameLine, LineError>> {
        let column = [first[0], second[0]];
        let is_counted = csv::counts(column.into_iter());
        if !is_counted && column[0] >= column[1] {
            let message = format!(
                "too many values: {}, but frames have {}; the first column is no time: it does not increase",
                first.len(),
                self.channel_count
            );
            return [line, self.line]
                .map(|line| Err(LineError { line, column: None, message: message.clone() }))
                .into();
        }
        self.columns = Columns::Known { beside: vec![0], time: (!is_counted).then_some(0) };
        vec![Ok(self.frame(line, first)), Ok(self.frame(self.line, second))]
    }

    fn frame(&self, line: u64, mut row: Vec<f64>) -> FrameLine {
        let Columns::Known { beside, time } = &self.columns else {
            return FrameLine { line, time_s: None, values: row };
        };
        let time_s = time.map(|column| row[column]);
        beside.iter().rev().for_each(|&column| _ = row.remove(column));
        FrameLine { line, time_s, values: row }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The frames of a text of two channels, and the messages about its other lines.
    fn read(text: &str) -> (Vec<FrameLine>, Vec<String>) {
        let mut lines = FrameLines::new(2);
        let taken: Vec<_> = text.lines().flat_map(|line| lines.take(line)).collect();
        let (mut frames, mut errors) = (Vec::new(), Vec::new());
        for one in taken.into_iter().chain(lines.finish().map(Ok)) {
            match one {
                Ok(frame) => frames.push(frame),
                Err(error) => errors.push(error.to_string()),
            }
        }
        (frames, errors)
    }

    fn frame(line: u64, time_s: Option<f64>, values: [f64; 2]) -> FrameLine {
        FrameLine { line, time_s, values: values.to_vec() }
    }

    #[test]
    fn any_separator_headers_and_comments() {
        let expected = |from: u64| vec![frame(from, None, [1.5, -2.0]), frame(from + 1, None, [3.0, 4e-3])];
        assert_eq!(read("1.5,-2\n3,4e-3\n"), (expected(1), vec![]));
        assert_eq!(read("\u{feff}left;right\n1,5;-2\n3;0,004\n"), (expected(2), vec![]));
        assert_eq!(read("# made by x\n\nleft right\n1.5 -2\n3\t4e-3\n"), (expected(4), vec![]));
        assert_eq!(read("0,1\n1.5,-2\n3,4e-3\n"), (expected(2), vec![]), "a header that numbers the columns");
        let again = read("left,right\n1.5,-2\nleft,right\n3,4e-3\n");
        assert_eq!(again, (vec![frame(2, None, [1.5, -2.0]), frame(4, None, [3.0, 4e-3])], vec![]));
    }

    #[test]
    fn a_first_column_is_row_numbers_or_times() {
        let times = |text: &str| read(text).0.iter().map(|frame| frame.time_s).collect::<Vec<_>>();
        assert_eq!(times("0,1,2\n1,1,2\n2,1,2\n"), [None; 3]);
        assert_eq!(times("0,1,2\n0.5,1,2\n1,1,2\n"), [Some(0.0), Some(0.5), Some(1.0)]);
        assert_eq!(times("Time [s],a,b\n0,1,2\n1,1,2\n"), [Some(0.0), Some(1.0)], "its name decides");
        assert_eq!(times("frame,a,b\n7,1,2\n9,1,2\n"), [None; 2]);
        assert_eq!(times(",0,1\n0,1,2\n1,1,2\n"), [None; 2], "as pandas writes it");
        assert_eq!(read("5,1,2\n"), (vec![frame(1, None, [1.0, 2.0])], vec![]), "a single row");
        let (frames, errors) = read("5,1,2\n5,1,2\n");
        assert!(frames.is_empty() && errors.len() == 2 && errors[0].starts_with("line 1: too many values: 3"));
        assert!(read("time_ms,a,b\n5,1,2\n").1[0].contains("not in seconds"));
        assert_eq!(times("frame,time_s,a,b\n7,0.5,1,2\n8,1,1,2\n"), [Some(0.5), Some(1.0)]);
        assert_eq!(
            read("a,b,time_s\n1,2,0.5\n"),
            (vec![frame(2, Some(0.5), [1.0, 2.0])], vec![]),
            "in the last column"
        );
    }

    #[test]
    fn what_is_no_channel_by_its_name_or_no_name_is_told() {
        let lacking = "line 2: the first column is `time_s`, so the rows have 1 values, not 2";
        assert!(read("time_s,a\n0.5,1\n").1[0].starts_with(lacking));
        let (frames, errors) = read("OVLD,OVLD\n1.5D+02,2\n1.5|2\n");
        assert_eq!(frames, [frame(3, None, [1.5, 2.0])]);
        let fix = "is not a number: write it as -1.5e+02, or NaN where there is no value";
        assert_eq!(errors, [format!("line 1, column 1: `OVLD` {fix}"), format!("line 2, column 1: `1.5D+02` {fix}")]);
    }

    #[test]
    fn a_wrong_line_is_named_and_the_others_are_read() {
        let (frames, errors) = read("5,2\n1\n1,2,3\n1,NaN\nx,2\noverflow\n5,2\n");
        assert_eq!(frames, [frame(1, None, [5.0, 2.0]), frame(7, None, [5.0, 2.0])]);
        assert_eq!(
            errors,
            [
                "line 2: too few values: 1, but frames have 2",
                "line 3: too many values: 3, but frames have 2",
                "line 4, column 2: the value is NaN: it must be finite",
                "line 5, column 1: `x` is not a number",
                "line 6, column 1: `overflow` is not a number: write it as -1.5e+02, or NaN where there is no value",
            ]
        );
    }

    proptest::proptest! {
        /// Any text gives frames or errors, never a panic.
        #[test]
        fn no_text_panics(lines in proptest::collection::vec("[0-9a-z.,; eE+-]{0,12}|\\PC*", 0..12)) {
            let mut reader = FrameLines::new(2);
            for one in lines.iter().flat_map(|line| reader.take(line)).collect::<Vec<_>>() {
                proptest::prop_assert!(one.is_err() || one.is_ok_and(|frame| frame.values.len() == 2));
            }
        }
    }
}
