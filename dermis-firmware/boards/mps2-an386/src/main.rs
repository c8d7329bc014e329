//! The firmware of a skin's reader on the board mps2-an386, as QEMU emulates it: commands, scan tables, rates and frames
//! run on a Cortex-M4; readings are those of a file that QEMU loads into the board's memory. So it shows that the code
//! works on the processor, and nothing of the analogue front end or its timing.

#![no_std]
#![no_main]

mod peripherals;
mod replay;
#[path = "../../skins/cylinder30.rs"]
mod skin;

use crate::peripherals::{Timer, Uart};
use crate::replay::Replay;
use cortex_m_rt::entry;
use dermis_firmware::{Device, Instrument, Memory, SlotScanner, TimedSlot};
use panic_halt as _;

/// Slots of the largest scan table.
const MOST_SLOTS: usize = 1024;

#[entry]
fn main() -> ! {
    let (mut complete, mut arriving, mut scanned) =
        ([TimedSlot::NONE; MOST_SLOTS], [TimedSlot::NONE; MOST_SLOTS], [TimedSlot::NONE; MOST_SLOTS]);
    let (mut tested, mut readings) = ([0; MOST_SLOTS], [0; MOST_SLOTS]);
    let mut outbox = [0; Memory::outbox_bytes(MOST_SLOTS)];
    let (mut uart, mut timer) = (Uart::open(), Timer::start());
    // The emulated clock starts at zero with every power-up: there is no source of random numbers for `boot`.
    let instrument = Instrument { name: "dermis mps2-an386", serial: 386, boot: 1, ..skin::INSTRUMENT };
    let memory = Memory { tables: [&mut complete, &mut arriving], readings: &mut tested, outbox: &mut outbox };
    let mut device = Device::new(instrument, memory);
    let mut scanner = SlotScanner::new(Replay::new(), &mut scanned, &mut readings);
    loop {
        device.poll(&mut scanner, &mut uart, &mut timer);
    }
}
