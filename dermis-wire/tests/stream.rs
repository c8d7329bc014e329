//! Long streams with damage: a damaged frame does not affect others, and no input causes a panic.

use dermis_wire::{
    Arrival, Arrivals, Decoder, Frame, FrameFlags, Hello, Readings, Received, ScanPart, Slot, Slots, Status, ToDevice,
    ToHost,
};
use rand::{Rng, RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

const SLOTS: usize = 30;
const PACKET_BYTES: usize = Frame::packet_bytes(SLOTS, 2);

/// Damage applied to the stream, which the decoder must report.
#[derive(Debug, Default, Clone, Copy, PartialEq, Eq)]
struct Counts {
    /// Frames whose packet arrived undamaged, each counted once.
    whole: u64,
    /// Frames whose packet was damaged or cut.
    lost: u64,
    /// Frames whose packet was repeated.
    repeated: u64,
    /// Sequences of bytes between zero bytes that are not a packet.
    damaged: u64,
}

/// The readings of frame `sequence`, computed from this number alone; some contain zero bytes.
fn readings(sequence: u32) -> [i16; SLOTS] {
    let mut rng = ChaCha8Rng::seed_from_u64(sequence.into());
    std::array::from_fn(|_| if rng.random_bool(0.1) { 0 } else { rng.random() })
}

fn packet(sequence: u32) -> Vec<u8> {
    let readings = readings(sequence);
    let (time_us, flags) = (u64::from(sequence) * 8333, FrameFlags::default());
    let mut packet = vec![0; PACKET_BYTES];
    let frame = ToHost::Frame(Frame { sequence, time_us, flags, readings: Readings::I16(&readings) });
    let length = frame.encode(&mut packet).unwrap();
    packet.truncate(length);
    packet
}

/// Counts the sequences of nonzero bytes in a stream that arrives in pieces.
#[derive(Default)]
struct Stretches {
    count: u64,
    within: bool,
}

impl Stretches {
    fn take(&mut self, bytes: &[u8]) {
        for &byte in bytes {
            self.count += u64::from(byte != 0 && !self.within);
            self.within = byte != 0;
        }
    }
}

fn noise(rng: &mut ChaCha8Rng) -> Vec<u8> {
    let mut bytes = vec![0; rng.random_range(1..300)];
    rng.fill_bytes(&mut bytes);
    bytes
}

/// Appends frame `sequence` to the stream; one in a hundred is altered, cut, repeated, or preceded by noise.
fn append(sequence: u32, rng: &mut ChaCha8Rng, stream: &mut Vec<u8>, counts: &mut Counts) {
    let sound = packet(sequence);
    let mut packet = sound.clone();
    match if rng.random_bool(0.01) { rng.random_range(0..4) } else { 9 } {
        // One to three bytes at any position, which may become or replace zero bytes.
        0 => {
            for _ in 0..rng.random_range(1..4) {
                packet[rng.random_range(0..sound.len())] ^= rng.random_range(1..=255u8);
            }
        }
        // Bytes removed, sometimes including the last zero byte.
        1 => {
            let start = rng.random_range(1..sound.len() - 1);
            packet.drain(start..rng.random_range(start + 1..=sound.len()));
        }
        2 => {
            stream.extend_from_slice(&packet);
            counts.repeated += 1;
        }
        // Noise; the zero byte of the packet ends it.
        3 => stream.extend(noise(rng)),
        _ => {}
    }
    let came = if packet == sound { &mut counts.whole } else { &mut counts.lost };
    *came += 1;
    stream.extend(packet);
}

/// Decodes `count` frames with damage, in chunks of any length, and compares the counts with the damage.
fn survives(count: u32, seed: u64) {
    let rng = &mut ChaCha8Rng::seed_from_u64(seed);
    let (mut stream, mut done, mut found) = (Vec::new(), Counts::default(), Counts::default());
    let (mut decoder, mut arrivals) = (Decoder::new([0; PACKET_BYTES]), Arrivals::default());
    let mut stretches = Stretches::default();
    // The first and the last frame are undamaged, so that every lost one is detected as missing.
    stream.extend(packet(0));
    done.whole += 1;
    for sequence in 1..=count {
        if sequence < count {
            append(sequence, rng, &mut stream, &mut done);
        } else {
            stream.extend(packet(sequence));
            done.whole += 1;
        }
        stretches.take(&stream);
        let mut rest = &stream[..];
        while !rest.is_empty() {
            let (chunk, others) = rest.split_at(rng.random_range(1..=rest.len().min(200)));
            decoder.feed(chunk, |received| match received {
                Received::Message(message) => take(message, &mut arrivals, &mut found),
                Received::Damaged => found.damaged += 1,
            });
            rest = others;
        }
        stream.clear();
    }
    done.damaged = stretches.count - done.whole - done.repeated;
    assert!(done.lost > 0 && done.repeated > 0 && done.damaged > done.lost);
    assert_eq!(found, done);
    let received = [arrivals.received, arrivals.lost, arrivals.repeated, arrivals.reordered];
    assert_eq!(received, [done.whole, done.lost, done.repeated, 0]);
    println!("{} frames, seed {seed}: {done:?}", count + 1);
}

/// Checks that a received frame equals the one that was sent.
fn take(message: &[u8], arrivals: &mut Arrivals, found: &mut Counts) {
    let Ok(ToHost::Frame(frame)) = ToHost::parse(message) else { panic!("no frame") };
    assert!(frame.readings.iter().eq(readings(frame.sequence).map(i32::from)));
    assert_eq!(frame.time_us, u64::from(frame.sequence) * 8333);
    match arrivals.take(frame.sequence) {
        Arrival::New { skipped } => {
            found.whole += 1;
            found.lost += u64::from(skipped);
        }
        Arrival::Repeated => found.repeated += 1,
        Arrival::Late => panic!("none was sent late"),
    }
}

#[test]
fn a_damaged_frame_costs_itself_alone() {
    survives(20_000, 1);
}

#[test]
#[ignore = "slow: a million frames, some seconds"]
fn a_damaged_frame_of_a_million_costs_itself_alone() {
    survives(1_000_000, 2);
}

/// Packets to mutate: one of every kind.
fn seeds() -> Vec<Vec<u8>> {
    let mut packets = vec![packet(3), packet(1 << 30)];
    let mut buffer = [0; 1024];
    let slots = [Slot { source: 0, sink: 1, measure: None }; 8];
    let part = ScanPart { first: 8, total: 16, slots: Slots::Given(&slots) };
    for message in [ToDevice::Identify, ToDevice::Rate(7), ToDevice::Scan(part)] {
        let length = message.encode(&mut buffer).unwrap();
        packets.push(buffer[..length].to_vec());
    }
    let fault = dermis_wire::Fault { code: 2.into(), text: "größe" };
    let hello = Hello {
        version: 1,
        reading_bytes: 4,
        design_sha256: [1; 32],
        electrode_count: 3,
        slot_count: 9,
        reference_ohm: 1.0,
        source_v: f32::NAN,
        volts_per_count: [0.0; 3],
        full_scale: 0,
        rate_millihertz: 0,
        highest_rate_millihertz: 0,
        baud: 0,
        serial: 0,
        boot: 0,
        name: "größe",
    };
    for message in [ToHost::Fault(fault), ToHost::Hello(hello), ToHost::Status(Status::default())] {
        let length = message.encode(&mut buffer).unwrap();
        packets.push(buffer[..length].to_vec());
    }
    packets
}

/// Parses a message as both sides do, and reads all of its contents.
fn parse_both(message: &[u8]) -> usize {
    Hello::version_of(message);
    let mut known = 0;
    if let Ok(message) = ToHost::parse(message) {
        known += 1;
        if let ToHost::Frame(frame) = message {
            assert_eq!(frame.readings.iter().count(), frame.readings.len());
            assert_eq!(frame.readings.get(frame.readings.len()), None);
        }
    }
    if let Ok(message) = ToDevice::parse(message) {
        known += 1;
        if let ToDevice::Scan(part) = message {
            assert_eq!(part.slots.iter().count(), part.slots.len());
        }
    }
    known
}

/// Alters, removes and inserts bytes.
fn mutate(bytes: &mut Vec<u8>, rng: &mut ChaCha8Rng) {
    for _ in 0..rng.random_range(1..4) {
        let at = rng.random_range(0..=bytes.len());
        match rng.random_range(0..5) {
            0 if at < bytes.len() => bytes[at] = rng.random(),
            1 if at < bytes.len() => bytes[at] ^= 1 << rng.random_range(0..8),
            2 if at < bytes.len() => drop(bytes.remove(at)),
            3 => bytes.insert(at, if rng.random() { 0xff } else { 0 }),
            _ => bytes.truncate(at),
        }
    }
}

#[test]
fn no_bytes_make_a_panic() {
    takes_any_bytes(700_000, 5);
}

#[test]
#[ignore = "slow: 30 million strings, ten seconds"]
fn no_bytes_of_30_million_make_a_panic() {
    takes_any_bytes(10_000_000, 6);
}

/// Three inputs per round: a mutated packet, a mutated message, noise.
fn takes_any_bytes(rounds: u32, seed: u64) {
    let rng = &mut ChaCha8Rng::seed_from_u64(seed);
    let seeds = seeds();
    let messages: Vec<Vec<u8>> = seeds.iter().map(|packet| unpacked(packet)).collect();
    // A buffer shorter than some of the packets, so that it also overflows.
    let mut decoder = Decoder::new([0; 80]);
    let (mut sound, mut damaged, mut known) = (0u64, 0u64, 0);
    let mut bytes = Vec::new();
    for _ in 0..rounds {
        bytes.clear();
        bytes.extend_from_slice(&seeds[rng.random_range(0..seeds.len())]);
        mutate(&mut bytes, rng);
        decoder.feed(&bytes, |received| match received {
            Received::Message(message) => {
                sound += 1;
                known += parse_both(message);
            }
            Received::Damaged => damaged += 1,
        });
        // The checksum rejects nearly all of them, so messages are mutated as well.
        bytes.clear();
        bytes.extend_from_slice(&messages[rng.random_range(0..messages.len())]);
        mutate(&mut bytes, rng);
        known += parse_both(&bytes);
        bytes.resize(rng.random_range(0..40), 0);
        rng.fill_bytes(&mut bytes);
        decoder.feed(&bytes, |received| damaged += u64::from(received == Received::Damaged));
        known += parse_both(&bytes);
    }
    assert!(sound > 1000 && damaged > 100_000 && known > 1000, "{sound} sound, {damaged} damaged, {known} known");
}

/// The message of a packet.
fn unpacked(packet: &[u8]) -> Vec<u8> {
    let mut message = Vec::new();
    Decoder::new([0; 1024]).feed(packet, |received| {
        if let Received::Message(bytes) = received {
            message = bytes.to_vec();
        }
    });
    message
}
