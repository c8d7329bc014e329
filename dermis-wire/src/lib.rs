//! The wire protocol between the instrument of a skin and its host, for microcontrollers and computers.
//!
//! A byte stream, over USB serial or TCP, contains packets that each begin and end with a zero byte:
//!
//! ```text
//! 00  COBS( message  CRC-32C of the message, little-endian )  00
//! ```
//!
//! [`encode`] writes a packet, a [`Decoder`] finds packets in a byte stream; [`ToHost`] and [`ToDevice`] are the
//! messages, little-endian and of fixed layout; [`Arrivals`] counts lost, repeated and reordered frames. Nothing here
//! allocates, and no input causes a panic. The layouts with test vectors, the sequence of messages and the errors are
//! specified in `docs/wire-protocol.md`.
//!
//! A device sends a frame, and the line damages the first copy:
//!
//! ```
//! use dermis_wire::{Arrival, Arrivals, Decoder, Frame, FrameFlags, Readings, Received, ToHost};
//!
//! let readings = [1200, -340, 0, 17];
//! let frame =
//!     Frame { sequence: 7, time_us: 58_333, flags: FrameFlags::default(), readings: Readings::I16(&readings) };
//! const PACKET_BYTES: usize = Frame::packet_bytes(4, 2);
//! let mut packet = [0; PACKET_BYTES];
//! let length = ToHost::Frame(frame).encode(&mut packet)?;
//!
//! let mut line = [packet, packet].concat();
//! line[5] ^= 0x10;
//!
//! // On the host: bytes arrive in pieces of any length.
//! let (mut decoder, mut arrivals) = (Decoder::new([0; PACKET_BYTES]), Arrivals::default());
//! let (mut frames, mut damaged) = (0, 0);
//! for piece in line.chunks(10) {
//!     decoder.feed(piece, |received| match received {
//!         Received::Message(message) => {
//!             assert_eq!(ToHost::parse(message), Ok(ToHost::Frame(frame)));
//!             assert_eq!(arrivals.take(frame.sequence), Arrival::New { skipped: 0 });
//!             frames += 1;
//!         }
//!         Received::Damaged => damaged += 1,
//!     });
//! }
//! assert_eq!((length, frames, damaged), (31, 1, 1));
//! # Ok::<(), dermis_wire::NoRoom>(())
//! ```
//!
//! A host sends messages in the same way:
//!
//! ```
//! use dermis_wire::ToDevice;
//!
//! let mut packet = [0; ToDevice::PACKET_BYTES];
//! let length = ToDevice::Rate(120_000).encode(&mut packet)?;
//! assert_eq!(packet[..2], [0, 5]);
//! assert_eq!((length, packet[length - 1]), (12, 0));
//! # Ok::<(), dermis_wire::NoRoom>(())
//! ```
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

/// Version of the protocol. Devices and hosts of different versions reject each other.
pub const VERSION: u16 = 1;

/// Length of the longest message, bytes: a frame of 65,535 readings of four bytes.
pub const LONGEST_MESSAGE: usize = Frame::HEADER_BYTES + 4 * u16::MAX as usize;

/// A message with a valid checksum that this version does not support.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Unknown {
    /// Its first byte, which is its kind; `None` for an empty message.
    pub kind: Option<u8>,
    /// Its length, bytes.
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
