//! The scan table: the order in which an instrument reads a frame, and the multiplexer inputs of each reading.

use crate::protocol::{Pair, Protocol, SCAN_COLUMNS};

/// A reading of a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ScanSlot {
    /// Electrodes on the source and on ground.
    pub drive: Pair,
    /// Electrodes on the inputs of the amplifier, plus and minus, and the channel; `None` if both inputs are on the
    /// reference resistor.
    pub measure: Option<(Pair, usize)>,
}

/// A place on the multiplexers of a line. Each of the four lines (source, sink, plus, minus) has its own; an electrode is
/// at the same place of all.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct MultiplexerInput {
    /// The multiplexer, from 0: the one that is enabled.
    pub multiplexer: usize,
    /// Its input: the address.
    pub input: usize,
}

impl MultiplexerInput {
    /// Inputs of a multiplexer (ADG732).
    pub const PER_MULTIPLEXER: usize = 32;
    /// The place of the reference resistor's ends on the lines plus and minus: no electrode is there.
    pub const REFERENCE: MultiplexerInput = MultiplexerInput::numbered(Self::PER_MULTIPLEXER - 1);

    /// The place with a number: 32 times the multiplexer, and the input.
    pub const fn numbered(number: usize) -> Self {
        MultiplexerInput { multiplexer: number / Self::PER_MULTIPLEXER, input: number % Self::PER_MULTIPLEXER }
    }

    /// Its number.
    pub const fn number(self) -> usize {
        self.multiplexer * Self::PER_MULTIPLEXER + self.input
    }

    /// The usual place of an electrode: its number, and one more from that of the reference resistor on.
    pub const fn usual(electrode: usize) -> Self {
        Self::numbered(if electrode < Self::REFERENCE.number() { electrode } else { electrode + 1 })
    }
}

/// Lines whose multiplexer places a scan table has.
const LINES: [&str; 4] = ["source", "sink", "plus", "minus"];

impl Protocol {
    /// The readings of a frame in their order: for each drive, in order of first use, one of the reference resistor, and
    /// then the drive's channels in their order.
    pub fn scan(&self) -> Vec<ScanSlot> {
        let (drives, drive_of) = self.drives();
        let mut channels_of = vec![Vec::new(); drives.len()];
        drive_of.iter().enumerate().for_each(|(channel, &drive)| channels_of[drive].push(channel));
        let slots = |(&drive, channels): (&Pair, Vec<usize>)| {
            let measure = |channel: usize| Some((self.channels()[channel].measure, channel));
            let rest: Vec<ScanSlot> =
                channels.into_iter().map(|channel| ScanSlot { drive, measure: measure(channel) }).collect();
            std::iter::once(ScanSlot { drive, measure: None }).chain(rest)
        };
        drives.iter().zip(channels_of).flat_map(slots).collect()
    }

    /// The scan table as CSV with the columns [`SCAN_COLUMNS`] and, for each line, multiplexer and input; readings of
    /// the reference resistor have no measure pair and no channel. A design reads it as its protocol (`pattern.table`).
    /// `places`: of each electrode.
    pub fn scan_csv(&self, places: &[MultiplexerInput]) -> String {
        let mut text = SCAN_COLUMNS.join(",");
        for line in LINES {
            text += &format!(",{line}_multiplexer,{line}_input");
        }
        for (index, slot) in self.scan().iter().enumerate() {
            let [source, sink] = slot.drive;
            text += &match slot.measure {
                Some(([plus, minus], channel)) => format!("\n{index},{source},{sink},{plus},{minus},{channel}"),
                None => format!("\n{index},{source},{sink},,,"),
            };
            for MultiplexerInput { multiplexer, input } in slot.places(places) {
                text += &format!(",{multiplexer},{input}");
            }
        }
        text + "\n"
    }

    /// The scan table as a C header for firmware: an array of `{source, sink, plus, minus}`, with `0xFFFF` for an input
    /// that is on the reference resistor, an array of their places on the multiplexers, and the design hash that the
    /// device must send in its hello. `places`: of each electrode.
    pub fn scan_c_header(&self, design: &str, design_sha256: [u8; 32], places: &[MultiplexerInput]) -> String {
        let hash: Vec<String> = design_sha256.iter().map(|byte| format!("0x{byte:02x}")).collect();
        let (slots, per_multiplexer) = (self.scan(), MultiplexerInput::PER_MULTIPLEXER);
        let mut text = format!(
            "/* Scan table of the skin `{}`, made by `dermis scan-table`. */\n#ifndef DERMIS_SCAN_TABLE_H\n\
             #define DERMIS_SCAN_TABLE_H\n\n#include <stdint.h>\n\n#define DERMIS_SLOT_COUNT {}\n\
             #define DERMIS_ON_REFERENCE 0xFFFFu\n\n\
             static const uint8_t dermis_design_sha256[32] = {{\n    {},\n    {}}};\n\n\
             /* source, sink, plus, minus */\nstatic const uint16_t dermis_scan_table[DERMIS_SLOT_COUNT][4] = {{\n",
            in_comment(design),
            slots.len(),
            hash[..16].join(", "),
            hash[16..].join(", "),
        );
        for slot in &slots {
            let [source, sink] = slot.drive;
            text += &match slot.measure {
                Some(([plus, minus], _)) => format!("    {{{source}, {sink}, {plus}, {minus}}},\n"),
                None => format!("    {{{source}, {sink}, DERMIS_ON_REFERENCE, DERMIS_ON_REFERENCE}},\n"),
            };
        }
        text += &format!(
            "}};\n\n/* Places on the multiplexers of source, sink, plus, minus: {per_multiplexer} times the multiplexer, \
             and its input */\nstatic const uint16_t dermis_scan_places[DERMIS_SLOT_COUNT][4] = {{\n"
        );
        for slot in &slots {
            let [source, sink, plus, minus] = slot.places(places).map(MultiplexerInput::number);
            text += &format!("    {{{source}, {sink}, {plus}, {minus}}},\n");
        }
        text + "};\n\n#endif\n"
    }
}

impl ScanSlot {
    /// The places that are connected to source, sink, plus and minus; `places` are those of the electrodes.
    fn places(&self, places: &[MultiplexerInput]) -> [MultiplexerInput; 4] {
        let [source, sink] = self.drive.map(|electrode| places[electrode]);
        let measure = self.measure.map(|(pair, _)| pair.map(|electrode| places[electrode]));
        let [plus, minus] = measure.unwrap_or([MultiplexerInput::REFERENCE; 2]);
        [source, sink, plus, minus]
    }
}

/// A name that cannot end a comment of C or begin another line.
fn in_comment(name: &str) -> String {
    name.replace(|letter: char| letter.is_control(), " ").replace("*/", "* /")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_scan_table_reads_each_drive_once_and_each_channel_once() {
        let protocol = Protocol::adjacent(30).unwrap();
        let slots = protocol.scan();
        assert_eq!(slots.len(), 900);
        assert_eq!(slots[30], ScanSlot { drive: [1, 2], measure: None });
        for slot in &slots {
            if let Some((measure, channel)) = slot.measure {
                let of = protocol.channels()[channel];
                assert_eq!((slot.drive, measure), (of.drive, of.measure));
            }
        }
        let mut channels: Vec<usize> = slots.iter().filter_map(|slot| Some(slot.measure?.1)).collect();
        channels.sort_unstable();
        assert!(channels.into_iter().eq(0..870));
    }

    #[test]
    fn the_table_has_the_places_of_its_electrodes_and_is_read_as_the_protocol() {
        let protocol = Protocol::adjacent(34).unwrap();
        let places: Vec<MultiplexerInput> = (0..34).map(MultiplexerInput::usual).collect();
        let text = protocol.scan_csv(&places);
        assert_eq!(text.lines().nth(1), Some("0,0,1,,,,0,0,0,1,0,31,0,31"));
        // Electrodes 30, 31 and 32: the place between them is the reference resistor's.
        assert!(text.contains(",30,31,32,33,") && text.contains(",0,30,1,0,1,1,1,2\n"), "{text}");
        assert_eq!(Protocol::parse_csv(&text, "scan.csv", 34).unwrap(), protocol);
        let header = protocol.scan_c_header("a */ b", [7; 32], &places);
        // 34 drives of 33 measure pairs and the reference resistor.
        assert!(header.contains("#define DERMIS_SLOT_COUNT 1156\n") && header.contains("`a * / b`"), "{header}");
        assert_eq!(header.matches("DERMIS_ON_REFERENCE, DERMIS_ON_REFERENCE}").count(), 34);
    }
}
