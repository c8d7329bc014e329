//! The firmware of a skin's reader, apart from its board: it reads the slots of a scan table through a board's front
//! end and implements the device's side of the wire protocol ([`dermis_wire`], `docs/wire-protocol.md`).
//!
//! A board implements three traits: [`Scanner`] (frames of readings; [`SlotScanner`] reads slot by slot through a
//! [`FrontEnd`]), [`Link`] (bytes to and from the host) and [`System`] (clock, watchdog, temperature). Its main loop
//! calls [`Device::poll`], which never waits for the host. Nothing here allocates, and no input causes a panic.
//!
//! How long a slot settles before it is read comes with the [`Instrument`]: `dermis scan-table --firmware` computes it
//! from the design, the line capacitance and the converter. `docs/firmware.md` describes boards and timing.

#![no_std]

mod board;
mod device;
mod instrument;
mod outbox;
mod scanner;
mod session;
mod table;
mod timing;

pub use board::{Gone, Link, System};
pub use device::{Device, Memory};
pub use instrument::{Instrument, Settling};
pub use scanner::{FrontEnd, Gain, HardwareFault, Limits, Plan, Scanned, Scanner, SlotScanner};
pub use table::TimedSlot;
pub use timing::{frame_ns, highest_rate_millihertz, shared_slot_ns};
