//! Every message is the same after encoding and decoding.

use dermis_wire::{
    Decoder, Fault, Frame, FrameFlags, Hello, LONGEST_MESSAGE, NoRoom, Readings, Received, ScanPart, Slot, Slots,
    Status, ToDevice, ToHost, Unknown, encode, packet_bytes, test_reading,
};
use proptest::collection::vec;
use proptest::prelude::*;

/// The one message of a packet.
fn unpack(packet: &[u8]) -> Vec<u8> {
    let mut messages = Vec::new();
    Decoder::new(vec![0; packet.len()]).feed(packet, |received| match received {
        Received::Message(message) => messages.push(message.to_vec()),
        Received::Damaged => panic!("a damaged packet"),
    });
    assert_eq!(messages.len(), 1);
    messages.remove(0)
}

fn packet_to_host(message: &ToHost<'_>) -> Vec<u8> {
    let mut packet = vec![0; packet_bytes(LONGEST_MESSAGE)];
    let length = message.encode(&mut packet).unwrap();
    packet.truncate(length);
    packet
}

fn packet_to_device(message: &ToDevice<'_>) -> Vec<u8> {
    let mut packet = vec![0; ToDevice::PACKET_BYTES];
    let length = message.encode(&mut packet).unwrap();
    packet.truncate(length);
    packet
}

/// Encodes and decodes a message and checks that it is unchanged and its packet has at most `most` bytes.
fn round_trip_to_host(message: &ToHost<'_>, most: usize) {
    let packet = packet_to_host(message);
    assert!(packet.len() <= most);
    let bytes = unpack(&packet);
    let parsed = ToHost::parse(&bytes).unwrap();
    assert_eq!(parsed, *message);
    assert_eq!(packet_to_host(&parsed), packet);
}

fn round_trip_to_device(message: &ToDevice<'_>) {
    let packet = packet_to_device(message);
    let bytes = unpack(&packet);
    let parsed = ToDevice::parse(&bytes).unwrap();
    assert_eq!(parsed, *message);
    assert_eq!(packet_to_device(&parsed), packet);
}

/// A text as received: truncated to at most 255 bytes, at a character boundary.
fn cut(text: &str) -> &str {
    let ends = text.char_indices().map(|(start, character)| start + character.len_utf8());
    &text[..ends.take_while(|&end| end <= 255).last().unwrap_or(0)]
}

prop_compose! {
    fn any_hello()(
        wide in any::<bool>(),
        [version, electrode_count, slot_count] in any::<[u16; 3]>(),
        design_sha256 in any::<[u8; 32]>(),
        numbers in proptest::array::uniform5(-1e9f32..1e9),
        [full_scale, rate_millihertz, highest_rate_millihertz, baud, serial, boot] in any::<[u32; 6]>(),
    ) -> Hello<'static> {
        let [reference_ohm, source_v, undriven, driven, reference] = numbers;
        Hello {
            version, reading_bytes: if wide { 4 } else { 2 }, design_sha256, electrode_count, slot_count, reference_ohm,
            source_v, volts_per_count: [undriven, driven, reference], full_scale, rate_millihertz, highest_rate_millihertz, baud,
            serial, boot, name: "",
        }
    }
}

fn any_flags() -> impl Strategy<Value = FrameFlags> {
    let named = [FrameFlags::SATURATED, FrameFlags::OVERRUN, FrameFlags::TEST];
    (0..8u8).prop_map(move |set| {
        let chosen = named.into_iter().enumerate().filter(|&(bit, _)| set >> bit & 1 == 1);
        chosen.fold(FrameFlags::default(), |flags, (_, flag)| flags.and(flag))
    })
}

fn any_slot() -> impl Strategy<Value = Slot> {
    let electrode = 0..u16::MAX;
    let measure = proptest::option::of([electrode.clone(), electrode]);
    ([any::<u16>(), any::<u16>()], measure).prop_map(|([source, sink], measure)| Slot { source, sink, measure })
}

proptest! {
    #[test]
    fn hello(hello in any_hello(), name in ".{0,300}") {
        let packet = packet_to_host(&ToHost::Hello(Hello { name: &name, ..hello }));
        prop_assert_eq!(Hello::version_of(&unpack(&packet)), Some(hello.version));
        round_trip_to_host(&ToHost::Hello(Hello { name: cut(&name), ..hello }), Hello::PACKET_BYTES);
        prop_assert_eq!(packet_to_host(&ToHost::Hello(Hello { name: cut(&name), ..hello })), packet);
    }

    #[test]
    fn frame_of_two_bytes(
        sequence: u32, time_us: u64, flags in any_flags(), readings in vec(any::<i16>(), 0..1000),
    ) {
        let frame = Frame { sequence, time_us, flags, readings: Readings::I16(&readings) };
        round_trip_to_host(&ToHost::Frame(frame), Frame::packet_bytes(readings.len(), 2));
        let wide: Vec<i32> = readings.iter().map(|&reading| reading.into()).collect();
        prop_assert!(frame.readings.iter().eq(wide.iter().copied()));
        prop_assert_ne!(frame.readings, Readings::I32(&wide), "readings of another width");
    }

    #[test]
    fn frame_of_four_bytes(
        sequence: u32, time_us: u64, flags in any_flags(), readings in vec(any::<i32>(), 0..1000),
    ) {
        let frame = Frame { sequence, time_us, flags, readings: Readings::I32(&readings) };
        round_trip_to_host(&ToHost::Frame(frame), Frame::packet_bytes(readings.len(), 4));
    }

    #[test]
    fn frame_of_few_nonzero_bytes(readings in vec(prop_oneof![9 => Just(0i16), 1 => any::<i16>()], 0..1000)) {
        let frame = Frame { sequence: 0, time_us: 0, flags: FrameFlags::default(), readings: Readings::I16(&readings) };
        round_trip_to_host(&ToHost::Frame(frame), Frame::packet_bytes(readings.len(), 2));
    }

    #[test]
    fn status(numbers: [u32; 4], temperature_cc: i16, supply_mv: u16) {
        let [uptime_ms, frames, dropped, damaged] = numbers;
        let status = Status { uptime_ms, frames, dropped, damaged, temperature_cc, supply_mv };
        round_trip_to_host(&ToHost::Status(status), Status::PACKET_BYTES);
    }

    #[test]
    fn fault(code: u8, text in ".{0,300}") {
        let fault = Fault { code: code.into(), text: cut(&text) };
        round_trip_to_host(&ToHost::Fault(fault), Fault::PACKET_BYTES);
        let long = packet_to_host(&ToHost::Fault(Fault { text: &text, ..fault }));
        prop_assert_eq!(long, packet_to_host(&ToHost::Fault(fault)));
    }

    #[test]
    fn scan(first in 0..=u16::MAX - 64, rest in 0..1000u16, slots in vec(any_slot(), 0..=ScanPart::MAX)) {
        let total = (first + slots.len() as u16).saturating_add(rest);
        round_trip_to_device(&ToDevice::Scan(ScanPart { first, total, slots: Slots::Given(&slots) }));
    }

    #[test]
    fn slot_of_any_bytes(bytes: [u8; 8]) {
        prop_assert_eq!(Slot::from_bytes(bytes).to_bytes(), bytes);
    }

    #[test]
    fn rate(rate_millihertz: u32) {
        round_trip_to_device(&ToDevice::Rate(rate_millihertz));
    }
}

#[test]
fn commands_without_a_value() {
    [ToDevice::Identify, ToDevice::Start, ToDevice::Stop, ToDevice::SelfTest].iter().for_each(round_trip_to_device);
}

/// One message of every kind.
fn one_of_each<T>(take: impl FnOnce(&[ToHost<'_>], &[ToDevice<'_>]) -> T) -> T {
    let hello = Hello {
        version: 1,
        reading_bytes: 2,
        design_sha256: [9; 32],
        electrode_count: 30,
        slot_count: 900,
        reference_ohm: 1000.0,
        source_v: 3.3,
        volts_per_count: [1e-6, 1e-4, 1e-3],
        full_scale: 2047,
        rate_millihertz: 120_000,
        highest_rate_millihertz: 120_000,
        baud: 0,
        serial: 1,
        boot: 77,
        name: "größe",
    };
    let (narrow, wide) = ([1, 0, -1, 300], [1, 0, -1, 70_000]);
    let frame = Frame { sequence: 1, time_us: 2, flags: FrameFlags::TEST, readings: Readings::I16(&narrow) };
    let slots = [Slot { source: 0, sink: 1, measure: None }, Slot { source: 0, sink: 1, measure: Some([2, 3]) }];
    let part = ScanPart { first: 0, total: 3, slots: Slots::Given(&slots) };
    let to_host = [
        ToHost::Hello(hello),
        ToHost::Frame(frame),
        ToHost::Frame(Frame { readings: Readings::I32(&wide), ..frame }),
        ToHost::Status(Status { frames: 5, ..Status::default() }),
        ToHost::Fault(Fault { code: 3.into(), text: "at most 120 Hz" }),
    ];
    let to_device = [
        ToDevice::Identify,
        ToDevice::Start,
        ToDevice::Stop,
        ToDevice::Scan(part),
        ToDevice::Rate(1),
        ToDevice::SelfTest,
    ];
    take(&to_host, &to_device)
}

/// A truncated or extended message is unknown: every length is checked.
#[test]
fn messages_of_a_wrong_length_are_unknown() {
    one_of_each(|to_host, to_device| {
        for packet in to_host.iter().map(packet_to_host) {
            let mut bytes = unpack(&packet);
            for length in 0..bytes.len() {
                let unknown = Unknown { kind: bytes[..length].first().copied(), length };
                assert_eq!(ToHost::parse(&bytes[..length]), Err(unknown));
            }
            bytes.push(0);
            assert!(ToHost::parse(&bytes).is_err());
        }
        for packet in to_device.iter().map(packet_to_device) {
            let mut bytes = unpack(&packet);
            for length in 0..bytes.len() {
                assert!(ToDevice::parse(&bytes[..length]).is_err());
            }
            assert!(ToHost::parse(&bytes).is_err(), "what is said to a device is not said to a host");
            bytes.push(0);
            assert!(ToDevice::parse(&bytes).is_err());
        }
    });
}

/// Every buffer shorter than the packet is rejected without a panic; the length of the packet is enough.
#[test]
fn buffers_of_every_length() {
    one_of_each(|to_host, to_device| {
        let encode_to_host = to_host.iter().map(|message| (packet_to_host(message), false)).enumerate();
        let encode_to_device = to_device.iter().map(|message| (packet_to_device(message), true)).enumerate();
        for (index, (packet, for_device)) in encode_to_host.chain(encode_to_device) {
            for room in 0..=packet.len() {
                let mut buffer = vec![0; room];
                let written = match for_device {
                    true => to_device[index].encode(&mut buffer),
                    false => to_host[index].encode(&mut buffer),
                };
                assert_eq!(written, if room < packet.len() { Err(NoRoom) } else { Ok(room) });
                assert!(room < packet.len() || buffer == packet);
            }
        }
    });
}

#[test]
fn values_that_a_layout_does_not_hold_are_refused() {
    let mut room = vec![0; 2 * packet_bytes(LONGEST_MESSAGE)];
    let readings = vec![1; 65_536];
    let frame = |readings| Frame { sequence: 0, time_us: 0, flags: FrameFlags::default(), readings };
    assert!(ToHost::Frame(frame(Readings::I16(&readings[..65_535]))).encode(&mut room).is_ok());
    assert_eq!(ToHost::Frame(frame(Readings::I16(&readings))).encode(&mut room), Err(NoRoom));

    let slots = [Slot { source: 0, sink: 1, measure: None }; ScanPart::MAX + 1];
    let part =
        |first, total, count: usize| ToDevice::Scan(ScanPart { first, total, slots: Slots::Given(&slots[..count]) });
    assert!(part(0, 64, 64).encode(&mut room).is_ok());
    assert_eq!(part(0, 65, 65).encode(&mut room), Err(NoRoom));
    assert_eq!(part(1, 64, 64).encode(&mut room), Err(NoRoom));
    assert_eq!(part(u16::MAX, u16::MAX, 1).encode(&mut room), Err(NoRoom));

    one_of_each(|to_host, _| {
        let ToHost::Hello(hello) = to_host[0] else { unreachable!() };
        for reading_bytes in [0, 1, 3, 8] {
            assert_eq!(ToHost::Hello(Hello { reading_bytes, ..hello }).encode(&mut room), Err(NoRoom));
        }
    });
}

#[test]
fn the_longest_frame_fits() {
    let readings = vec![-1; 65_535];
    let frame =
        Frame { sequence: 0, time_us: u64::MAX, flags: FrameFlags::default(), readings: Readings::I32(&readings) };
    round_trip_to_host(&ToHost::Frame(frame), packet_bytes(LONGEST_MESSAGE));
}

/// A truncated text ends with a complete character; invalid UTF-8 ends the text, and the rest of the message is valid.
#[test]
fn texts_are_cut_between_characters() {
    for start in 0..4 {
        let text = "x".repeat(start) + &"€".repeat(100);
        let packet = packet_to_host(&ToHost::Fault(Fault { code: 9.into(), text: &text }));
        let bytes = unpack(&packet);
        let whole = (255 - start) / 3 * 3 + start;
        assert_eq!(ToHost::parse(&bytes), Ok(ToHost::Fault(Fault { code: 9.into(), text: &text[..whole] })));
    }
    assert_eq!(ToHost::parse(b"\x04\x05\x03a\xffb"), Ok(ToHost::Fault(Fault { code: 5.into(), text: "a" })));
    assert_eq!(ToHost::parse(b"\x04\x05\x03abcd"), Err(Unknown { kind: Some(4), length: 7 }));
}

/// Every bit of a test reading takes both values in a frame with few slots, and no two slots have the same reading.
#[test]
fn test_readings_show_every_bit() {
    let readings: Vec<i16> = (0..=u16::MAX).map(test_reading).collect();
    let few = &readings[..12];
    assert_eq!(few.iter().fold(0, |bits, reading| bits | reading), -1);
    assert_eq!(few.iter().fold(-1, |bits, reading| bits & reading), 0);
    let distinct: std::collections::HashSet<_> = readings.iter().collect();
    assert_eq!(distinct.len(), 65_536);
}

#[test]
fn an_unknown_message_says_what_it_was() {
    assert_eq!(ToHost::parse(&[]).unwrap_err().to_string(), "an empty message");
    assert_eq!(ToDevice::parse(&[0x7f, 1]).unwrap_err().to_string(), "a message of kind 0x7f and 2 bytes is unknown");
    let mut packet = [0; 16];
    let length = encode(&[], &mut packet).unwrap();
    assert_eq!(unpack(&packet[..length]), []);
}
