//! Columns by their names: times, row numbers and channels.

use crate::frame::Table;
use crate::protocol::{Channel, Protocol};
use std::collections::BTreeMap;

/// Names of a column of times, s.
const TIMES: [&str; 8] = ["time", "time_s", "t", "t_s", "seconds", "timestamp", "timestamp_s", "measured_s"];
/// Names of a column of row numbers; pandas writes an empty one.
const ROW_NUMBERS: [&str; 8] = ["", "frame", "frame_number", "index", "number", "row", "sample", "sequence"];

/// What a column is by its name.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum ColumnName {
    Seconds,
    OtherTimes,
    RowNumbers,
    Other,
}

impl ColumnName {
    pub(super) fn of(name: &str) -> Self {
        let name = name.to_lowercase().replace([' ', '(', '['], "_").replace([')', ']'], "").replace("__", "_");
        let is_other_unit = ["_ms", "_us", "_ns", "_min", "_h"].iter().any(|unit| name.ends_with(unit));
        if TIMES.contains(&name.as_str()) {
            ColumnName::Seconds
        } else if is_other_unit && (name.starts_with('t') || name.starts_with("measured")) {
            ColumnName::OtherTimes
        } else if ROW_NUMBERS.contains(&name.as_str()) {
            ColumnName::RowNumbers
        } else {
            ColumnName::Other
        }
    }
}

/// The names of the columns of rows with some values: without empty ones at the end, as of a separator there, and with an empty
/// one for a first column of row numbers, which R does not name.
pub(super) fn fitted(mut header: Vec<String>, values: usize, is_numbered: impl Fn() -> bool) -> Vec<String> {
    while header.len() > values && header.last().is_some_and(String::is_empty) {
        header.pop();
    }
    let is_other = header.first().is_some_and(|name| ColumnName::of(name) == ColumnName::Other);
    if header.len() + 1 == values && is_other && is_numbered() {
        header.insert(0, String::new());
    }
    header
}

/// The columns of times and row numbers by their names: of the first two and, with times, the last.
pub(super) fn beside_channels(header: &[String]) -> Vec<usize> {
    let kind = |column: usize| ColumnName::of(&header[column]);
    let first = (0..header.len().min(2)).take_while(|&column| kind(column) != ColumnName::Other);
    let last = (2.max(header.len().saturating_sub(1))..header.len())
        .filter(|&column| matches!(kind(column), ColumnName::Seconds | ColumnName::OtherTimes));
    first.chain(last).collect()
}

/// What is wrong with rows that have as many values as channels only with the columns beside these.
pub(super) fn lacks_channels(header: &[String], beside: &[usize], channels: usize) -> Option<String> {
    let values = header.len() - beside.len();
    let column = beside.iter().copied().find(|_| values < channels && channels <= header.len())?;
    let place = if column < 2 { ["first", "second"][column] } else { "last" };
    let is_named = format!("is `{}`", header[column]);
    let is_named = if header[column].is_empty() { "has no name, as row numbers" } else { &is_named };
    Some(format!(
        "the {place} column {is_named}, so the rows have {values} values, not {channels}: add what is missing, or if the column is \
         a channel, call it `ch0` or remove the header"
    ))
}

/// A table without the columns that are named as times or row numbers. Frames as columns keep theirs, of the channels' numbers.
///
/// # Errors
/// Rows that lack channels.
pub(super) fn without_times(mut table: Table, channels: usize) -> Result<Table, String> {
    let width = table.rows[0].len();
    let Some(header) = table.header.as_mut().filter(|header| header.len() == width) else { return Ok(table) };
    let beside = beside_channels(header);
    if beside.is_empty() || beside.len() == width || (table.rows.len() == channels && width < channels) {
        return Ok(table);
    }
    // Complex values may be pairs of columns.
    if let Some(message) = [channels, 2 * channels].iter().find_map(|&count| lacks_channels(header, &beside, count)) {
        return Err(message);
    }
    for &column in beside.iter().rev() {
        header.remove(column);
        table.rows.iter_mut().for_each(|row| _ = row.remove(column));
    }
    Ok(table)
}

/// The columns of a table in the [order](column_order) of the channels; columns of other names are then dropped. A table whose
/// names say nothing is returned as it is.
///
/// # Errors
/// As [`column_order`].
pub(super) fn in_order(mut table: Table, protocol: &Protocol) -> Result<Table, String> {
    let (width, channels) = (table.rows[0].len(), protocol.channel_count());
    let Some(header) = table.header.as_ref() else { return Ok(table) };
    let order = if header.len() == width { named_order(header, protocol)? } else { None };
    if let Some(order) = order {
        table.rows.iter_mut().for_each(|row| *row = order.iter().map(|&column| row[column]).collect());
        table.header = None;
    } else if table.rows.len() != channels || width >= channels {
        // Of frames as columns, the names are those of frames.
        check_turn(header, channels)?;
    }
    Ok(table)
}

/// The column of each channel, where the names of columns say which channels they are: four electrodes, as in `v_0_1_2_3` (drive
/// source and sink, measure plus and minus), the number of the channel, as in `ch12`, or both, as in `ch12:0_1_2_3`. Electrodes and
/// channels count from 0 or 1. `None` where most names say nothing of the kind.
///
/// # Errors
/// A channel without a column, or with several; names that are out of order and do not say which channels they are.
pub fn column_order(header: &[String], protocol: &Protocol) -> Result<Option<Vec<usize>>, String> {
    let order = named_order(header, protocol)?;
    if order.is_none() {
        check_turn(header, protocol.channel_count())?;
    }
    Ok(order)
}

/// [`column_order`] where names that say nothing may be in any order.
fn named_order(header: &[String], protocol: &Protocol) -> Result<Option<Vec<usize>>, String> {
    // Most names are those of channels, and so is the one in the middle.
    let Some(middle) = header.get(header.len() / 2) else { return Ok(None) };
    let (usual, of_usual) = pattern(middle);
    let is_usual = |(column, name): (usize, &String)| {
        let (pattern, numbers) = pattern(name);
        (pattern == usual && numbers.len() == of_usual.len()).then_some((column, numbers))
    };
    let (columns, named): (Vec<usize>, Vec<Vec<usize>>) = header.iter().enumerate().filter_map(is_usual).unzip();
    let are_most = 2 * named.len() > header.len();
    let order = match of_usual.len() {
        4 | 5 if are_most => Some(by_electrodes(&named, protocol)?),
        1 if are_most => by_number(named.iter().map(|numbers| numbers[0]), protocol.channel_count()),
        _ => None,
    };
    Ok(order.map(|order| order.into_iter().map(|place| columns[place]).collect()))
}

/// Refuses names that are out of order.
fn check_turn(header: &[String], channels: usize) -> Result<(), String> {
    out_of_order(header).map_or(Ok(()), |[before, after]| {
        Err(format!(
            "the column `{after}` comes after `{before}`, and the names do not say which channels they are: call them `v_0_1_2_3` \
             (source and sink of the drive, plus and minus of the measure) or `ch0` to `ch{}`, or remove the header where the \
             columns are in order",
            channels - 1
        ))
    })
}

/// A name without its numbers, and these.
fn pattern(name: &str) -> (String, Vec<usize>) {
    let digits = name.split(|c: char| !c.is_ascii_digit()).filter(|digits| !digits.is_empty());
    // A number that is too large is none of a channel.
    let numbers = digits.map(|digits| digits.parse().unwrap_or(usize::MAX)).collect();
    let mut pattern = name.to_lowercase();
    pattern.retain(|c| !c.is_ascii_digit());
    (pattern, numbers)
}

/// The first two names in turn that differ by their numbers alone, the larger ones before the smaller ones.
fn out_of_order(header: &[String]) -> Option<[&String; 2]> {
    let patterns: Vec<(String, Vec<usize>)> = header.iter().map(|name| pattern(name)).collect();
    let at = patterns.windows(2).position(|pair| {
        let [(before, first), (after, second)] = pair else { return false };
        before == after && first.len() == second.len() && first > second
    })?;
    Some([&header[at], &header[at + 1]])
}

/// The number of the first electrode: 1 if no name has a 0 and some have the number of electrodes.
fn first_electrode(named: &[&[usize]], electrode_count: usize) -> usize {
    let all = || named.iter().copied().flatten();
    usize::from(!all().any(|&number| number == 0) && all().any(|&number| number == electrode_count))
}

/// The column of each channel by its electrodes, which may follow the number of the channel.
fn by_electrodes(named: &[Vec<usize>], protocol: &Protocol) -> Result<Vec<usize>, String> {
    let named: Vec<&[usize]> = named.iter().map(|numbers| &numbers[numbers.len().saturating_sub(4)..]).collect();
    let first = first_electrode(&named, protocol.electrode_count());
    let mut columns = BTreeMap::new();
    for (column, &numbers) in named.iter().enumerate() {
        if columns.insert(numbers, column).is_some() {
            return Err(format!("two columns are named by the electrodes {numbers:?}: remove one"));
        }
    }
    let of = |(number, channel): (usize, &Channel)| {
        let ([source, sink], [plus, minus]) = (channel.drive, channel.measure);
        let electrodes = [source, sink, plus, minus].map(|electrode| electrode + first);
        columns.get(&electrodes[..]).copied().ok_or_else(|| {
            format!(
                "no column is named by the electrodes {electrodes:?} of channel {number}: source and sink of the drive, plus and \
                 minus of the measure; make the design's protocol that of the file, or remove the header where the columns are in order"
            )
        })
    };
    protocol.channels().iter().enumerate().map(of).collect()
}

/// The place of each channel by its number; `None` if the numbers are not those of all channels, from 0 or 1.
pub(super) fn by_number(numbers: impl Iterator<Item = usize> + Clone, channel_count: usize) -> Option<Vec<usize>> {
    let first = numbers.clone().min().filter(|&first| first <= 1)?;
    let mut order = vec![None; channel_count];
    for (place, number) in numbers.enumerate() {
        if order.get_mut(number - first)?.replace(place).is_some() {
            return None;
        }
    }
    order.into_iter().collect()
}
