//! Baud rates.

use crate::report::{Frame, Status};

/// Common baud rates of serial lines, bits per second.
pub const STANDARD_BAUD: [u32; 17] = [
    9_600, 19_200, 38_400, 57_600, 115_200, 230_400, 460_800, 500_000, 576_000, 921_600, 1_000_000, 1_500_000,
    2_000_000, 2_500_000, 3_000_000, 3_500_000, 4_000_000,
];

/// Bits per byte on a serial line: a start bit, eight data bits, a stop bit.
const BITS_PER_BYTE: u64 = 10;

/// The most bytes per second that a device sends: its frames and a status.
pub const fn bytes_per_second(slot_count: usize, reading_bytes: usize, rate_millihertz: u32) -> u64 {
    let frame = Frame::packet_bytes(slot_count, reading_bytes) as u64;
    (frame * rate_millihertz as u64).div_ceil(1000) + Status::PACKET_BYTES as u64
}

/// The smallest common baud rate that carries `bytes_per_second`; `Err` with the required bits per second if there is
/// none.
pub fn smallest_baud(bytes_per_second: u64) -> Result<u32, u64> {
    let needed = bytes_per_second.saturating_mul(BITS_PER_BYTE);
    STANDARD_BAUD.into_iter().find(|&baud| u64::from(baud) >= needed).ok_or(needed)
}
