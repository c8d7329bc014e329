//! Packets: messages with a checksum, delimited by zero bytes.

use crc::{CRC_32_ISCSI, Crc, Digest, Table};

/// CRC-32C, named after iSCSI.
static CRC: Crc<u32, Table<16>> = Crc::<u32, Table<16>>::new(&CRC_32_ISCSI);

const CHECKSUM_BYTES: usize = 4;

/// A message that cannot be encoded: the buffer is too small for its packet, or a value does not fit its layout.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct NoRoom;

impl core::fmt::Display for NoRoom {
    fn fmt(&self, formatter: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        formatter.write_str("the message does not fit: a buffer too small, or a value that its layout does not hold")
    }
}

impl core::error::Error for NoRoom {}

/// Maximum length of the packet of a message: with its checksum, the overhead of COBS and both zero bytes.
pub const fn packet_bytes(message_bytes: usize) -> usize {
    cobs::max_encoding_length(message_bytes + CHECKSUM_BYTES) + 2
}

/// Writes the packet of a message, which `put` supplies piece by piece, to `out` and returns its length.
///
/// # Errors
/// A buffer that is too small; [`packet_bytes`] is always enough.
pub(crate) fn pack(out: &mut [u8], put: impl FnOnce(&mut Packer<'_>) -> Result<(), NoRoom>) -> Result<usize, NoRoom> {
    let (first, rest) = out.split_first_mut().ok_or(NoRoom)?;
    *first = 0;
    // The encoder writes its first byte unconditionally.
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

/// Adds the bytes of a message to a packet.
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

/// Writes the packet of a message to `out` and returns its length.
///
/// # Errors
/// A buffer that is too small; [`packet_bytes`] is always enough.
pub fn encode(message: &[u8], out: &mut [u8]) -> Result<usize, NoRoom> {
    pack(out, |packer| packer.put(message))
}

/// An item found by a [`Decoder`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Received<'a> {
    /// A message with a valid checksum.
    Message(&'a [u8]),
    /// Bytes between two zeros that are not a packet: noise, or a truncated or damaged packet.
    Damaged,
}

/// Finds packets in a byte stream, with a buffer as long as the longest packet to decode.
///
/// After any input, decoding continues at the next zero byte: a damaged packet does not affect others. Damage that
/// creates a zero byte splits a packet, and both halves are reported; [`Arrivals`](crate::Arrivals) counts the lost
/// frames. A packet longer than the buffer is reported as damaged. Nothing is reported before a zero byte arrives.
#[derive(Debug)]
pub struct Decoder<B> {
    buffer: B,
    length: usize,
    /// Whether the packet is longer than the buffer.
    overrun: bool,
}

impl<B: AsMut<[u8]>> Decoder<B> {
    /// A decoder with its buffer: an array, or any other bytes.
    pub fn new(buffer: B) -> Self {
        Decoder { buffer, length: 0, overrun: false }
    }

    /// Processes bytes and passes every completed packet to `found`, in order.
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

    /// Discards a partial packet, for example after a reconnection.
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

    /// The packet since the last zero byte; `None` for an empty one.
    fn finish(&mut self) -> Option<Received<'_>> {
        let (length, overrun) = (self.length, self.overrun);
        self.reset();
        if length == 0 && !overrun {
            return None;
        }
        let coded = &mut self.buffer.as_mut()[..length];
        let decoded = if overrun { None } else { unpack(coded) };
        Some(decoded.map_or(Received::Damaged, Received::Message))
    }
}

/// Decodes a packet without its zero bytes in place; returns its message.
fn unpack(coded: &mut [u8]) -> Option<&[u8]> {
    let coded_bytes = coded.len();
    let report = cobs::decode_in_place_report(coded).ok()?;
    if report.parsed_size() != coded_bytes {
        return None;
    }
    let (message, checksum) = coded[..report.frame_size()].split_last_chunk::<CHECKSUM_BYTES>()?;
    (CRC.checksum(message) == u32::from_le_bytes(*checksum)).then_some(message)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Longest message in these tests, and room for its packet.
    const MAX: usize = 600;
    const ROOM: usize = packet_bytes(MAX);

    #[test]
    fn the_checksum_is_crc_32c() {
        assert_eq!(CRC.checksum(b"123456789"), 0xE306_9283);
    }

    /// Reference decoder of COBS, block by block, as defined. Writes the bytes between the zero bytes.
    fn cobs_twin(coded: &[u8], out: &mut [u8]) -> usize {
        let (mut rest, mut length) = (coded, 0);
        loop {
            let run = rest.iter().position(|&byte| byte == 0).unwrap_or(rest.len()).min(254);
            out[length] = run as u8 + 1;
            out[length + 1..length + 1 + run].copy_from_slice(&rest[..run]);
            length += 1 + run;
            // A full block does not represent a zero byte. Any other block does, and what follows needs a block even if
            // it is empty.
            match run {
                254 if rest.len() == 254 => return length,
                254 => rest = &rest[254..],
                _ if run == rest.len() => return length,
                _ => rest = &rest[run + 1..],
            }
        }
    }

    /// A message of `length` bytes without a zero byte except at `zero`, and with no zero byte in its checksum.
    fn message(length: usize, zero: Option<usize>) -> [u8; MAX] {
        let mut bytes = [0x55; MAX];
        if let Some(zero) = zero {
            bytes[zero] = 0;
        }
        let last = (1..=255).find(|&last| {
            bytes[length - 1] = last;
            !CRC.checksum(&bytes[..length]).to_le_bytes().contains(&0)
        });
        assert!(last.is_some());
        bytes
    }

    #[test]
    fn packets_at_the_edges_of_cobs_blocks() {
        for length in (240..=260).chain(500..=520) {
            for zero in [None, Some(0), Some(1), Some(length / 2), Some(length - 2)] {
                let message = &message(length, zero)[..length];
                let mut coded = [0; MAX + 4];
                coded[..length].copy_from_slice(message);
                coded[length..length + 4].copy_from_slice(&CRC.checksum(message).to_le_bytes());
                let mut expected = [0; ROOM];
                let coded_bytes = cobs_twin(&coded[..length + 4], &mut expected[1..]);

                let mut packet = [0xAA; ROOM];
                let packet_length = encode(message, &mut packet).unwrap();
                assert_eq!(packet[..packet_length], expected[..coded_bytes + 2], "{length} bytes, a zero at {zero:?}");
                assert!(packet_length <= packet_bytes(length));
                // Without any zero byte the packet has the maximum length.
                assert!(zero.is_some() || packet_length == packet_bytes(length));
                assert_eq!(packet[packet_length], 0xAA, "nothing is written behind the packet");

                let mut decoder = Decoder::new([0; ROOM]);
                let mut found = 0;
                decoder.feed(&packet[..packet_length], |received| {
                    assert_eq!(received, Received::Message(message));
                    found += 1;
                });
                assert_eq!(found, 1);
            }
        }
    }

    #[test]
    fn a_buffer_of_any_length_is_enough_or_refused() {
        for length in [0, 1, 5, 249, 250, 251, 252, 504, 505] {
            let message = &[7; MAX][..length];
            let mut whole = [0; ROOM];
            let needed = encode(message, &mut whole).unwrap();
            for room in 0..needed + 3 {
                let mut packet = [0; ROOM];
                let expected = if room < needed { Err(NoRoom) } else { Ok(needed) };
                assert_eq!(encode(message, &mut packet[..room]), expected, "{length} bytes into {room}");
                assert!(room < needed || packet == whole);
            }
        }
    }

    /// The numbers of messages and of damaged packets in some bytes.
    fn count<const N: usize>(bytes: &[&[u8]]) -> [usize; 2] {
        let (mut decoder, mut counts) = (Decoder::new([0; N]), [0, 0]);
        for bytes in bytes {
            decoder.feed(bytes, |received| counts[usize::from(received == Received::Damaged)] += 1);
        }
        counts
    }

    #[test]
    fn packets_are_found_in_whatever_comes() {
        let mut buffer = [0; 16];
        let length = encode(b"abc", &mut buffer).unwrap();
        let packet = &buffer[..length];
        let inner = &packet[1..length - 1];
        assert_eq!(count::<16>(&[packet, packet]), [2, 0]);
        assert_eq!(count::<16>(&[inner, packet]), [2, 0], "the first zero byte was lost");
        assert_eq!(count::<16>(&[packet, inner, &[0], inner, &[0]]), [3, 0], "one zero byte between two");
        assert_eq!(count::<16>(&[inner, inner, &[0], packet]), [1, 1], "no zero byte between two");
        assert_eq!(count::<16>(&[&packet[..4], packet]), [1, 1], "cut");
        assert_eq!(count::<16>(&[&packet[4..], packet]), [1, 1], "its beginning is missing");
        assert_eq!(count::<16>(&[&[0, 0, 0, 9, 9, 0, 9, 0, 0], packet]), [1, 2], "noise with zero bytes");
        assert_eq!(count::<16>(&[&[9; 40], packet, &[9; 17], packet]), [2, 2], "more noise than it holds");
        assert_eq!(count::<8>(&[packet, packet]), [2, 0], "a buffer just long enough");
        assert_eq!(count::<7>(&[packet, packet]), [0, 2], "a buffer too short");
        assert_eq!(count::<8>(&[inner, &[9; 5], packet]), [1, 1], "a packet that goes on behind what the buffer holds");
        assert_eq!(count::<0>(&[packet, packet]), [0, 2], "no buffer");
        assert_eq!(count::<16>(&[&[0, 5, 1, 2, 3, 4, 0]]), [0, 1], "shorter than a checksum, and wrong");
        assert_eq!(count::<16>(&[&[0, 1, 1, 1, 1, 1, 0]]), [1, 0], "an empty message");
        assert_eq!(count::<16>(&[&[0, 1, 1, 1, 1, 0]]), [0, 1], "less than a checksum");
    }

    #[test]
    fn a_reset_discards_a_partial_packet() {
        let mut packet = [0; 16];
        let length = encode(b"abc", &mut packet).unwrap();
        let (mut decoder, mut found) = (Decoder::new([0; 8]), 0);
        decoder.feed(&[9; 30], |_| found += 10);
        decoder.reset();
        decoder.feed(&packet[1..length], |received| found += usize::from(received == Received::Message(b"abc")));
        assert_eq!(found, 1);
    }
}
