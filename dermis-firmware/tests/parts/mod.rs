//! The parts of a board for tests: a line, a clock, and a front end that checks its order of operations.

use dermis_firmware::{Device, FrontEnd, Gain, Gone, Instrument, Limits, Link, Memory, Settling, System, TimedSlot};
use dermis_wire::{Decoder, Received, Slot, ToDevice, ToHost, packet_bytes};
use std::collections::VecDeque;

/// Slots of the largest table here.
pub const MAX: usize = 40;

/// A line between device and host that carries so many bytes per poll.
pub struct FakeLink {
    pub to_device: VecDeque<u8>,
    pub to_host: Vec<u8>,
    pub plugged: bool,
    pub bytes_per_poll: usize,
    left: usize,
}

impl FakeLink {
    pub fn new() -> Self {
        FakeLink { to_device: VecDeque::new(), to_host: Vec::new(), plugged: true, bytes_per_poll: 100_000, left: 0 }
    }

    pub fn ask(&mut self, message: &ToDevice<'_>) {
        let mut packet = [0; ToDevice::PACKET_BYTES];
        let length = message.encode(&mut packet).unwrap();
        self.to_device.extend(&packet[..length]);
    }

    /// The messages that have arrived at the host; every packet must be sound.
    pub fn heard(&mut self) -> Vec<Vec<u8>> {
        let mut decoder = Decoder::new(vec![0; packet_bytes(4096)]);
        let mut messages = Vec::new();
        decoder.feed(&std::mem::take(&mut self.to_host), |received| match received {
            Received::Message(message) => messages.push(message.to_vec()),
            Received::Damaged => panic!("the device sent a damaged packet"),
        });
        messages.iter().for_each(|message| assert!(ToHost::parse(message).is_ok()));
        messages
    }
}

impl Link for FakeLink {
    fn connected(&mut self) -> bool {
        self.left = self.bytes_per_poll;
        self.plugged
    }

    fn receive(&mut self, buffer: &mut [u8]) -> Result<usize, Gone> {
        if !self.plugged {
            return Err(Gone);
        }
        let count = buffer.len().min(self.to_device.len());
        buffer.iter_mut().zip(self.to_device.drain(..count)).for_each(|(place, byte)| *place = byte);
        Ok(count)
    }

    fn send(&mut self, bytes: &[u8]) -> Result<usize, Gone> {
        if !self.plugged {
            return Err(Gone);
        }
        let count = bytes.len().min(self.left);
        self.left -= count;
        self.to_host.extend(&bytes[..count]);
        Ok(count)
    }
}

/// A clock that the test sets.
#[derive(Default)]
pub struct FakeSystem {
    pub now_us: u64,
    pub fed: u64,
}

impl System for FakeSystem {
    fn now_us(&mut self) -> u64 {
        self.now_us
    }

    fn feed_watchdog(&mut self) {
        self.fed += 1;
    }
}

/// Counts of a slot, as this front end reads them.
pub fn counts(slot: Slot) -> i16 {
    let [plus, minus] = slot.measure.unwrap_or([40, 41]);
    (1000 * slot.source + 100 * slot.sink + 10 * plus + minus) as i16
}

/// A front end that checks the order of its operations.
#[derive(Default)]
pub struct FakeFrontEnd {
    closed: bool,
    selected: Option<Slot>,
    waited_ns: u32,
    /// Slots that were converted, with their settling.
    pub converted: Vec<(Slot, Gain, u32)>,
    gain: Option<Gain>,
}

impl FrontEnd for FakeFrontEnd {
    const LIMITS: Limits = Limits { overhead_ns: 1000, frame_ns: 10_000, longest_wait_ns: 1_000_000 };

    fn open(&mut self) {
        (self.closed, self.selected) = (false, None);
    }

    fn select(&mut self, slot: Slot, gain: Gain) {
        assert!(!self.closed, "switched while switches were closed");
        (self.selected, self.gain) = (Some(slot), Some(gain));
    }

    fn close(&mut self) {
        assert!(self.selected.is_some(), "closed without an address");
        (self.closed, self.waited_ns) = (true, 0);
    }

    fn wait_ns(&mut self, wait_ns: u32) {
        self.waited_ns += wait_ns;
    }

    fn convert(&mut self) -> i16 {
        assert!(self.closed, "converted with open switches");
        let slot = self.selected.unwrap();
        self.converted.push((slot, self.gain.unwrap(), self.waited_ns));
        counts(slot)
    }
}

pub const fn slot(source: u16, sink: u16, measure: Option<[u16; 2]>, wait_ns: u32) -> TimedSlot {
    TimedSlot::new(source, sink, measure, wait_ns)
}

/// Eight electrodes, two drives of three slots.
pub static SLOTS: [TimedSlot; 6] = [
    slot(0, 1, None, 2000),
    slot(0, 1, Some([1, 2]), 3000),
    slot(0, 1, Some([2, 3]), 4000),
    slot(1, 2, None, 2000),
    slot(1, 2, Some([2, 3]), 3000),
    slot(1, 2, Some([3, 4]), 9000),
];

pub const INSTRUMENT: Instrument<'static> = Instrument {
    design_sha256: [7; 32],
    electrode_count: 8,
    reference_ohm: 1000.0,
    source_v: 5.0,
    volts_per_count: [1e-5, 1e-4, 1e-4],
    full_scale: 32_767,
    settling: Settling { slots: &SLOTS, otherwise_ns: 20_000 },
    rate_millihertz: 120_000,
    name: "test",
    baud: 0,
    serial: 5,
    boot: 6,
};

/// Calls a function with a device that has memory for [`MAX`] slots.
pub fn with_device<R>(instrument: Instrument<'_>, run: impl FnOnce(Device<'_>) -> R) -> R {
    let (mut complete, mut arriving) = ([TimedSlot::NONE; MAX], [TimedSlot::NONE; MAX]);
    let (mut readings, mut outbox) = ([0; MAX], [0; Memory::outbox_bytes(MAX)]);
    let memory = Memory { tables: [&mut complete, &mut arriving], readings: &mut readings, outbox: &mut outbox };
    run(Device::new(instrument, memory))
}
