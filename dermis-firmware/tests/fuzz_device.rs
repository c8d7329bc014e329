//! The fuzz target of the firmware on seeded mutations of valid conversations, and conversations that are unplugged at
//! every step: no panic, only sound packets, and afterwards the device answers.

#[path = "../../fuzz/src/mutation.rs"]
mod mutation;
#[path = "../../fuzz/src/firmware.rs"]
mod target;

use dermis_wire::{Decoder, Received, ScanPart, Slot, Slots, ToDevice};
use mutation::mutated;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use target::{LATER, POLLS_BIT, RAW, ROOM_BIT, UNPLUGGED, fuzz_firmware};

/// Number of conversations. Set `DERMIS_FUZZ_RUNS` for more.
const RUNS: usize = 50_000;

/// A step of a conversation, with room on the line for `room` times 40 bytes.
fn step(flags: u8, room: u8, bytes: &[u8]) -> Vec<u8> {
    let mut step = vec![flags | 3 << POLLS_BIT | room << ROOM_BIT, bytes.len() as u8];
    step.extend(bytes);
    step
}

/// The bytes of a request, without its frame.
fn message(request: &ToDevice<'_>) -> Vec<u8> {
    let mut packet = [0; ToDevice::PACKET_BYTES];
    let length = request.encode(&mut packet).unwrap();
    let mut message = Vec::new();
    Decoder::new([0; ToDevice::PACKET_BYTES]).feed(&packet[..length], |received| {
        let Received::Message(bytes) = received else { panic!("its own packet is sound") };
        message = bytes.to_vec();
    });
    message
}

/// Every request, sound and unsound.
fn requests() -> Vec<Vec<u8>> {
    let slots: Vec<Slot> = (0..12u16)
        .map(|k| Slot { source: k % 5, sink: (k + 1) % 5, measure: (k % 3 > 0).then_some([(k + 2) % 5, (k + 3) % 5]) })
        .collect();
    let part = |first: u16, total: u16, slots| ToDevice::Scan(ScanPart { first, total, slots: Slots::Given(slots) });
    let absent = [Slot { source: 5, sink: 0, measure: None }];
    let requests = [
        ToDevice::Stop,
        ToDevice::Identify,
        part(0, 12, &slots[..7]),
        part(7, 12, &slots[7..]),
        ToDevice::Rate(2_000_000),
        ToDevice::SelfTest,
        ToDevice::Start,
        part(0, 2, &slots[..2]),
        part(1, 2, &absent),
        part(0, 1, &absent),
        part(0, 0, &[]),
        part(0, 17, &slots[..1]),
        ToDevice::Rate(0),
        ToDevice::Rate(u32::MAX),
        ToDevice::Start,
        ToDevice::SelfTest,
        ToDevice::Stop,
    ];
    requests.iter().map(message).chain([vec![0x99], vec![], vec![0x82, 0]]).collect()
}

/// Conversations at several speeds of the line, whole and cut into pieces.
fn seeds() -> Vec<Vec<u8>> {
    let requests = requests();
    let spoken = |flags: u8, room: u8| requests.iter().flat_map(|bytes| step(flags, room, bytes)).collect::<Vec<_>>();
    let raw: Vec<u8> = requests.concat();
    let pieces = raw.chunks(7).flat_map(|bytes| step(RAW, 2, bytes)).collect();
    vec![spoken(0, 7), spoken(0, 1), spoken(LATER, 3), spoken(0, 0), pieces]
}

/// A conversation of valid steps in any order, or a valid one with changes of its bytes.
fn conversation(seeds: &[Vec<u8>], requests: &[Vec<u8>], random: &mut ChaCha8Rng) -> Vec<u8> {
    if random.random() {
        return mutated(seeds, random);
    }
    let steps = (0..random.random_range(1..12)).flat_map(|_| {
        let mut bytes = requests[random.random_range(0..requests.len())].clone();
        if random.random_bool(0.2) {
            bytes = mutated(&[bytes, seeds[0][..40].to_vec()], random);
        }
        bytes.truncate(255);
        step(random.random::<u8>() & 0x1F, random.random_range(0..8), &bytes)
    });
    steps.collect()
}

#[test]
fn random_conversations_are_survived() {
    let runs = std::env::var("DERMIS_FUZZ_RUNS").ok().and_then(|text| text.parse().ok()).unwrap_or(RUNS);
    let (seeds, requests) = (seeds(), requests());
    seeds.iter().for_each(|seed| fuzz_firmware(seed));
    for run in 0..runs {
        let mut random = ChaCha8Rng::seed_from_u64(386);
        random.set_stream(run as u64);
        let bytes = conversation(&seeds, &requests, &mut random);
        if let Err(panic) = std::panic::catch_unwind(|| fuzz_firmware(&bytes)) {
            eprintln!("run {run}: {bytes:?}");
            std::panic::resume_unwind(panic);
        }
    }
}

/// The line is unplugged after every byte from the host, with every room on the line.
#[test]
fn unplugging_at_every_byte_is_survived() {
    for request in requests() {
        let mut packet = vec![0; dermis_wire::packet_bytes(request.len())];
        let length = dermis_wire::encode(&request, &mut packet).unwrap();
        for (cut, room) in (0..=length).flat_map(|cut| (0..8).map(move |room| (cut, room))) {
            let before = [step(0, 7, &message(&ToDevice::Start)), step(RAW, room, &packet[..cut.min(255)])].concat();
            for after in [
                step(UNPLUGGED, 0, &[]),
                [step(UNPLUGGED, 0, &[]), step(RAW, 7, &packet[cut..length.min(cut + 255)])].concat(),
            ] {
                fuzz_firmware(&[&before[..], &after[..]].concat());
            }
        }
    }
}
