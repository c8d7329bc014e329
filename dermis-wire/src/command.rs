//! What a host asks of a device.

use crate::bytes::Reader;
use crate::packet::{NoRoom, Packer, pack};
use crate::scan::{ScanPart, Slot};
use crate::{Unknown, packet_bytes};

/// A message from the host to the device.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum ToDevice<'a> {
    /// Say who you are: the answer is a [`Hello`](crate::Hello).
    Identify,
    /// Begin to send frames.
    Start,
    /// Send no more frames.
    Stop,
    /// A part of the scan table to be used from the next start on.
    Scan(ScanPart<'a>),
    /// Frames a second, in thousandths of a hertz.
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
    /// Bytes of the longest packet.
    pub const PACKET_BYTES: usize = packet_bytes(7 + ScanPart::MOST * Slot::BYTES);

    /// Writes its packet into `out` and tells its length.
    ///
    /// # Errors
    /// A buffer that is too small ([`PACKET_BYTES`](Self::PACKET_BYTES) is enough), a part of more than
    /// [`ScanPart::MOST`] slots or that reaches past its table.
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

    /// Reads one.
    ///
    /// # Errors
    /// A kind or a length that this version does not know.
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
