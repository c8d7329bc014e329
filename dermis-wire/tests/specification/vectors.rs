//! The test vectors of `docs/wire-protocol.md`: their messages, and the bytes in the document.

use dermis_wire::{
    Fault, FaultCode, Frame, FrameFlags, Hello, Readings, ScanPart, Slot, Slots, Status, ToDevice, ToHost, encode,
    test_reading,
};

/// The text of the document.
pub fn page() -> String {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../docs/wire-protocol.md");
    std::fs::read_to_string(path).expect("the specification lies beside the crates")
}

/// Name and packet of each vector in the document, in order.
pub fn written() -> Vec<(String, Vec<u8>)> {
    let page = page();
    let (_, rest) = page.split_once("## Test vectors").expect("the page has test vectors");
    let (_, rest) = rest.split_once("```text\n").expect("they are a block of text");
    let (block, _) = rest.split_once("```").expect("that ends");
    let mut vectors: Vec<(String, Vec<u8>)> = Vec::new();
    for line in block.lines() {
        let mut words = line.split_whitespace();
        if !line.starts_with(' ') {
            vectors.push((words.next().expect("no line is empty").into(), Vec::new()));
        }
        let bytes = words.map(|word| u8::from_str_radix(word, 16).expect("two hexadecimal digits"));
        vectors.last_mut().expect("the first line has a name").1.extend(bytes);
    }
    vectors
}

/// A message of either direction.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Message<'a> {
    Host(ToHost<'a>),
    Device(ToDevice<'a>),
    Empty,
}

impl<'a> Message<'a> {
    pub fn packet(&self) -> Vec<u8> {
        let mut packet = vec![0; 4096];
        let length = match self {
            Message::Host(message) => message.encode(&mut packet),
            Message::Device(message) => message.encode(&mut packet),
            Message::Empty => encode(&[], &mut packet),
        };
        packet.truncate(length.expect("the vectors are short"));
        packet
    }

    /// The kinds of the two directions are distinct.
    pub fn parse(message: &'a [u8]) -> Option<Self> {
        match message {
            [] => Some(Message::Empty),
            [kind, ..] if kind & 0x80 != 0 => ToDevice::parse(message).ok().map(Message::Device),
            _ => ToHost::parse(message).ok().map(Message::Host),
        }
    }
}

/// Passes the name and the message of every vector to `take`, as the last table of the document lists them.
pub fn said(mut take: impl FnMut(&str, Message<'_>)) {
    commands(|name, message| take(name, Message::Device(message)));
    reports(|name, message| take(name, Message::Host(message)));
    frames(|name, frame| take(name, Message::Host(ToHost::Frame(frame))));
    take("empty", Message::Empty);
}

fn commands(mut take: impl FnMut(&str, ToDevice<'_>)) {
    take("identify", ToDevice::Identify);
    take("start", ToDevice::Start);
    take("stop", ToDevice::Stop);
    take("self_test", ToDevice::SelfTest);
    take("rate", ToDevice::Rate(120_000));
    let slot = |measure| Slot { source: 0, sink: 1, measure };
    let slots = [slot(None), slot(Some([2, 3])), slot(Some([3, 4]))];
    take("scan", ToDevice::Scan(ScanPart { first: 0, total: 4, slots: Slots::Given(&slots) }));
    let last = [Slot { source: 256, sink: 258, measure: Some([511, 0]) }];
    take("scan_end", ToDevice::Scan(ScanPart { first: 3, total: 4, slots: Slots::Given(&last) }));
}

fn reports(mut take: impl FnMut(&str, ToHost<'_>)) {
    let hello = Hello {
        version: 1,
        reading_bytes: 2,
        design_sha256: std::array::from_fn(|index| index as u8),
        electrode_count: 30,
        slot_count: 900,
        reference_ohm: 1000.0,
        source_v: 3.3,
        volts_per_count: [0.000_125, 0.001_25, 0.000_5],
        full_scale: 2047,
        rate_millihertz: 120_000,
        highest_rate_millihertz: 2_000_000,
        baud: 0,
        serial: 42,
        boot: 0xDEAD_BEEF,
        name: "größe 30",
    };
    take("hello", ToHost::Hello(hello));
    let status =
        Status { uptime_ms: 60_000, frames: 7200, dropped: 3, damaged: 1, temperature_cc: -512, supply_mv: 5000 };
    take("status", ToHost::Status(status));
    take("fault", ToHost::Fault(Fault { code: FaultCode::Rate, text: "at most 120 Hz" }));
    take("fault_254", ToHost::Fault(Fault { code: FaultCode::Hardware, text: &"u".repeat(247) }));
}

fn frames(mut take: impl FnMut(&str, Frame<'_>)) {
    let frame = |sequence, time_us, flags, readings| Frame { sequence, time_us, flags, readings };
    let none = FrameFlags::default();
    let narrow = [1200, -340, 0, 17, i16::MIN, i16::MAX];
    take("frame_2", frame(7, 58_333, none, Readings::I16(&narrow)));
    let wide = [1200, -340, 0, i32::MAX, i32::MIN];
    let flags = FrameFlags::SATURATED.and(FrameFlags::OVERRUN);
    take("frame_4", frame(u32::MAX, (1 << 40) + 5, flags, Readings::I32(&wide)));
    let test: Vec<i16> = (0..12).map(test_reading).collect();
    take("frame_test", frame(8, 66_667, FrameFlags::TEST, Readings::I16(&test)));
    let full = (0..200).map(|k| 0x0101 * (1 + k % 100));
    let long: Vec<i16> = [0, 0].into_iter().chain(full).chain([0]).collect();
    take("frame_long", frame(0x0102_0304, 0x0102_0304_0506_0708, none, Readings::I16(&long)));
}
