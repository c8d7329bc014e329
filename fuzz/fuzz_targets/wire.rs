//! The wire protocol on arbitrary bytes: as a stream in parts of any length, and as a message of either direction.

#![no_main]

use dermis_wire::{Decoder, Received, ToDevice, ToHost, encode, packet_bytes};

libfuzzer_sys::fuzz_target!(|data: &[u8]| {
    let [room, piece_bytes, bytes @ ..] = data else { return };
    let room = usize::from(*room);
    let at_once = found(bytes, room, usize::MAX);
    assert_eq!(found(bytes, room, usize::from(*piece_bytes).max(1)), at_once);
    at_once.iter().flatten().for_each(|message| check(message));
    check(bytes);

    // After any bytes, a valid packet is found, as the last one.
    let mut packet = vec![0; packet_bytes(bytes.len())];
    let length = encode(bytes, &mut packet).expect("`packet_bytes` is enough");
    let stream = [bytes, &packet[..length]].concat();
    assert_eq!(found(&stream, packet.len(), 7).last(), Some(&Some(bytes.to_vec())));
});

/// The messages in some bytes, `None` for a damaged packet.
fn found(bytes: &[u8], room: usize, piece_bytes: usize) -> Vec<Option<Vec<u8>>> {
    let (mut decoder, mut messages) = (Decoder::new(vec![0; room]), Vec::new());
    for piece in bytes.chunks(piece_bytes) {
        decoder.feed(piece, |received| match received {
            Received::Message(message) => messages.push(Some(message.to_vec())),
            Received::Damaged => messages.push(None),
        });
    }
    messages
}

/// A decoded message is encoded to the bytes it was decoded from.
fn check(bytes: &[u8]) {
    if let Ok(message) = ToHost::parse(bytes) {
        let again = written(bytes, |packet| message.encode(packet));
        let text = match message {
            ToHost::Hello(_) => &bytes[85..],
            ToHost::Fault(_) => &bytes[3..],
            ToHost::Frame(_) | ToHost::Status(_) => &[],
        };
        // A text ends at invalid characters, which are not encoded again.
        if std::str::from_utf8(text).is_ok() {
            assert_eq!(again, bytes);
        } else {
            // Texts are compared instead of values: NaN is not equal to itself.
            assert_eq!(format!("{:?}", ToHost::parse(&again)), format!("{:?}", Ok::<_, ()>(message)));
        }
    }
    if let Ok(message) = ToDevice::parse(bytes) {
        assert_eq!(written(bytes, |packet| message.encode(packet)), bytes);
    }
}

/// The message of the packet that `encode` writes.
fn written(bytes: &[u8], encode: impl Fn(&mut [u8]) -> Result<usize, dermis_wire::NoRoom>) -> Vec<u8> {
    let mut packet = vec![0; packet_bytes(bytes.len())];
    let length = encode(&mut packet).expect("what was read fits where it came from");
    found(&packet[..length], length, usize::MAX).remove(0).expect("its own packet is sound")
}
