//! Channels by the names of their columns.

use crate::frame::Table;
use crate::protocol::{Channel, Protocol};
use std::collections::BTreeMap;

/// The columns of a table in the order of the channels, where their names say which channels they are: four electrodes, as in
/// `v_0_1_2_3` (drive source and sink, measure plus and minus), or the number of the channel, as in `ch12`. Electrodes and
/// channels count from 0 or 1. A first column with another name is dropped. Any other table is returned as it is.
///
/// # Errors
/// A channel without a column, or with several.
pub(super) fn in_order(mut table: Table, protocol: &Protocol) -> Result<Table, String> {
    let width = table.rows[0].len();
    let Some(header) = table.header.as_ref().filter(|header| header.len() == width) else { return Ok(table) };
    let numbers: Vec<Vec<usize>> = header.iter().map(|name| numbers_in(name)).collect();
    let skipped = usize::from(numbers[0].len() != numbers[width - 1].len());
    let named = &numbers[skipped..];
    let have = |count: usize| !named.is_empty() && named.iter().all(|numbers| numbers.len() == count);
    let order = if have(4) {
        let first = first_electrode(named, protocol.electrode_count());
        by_electrodes(named, first, protocol)?
    } else if have(1) && have_one_stem(&header[skipped..]) {
        match by_number(named, protocol.channel_count()) {
            Some(order) => order,
            None => return Ok(table),
        }
    } else {
        return Ok(table);
    };
    table.rows.iter_mut().for_each(|row| *row = order.iter().map(|column| row[skipped + column]).collect());
    table.header = None;
    Ok(table)
}

/// The numbers in a name.
fn numbers_in(name: &str) -> Vec<usize> {
    name.split(|c: char| !c.is_ascii_digit()).filter_map(|digits| digits.parse().ok()).collect()
}

/// Whether names are the same but for their numbers.
fn have_one_stem(names: &[String]) -> bool {
    let stem = |name: &String| name.trim_end_matches(|c: char| c.is_ascii_digit()).to_lowercase();
    names.iter().all(|name| stem(name) == stem(&names[0]))
}

/// The number of the first electrode: 1 if no name has a 0 and some have the number of electrodes.
fn first_electrode(named: &[Vec<usize>], electrode_count: usize) -> usize {
    let all = || named.iter().flatten();
    usize::from(!all().any(|&number| number == 0) && all().any(|&number| number == electrode_count))
}

/// The column of each channel by its electrodes.
fn by_electrodes(named: &[Vec<usize>], first: usize, protocol: &Protocol) -> Result<Vec<usize>, String> {
    let mut columns = BTreeMap::new();
    for (column, numbers) in named.iter().enumerate() {
        if columns.insert(numbers.as_slice(), column).is_some() {
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

/// The column of each channel by its number; `None` if the numbers are not those of all channels.
fn by_number(named: &[Vec<usize>], channel_count: usize) -> Option<Vec<usize>> {
    let first = named.iter().map(|numbers| numbers[0]).min()?;
    let mut order = vec![None; channel_count];
    for (column, numbers) in named.iter().enumerate() {
        let place = order.get_mut(numbers[0] - first)?;
        if first > 1 || place.replace(column).is_some() {
            return None;
        }
    }
    order.into_iter().collect()
}
