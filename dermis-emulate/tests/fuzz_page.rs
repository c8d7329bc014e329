//! The fuzz target of page messages on seeded mutations of valid ones, while the skin is read: no panic, and frames
//! continue.

#[path = "../../fuzz/src/page.rs"]
mod target;

use crate::page;
use dermis_live::{ClientSession, Event, Popped};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::sync::Arc;
use std::time::Duration;

/// Number of mutations. Set `DERMIS_FUZZ_RUNS` for more.
const RUNS: usize = 100_000;

/// Every request, with extreme values.
const SEEDS: [&str; 13] = [
    r#"{"do":"tare"}"#,
    r#"{"do":"threshold","value":1.5}"#,
    r#"{"do":"threshold","value":-1e308}"#,
    r#"{"do":"method","name":"noser"}"#,
    r#"{"do":"method","name":"laplace"}"#,
    r#"{"do":"record","on":true}"#,
    r#"{"do":"record","on":false}"#,
    r#"{"do":"pause","on":true}"#,
    r#"{"do":"press","finger":0,"position_m":[0.01,0.02,0.0],"force_n":2.0}"#,
    r#"{"do":"press","finger":4294967295,"position_m":[1e9,-0.0,0.3],"force_n":1e-9}"#,
    r#"{"do":"release","finger":0}"#,
    r#"{"do":"guide","action":"redo"}"#,
    r#"{"do":"zones","zones":[{"name":"\u0000","centre_m":[0,0,0],"radius_m":1,"threshold":2}]}"#,
];

/// Fragments of JSON, and some that are invalid.
const PIECES: [&str; 14] =
    ["{", "}", "[", "]", "\"", ",", ":", "null", "NaN", "1e999", "-0", "\\ud800", "[[[[[[[[[[[[[[[[", "\u{10FFFF}"];

/// One to four mutations of a valid message.
fn mutated(random: &mut ChaCha8Rng) -> Vec<u8> {
    let mut bytes = SEEDS[random.random_range(0..SEEDS.len())].as_bytes().to_vec();
    for _ in 0..random.random_range(1..=4) {
        let at = random.random_range(0..=bytes.len());
        let end = (at + random.random_range(1..8)).min(bytes.len());
        match random.random_range(0..7) {
            0 if at < bytes.len() => bytes[at] ^= 1 << random.random_range(0..7),
            1 if at < bytes.len() => bytes[at] = b'0' + random.random_range(0..10),
            2 => bytes.truncate(at),
            3 => drop(bytes.drain(at..end)),
            4 => {
                let piece = bytes[at..end].to_vec();
                bytes.splice(end..end, piece);
            }
            5 => {
                let other = SEEDS[random.random_range(0..SEEDS.len())].as_bytes();
                bytes.truncate(at);
                bytes.extend_from_slice(&other[at.min(other.len())..]);
            }
            _ => {
                let piece = PIECES[random.random_range(0..PIECES.len())].as_bytes();
                bytes.splice(at..at, piece.iter().copied());
            }
        }
    }
    bytes
}

#[test]
fn no_message_of_a_page_makes_the_skin_panic() {
    let runs = std::env::var("DERMIS_FUZZ_RUNS").ok().and_then(|text| text.parse().ok()).unwrap_or(RUNS);
    let folder = tempfile::tempdir().unwrap();
    let (live, control) = page::live(folder.path());
    let mailbox = live.shared().subscribe(1);
    let mut guest = ClientSession::new(Arc::clone(&control));
    SEEDS[..2].iter().for_each(|seed| guest.ask(seed).unwrap());
    for run in 0..runs {
        let mut random = ChaCha8Rng::seed_from_u64(run as u64);
        let bytes = mutated(&mut random);
        let all = std::panic::AssertUnwindSafe(|| target::ask(&mut guest, &bytes));
        if std::panic::catch_unwind(all).is_err() {
            panic!("run {run} panics: {}", String::from_utf8_lossy(&bytes));
        }
        if run % 10_000 == 0 {
            // A client has at most ten fingers: start a new session.
            drop(std::mem::replace(&mut guest, ClientSession::new(Arc::clone(&control))));
        }
    }
    drop(guest);
    control.end_recording();
    let goes_on = (0..50).any(|_| matches!(mailbox.take(Duration::from_secs(1)), Popped::Item(Event::Frame(_))));
    assert!(goes_on, "frames go on");
    // A panic on another thread would have stopped it.
    live.shared().request_state();
    live.stop();
}
