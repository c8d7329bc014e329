//! The wire protocol between a skin's instrument and its host: what a microcontroller and a computer share.
//!
//! A stream of bytes, over USB serial or TCP, carries packets that each begin and end with a zero byte:
//!
//! ```text
//! 00  COBS( message  CRC-32C of the message, little-endian )  00
//! ```
//!
//! [`encode`] writes one, a [`Decoder`] finds them in whatever arrives; [`ToHost`] and [`ToDevice`] are the messages,
//! little-endian and of fixed layout; [`Arrivals`] counts what was lost, repeated or reordered on the way. Nothing
//! allocates. The layouts, byte by byte and with test vectors, are in `docs/wire-protocol.md`.
//!
//! COBS: Cheshire and Baker, 1999, DOI 10.1109/90.769765. CRC-32C: Castagnoli et al., 1993, DOI 10.1109/26.231911.

#![no_std]

mod arrivals;
mod baud;
mod bytes;
mod command;
mod packet;
mod report;
mod scan;

pub use arrivals::{Arrival, Arrivals};
pub use baud::{STANDARD_BAUD, bytes_per_second, smallest_baud};
pub use command::ToDevice;
pub use packet::{Decoder, NoRoom, Received, encode, packet_bytes};
pub use report::{Fault, FaultCode, Frame, FrameFlags, Hello, Readings, Status, ToHost, test_reading};
pub use scan::{ScanPart, Slot, Slots};

/// Version of the protocol. Devices and hosts of different versions refuse each other.
pub const VERSION: u16 = 1;

/// Bytes of the longest message: a frame of 65,535 readings of four bytes.
pub const LONGEST_MESSAGE: usize = Frame::HEADER_BYTES + 4 * u16::MAX as usize;

/// A message whose checksum is right and that says nothing this version knows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Unknown {
    /// Its first byte, which says what it is; `None` of an empty one.
    pub kind: Option<u8>,
    /// Its bytes.
    pub length: usize,
}

impl core::fmt::Display for Unknown {
    fn fmt(&self, formatter: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self.kind {
            Some(kind) => write!(formatter, "a message of kind 0x{kind:02x} and {} bytes is unknown", self.length),
            None => write!(formatter, "an empty message"),
        }
    }
}

impl core::error::Error for Unknown {}
