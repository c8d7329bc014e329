//! Orders in which the channels of a frame may come, other than that of the design.

use dermis::protocol::{Channel, Protocol};
use rayon::prelude::*;
use std::collections::HashMap;

/// Changes of the measurements and of the drives are combined up to this number of electrodes.
const MAX_COMBINED: usize = 32;

/// A way in which the order of a file may differ from the design.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Change {
    /// The measurements of each drive start at this many electrodes after its source.
    StartAtDrive(usize),
    /// The measurements of each drive start at this electrode.
    StartAtElectrode(usize),
    /// The measurements of each drive come in descending order.
    MeasuresDescending,
    /// The first drive is this one.
    DrivesRotated(usize),
    /// The drives come in descending order, from the last to the first.
    DrivesDescending,
    /// By measurement first, then by drive.
    MeasureMajor,
    /// Electrode `e` is where the design has electrode `e + n`.
    ElectrodesRotated(usize),
    /// Electrode `e` is where the design has electrode `n - e`.
    ElectrodesMirrored(usize),
    /// The drives come in another order.
    DrivesPermuted,
}

/// An order of the channels: where each channel of the design is in the file.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Order {
    /// What differs from the design; empty for its own order.
    pub changes: Vec<Change>,
    /// For each channel of the design its column in the file.
    pub columns: Vec<usize>,
    /// For each channel of the design the factor on its value in the file, 1 or -1.
    pub signs: Vec<f64>,
}

impl Order {
    /// The order of the design.
    pub(crate) fn of_design(protocol: &Protocol) -> Self {
        let count = protocol.channel_count();
        Order { changes: Vec::new(), columns: (0..count).collect(), signs: vec![1.0; count] }
    }

    /// The order of a file with these channels; `None` where they are not those of the design.
    fn of_channels(changes: Vec<Change>, file: &[Channel], protocol: &Protocol) -> Option<Self> {
        let mut column_of: HashMap<[usize; 4], usize> = HashMap::with_capacity(file.len());
        for (column, Channel { drive: [a, b], measure: [c, d] }) in file.iter().enumerate() {
            column_of.insert([*a, *b, *c, *d], column);
        }
        if column_of.len() != file.len() {
            return None;
        }
        let (mut columns, mut signs) = (Vec::with_capacity(file.len()), Vec::with_capacity(file.len()));
        for Channel { drive: [a, b], measure: [c, d] } in protocol.channels() {
            let ways =
                [([*a, *b, *c, *d], 1.0), ([*a, *b, *d, *c], -1.0), ([*b, *a, *c, *d], -1.0), ([*b, *a, *d, *c], 1.0)];
            let (column, sign) = ways.iter().find_map(|(key, sign)| Some((*column_of.get(key)?, *sign)))?;
            columns.push(column);
            signs.push(if protocol.amplitude_only() { 1.0 } else { sign });
        }
        Some(Order { changes, columns, signs })
    }

    /// The value of each channel of the design in a row of the file.
    pub(crate) fn apply(&self, row: &[f64]) -> Vec<f64> {
        self.columns.iter().zip(&self.signs).map(|(&column, sign)| sign * row[column]).collect()
    }

    /// All orders that are considered, that of the design first and simple ones before combined ones. An order may come
    /// more than once, by other changes.
    pub(crate) fn all(protocol: &Protocol) -> Vec<Order> {
        let mut lists = single_changes(protocol);
        if protocol.electrode_count() <= MAX_COMBINED {
            lists.extend(combined(&measure_changes(protocol)));
        }
        let order = |(changes, file): Listed| Order::of_channels(changes, &file, protocol);
        let others: Vec<Order> = lists.into_par_iter().filter_map(order).collect();
        std::iter::once(Order::of_design(protocol)).chain(others).collect()
    }

    /// The same with the drives of the design taken from those of other drives: drive `d` is where drive `drives[d]`
    /// was.
    pub(crate) fn with_drives(&self, protocol: &Protocol, drives: &[usize]) -> Option<Order> {
        let (_, of_channel) = protocol.drives();
        let mut blocks = vec![Vec::new(); drives.len()];
        for (channel, &drive) in of_channel.iter().enumerate() {
            blocks[drive].push(channel);
        }
        if blocks.iter().any(|block| block.len() != blocks[0].len()) {
            return None;
        }
        let mut order = self.clone();
        for (block, &from) in blocks.iter().zip(drives) {
            for (&channel, &other) in block.iter().zip(&blocks[from]) {
                order.columns[channel] = self.columns[other];
                order.signs[channel] = self.signs[other];
            }
        }
        Some(order)
    }
}

/// Channels in the order of a file, and what makes it differ from the design.
type Listed = (Vec<Change>, Vec<Channel>);

/// The channels of each drive, in the order of the drives.
fn by_drive(protocol: &Protocol) -> Vec<Vec<Channel>> {
    let (drives, of_channel) = protocol.drives();
    let mut blocks = vec![Vec::new(); drives.len()];
    for (channel, &drive) in protocol.channels().iter().zip(&of_channel) {
        blocks[drive].push(*channel);
    }
    blocks
}

/// The blocks with the measurements of each drive sorted by their distance from a start.
fn sorted_from(blocks: &[Vec<Channel>], electrodes: usize, start: impl Fn(&Channel) -> usize) -> Vec<Vec<Channel>> {
    let mut blocks = blocks.to_vec();
    for block in &mut blocks {
        // The lower electrode of an adjacent pair, so that both senses of a pair have the same order.
        let first = |channel: &Channel| {
            let [a, b] = channel.measure;
            if (b + 1) % electrodes == a { b } else { a }
        };
        block.sort_by_key(|channel| (first(channel) + electrodes - start(channel) % electrodes) % electrodes);
    }
    blocks
}

fn measure_changes(protocol: &Protocol) -> Vec<(Vec<Change>, Vec<Vec<Channel>>)> {
    let (blocks, count) = (by_drive(protocol), protocol.electrode_count());
    let mut starts = vec![(Vec::new(), blocks.clone())];
    starts.extend((0..count).map(|k| (vec![Change::StartAtElectrode(k)], sorted_from(&blocks, count, |_| k))));
    starts.extend(
        (0..count)
            .map(|k| (vec![Change::StartAtDrive(k)], sorted_from(&blocks, count, |channel| channel.drive[0] + k))),
    );
    let descending = starts.iter().map(|(changes, blocks)| {
        let reversed = blocks.iter().map(|block| block.iter().rev().copied().collect()).collect();
        ([&changes[..], &[Change::MeasuresDescending]].concat(), reversed)
    });
    let descending: Vec<_> = descending.collect();
    starts.extend(descending);
    starts
}

fn drive_changes(blocks: &[Vec<Channel>]) -> Vec<(Vec<Change>, Vec<Vec<Channel>>)> {
    let rotated = |blocks: &[Vec<Channel>], k: usize| [&blocks[k..], &blocks[..k]].concat();
    let reversed: Vec<Vec<Channel>> = blocks.iter().rev().cloned().collect();
    let mut changes = vec![(vec![Change::DrivesDescending], reversed.clone())];
    for k in 1..blocks.len() {
        changes.push((vec![Change::DrivesRotated(k)], rotated(blocks, k)));
        changes.push((vec![Change::DrivesRotated(k), Change::DrivesDescending], rotated(&reversed, k)));
    }
    changes
}

/// Changes of one kind: measurements, drives, electrodes.
fn single_changes(protocol: &Protocol) -> Vec<Listed> {
    let count = protocol.electrode_count();
    let flat = |(changes, blocks): (Vec<Change>, Vec<Vec<Channel>>)| (changes, blocks.concat());
    let mut lists: Vec<Listed> = measure_changes(protocol).into_iter().map(flat).collect();
    lists.extend(drive_changes(&by_drive(protocol)).into_iter().map(flat));
    let renumbered = |change: Change, number: &dyn Fn(usize) -> usize| {
        let pair = |[a, b]: [usize; 2]| [number(a), number(b)];
        let channel = |channel: &Channel| Channel { drive: pair(channel.drive), measure: pair(channel.measure) };
        (vec![change], protocol.channels().iter().map(channel).collect::<Vec<_>>())
    };
    lists.extend((1..count).map(|k| renumbered(Change::ElectrodesRotated(k), &|e| (e + k) % count)));
    lists.extend((0..count).map(|k| renumbered(Change::ElectrodesMirrored(k), &|e| (k + count - e) % count)));
    let mut by_measure = protocol.channels().to_vec();
    let (_, of_channel) = protocol.measures();
    let key: HashMap<Channel, usize> = protocol.channels().iter().copied().zip(of_channel).collect();
    by_measure.sort_by_key(|channel| key[channel]);
    lists.push((vec![Change::MeasureMajor], by_measure));
    lists
}

/// Changes of the measurements and of the drives.
fn combined(measures: &[(Vec<Change>, Vec<Vec<Channel>>)]) -> Vec<Listed> {
    let with_drives = |(changes, blocks): &(Vec<Change>, Vec<Vec<Channel>>)| {
        let all = drive_changes(blocks);
        let changes = changes.clone();
        all.into_iter()
            .map(move |(more, blocks)| ([&changes[..], &more[..]].concat(), blocks.concat()))
            .collect::<Vec<_>>()
    };
    measures.iter().skip(1).flat_map(with_drives).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn orders_are_permutations_of_the_channels() {
        for protocol in [Protocol::opposite(8).unwrap(), Protocol::adjacent(7).unwrap()] {
            let orders = Order::all(&protocol);
            assert!(orders.len() > 400 && orders[0].changes.is_empty());
            for order in &orders {
                let mut columns = order.columns.clone();
                columns.sort_unstable();
                assert!(columns.iter().copied().eq(0..protocol.channel_count()), "{:?}", order.changes);
            }
        }
    }

    #[test]
    fn measurements_that_start_at_the_drive_are_undone() {
        let protocol = Protocol::adjacent_undriven(8).unwrap();
        // A file whose values are the numbers of their electrodes, in the order of pyEIT's `fmmu`.
        let mut file = protocol.channels().to_vec();
        for block in file.chunk_by_mut(|a, b| a.drive == b.drive) {
            block.sort_by_key(|channel| (channel.measure[0] + 8 - channel.drive[0]) % 8);
        }
        let code = |channel: &Channel| (8 * channel.drive[0] + channel.measure[0]) as f64;
        let row: Vec<f64> = file.iter().map(code).collect();
        let expected: Vec<f64> = protocol.channels().iter().map(code).collect();
        let order = Order::all(&protocol).into_iter().find(|order| order.changes == [Change::StartAtDrive(0)]).unwrap();
        assert_eq!(order.apply(&row), expected);
    }

    #[test]
    fn mirrored_electrodes_turn_signs() {
        let protocol = Protocol::adjacent(6).unwrap();
        let orders = Order::all(&protocol);
        let mirrored = orders.iter().find(|order| order.changes == [Change::ElectrodesMirrored(0)]).unwrap();
        // Drive and measure are both turned: the sign stays.
        assert!(mirrored.signs.iter().all(|sign| *sign == 1.0));
        assert_ne!(mirrored.columns, orders[0].columns);
    }
}
