//! The fuzz target of recordings on seeded mutations of valid ones: bits flipped, bytes overwritten, lengths made
//! extreme, pieces cut, doubled and moved. No panic, and no allocation for a size that a file only claims.

#[path = "../../fuzz/src/recording.rs"]
mod target;

use crate::synthetic;
use dermis_live::recording::{Event, Recorder, Recording, Session};
use dermis_live::sinks::ros2::{self as ros, Message};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::io::Cursor;
use std::path::Path;

/// Number of mutations. Set `DERMIS_FUZZ_RUNS` for more.
const RUNS: usize = 100_000;

/// Small recordings: a complete one, an incomplete one, and one with uncompressed chunks, so that mutations reach their
/// contents.
fn seeds() -> Vec<Vec<u8>> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("seed.mcap");
    let skin = synthetic::SyntheticSkin::shipped("skin16");
    let session = Session { design_toml: "# a design\n".into(), hello: vec![1, 2, 3], ..Session::default() };
    let mut recorder = Recorder::create(&path, skin.reference.clone(), &session).unwrap();
    recorder.event(synthetic::BEGINNING, &Event::Command(serde_json::json!({"tare": null}))).unwrap();
    recorder.frame(&skin.frame(0)).unwrap();
    recorder.flush().unwrap();
    let unfinished = std::fs::read(&path).unwrap();
    recorder.frame(&skin.frame(1)).unwrap();
    recorder.finish().unwrap();
    let finished = std::fs::read(&path).unwrap();
    let open = laid_open(&finished);
    vec![finished, unfinished, open]
}

/// The same recording with chunks that are neither compressed nor checked: a checksum of 0 means none.
fn laid_open(bytes: &[u8]) -> Vec<u8> {
    const CHUNK: u8 = 6;
    const MAGIC_BYTES: usize = 8;
    // Opcode and length.
    const PREFIX_BYTES: usize = 9;
    // Two times and the length of the records; the checksum; the word `zstd` and its length; the compressed length.
    const BEFORE_CHECKSUM: usize = 24;
    const BEFORE_RECORDS: usize = BEFORE_CHECKSUM + 4 + 8 + 8;
    let (magic, mut rest) = bytes.split_at(MAGIC_BYTES);
    let mut out = magic.to_vec();
    while rest.len() >= PREFIX_BYTES {
        let length = u64::from_le_bytes(rest[1..PREFIX_BYTES].try_into().unwrap()) as usize;
        let (record, behind) = rest.split_at(PREFIX_BYTES + length);
        if record[0] == CHUNK {
            let body = &record[PREFIX_BYTES..];
            let records = zstd::decode_all(&body[BEFORE_RECORDS..]).unwrap();
            let open = [&body[..BEFORE_CHECKSUM], &[0; 8], &(records.len() as u64).to_le_bytes(), &records].concat();
            out.push(CHUNK);
            out.extend((open.len() as u64).to_le_bytes());
            out.extend(open);
        } else {
            out.extend(record);
        }
        rest = behind;
    }
    out.extend(rest);
    out
}

/// One to four mutations of a valid file.
fn mutated(seeds: &[Vec<u8>], random: &mut ChaCha8Rng) -> Vec<u8> {
    const LENGTHS: [u64; 7] = [0, 1, u64::MAX, 1 << 63, u32::MAX as u64, 1 << 31, 1 << 24];
    let mut bytes = seeds[random.random_range(0..seeds.len())].clone();
    for _ in 0..random.random_range(1..=4) {
        let at = random.random_range(0..bytes.len().max(1));
        let end = (at + random.random_range(1..200)).min(bytes.len());
        match random.random_range(0..8) {
            0 if !bytes.is_empty() => bytes[at] ^= 1 << random.random_range(0..8),
            1 if !bytes.is_empty() => bytes[at] = random.random(),
            2 => bytes.truncate(at),
            3 => drop(bytes.drain(at.min(end)..end)),
            4 => {
                let piece = bytes[at.min(end)..end].to_vec();
                let to = random.random_range(0..=bytes.len());
                bytes.splice(to..to, piece);
            }
            5 => {
                let other = &seeds[random.random_range(0..seeds.len())];
                bytes.truncate(at);
                bytes.extend_from_slice(&other[at.min(other.len())..]);
            }
            6 => {
                let length = LENGTHS[random.random_range(0..LENGTHS.len())].to_le_bytes();
                let end = (at + random.random_range(1..=8)).min(bytes.len());
                let count = end.saturating_sub(at);
                bytes[at.min(end)..end].copy_from_slice(&length[..count]);
            }
            _ => bytes.insert(at.min(bytes.len()), random.random()),
        }
    }
    bytes
}

#[test]
fn no_recording_makes_the_reader_panic() {
    let runs = std::env::var("DERMIS_FUZZ_RUNS").ok().and_then(|text| text.parse().ok()).unwrap_or(RUNS);
    let seeds = seeds();
    for seed in &seeds {
        let good = Recording::from_reader(Box::new(Cursor::new(seed.clone())), seed.len() as u64, Path::new("seed"));
        assert!(good.unwrap().filter(Result::is_ok).count() >= 2, "a seed that cannot be read finds nothing");
        target::repair(seed);
    }
    for run in 0..runs {
        let mut random = ChaCha8Rng::seed_from_u64(run as u64);
        let bytes = mutated(&seeds, &mut random);
        let all = || {
            target::read(&bytes);
            // Repairing takes ten times as long.
            if run % 10 == 0 {
                target::repair(&bytes);
            }
        };
        if std::panic::catch_unwind(all).is_err() {
            panic!("run {run} panics");
        }
    }
}

#[test]
fn no_message_makes_the_decoder_panic() {
    fn decode<M: Message>(good: &M, runs: u64) {
        let seeds = [ros::encode(good)];
        for run in 0..runs {
            let mut random = ChaCha8Rng::seed_from_u64(run);
            if let Ok(message) = ros::decode::<M>(&mutated(&seeds, &mut random)) {
                // Every decoded message can be encoded.
                ros::encode(&message);
            }
        }
    }
    let (reference, frame) = synthetic::pressed();
    const RUNS: u64 = 10_000;
    decode(&ros::image(&reference, &frame), RUNS);
    decode(&ros::contacts(&reference, &frame), RUNS);
    decode(&ros::wrench(&reference, &frame), RUNS);
    decode(&ros::markers(&reference, &frame), RUNS);
    decode(&ros::diagnostics(&reference, &frame), RUNS);
}
