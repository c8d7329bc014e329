//! The scan table of a protocol: the channel of each reading of a frame.

use dermis::protocol::{Protocol, SCAN_COLUMNS};
use dermis_wire::{ScanPart, Slot, Slots};

/// The meaning of the readings of a frame, slot by slot: for each drive, in order of first use, one reading of the
/// reference resistor and then the drive's channels in their order.
#[derive(Debug, Clone, PartialEq)]
pub struct ScanTable {
    slots: Vec<Slot>,
    /// For each slot, the drive whose current it reads, or the channel.
    roles: Vec<Role>,
}

/// Meaning of a slot.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Role {
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
        let (drives, drive_of) = protocol.drives();
        let slot_count = drives.len() + drive_of.len();
        if slot_count > usize::from(u16::MAX) || protocol.electrode_count() >= usize::from(u16::MAX) {
            return Err(TooLarge { slot_count, electrode_count: protocol.electrode_count() });
        }
        let short = |electrode: usize| electrode as u16;
        let mut table = ScanTable { slots: Vec::with_capacity(slot_count), roles: Vec::with_capacity(slot_count) };
        let mut channels_of = vec![Vec::new(); drives.len()];
        drive_of.iter().enumerate().for_each(|(channel, &drive)| channels_of[drive].push(channel));
        for (drive, (&[source, sink], channels)) in drives.iter().zip(channels_of).enumerate() {
            let mut add = |measure: Option<[u16; 2]>, role: Role| {
                table.slots.push(Slot { source: short(source), sink: short(sink), measure });
                table.roles.push(role);
            };
            add(None, Role::Current(drive));
            for channel in channels {
                add(Some(protocol.channels()[channel].measure.map(short)), Role::Channel(channel));
            }
        }
        Ok(table)
    }

    /// The slots, as sent to a device.
    pub fn slots(&self) -> &[Slot] {
        &self.slots
    }

    /// The meaning of each slot.
    pub(crate) fn roles(&self) -> &[Role] {
        &self.roles
    }

    /// The parts in which it is sent.
    pub fn parts(&self) -> impl Iterator<Item = ScanPart<'_>> {
        let total = self.slots.len() as u16;
        self.slots.chunks(ScanPart::MOST).enumerate().map(move |(part, slots)| ScanPart {
            first: (part * ScanPart::MOST) as u16,
            total,
            slots: Slots::Given(slots),
        })
    }

    /// The table as CSV with the columns [`SCAN_COLUMNS`]; readings of the reference resistor have no measure pair and
    /// no channel. A design reads it as its protocol (`pattern.table`).
    pub fn to_csv(&self) -> String {
        let mut text = SCAN_COLUMNS.join(",") + "\n";
        for (index, (slot, role)) in self.slots.iter().zip(&self.roles).enumerate() {
            let Slot { source, sink, measure } = slot;
            text += &match (measure, role) {
                (Some([plus, minus]), Role::Channel(channel)) => {
                    format!("{index},{source},{sink},{plus},{minus},{channel}\n")
                }
                _ => format!("{index},{source},{sink},,,\n"),
            };
        }
        text
    }

    /// The table as a C header for firmware: an array of `{source, sink, plus, minus}`, with `0xFFFF` for an input that
    /// is on the reference resistor, and the design hash that the device must send in its hello.
    pub fn to_c_header(&self, design: &str, design_sha256: [u8; 32]) -> String {
        let hash: Vec<String> = design_sha256.iter().map(|byte| format!("0x{byte:02x}")).collect();
        let mut text = format!(
            "/* Scan table of the skin `{design}`, made by `dermis scan-table`. */\n#ifndef DERMIS_SCAN_TABLE_H\n\
             #define DERMIS_SCAN_TABLE_H\n\n#include <stdint.h>\n\n#define DERMIS_SLOT_COUNT {}\n\
             #define DERMIS_ON_REFERENCE 0xFFFFu\n\n\
             static const uint8_t dermis_design_sha256[32] = {{\n    {},\n    {}}};\n\n\
             /* source, sink, plus, minus */\nstatic const uint16_t dermis_scan_table[DERMIS_SLOT_COUNT][4] = {{\n",
            self.slots.len(),
            hash[..16].join(", "),
            hash[16..].join(", "),
        );
        for Slot { source, sink, measure } in &self.slots {
            text += &match measure {
                Some([plus, minus]) => format!("    {{{source}, {sink}, {plus}, {minus}}},\n"),
                None => format!("    {{{source}, {sink}, DERMIS_ON_REFERENCE, DERMIS_ON_REFERENCE}},\n"),
            };
        }
        text + "};\n\n#endif\n"
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
        assert_eq!(table.to_csv().lines().count(), 901);
        assert_eq!(table.to_csv().lines().nth(2), Some("1,0,1,1,2,0"));
        assert_eq!(Protocol::parse_csv(&table.to_csv(), "scan.csv", 30).unwrap(), design.protocol);
        assert!(table.to_c_header("x", [7; 32]).contains("#define DERMIS_SLOT_COUNT 900\n"));
    }
}
