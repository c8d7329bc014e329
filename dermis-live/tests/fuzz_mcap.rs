//! The fuzz target of recordings on seeded mutations of good ones: bits flipped, bytes overwritten, lengths made extreme,
//! pieces cut, doubled and moved. No panic, no memory that a file only claims.

mod synthetic;
#[path = "../../fuzz/src/recording.rs"]
mod target;

use dermis_live::record::{Event, Recorder, Session};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Mutations. Set `DERMIS_FUZZ_RUNS` for more.
const RUNS: usize = 100_000;

/// Small recordings: a finished one, one that was not finished, and one whose chunks have no checksum, so that what is in
/// them is read whatever it is.
fn seeds() -> Vec<Vec<u8>> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("seed.mcap");
    let skin = synthetic::Skin::shipped("skin16");
    let session = Session { design_toml: "# a design\n".into(), hello: vec![1, 2, 3], ..Session::default() };
    let mut recorder = Recorder::create(&path, skin.reference.clone(), &session).unwrap();
    recorder.event(synthetic::BEGINNING, &Event::Command(serde_json::json!({"tare": null}))).unwrap();
    recorder.frame(&skin.frame(0)).unwrap();
    recorder.flush().unwrap();
    let unfinished = std::fs::read(&path).unwrap();
    recorder.frame(&skin.frame(1)).unwrap();
    recorder.finish().unwrap();
    let finished = std::fs::read(&path).unwrap();
    let unchecked = without_checksums(finished.clone());
    vec![finished, unfinished, unchecked]
}

/// Writes 0, which means none, over the checksum of each chunk.
fn without_checksums(mut bytes: Vec<u8>) -> Vec<u8> {
    const CHUNK: u8 = 6;
    // The magic; kind and length; two times and the length of the records.
    let mut at = 8;
    while at + 9 <= bytes.len() {
        let length = u64::from_le_bytes(bytes[at + 1..at + 9].try_into().unwrap()) as usize;
        if bytes[at] == CHUNK {
            bytes[at + 9 + 24..][..4].fill(0);
        }
        at += 9 + length;
    }
    bytes
}

/// One to four changes of a good file.
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
        target::fuzz_mcap(seed);
    }
    for run in 0..runs {
        let mut random = ChaCha8Rng::seed_from_u64(run as u64);
        let bytes = mutated(&seeds, &mut random);
        if std::panic::catch_unwind(|| target::fuzz_mcap(&bytes)).is_err() {
            panic!("run {run} panics");
        }
    }
}
