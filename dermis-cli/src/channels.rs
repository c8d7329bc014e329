//! Channels of a protocol, as arguments name them.

use crate::failure::{Failure, Outcome};
use crate::range::count;
use clap::Args;
use dermis::design::MAX_ELECTRODES;
use dermis::files::{MAX_SETTINGS_BYTES, read_text_at_most};
use dermis::protocol::Protocol;
use std::path::Path;
use std::str::FromStr;

/// The channels that a command leaves out.
#[derive(Debug, Clone, Args)]
pub struct LeaveOutArguments {
    /// Channels to leave out: numbers and ranges, as in 0-23,40; or a file with such a list, on one line or several. Their
    /// values may be missing or NaN.
    #[arg(long, value_name = "CHANNELS|FILE", default_value = "", hide_default_value = true)]
    leave_out: Channels,
    #[command(flatten)]
    electrodes: LeaveOutElectrodes,
}

/// The electrodes whose channels a command leaves out.
#[derive(Debug, Clone, Args)]
pub struct LeaveOutElectrodes {
    /// Electrode to leave out, from 0: every channel that drives or measures at it. May be given more than once.
    #[arg(long, value_name = "N", value_parser = count(0..=MAX_ELECTRODES - 1))]
    leave_out_electrode: Vec<usize>,
}

impl LeaveOutArguments {
    /// The numbers of the channels of a protocol that are left out.
    pub fn of(&self, protocol: &Protocol) -> Outcome<Vec<usize>> {
        let electrodes = self.electrodes.of(protocol)?;
        if let Some(channel) = self.leave_out.0.iter().find(|&&channel| channel >= protocol.channel_count()) {
            let message =
                format!("cannot leave channel {channel} out: the channels are 0 to {}", protocol.channel_count() - 1);
            return Err(Failure::given(message, Some("channels are numbered from 0")));
        }
        let uses = |channel: &usize| electrodes.iter().any(|&electrode| protocol.channels()[*channel].uses(electrode));
        let mut channels = self.leave_out.0.clone();
        channels.extend((0..protocol.channel_count()).filter(uses));
        channels.sort_unstable();
        channels.dedup();
        Ok(channels)
    }
}

impl LeaveOutElectrodes {
    /// Whether there are any.
    pub fn are_given(&self) -> bool {
        !self.leave_out_electrode.is_empty()
    }

    /// Their numbers.
    pub fn of(&self, protocol: &Protocol) -> Outcome<Vec<usize>> {
        let count = protocol.electrode_count();
        if let Some(electrode) = self.leave_out_electrode.iter().find(|&&electrode| electrode >= count) {
            let message = format!("--leave-out-electrode {electrode}: the skin has electrodes 0 to {}", count - 1);
            return Err(Failure::given(message, Some("electrodes are numbered from 0")));
        }
        let mut electrodes = self.leave_out_electrode.clone();
        electrodes.sort_unstable();
        electrodes.dedup();
        Ok(electrodes)
    }
}

/// Channels by number and range, as in `0-23,40`, or those listed in a file.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
struct Channels(Vec<usize>);

/// A protocol with the maximum number of electrodes has about one million channels.
const MAX_CHANNELS: usize = 2_000_000;

impl Channels {
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
    fn an_electrode_is_left_out_with_all_its_channels() {
        let protocol = Protocol::adjacent_undriven(8).unwrap();
        let leave_out = |channels: &str, electrodes: &[usize]| {
            let electrodes = LeaveOutElectrodes { leave_out_electrode: electrodes.to_vec() };
            LeaveOutArguments { leave_out: channels.parse().unwrap(), electrodes }.of(&protocol)
        };
        let left_out = leave_out("0,1,1", &[3, 3]).unwrap();
        for (index, channel) in protocol.channels().iter().enumerate() {
            assert_eq!(left_out.contains(&index), index < 2 || channel.uses(3), "{index}");
        }
        assert!(left_out.is_sorted_by(|a, b| a < b));
        let Err(Failure::Given(error)) = leave_out("", &[8]) else { panic!("electrode 8 of 8") };
        assert_eq!(error.to_string(), "--leave-out-electrode 8: the skin has electrodes 0 to 7");
    }

    #[test]
    fn a_list_is_read_from_the_argument_or_a_file() {
        assert_eq!("0-2, 7".parse::<Channels>().unwrap().0, [0, 1, 2, 7]);
        assert!("".parse::<Channels>().unwrap().0.is_empty());
        let read = |text: &str| Channels::of_file(text, Path::new("dead.csv"));
        for text in ["0-2,7\n", "channel\n0\n1\n2\n7", "\u{feff}# dead\n0-2 # a drive\n\n7\n", "0;1;2\r\n7\r\n"] {
            assert_eq!(read(text).unwrap().0, [0, 1, 2, 7], "{text}");
        }
        assert_eq!(read("0\n5-3\n").unwrap_err(), "dead.csv, line 2: `5-3` is not a range of channels");
        assert_eq!(read("0\nx\n").unwrap_err(), "dead.csv, line 2: `x` is not the number of a channel");
        assert!("dead.csv".parse::<Channels>().unwrap_err().starts_with("neither a list of channels"));
        for wrong in ["3-1", "1-2-3", "-1"] {
            assert!(wrong.parse::<Channels>().is_err(), "{wrong}");
        }
    }
}
