//! The scan table of a protocol: the channel of each reading of a frame.

use dermis::protocol::{Pair, Protocol, ScanSlot};
use dermis_wire::{ScanPart, Slot, Slots};

/// The slots of a [scan](Protocol::scan) in the wire format, and the meaning of each.
#[derive(Debug, Clone, PartialEq)]
pub struct ScanTable {
    slots: Vec<Slot>,
    /// For each slot, the drive whose current it reads, or the channel.
    roles: Vec<Role>,
}

/// Meaning of a slot.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Role {
    /// The current of a drive, by its number.
    Current(usize),
    /// A channel, by its number.
    Channel(usize),
}

impl ScanTable {
    /// The table of a protocol.
    ///
    /// # Errors
    /// More electrodes or slots than the wire format supports.
    pub fn new(protocol: &Protocol) -> Result<Self, TooLarge> {
        let scan = protocol.scan();
        let (slot_count, electrode_count) = (scan.len(), protocol.electrode_count());
        if slot_count > usize::from(u16::MAX) || electrode_count >= usize::from(u16::MAX) {
            return Err(TooLarge { slot_count, electrode_count });
        }
        let short = |pair: Pair| pair.map(|electrode| electrode as u16);
        let slot = |ScanSlot { drive, measure }: &ScanSlot| {
            let [source, sink] = short(*drive);
            Slot { source, sink, measure: measure.map(|(pair, _)| short(pair)) }
        };
        let mut drives = 0..;
        let role = |slot: &ScanSlot| match slot.measure {
            Some((_, channel)) => Role::Channel(channel),
            None => Role::Current(drives.next().expect("a range without an end")),
        };
        Ok(ScanTable { slots: scan.iter().map(slot).collect(), roles: scan.iter().map(role).collect() })
    }

    /// The slots, as sent to a device.
    pub fn slots(&self) -> &[Slot] {
        &self.slots
    }

    /// The meaning of each slot.
    pub fn roles(&self) -> &[Role] {
        &self.roles
    }

    /// The parts in which it is sent.
    pub fn parts(&self) -> impl Iterator<Item = ScanPart<'_>> {
        let total = self.slots.len() as u16;
        self.slots.chunks(ScanPart::MAX).enumerate().map(move |(part, slots)| ScanPart {
            first: (part * ScanPart::MAX) as u16,
            total,
            slots: Slots::Given(slots),
        })
    }
}

/// A protocol that exceeds the limits of the wire format.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error(
    "{slot_count} readings of {electrode_count} electrodes are more than a device accepts: at most 65,535 readings of 65,534 electrodes"
)]
pub struct TooLarge {
    /// Readings per frame.
    pub slot_count: usize,
    /// Electrodes.
    pub electrode_count: usize,
}

#[cfg(test)]
mod tests {
    use super::*;
    use dermis::design::SkinDesign;

    #[test]
    fn the_papers_skin_has_30_readings_of_currents_and_870_of_channels() {
        let design = SkinDesign::shipped("cylinder30").unwrap();
        let table = ScanTable::new(&design.protocol).unwrap();
        assert_eq!(table.slots().len(), 900);
        assert_eq!(table.slots()[0], Slot { source: 0, sink: 1, measure: None });
        assert_eq!(table.slots()[30], Slot { source: 1, sink: 2, measure: None });
        assert_eq!(table.roles()[31], Role::Channel(29));
        for (slot, role) in table.slots().iter().zip(table.roles()) {
            if let Role::Channel(channel) = *role {
                let channel = design.protocol.channels()[channel];
                assert_eq!([slot.source, slot.sink].map(usize::from), channel.drive);
                assert_eq!(slot.measure.unwrap().map(usize::from), channel.measure);
            }
        }
        let whole: Vec<Slot> = table.parts().flat_map(|part| part.slots.iter().collect::<Vec<_>>()).collect();
        assert_eq!(whole, table.slots());
    }
}
