//! A recording of an earlier version of the program replays to the contacts that this version had found.

use dermis::linalg::SimdLevel;
use dermis_live::recording::{Replay, Replayed};
use serde_json::Value;
use std::path::Path;

/// Instruction set of the machine that made the recording: others round sums differently.
const RECORDED_AT: SimdLevel = SimdLevel::Avx512;
/// Tolerance on other instruction sets, relative.
const ROUNDING: f64 = 1e-6;

/// Whether two values are equal within rounding.
fn is_near(a: &Value, b: &Value) -> bool {
    match (a, b) {
        (Value::Number(a), Value::Number(b)) => {
            let [a, b] = [a, b].map(|number| number.as_f64().expect("a number of 64 bits"));
            (a - b).abs() <= ROUNDING * a.abs().max(b.abs()).max(1e-3)
        }
        (Value::Array(a), Value::Array(b)) => a.len() == b.len() && a.iter().zip(b).all(|(a, b)| is_near(a, b)),
        (Value::Object(a), Value::Object(b)) => {
            a.len() == b.len() && a.iter().all(|(key, value)| b.get(key).is_some_and(|other| is_near(value, other)))
        }
        _ => a == b,
    }
}

#[test]
fn a_recording_of_an_earlier_version_replays_to_its_contacts() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../data/recordings");
    let expected = std::fs::read_to_string(folder.join("disk12.contacts.jsonl")).expect("the contacts of then");
    let mut replay = Replay::open(&folder.join("disk12.mcap")).expect("a recording");
    let exact = SimdLevel::best() == RECORDED_AT;
    let (mut lines, mut contacts) = (expected.lines(), 0);
    while let Some(replayed) = replay.step().expect("frames that can be read") {
        let Replayed::Frame(frame) = replayed else { continue };
        let now = serde_json::to_string(&frame.result.contacts).expect("contacts are JSON");
        let then = lines.next().expect("a line for each frame");
        let value = |text: &str| serde_json::from_str::<Value>(text).expect("JSON");
        let frame_number = frame.result.sequence;
        assert!(
            if exact { now == then } else { is_near(&value(&now), &value(then)) },
            "frame {frame_number}:\n{then}\n{now}"
        );
        contacts += frame.result.contacts.len();
    }
    assert_eq!(lines.next(), None, "frames are missing");
    assert!(contacts > 100, "{contacts} contacts");
}
