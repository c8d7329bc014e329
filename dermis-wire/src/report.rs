//! Messages from a device to its host.

use crate::Unknown;
use crate::bytes::{Reader, put_text};
use crate::packet::{NoRoom, Packer, pack, packet_bytes};

/// A message from the device to the host.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum ToHost<'a> {
    /// Its identity, on connecting and on request.
    Hello(Hello<'a>),
    /// The readings of one frame.
    Frame(Frame<'a>),
    /// Its status, about once per second.
    Status(Status),
    /// A fault or a rejected request.
    Fault(Fault<'a>),
}

const HELLO: u8 = 0x01;
const FRAME: u8 = 0x02;
const STATUS: u8 = 0x03;
const FAULT: u8 = 0x04;

impl<'a> ToHost<'a> {
    /// Writes the packet of the message to `out` and returns its length.
    ///
    /// # Errors
    /// A buffer that is too small, more than 65,535 readings, or a hello with readings of neither two nor four bytes.
    pub fn encode(&self, out: &mut [u8]) -> Result<usize, NoRoom> {
        pack(out, |packer| match self {
            ToHost::Hello(hello) => hello.put(packer),
            ToHost::Frame(frame) => frame.put(packer),
            ToHost::Status(status) => status.put(packer),
            ToHost::Fault(fault) => fault.put(packer),
        })
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
            HELLO => Hello::read(&mut reader).map(ToHost::Hello),
            FRAME => Frame::read(&mut reader).map(ToHost::Frame),
            STATUS => Status::read(&mut reader).map(ToHost::Status),
            FAULT => Fault::read(&mut reader).map(ToHost::Fault),
            _ => None,
        }
    }
}

/// Identity of a device, and the format of its readings.
///
/// Only the first four bytes are the same in every version, so that hosts of another version can report the version.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hello<'a> {
    /// Version of its protocol: [`VERSION`](crate::VERSION).
    pub version: u16,
    /// Bytes per reading: 2 or 4.
    pub reading_bytes: u8,
    /// Identifier of the skin: SHA-256 of its body, electrodes and protocol.
    pub design_sha256: [u8; 32],
    /// Electrodes of the skin.
    pub electrode_count: u16,
    /// Readings per frame, including those of the reference resistor.
    pub slot_count: u16,
    /// Resistor in series with the source, ohm.
    pub reference_ohm: f32,
    /// Voltage of the source, V.
    pub source_v: f32,
    /// Volts per count: of readings without a driven electrode, of those with one, of the reference resistor.
    pub volts_per_count: [f32; 3],
    /// Largest count of a reading, positive or negative; such a reading is out of range.
    pub full_scale: u32,
    /// Current frame rate, thousandths of a hertz.
    pub rate_millihertz: u32,
    /// Highest frame rate, thousandths of a hertz.
    pub highest_rate_millihertz: u32,
    /// Baud rate of its serial line, bits per second; 0 where it has no effect (USB, TCP).
    pub baud: u32,
    /// Serial number of the device.
    pub serial: u32,
    /// Random number of each power-up; sequence numbers then begin again.
    pub boot: u32,
    /// Name of the device, as text; at most 255 bytes.
    pub name: &'a str,
}

impl<'a> Hello<'a> {
    /// Length of the longest packet, bytes.
    pub const PACKET_BYTES: usize = packet_bytes(84 + 1 + 255);

    fn put(&self, packer: &mut Packer<'_>) -> Result<(), NoRoom> {
        if !self.has_known_readings() {
            return Err(NoRoom);
        }
        packer.put(&[HELLO, self.reading_bytes])?;
        packer.put(&self.version.to_le_bytes())?;
        packer.put(&self.design_sha256)?;
        packer.put(&self.electrode_count.to_le_bytes())?;
        packer.put(&self.slot_count.to_le_bytes())?;
        for value in [self.reference_ohm, self.source_v].into_iter().chain(self.volts_per_count) {
            packer.put(&value.to_le_bytes())?;
        }
        for value in
            [self.full_scale, self.rate_millihertz, self.highest_rate_millihertz, self.baud, self.serial, self.boot]
        {
            packer.put(&value.to_le_bytes())?;
        }
        put_text(packer, self.name)
    }

    fn read(reader: &mut Reader<'a>) -> Option<Self> {
        let reading_bytes = reader.u8()?;
        let version = reader.u16()?;
        let hello = Hello {
            version,
            reading_bytes,
            design_sha256: reader.array()?,
            electrode_count: reader.u16()?,
            slot_count: reader.u16()?,
            reference_ohm: reader.f32()?,
            source_v: reader.f32()?,
            volts_per_count: [reader.f32()?, reader.f32()?, reader.f32()?],
            full_scale: reader.u32()?,
            rate_millihertz: reader.u32()?,
            highest_rate_millihertz: reader.u32()?,
            baud: reader.u32()?,
            serial: reader.u32()?,
            boot: reader.u32()?,
            name: reader.text()?,
        };
        reader.end(hello).filter(Self::has_known_readings)
    }

    fn has_known_readings(&self) -> bool {
        [2, 4].contains(&self.reading_bytes)
    }

    /// The version in a message that may be the hello of any version. Check this first, because a hello of another
    /// version may parse without an error and contain wrong values.
    pub fn version_of(message: &[u8]) -> Option<u16> {
        match *message {
            [HELLO, _, low, high, ..] => Some(u16::from_le_bytes([low, high])),
            _ => None,
        }
    }
}

/// The readings of one frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Frame<'a> {
    /// Sequence number of the frame, from 0 at power-up; it wraps around to 0.
    pub sequence: u32,
    /// The device's time when the frame's first reading was taken, microseconds since power-up.
    pub time_us: u64,
    /// Flags of the frame.
    pub flags: FrameFlags,
    /// Readings in the order of the scan table, counts.
    pub readings: Readings<'a>,
}

/// Flags of a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct FrameFlags(u8);

impl FrameFlags {
    /// A reading was out of the range of the converter.
    pub const SATURATED: FrameFlags = FrameFlags(1);
    /// Earlier frames were not sent because the line was too slow.
    pub const OVERRUN: FrameFlags = FrameFlags(2);
    /// Its readings are the [test readings](test_reading).
    pub const TEST: FrameFlags = FrameFlags(4);

    /// The union of both.
    #[must_use]
    pub fn and(self, other: FrameFlags) -> FrameFlags {
        FrameFlags(self.0 | other.0)
    }

    /// Whether all flags of `other` are set.
    pub fn has(self, other: FrameFlags) -> bool {
        self.0 & other.0 == other.0
    }

    /// Its bits, including those without a name.
    pub fn bits(self) -> u8 {
        self.0
    }
}

/// Readings, counts: given as numbers, or as the bytes of a message. Equal counts of the same width are equal in either
/// form.
#[derive(Debug, Clone, Copy)]
pub enum Readings<'a> {
    /// Numbers of two bytes each.
    I16(&'a [i16]),
    /// Numbers of four bytes each.
    I32(&'a [i32]),
    /// In the bytes of a message, of two bytes each.
    Bytes2(&'a [[u8; 2]]),
    /// In the bytes of a message, of four bytes each.
    Bytes4(&'a [[u8; 4]]),
}

impl<'a> Readings<'a> {
    /// The number of readings.
    pub fn len(&self) -> usize {
        match self {
            Readings::I16(values) => values.len(),
            Readings::I32(values) => values.len(),
            Readings::Bytes2(bytes) => bytes.len(),
            Readings::Bytes4(bytes) => bytes.len(),
        }
    }

    /// Whether there are no readings.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Bytes per reading.
    pub fn reading_bytes(&self) -> u8 {
        match self {
            Readings::I16(_) | Readings::Bytes2(_) => 2,
            Readings::I32(_) | Readings::Bytes4(_) => 4,
        }
    }

    /// The counts of reading `slot`; `None` where there is none.
    pub fn get(&self, slot: usize) -> Option<i32> {
        match self {
            Readings::I16(values) => values.get(slot).map(|&value| i32::from(value)),
            Readings::I32(values) => values.get(slot).copied(),
            Readings::Bytes2(bytes) => bytes.get(slot).map(|&bytes| i32::from(i16::from_le_bytes(bytes))),
            Readings::Bytes4(bytes) => bytes.get(slot).map(|&bytes| i32::from_le_bytes(bytes)),
        }
    }

    /// The readings in order, counts.
    pub fn iter(self) -> impl ExactSizeIterator<Item = i32> + 'a {
        (0..self.len()).map(move |slot| self.get(slot).unwrap_or_default())
    }
}

impl PartialEq for Readings<'_> {
    fn eq(&self, other: &Self) -> bool {
        self.reading_bytes() == other.reading_bytes() && self.iter().eq(other.iter())
    }
}

impl Eq for Readings<'_> {}

impl<'a> Frame<'a> {
    /// Bytes before the readings.
    pub(crate) const HEADER_BYTES: usize = 16;

    /// Maximum length of its packet, bytes.
    pub const fn packet_bytes(slot_count: usize, reading_bytes: usize) -> usize {
        packet_bytes(Self::HEADER_BYTES + slot_count * reading_bytes)
    }

    fn put(&self, packer: &mut Packer<'_>) -> Result<(), NoRoom> {
        let count = u16::try_from(self.readings.len()).map_err(|_| NoRoom)?;
        // Readings have two bytes, or four if the highest bit of the flags is set.
        let wide = if self.readings.reading_bytes() == 4 { Self::WIDE } else { 0 };
        packer.put(&[FRAME, self.flags.0 | wide])?;
        packer.put(&count.to_le_bytes())?;
        packer.put(&self.sequence.to_le_bytes())?;
        packer.put(&self.time_us.to_le_bytes())?;
        match self.readings {
            Readings::I16(values) => values.iter().try_for_each(|value| packer.put(&value.to_le_bytes())),
            Readings::I32(values) => values.iter().try_for_each(|value| packer.put(&value.to_le_bytes())),
            Readings::Bytes2(bytes) => packer.put(bytes.as_flattened()),
            Readings::Bytes4(bytes) => packer.put(bytes.as_flattened()),
        }
    }

    /// The flag bit of readings of four bytes.
    const WIDE: u8 = 0x80;

    fn read(reader: &mut Reader<'a>) -> Option<Self> {
        let flags = reader.u8()?;
        let count = usize::from(reader.u16()?);
        let (sequence, time_us) = (reader.u32()?, reader.u64()?);
        let readings = if flags & Self::WIDE == 0 {
            Readings::Bytes2(reader.take(2 * count)?.as_chunks().0)
        } else {
            Readings::Bytes4(reader.take(4 * count)?.as_chunks().0)
        };
        reader.end(Frame { sequence, time_us, flags: FrameFlags(flags & !Self::WIDE), readings })
    }
}

/// The reading of a slot in a test frame: every bit of a two-byte reading takes both values.
pub const fn test_reading(slot: u16) -> i16 {
    // An odd factor near 2^16 divided by the golden ratio visits all values and spreads them.
    slot.wrapping_mul(40_503) as i16
}

/// Status of a device.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Status {
    /// Time since power-up, ms.
    pub uptime_ms: u32,
    /// Frames taken since power-up.
    pub frames: u32,
    /// Of these, frames that were not sent because the line was too slow.
    pub dropped: u32,
    /// Packets from the host that were damaged.
    pub damaged: u32,
    /// Temperature of the board, hundredths of a degree Celsius; [`i16::MIN`] if unknown.
    pub temperature_cc: i16,
    /// Supply voltage, mV; 0 if unknown.
    pub supply_mv: u16,
}

impl Status {
    /// Maximum length of its packet, bytes.
    pub const PACKET_BYTES: usize = packet_bytes(21);

    fn put(&self, packer: &mut Packer<'_>) -> Result<(), NoRoom> {
        packer.put(&[STATUS])?;
        for value in [self.uptime_ms, self.frames, self.dropped, self.damaged] {
            packer.put(&value.to_le_bytes())?;
        }
        packer.put(&self.temperature_cc.to_le_bytes())?;
        packer.put(&self.supply_mv.to_le_bytes())
    }

    fn read(reader: &mut Reader<'_>) -> Option<Self> {
        let status = Status {
            uptime_ms: reader.u32()?,
            frames: reader.u32()?,
            dropped: reader.u32()?,
            damaged: reader.u32()?,
            temperature_cc: reader.i16()?,
            supply_mv: reader.u16()?,
        };
        reader.end(status)
    }
}

/// A fault of a device, or a request that it rejects.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Fault<'a> {
    /// Kind of fault.
    pub code: FaultCode,
    /// Description as text; at most 255 bytes.
    pub text: &'a str,
}

/// Kinds of faults.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FaultCode {
    /// A message that it does not support.
    UnknownMessage,
    /// A scan table with an electrode that it does not have, or with a part missing.
    ScanTable,
    /// A rate that it does not support; the text states the highest.
    Rate,
    /// Its line is too slow for its frames.
    Line,
    /// An internal fault.
    Hardware,
    /// Any other.
    Other(u8),
}

impl From<u8> for FaultCode {
    fn from(code: u8) -> Self {
        match code {
            1 => FaultCode::UnknownMessage,
            2 => FaultCode::ScanTable,
            3 => FaultCode::Rate,
            4 => FaultCode::Line,
            5 => FaultCode::Hardware,
            other => FaultCode::Other(other),
        }
    }
}

impl From<FaultCode> for u8 {
    fn from(code: FaultCode) -> u8 {
        match code {
            FaultCode::UnknownMessage => 1,
            FaultCode::ScanTable => 2,
            FaultCode::Rate => 3,
            FaultCode::Line => 4,
            FaultCode::Hardware => 5,
            FaultCode::Other(other) => other,
        }
    }
}

impl<'a> Fault<'a> {
    /// Length of the longest packet, bytes.
    pub const PACKET_BYTES: usize = packet_bytes(2 + 1 + 255);

    fn put(&self, packer: &mut Packer<'_>) -> Result<(), NoRoom> {
        packer.put(&[FAULT, self.code.into()])?;
        put_text(packer, self.text)
    }

    fn read(reader: &mut Reader<'a>) -> Option<Self> {
        let fault = Fault { code: reader.u8()?.into(), text: reader.text()? };
        reader.end(fault)
    }
}
