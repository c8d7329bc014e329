//! A front end that replays readings from the board's memory, where QEMU loads them
//! (`-device loader,file=FILE,addr=0x21000000`).
//!
//! The file, little-endian: u32 0x31445244 ("DRD1"), u16 slots, u16 frames; for each slot u16 source, sink, plus, minus
//! (0xFFFF twice for the reference resistor); for each frame an i16 per slot. `dermis check-device --readings` writes
//! it.

use crate::peripherals::Register;
use dermis_firmware::{FrontEnd, Gain, Limits};
use dermis_wire::Slot;

/// The board's PSRAM.
const FILE: usize = 0x2100_0000;
const MAGIC: u32 = u32::from_le_bytes(*b"DRD1");
const HEADER_BYTES: usize = 8;

/// The replayed readings.
pub struct Replay {
    slots: usize,
    frames: usize,
    /// Number of the frame that is being read.
    frame: usize,
    /// Place of the selected slot in the file; `None` for one that it does not have.
    selected: Option<usize>,
    next: usize,
}

impl Replay {
    /// The file in memory; without a file all readings are zero.
    pub fn new() -> Self {
        let counts = word(4);
        let (slots, frames) = ((counts & 0xFFFF) as usize, (counts >> 16) as usize);
        let (slots, frames) = if word(0) == MAGIC { (slots, frames) } else { (0, 0) };
        Replay { slots, frames, frame: 0, selected: None, next: 0 }
    }

    fn slot(&self, index: usize) -> Slot {
        let at = HEADER_BYTES + Slot::BYTES * index;
        let [low, high] = [word(at), word(at + 4)].map(u32::to_le_bytes);
        let mut bytes = [0; Slot::BYTES];
        bytes[..4].copy_from_slice(&low);
        bytes[4..].copy_from_slice(&high);
        Slot::from_bytes(bytes)
    }
}

/// The word at an offset in the file, a multiple of four.
fn word(offset: usize) -> u32 {
    Register::at(FILE + offset).read()
}

impl FrontEnd for Replay {
    /// Those of the board Pico, so that both state the same rates.
    const LIMITS: Limits = Limits { overhead_ns: 1400, frame_ns: 30_000, longest_wait_ns: 65_000 };

    /// QEMU's time is that of a computer, which may be late.
    const MOST_LATE_US: u64 = 250_000;

    fn begin(&mut self, _time_us: u64) {
        self.frame = if self.frame + 1 < self.frames { self.frame + 1 } else { 0 };
        self.next = 0;
    }

    fn open(&mut self) {
        self.selected = None;
    }

    fn select(&mut self, slot: Slot, _gain: Gain) {
        // The scan table is usually that of the file.
        let from_next = (0..self.slots).map(|step| (self.next + step) % self.slots);
        self.selected = from_next.into_iter().find(|&index| self.slot(index) == slot);
        self.next = self.selected.map_or(0, |index| index + 1);
    }

    fn close(&mut self) {}

    fn wait_ns(&mut self, _wait_ns: u32) {}

    fn convert(&mut self) -> i16 {
        let Some(index) = self.selected else { return 0 };
        let at = HEADER_BYTES + Slot::BYTES * self.slots + 2 * (self.frame * self.slots + index);
        let both = word(at & !3).to_le_bytes();
        i16::from_le_bytes([both[at & 2], both[(at & 2) + 1]])
    }
}
