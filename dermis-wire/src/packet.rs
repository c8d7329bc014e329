//! Packets: messages with a checksum between zero bytes.

use crc::{CRC_32_ISCSI, Crc, Digest, Table};

/// CRC-32C, by the name of its best-known user.
static CRC: Crc<u32, Table<16>> = Crc::<u32, Table<16>>::new(&CRC_32_ISCSI);

const CHECKSUM_BYTES: usize = 4;

/// A buffer too small for a packet.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct NoRoom;

impl core::fmt::Display for NoRoom {
    fn fmt(&self, formatter: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        formatter.write_str("the buffer is too small for the packet")
    }
}

impl core::error::Error for NoRoom {}

/// Bytes of the packet of a message, at most: its checksum, COBS's overhead and both zero bytes.
pub const fn packet_bytes(message_bytes: usize) -> usize {
    cobs::max_encoding_length(message_bytes + CHECKSUM_BYTES) + 2
}

/// Writes the packet of a message, which `put` gives piece by piece, into `out` and tells its length.
///
/// # Errors
/// A buffer that is too small; [`packet_bytes`] is always enough.
pub(crate) fn pack(out: &mut [u8], put: impl FnOnce(&mut Packer<'_>) -> Result<(), NoRoom>) -> Result<usize, NoRoom> {
    let (first, rest) = out.split_first_mut().ok_or(NoRoom)?;
    *first = 0;
    // The encoder writes its first byte unasked.
    if rest.is_empty() {
        return Err(NoRoom);
    }
    let mut packer = Packer { encoder: cobs::CobsEncoder::new(rest), digest: CRC.digest() };
    put(&mut packer)?;
    let Packer { mut encoder, digest } = packer;
    encoder.push(&digest.finalize().to_le_bytes()).map_err(|_| NoRoom)?;
    let length = encoder.finalize();
    *rest.get_mut(length).ok_or(NoRoom)? = 0;
    Ok(length + 2)
}

/// Takes the bytes of a message into a packet.
pub(crate) struct Packer<'a> {
    encoder: cobs::CobsEncoder<'a>,
    digest: Digest<'static, u32, Table<16>>,
}

impl Packer<'_> {
    pub fn put(&mut self, bytes: &[u8]) -> Result<(), NoRoom> {
        self.digest.update(bytes);
        self.encoder.push(bytes).map_err(|_| NoRoom)
    }
}

/// Writes the packet of a message's bytes into `out` and tells its length.
///
/// # Errors
/// A buffer that is too small; [`packet_bytes`] is always enough.
pub fn encode(message: &[u8], out: &mut [u8]) -> Result<usize, NoRoom> {
    pack(out, |packer| packer.put(message))
}

/// What a [`Decoder`] found.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Received<'a> {
    /// A message whose checksum is right.
    Message(&'a [u8]),
    /// Bytes between two zeros that are no packet: noise, or a packet that was cut or damaged on the way.
    Damaged,
}

/// Finds packets in a stream of bytes, with a buffer as long as the longest packet that it shall understand.
///
/// Whatever comes in, it goes on at the next zero byte: a damaged packet costs itself alone.
#[derive(Debug)]
pub struct Decoder<B> {
    buffer: B,
    length: usize,
    /// Whether more came than the buffer holds.
    overrun: bool,
}

impl<B: AsMut<[u8]>> Decoder<B> {
    /// A decoder with its memory: an array, or any other bytes.
    pub fn new(buffer: B) -> Self {
        Decoder { buffer, length: 0, overrun: false }
    }

    /// Takes bytes in and tells `found` of every packet that they complete, in their order.
    pub fn feed(&mut self, mut bytes: &[u8], mut found: impl FnMut(Received<'_>)) {
        while let Some(zero) = bytes.iter().position(|&byte| byte == 0) {
            self.take(&bytes[..zero]);
            if let Some(received) = self.finish() {
                found(received);
            }
            bytes = &bytes[zero + 1..];
        }
        self.take(bytes);
    }

    /// Forgets what has begun to come in, as when a connection is made anew.
    pub fn reset(&mut self) {
        self.length = 0;
        self.overrun = false;
    }

    fn take(&mut self, bytes: &[u8]) {
        let room = &mut self.buffer.as_mut()[self.length..];
        let count = bytes.len().min(room.len());
        room[..count].copy_from_slice(&bytes[..count]);
        self.length += count;
        self.overrun |= count < bytes.len();
    }

    /// What came in since the last zero byte; `None` where nothing did.
    fn finish(&mut self) -> Option<Received<'_>> {
        let (length, overrun) = (self.length, self.overrun);
        self.reset();
        if length == 0 {
            return None;
        }
        let coded = &mut self.buffer.as_mut()[..length];
        let decoded = if overrun { None } else { unpack(coded) };
        Some(decoded.map_or(Received::Damaged, Received::Message))
    }
}

/// The message in a packet without its zero bytes, decoded in place.
fn unpack(coded: &mut [u8]) -> Option<&[u8]> {
    let coded_bytes = coded.len();
    let report = cobs::decode_in_place_report(coded).ok()?;
    if report.parsed_size() != coded_bytes {
        return None;
    }
    let (message, checksum) = coded[..report.frame_size()].split_last_chunk::<CHECKSUM_BYTES>()?;
    (CRC.checksum(message) == u32::from_le_bytes(*checksum)).then_some(message)
}
