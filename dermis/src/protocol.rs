//! The drive and measure electrodes of every value of a frame.

mod scan;
mod table;

pub use scan::{MultiplexerInput, ScanSlot};
pub use table::SCAN_COLUMNS;
pub(crate) use table::{CHANNEL_COLUMNS, numbered};

use crate::files::sha256;
use crate::stats::rms;
use crate::text::hexadecimal;
use serde::{Deserialize, Serialize};
use std::collections::HashMap;
use thiserror::Error;

/// Two electrodes: for a drive, where current enters and leaves; for a measure, plus and minus.
pub type Pair = [usize; 2];

/// One value of a frame: `V[measure[0]] - V[measure[1]]` per ampere that enters at `drive[0]` and leaves at `drive[1]`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct Channel {
    /// Electrodes where the current enters and leaves.
    pub drive: Pair,
    /// Electrodes between which the voltage is read.
    pub measure: Pair,
}

impl Channel {
    /// Whether an electrode of the measure pair is also driven, so that the value depends on its contact impedance.
    pub fn touches_driven(&self) -> bool {
        self.measure.iter().any(|electrode| self.drive.contains(electrode))
    }

    /// Whether an electrode is driven or measured.
    pub fn uses(&self, electrode: usize) -> bool {
        self.drive.contains(&electrode) || self.measure.contains(&electrode)
    }

    /// The channel with drive and measure exchanged; by reciprocity it reads the same value.
    pub fn reciprocal(&self) -> Channel {
        Channel { drive: self.measure, measure: self.drive }
    }
}

/// A protocol with an electrode that does not exist or a drive that is not possible.
#[derive(Debug, Error, PartialEq)]
#[non_exhaustive]
pub enum ProtocolError {
    /// Fewer electrodes than imaging needs.
    #[error("{electrode_count} electrodes are too few: a skin needs at least 4")]
    TooFewElectrodes {
        /// Number of electrodes given.
        electrode_count: usize,
    },
    /// An electrode that the skin does not have.
    #[error("channel {channel} names electrode {electrode}, but the skin has electrodes 0 to {}", electrode_count - 1)]
    NoSuchElectrode {
        /// Index of the channel.
        channel: usize,
        /// The electrode.
        electrode: usize,
        /// Number of electrodes of the skin.
        electrode_count: usize,
    },
    /// A pair of an electrode with itself.
    #[error("channel {channel} {verb} electrode {electrode} against itself")]
    SelfPair {
        /// Index of the channel.
        channel: usize,
        /// "drives" or "measures".
        verb: &'static str,
        /// The electrode.
        electrode: usize,
    },
    /// A skip that pairs an electrode with itself.
    #[error("skip {skip} pairs every electrode with itself on a skin of {electrode_count} electrodes")]
    BadSkip {
        /// Electrodes skipped.
        skip: usize,
        /// Number of electrodes of the skin.
        electrode_count: usize,
    },
    /// A distance that pairs an electrode with itself.
    #[error("distance {distance} pairs every electrode with itself on a skin of {electrode_count} electrodes")]
    BadDistance {
        /// Electrodes from the first to the second of a pair.
        distance: usize,
        /// Number of electrodes of the skin.
        electrode_count: usize,
    },
    /// Opposite drive needs an even number of electrodes.
    #[error("opposite drive needs an even number of electrodes, not {electrode_count}")]
    OddOpposite {
        /// Number of electrodes of the skin.
        electrode_count: usize,
    },
    /// A protocol without a channel.
    #[error("the protocol has no channel")]
    Empty,
    /// A channel table that cannot be read.
    #[error("{path}, line {line}: {message}")]
    Table {
        /// The file.
        path: String,
        /// 1-based line.
        line: u64,
        /// What is wrong, and the fix.
        message: String,
    },
}

/// Which measure pairs with a driven electrode a protocol has.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Driven {
    /// None.
    LeftOut,
    /// All but the drive pair itself.
    NotItsPair,
}

impl Driven {
    /// Most electrodes that a measure pair shares with its drive.
    fn most_shared(self) -> usize {
        match self {
            Driven::LeftOut => 0,
            Driven::NotItsPair => 1,
        }
    }
}

/// The order of a frame's values, and the drive and measure electrodes of each.
#[derive(Debug, Clone, PartialEq)]
pub struct Protocol {
    electrode_count: usize,
    channels: Vec<Channel>,
    amplitude_only: bool,
}

impl Protocol {
    /// A protocol from its channels.
    ///
    /// # Errors
    /// Fewer than four electrodes, no channel, an electrode that does not exist, a pair of an electrode with itself.
    pub fn new(electrode_count: usize, channels: Vec<Channel>) -> Result<Self, ProtocolError> {
        if electrode_count < 4 {
            return Err(ProtocolError::TooFewElectrodes { electrode_count });
        }
        if channels.is_empty() {
            return Err(ProtocolError::Empty);
        }
        for (index, channel) in channels.iter().enumerate() {
            for (verb, pair) in [("drives", channel.drive), ("measures", channel.measure)] {
                if let Some(&electrode) = pair.iter().find(|&&electrode| electrode >= electrode_count) {
                    return Err(ProtocolError::NoSuchElectrode { channel: index, electrode, electrode_count });
                }
                if pair[0] == pair[1] {
                    return Err(ProtocolError::SelfPair { channel: index, verb, electrode: pair[0] });
                }
            }
        }
        Ok(Protocol { electrode_count, channels, amplitude_only: false })
    }

    /// The protocol without the channels that use some electrodes, as when these are disconnected.
    ///
    /// # Errors
    /// No channel left.
    pub fn without_electrodes(&self, electrodes: &[usize]) -> Result<Self, ProtocolError> {
        let is_left = |channel: &&Channel| !electrodes.iter().any(|&electrode| channel.uses(electrode));
        let channels: Vec<Channel> = self.channels.iter().filter(is_left).copied().collect();
        Ok(Protocol::new(self.electrode_count, channels)?.with_amplitude_only(self.amplitude_only))
    }

    /// Adjacent drive, adjacent measure, all pairs except the driven one: `L (L - 1)` values, drive-major.
    ///
    /// # Errors
    /// Fewer than four electrodes.
    pub fn adjacent(electrode_count: usize) -> Result<Self, ProtocolError> {
        Self::cyclic(electrode_count, [1, 1], Driven::NotItsPair)
    }

    /// Adjacent drive, adjacent measure, without pairs that contain a driven electrode: `L (L - 3)` values.
    ///
    /// # Errors
    /// Fewer than four electrodes.
    pub fn adjacent_undriven(electrode_count: usize) -> Result<Self, ProtocolError> {
        Self::cyclic(electrode_count, [1, 1], Driven::LeftOut)
    }

    /// Drive `d` to `d + 1 + skip`, adjacent measure, without pairs that contain a driven electrode.
    ///
    /// # Errors
    /// Fewer than four electrodes; a skip that pairs an electrode with itself.
    pub fn skip(electrode_count: usize, skip: usize) -> Result<Self, ProtocolError> {
        if electrode_count > 0 && (skip + 1).is_multiple_of(electrode_count) {
            return Err(ProtocolError::BadSkip { skip, electrode_count });
        }
        Self::cyclic(electrode_count, [skip + 1, 1], Driven::LeftOut)
    }

    /// Drive `d` to `d + distances[0]`, measure `m` to `m + distances[1]`; `driven` says which measure pairs with a driven
    /// electrode there are.
    ///
    /// ```
    /// use dermis::protocol::{Driven, Protocol};
    ///
    /// let protocol = Protocol::distances(16, [5, 1], Driven::LeftOut)?;
    /// assert_eq!((protocol.channels()[0].drive, protocol.channel_count()), ([0, 5], 16 * 12));
    /// # Ok::<(), dermis::protocol::ProtocolError>(())
    /// ```
    ///
    /// # Errors
    /// Fewer than four electrodes; a distance that pairs an electrode with itself.
    pub fn distances(electrode_count: usize, distances: [usize; 2], driven: Driven) -> Result<Self, ProtocolError> {
        let is_bad = |distance: &usize| electrode_count > 0 && distance.is_multiple_of(electrode_count);
        match distances.into_iter().find(is_bad) {
            Some(distance) => Err(ProtocolError::BadDistance { distance, electrode_count }),
            None => Self::cyclic(electrode_count, distances, driven),
        }
    }

    /// Drive `d` to `d + L/2`, adjacent measure, without pairs that contain a driven electrode.
    ///
    /// # Errors
    /// Fewer than four electrodes, or an odd number of them.
    pub fn opposite(electrode_count: usize) -> Result<Self, ProtocolError> {
        if electrode_count % 2 == 1 {
            return Err(ProtocolError::OddOpposite { electrode_count });
        }
        Self::cyclic(electrode_count, [electrode_count / 2, 1], Driven::LeftOut)
    }

    /// Drives `d -> d + distances[0]` and measures `m -> m + distances[1]`, drive-major, measure ascending.
    fn cyclic(electrode_count: usize, distances: [usize; 2], driven: Driven) -> Result<Self, ProtocolError> {
        let count = electrode_count;
        // Smaller numbers than the count, so that no sum overflows.
        let pair = |from: usize, distance: usize| [from, (from + distance % count) % count];
        let mut channels = Vec::new();
        for d in 0..count {
            let drive = pair(d, distances[0]);
            for m in 0..count {
                let measure = pair(m, distances[1]);
                let shared = measure.iter().filter(|electrode| drive.contains(electrode)).count();
                if shared <= driven.most_shared() {
                    channels.push(Channel { drive, measure });
                }
            }
        }
        if count < 4 {
            return Err(ProtocolError::TooFewElectrodes { electrode_count });
        }
        Self::new(count, channels)
    }

    /// The same protocol for an instrument that reports amplitudes: the signs are lost and must be restored from the
    /// untouched model.
    pub fn with_amplitude_only(mut self, amplitude_only: bool) -> Self {
        self.amplitude_only = amplitude_only;
        self
    }

    /// Whether the instrument reports amplitudes without their sign.
    pub fn amplitude_only(&self) -> bool {
        self.amplitude_only
    }

    /// Removes the signs of the values of a frame where the instrument reports amplitudes alone.
    pub fn drop_signs(&self, values: &mut [f64]) {
        if self.amplitude_only {
            values.iter_mut().for_each(|value| *value = value.abs());
        }
    }

    /// Pairs of reciprocal channels, drive and measured pair exchanged: the lower number first.
    pub fn reciprocal_pairs(&self) -> Vec<[usize; 2]> {
        let index: HashMap<&Channel, usize> = self.channels.iter().zip(0..).collect();
        let pair = |(own, channel): (usize, &Channel)| {
            index.get(&channel.reciprocal()).filter(|&&other| own < other).map(|&other| [own, other])
        };
        self.channels.iter().enumerate().filter_map(pair).collect()
    }

    /// Number of electrodes of the skin.
    pub fn electrode_count(&self) -> usize {
        self.electrode_count
    }

    /// Number of values of a frame.
    pub fn channel_count(&self) -> usize {
        self.channels.len()
    }

    /// The channels in the order of a frame.
    pub fn channels(&self) -> &[Channel] {
        &self.channels
    }

    /// The channels that read no voltage at a driven electrode, and those that do.
    pub fn channels_by_drive(&self) -> [Vec<usize>; 2] {
        let (driven, others) = (0..self.channels.len()).partition(|&one| self.channels[one].touches_driven());
        [others, driven]
    }

    /// The distinct drive pairs in order of first use, and for each channel the index of its drive pair.
    pub fn drives(&self) -> (Vec<Pair>, Vec<usize>) {
        distinct(self.channels.iter().map(|channel| channel.drive))
    }

    /// The distinct measure pairs in order of first use, and for each channel the index of its measure pair.
    pub fn measures(&self) -> (Vec<Pair>, Vec<usize>) {
        distinct(self.channels.iter().map(|channel| channel.measure))
    }

    /// The channels whose measure pair shares no electrode with their drive: contact impedances do not touch their values.
    pub fn undriven(&self) -> impl Iterator<Item = usize> {
        (0..self.channels.len()).filter(|&channel| !self.channels[channel].touches_driven())
    }

    /// Root mean square of the values of the [undriven](Self::undriven) channels of a frame; `NaN` if there are none.
    pub fn undriven_rms(&self, frame: &[f64]) -> f64 {
        rms(self.undriven().map(|channel| frame[channel]))
    }

    /// The change of each channel's value per ohm of increase of an electrode's contact resistance: 1 or -1 if the
    /// channel drives and measures at the electrode, else 0.
    pub(crate) fn contact_gains(&self, electrode: usize) -> impl Iterator<Item = f64> {
        let sign = move |pair: Pair| f64::from(pair[0] == electrode) - f64::from(pair[1] == electrode);
        self.channels.iter().map(move |channel| sign(channel.drive) * sign(channel.measure))
    }

    /// SHA-256 of the channel table ([`to_csv`](Self::to_csv)), in hexadecimal digits: identifies the protocol.
    pub fn sha256(&self) -> String {
        hexadecimal(&sha256(self.to_csv().as_bytes()))
    }

    /// The channel table as CSV: `channel,drive_source,drive_sink,measure_plus,measure_minus`.
    pub fn to_csv(&self) -> String {
        let mut text = CHANNEL_COLUMNS.join(",") + "\n";
        for (index, Channel { drive, measure }) in self.channels.iter().enumerate() {
            text += &format!("{index},{},{},{},{}\n", drive[0], drive[1], measure[0], measure[1]);
        }
        text
    }
}

fn distinct(pairs: impl Iterator<Item = Pair>) -> (Vec<Pair>, Vec<usize>) {
    let mut order = Vec::new();
    let mut index_of = HashMap::new();
    let indices = pairs
        .map(|pair| {
            *index_of.entry(pair).or_insert_with(|| {
                order.push(pair);
                order.len() - 1
            })
        })
        .collect();
    (order, indices)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_papers_protocol_has_870_values_of_which_60_touch_a_driven_electrode() {
        let protocol = Protocol::adjacent(30).unwrap();
        assert_eq!(protocol.channel_count(), 870);
        assert_eq!(protocol.channels().iter().filter(|c| c.touches_driven()).count(), 60);
        assert_eq!(protocol.channels()[0], Channel { drive: [0, 1], measure: [1, 2] });
        assert_eq!(protocol.channels()[869], Channel { drive: [29, 0], measure: [28, 29] });
    }

    #[test]
    fn a_protocol_without_an_electrode_has_no_channel_of_it() {
        let protocol = Protocol::adjacent(30).unwrap().without_electrodes(&[7]).unwrap();
        // 28 drives; of each the measuring pairs without two, and without the driven one.
        assert_eq!((protocol.electrode_count(), protocol.channel_count()), (30, 28 * 27));
        assert!(!protocol.channels().iter().any(|channel| channel.uses(7)));
        let all: Vec<usize> = (0..30).step_by(2).collect();
        assert_eq!(Protocol::adjacent(30).unwrap().without_electrodes(&all), Err(ProtocolError::Empty));
    }

    #[test]
    fn distances_are_those_between_the_electrodes_of_a_pair() {
        let protocol = Protocol::distances(16, [5, 3], Driven::LeftOut).unwrap();
        assert!(protocol.channels().iter().all(|channel| {
            let [drive, measure] = [channel.drive, channel.measure].map(|[from, to]| (to + 16 - from) % 16);
            (drive, measure) == (5, 3) && !channel.touches_driven()
        }));
        // Two of the measures start at a driven electrode, and two end at one.
        assert_eq!(protocol.channel_count(), 16 * 12);
        let all = Protocol::distances(16, [5, 5], Driven::NotItsPair).unwrap();
        assert_eq!(all.channel_count(), 16 * 15);
        assert_eq!(Protocol::distances(16, [1, 1], Driven::NotItsPair), Protocol::adjacent(16));
        assert_eq!(Protocol::distances(16, [3, 1], Driven::LeftOut), Protocol::skip(16, 2));
        for distances in [[0, 1], [1, 32]] {
            let error = Protocol::distances(16, distances, Driven::LeftOut).unwrap_err();
            assert!(matches!(error, ProtocolError::BadDistance { .. }), "{error}");
        }
    }

    #[test]
    fn a_pair_of_an_electrode_with_itself_is_named() {
        let channel = Channel { drive: [2, 2], measure: [0, 1] };
        let error = Protocol::new(16, vec![channel]).unwrap_err();
        assert_eq!(error, ProtocolError::SelfPair { channel: 0, verb: "drives", electrode: 2 });
        assert!(Protocol::skip(16, 15).is_err());
        assert!(Protocol::adjacent(3).is_err());
    }
}
