//! Messages from a host to a device.

use crate::bytes::Reader;
use crate::packet::{NoRoom, Packer, pack};
use crate::scan::{ScanPart, Slot};
use crate::{Unknown, packet_bytes};

/// A message from the host to the device.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum ToDevice<'a> {
    /// Request the identity of the device: it answers with a [`Hello`](crate::Hello).
    Identify,
    /// Start sending frames.
    Start,
    /// Stop sending frames.
    Stop,
    /// A part of the scan table for the next start.
    Scan(ScanPart<'a>),
    /// Frame rate, thousandths of a hertz.
    Rate(u32),
    /// Send one frame of [test readings](crate::test_reading) and a [`Status`](crate::Status).
    SelfTest,
}

const IDENTIFY: u8 = 0x81;
const START: u8 = 0x82;
const STOP: u8 = 0x83;
const SCAN: u8 = 0x84;
const RATE: u8 = 0x85;
const SELF_TEST: u8 = 0x86;

impl<'a> ToDevice<'a> {
    /// Length of the longest packet, bytes.
    pub const PACKET_BYTES: usize = packet_bytes(7 + ScanPart::MAX * Slot::BYTES);

    /// Writes the packet of the message to `out` and returns its length.
    ///
    /// # Errors
    /// A buffer that is too small ([`PACKET_BYTES`](Self::PACKET_BYTES) is enough), or a part with more than
    /// [`ScanPart::MAX`] slots or past the end of its table.
    pub fn encode(&self, out: &mut [u8]) -> Result<usize, NoRoom> {
        pack(out, |packer| self.put(packer))
    }

    fn put(&self, packer: &mut Packer<'_>) -> Result<(), NoRoom> {
        match self {
            ToDevice::Identify => packer.put(&[IDENTIFY]),
            ToDevice::Start => packer.put(&[START]),
            ToDevice::Stop => packer.put(&[STOP]),
            ToDevice::Scan(part) => packer.put(&[SCAN]).and_then(|()| part.put(packer)),
            ToDevice::Rate(rate_millihertz) => {
                packer.put(&[RATE]).and_then(|()| packer.put(&rate_millihertz.to_le_bytes()))
            }
            ToDevice::SelfTest => packer.put(&[SELF_TEST]),
        }
    }

    /// Parses a message.
    ///
    /// # Errors
    /// A kind or a length that this version does not support.
    pub fn parse(message: &'a [u8]) -> Result<Self, Unknown> {
        Self::read(message).ok_or(Unknown { kind: message.first().copied(), length: message.len() })
    }

    fn read(message: &'a [u8]) -> Option<Self> {
        let mut reader = Reader::new(message);
        match reader.u8()? {
            IDENTIFY => reader.end(ToDevice::Identify),
            START => reader.end(ToDevice::Start),
            STOP => reader.end(ToDevice::Stop),
            SCAN => ScanPart::read(&mut reader).map(ToDevice::Scan),
            RATE => reader.u32().and_then(|rate_millihertz| reader.end(ToDevice::Rate(rate_millihertz))),
            SELF_TEST => reader.end(ToDevice::SelfTest),
            _ => None,
        }
    }
}
