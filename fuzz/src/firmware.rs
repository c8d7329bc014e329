//! The fuzz target of a reader's firmware: arbitrary bytes from a host over a line that is unplugged at arbitrary
//! moments. Every packet that the device sends is sound, and afterwards it answers.
//!
//! `cargo +nightly fuzz run firmware` from this folder's parent; `dermis-firmware/tests/fuzz_device.rs` runs the same
//! function on seeded mutations of valid conversations in the ordinary tests.

use dermis_firmware::{
    Device, FrontEnd, Gain, Gone, Instrument, Limits, Link, Memory, Settling, SlotScanner, System, TimedSlot,
};
use dermis_wire::{Decoder, Received, Slot, ToDevice, ToHost};

/// Slots of the largest scan table.
const MAX: usize = 16;
const SLOTS: [TimedSlot; 2] = [TimedSlot::new(0, 1, None, 1000), TimedSlot::new(0, 1, Some([1, 2]), 2000)];
const INSTRUMENT: Instrument<'static> = Instrument {
    design_sha256: [0; 32],
    electrode_count: 5,
    reference_ohm: 1.0,
    source_v: 1.0,
    volts_per_count: [1.0; 3],
    full_scale: 100,
    settling: Settling { slots: &SLOTS, otherwise_ns: 5000 },
    rate_millihertz: 100_000,
    name: "fuzzed",
    baud: 0,
    serial: 0,
    boot: 0,
};

/// First byte of a step: its bytes are sent as they are, not as a packet.
pub const RAW: u8 = 1;
/// First byte of a step: the line is unplugged.
pub const UNPLUGGED: u8 = 2;
/// First byte of a step: more than a second passes before it.
pub const LATER: u8 = 4;
/// Polls of a step: bits of the first byte from this one on, and one more.
pub const POLLS_BIT: u8 = 3;
/// Room on the line, in steps of 40 bytes: bits of the first byte from this one on.
pub const ROOM_BIT: u8 = 5;

/// Readings of a front end that is always the same.
struct Constant;

impl FrontEnd for Constant {
    const LIMITS: Limits = Limits { overhead_ns: 500, frame_ns: 0, longest_wait_ns: 1_000_000 };

    fn open(&mut self) {}
    fn select(&mut self, _: Slot, _: Gain) {}
    fn close(&mut self) {}
    fn wait_ns(&mut self, _: u32) {}
    fn convert(&mut self) -> i16 {
        7
    }
}

/// Bytes to the device, some per step; the host is there or not.
#[derive(Default)]
struct Line {
    bytes: Vec<u8>,
    plugged: bool,
    room: usize,
    said: Vec<u8>,
}

impl Link for Line {
    fn connected(&mut self) -> bool {
        self.plugged
    }

    fn receive(&mut self, buffer: &mut [u8]) -> Result<usize, Gone> {
        let count = buffer.len().min(self.bytes.len());
        buffer[..count].copy_from_slice(&self.bytes[..count]);
        self.bytes.drain(..count);
        Ok(count)
    }

    fn send(&mut self, bytes: &[u8]) -> Result<usize, Gone> {
        let count = bytes.len().min(self.room);
        self.room -= count;
        self.said.extend(&bytes[..count]);
        Ok(count)
    }
}

struct Clock(u64);

impl System for Clock {
    fn now_us(&mut self) -> u64 {
        self.0 += 37;
        self.0
    }
}

/// A conversation: steps of a first byte, a length, and so many bytes from the host.
pub fn fuzz_firmware(mut data: &[u8]) {
    let [mut complete, mut arriving, mut scanned] = [[TimedSlot::NONE; MAX]; 3];
    let (mut tested, mut readings, mut outbox) = ([0; MAX], [0; MAX], [0; Memory::outbox_bytes(MAX)]);
    let memory = Memory { tables: [&mut complete, &mut arriving], readings: &mut tested, outbox: &mut outbox };
    let mut device = Device::new(INSTRUMENT, memory);
    let mut scanner = SlotScanner::new(Constant, &mut scanned, &mut readings);
    let (mut line, mut clock) = (Line::default(), Clock(0));
    while let [first, length, rest @ ..] = data {
        let (bytes, rest) = rest.split_at(rest.len().min(usize::from(*length)));
        data = rest;
        line.bytes = if first & RAW == 0 { packet(bytes) } else { bytes.to_vec() };
        line.plugged = first & UNPLUGGED == 0;
        clock.0 += if first & LATER == 0 { 0 } else { 1_100_000 };
        for _ in 0..1 + (first >> POLLS_BIT & 3) {
            line.room = 40 * usize::from(first >> ROOM_BIT);
            device.poll(&mut scanner, &mut line, &mut clock);
        }
        if !line.plugged {
            hellos(&std::mem::take(&mut line.said));
        }
    }
    hellos(&line.said);
    check(&mut |line| device.poll(&mut scanner, line, &mut clock));
}

fn packet(message: &[u8]) -> Vec<u8> {
    let mut packet = vec![0; dermis_wire::packet_bytes(message.len())];
    let length = dermis_wire::encode(message, &mut packet).expect("`packet_bytes` is enough");
    packet.truncate(length);
    packet
}

/// A new host hears a greeting and an answer in sound packets.
fn check(poll: &mut dyn FnMut(&mut Line)) {
    let mut line = Line::default();
    poll(&mut line);
    let mut packet = [0; ToDevice::PACKET_BYTES];
    let length = ToDevice::Identify.encode(&mut packet).expect("an identify fits");
    (line.plugged, line.bytes) = (true, packet[..length].to_vec());
    for _ in 0..8 {
        line.room = usize::MAX;
        poll(&mut line);
    }
    assert_eq!(hellos(&line.said), 2, "it greets its host and answers");
}

/// The hellos in what the device has said to one host. All packets must be sound but the last, which may be cut off.
fn hellos(said: &[u8]) -> usize {
    let mut hellos = 0;
    Decoder::new([0; 1024]).feed(said, |received| match received {
        Received::Message(message) => {
            let message = ToHost::parse(message).expect("the device sends messages of the protocol");
            hellos += usize::from(matches!(message, ToHost::Hello(_)));
        }
        Received::Damaged => panic!("the device sent a damaged packet"),
    });
    hellos
}
