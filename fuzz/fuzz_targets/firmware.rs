//! Arbitrary bytes from a host to the firmware of a reader, over a line that is unplugged at arbitrary moments: every
//! packet it sends is sound, and afterwards it answers.

#![no_main]

use dermis_firmware::{
    Device, FrontEnd, Gain, Gone, Instrument, Limits, Link, Memory, Settling, SlotScanner, System, TimedSlot,
};
use dermis_wire::{Decoder, Received, Slot, ToDevice, ToHost};

const MOST: usize = 16;
const SLOTS: [TimedSlot; 2] = [TimedSlot::new(0, 1, None, 1000), TimedSlot::new(0, 1, Some([1, 2]), 2000)];

struct Still;

impl FrontEnd for Still {
    const LIMITS: Limits = Limits { overhead_ns: 500, frame_ns: 0, longest_wait_ns: 1_000_000 };

    fn open(&mut self) {}
    fn select(&mut self, _: Slot, _: Gain) {}
    fn close(&mut self) {}
    fn wait_ns(&mut self, _: u32) {}
    fn convert(&mut self) -> i16 {
        7
    }
}

/// Bytes to the device, some per poll; the host is there or not.
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

libfuzzer_sys::fuzz_target!(|data: &[u8]| {
    let instrument = Instrument {
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
    let [mut complete, mut arriving, mut scanned] = [[TimedSlot::NONE; MOST]; 3];
    let (mut tested, mut readings, mut outbox) = ([0; MOST], [0; MOST], [0; Memory::outbox_bytes(MOST)]);
    let memory = Memory { tables: [&mut complete, &mut arriving], readings: &mut tested, outbox: &mut outbox };
    let mut device = Device::new(instrument, memory);
    let mut scanner = SlotScanner::new(Still, &mut scanned, &mut readings);
    let mut line = Line { bytes: Vec::new(), plugged: true, room: 0, said: Vec::new() };
    let mut clock = Clock(0);
    for piece in data.chunks(24) {
        let [first, bytes @ ..] = piece else { break };
        // A sound packet of the bytes, or the bytes as they are; the line's speed; whether it is unplugged.
        let mut packet = [0; 64];
        let length = dermis_wire::encode(bytes, &mut packet).expect("24 bytes fit");
        line.bytes = if first & 1 == 0 { packet[..length].to_vec() } else { bytes.to_vec() };
        line.plugged = first & 0x1E != 0x1E;
        line.room = usize::from(first >> 5) * 40;
        for _ in 0..8 {
            device.poll(&mut scanner, &mut line, &mut clock);
        }
        line.bytes.clear();
        if !line.plugged {
            line.said.clear();
        }
    }
    let mut packet = [0; ToDevice::PACKET_BYTES];
    let length = ToDevice::Identify.encode(&mut packet).expect("an identify fits");
    line.plugged = false;
    device.poll(&mut scanner, &mut line, &mut clock);
    (line.plugged, line.room, line.bytes) = (true, usize::MAX, packet[..length].to_vec());
    line.said.clear();
    for _ in 0..8 {
        device.poll(&mut scanner, &mut line, &mut clock);
    }
    let mut hellos = 0;
    Decoder::new([0; 1024]).feed(&line.said, |received| match received {
        Received::Message(message) => hellos += usize::from(matches!(ToHost::parse(message), Ok(ToHost::Hello(_)))),
        Received::Damaged => panic!("the device sent a damaged packet"),
    });
    assert_eq!(hellos, 2, "it greets its host and answers");
});
