//! Channels of a protocol, as arguments name them.

use dermis::files::{MAX_SETTINGS_BYTES, read_text_at_most};
use std::path::Path;
use std::str::FromStr;

/// The help of `--leave-out`, the same for every command.
pub const LEAVE_OUT_HELP: &str = "Channels to leave out: numbers and ranges, as in 0-23,40; or a file with such a list, on \
    one line or several. Their values may be missing or NaN";

/// Channels by number and range, as in `0-23,40`, or those listed in a file.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Channels(Vec<usize>);

/// A protocol with the maximum number of electrodes has about one million channels.
const MAX_CHANNELS: usize = 2_000_000;

impl Channels {
    /// Their numbers.
    pub fn numbers(&self) -> &[usize] {
        &self.0
    }

    /// Channels from the text of a file: numbers and ranges, separated by commas, semicolons, spaces or lines. A name
    /// of the column above them and comments after `#` are ignored.
    fn of_file(text: &str, path: &Path) -> Result<Self, String> {
        let mut channels = Vec::new();
        for (index, line) in text.trim_start_matches('\u{feff}').lines().enumerate() {
            let line = line.split('#').next().unwrap_or_default().trim();
            if index == 0 && line.trim_matches('"').starts_with(char::is_alphabetic) {
                continue;
            }
            for part in line.split([',', ';', ' ', '\t']).filter(|part| !part.is_empty()) {
                let range = range(part).map_err(|why| format!("{}, line {}: {why}", path.display(), index + 1))?;
                channels.extend(range);
                if channels.len() > MAX_CHANNELS {
                    return Err(format!("{}: more than {MAX_CHANNELS} channels", path.display()));
                }
            }
        }
        Ok(Channels(channels))
    }
}

impl FromStr for Channels {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let is_list = |c: char| c.is_ascii_digit() || c.is_whitespace() || c == ',' || c == '-';
        if text.chars().all(is_list) {
            let parts = text.split(',').filter(|part| !part.trim().is_empty());
            return Ok(Channels(parts.map(range).collect::<Result<Vec<_>, _>>()?.into_iter().flatten().collect()));
        }
        let path = Path::new(text);
        let read = read_text_at_most(path, MAX_SETTINGS_BYTES)
            .map_err(|error| format!("neither a list of channels, as in 0-23,40, nor a file: {error}"))?;
        Self::of_file(&read, path)
    }
}

/// A number, or the first and the last one of a range.
fn range(text: &str) -> Result<std::ops::RangeInclusive<usize>, String> {
    let number =
        |text: &str| text.trim().parse::<usize>().map_err(|_| format!("`{text}` is not the number of a channel"));
    let (first, last) = text.split_once('-').unwrap_or((text, text));
    let (first, last) = (number(first)?, number(last)?);
    if last < first || last - first > MAX_CHANNELS {
        return Err(format!("`{text}` is not a range of channels"));
    }
    Ok(first..=last)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_list_is_read_from_the_argument_or_a_file() {
        assert_eq!("0-2, 7".parse::<Channels>().unwrap().numbers(), [0, 1, 2, 7]);
        assert!("".parse::<Channels>().unwrap().numbers().is_empty());
        let read = |text: &str| Channels::of_file(text, Path::new("dead.csv"));
        for text in ["0-2,7\n", "channel\n0\n1\n2\n7", "\u{feff}# dead\n0-2 # a drive\n\n7\n", "0;1;2\r\n7\r\n"] {
            assert_eq!(read(text).unwrap().numbers(), [0, 1, 2, 7], "{text}");
        }
        assert_eq!(read("0\n5-3\n").unwrap_err(), "dead.csv, line 2: `5-3` is not a range of channels");
        assert_eq!(read("0\nx\n").unwrap_err(), "dead.csv, line 2: `x` is not the number of a channel");
        assert!("dead.csv".parse::<Channels>().unwrap_err().starts_with("neither a list of channels"));
        for wrong in ["3-1", "1-2-3", "-1"] {
            assert!(wrong.parse::<Channels>().is_err(), "{wrong}");
        }
    }
}
