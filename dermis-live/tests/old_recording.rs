//! A recording of an earlier version of the program replays to its contacts (`data/README.md`).

use crate::synthetic;
use dermis_live::recording::{Recorder, Replay, Replayed, Session, convert, recover};
use dermis_sim::random::sample_rng;
use rand::RngExt;
use serde_json::Value;
use std::collections::HashSet;
use std::ops::Range;
use std::path::Path;

/// Tolerance, relative: other instruction sets, and the order of elimination since then, round sums differently.
const ROUNDING: f64 = 1e-6;

/// Whether two values are equal within rounding; an object may have more keys than it had then.
fn is_near(a: &Value, b: &Value) -> bool {
    match (a, b) {
        (Value::Number(a), Value::Number(b)) => {
            let [a, b] = [a, b].map(|number| number.as_f64().expect("a number of 64 bits"));
            (a - b).abs() <= ROUNDING * a.abs().max(b.abs()).max(1e-3)
        }
        (Value::Array(a), Value::Array(b)) => a.len() == b.len() && a.iter().zip(b).all(|(a, b)| is_near(a, b)),
        (Value::Object(a), Value::Object(b)) => {
            b.iter().all(|(key, value)| a.get(key).is_some_and(|other| is_near(value, other)))
        }
        _ => a == b,
    }
}

#[test]
fn a_recording_of_an_earlier_version_replays_to_its_contacts() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../data/recordings");
    let expected = std::fs::read_to_string(folder.join("disk12.contacts.jsonl")).expect("its contacts");
    let mut replay = Replay::open(&folder.join("disk12.mcap"), &dermis_learn::methods(), None).expect("a recording");
    let (mut lines, mut contacts) = (expected.lines(), 0);
    while let Some(replayed) = replay.step().expect("frames that can be read") {
        let Replayed::Frame(frame) = replayed else { continue };
        let now = serde_json::to_string(&frame.result.contacts).expect("contacts are JSON");
        let then = lines.next().expect("a line for each frame");
        let value = |text: &str| serde_json::from_str::<Value>(text).expect("JSON");
        let frame_number = frame.result.sequence;
        assert!(is_near(&value(&now), &value(then)), "frame {frame_number}:\n{then}\n{now}");
        contacts += frame.result.contacts.len();
    }
    assert_eq!(lines.next(), None, "frames are missing");
    assert!(contacts > 100, "{contacts} contacts");
}

/// Its point clouds have fewer fields than those of this version.
#[test]
fn tables_of_a_recording_of_an_earlier_version_have_what_it_holds() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../data/recordings");
    let out = tempfile::tempdir().unwrap();
    let converted = convert(&folder.join("disk12.mcap"), &out.path().join("tables")).unwrap();
    assert!(converted.left_out.is_empty() && converted.contacts > 100, "{converted:?}");
    let table = std::fs::read_to_string(out.path().join("tables/contacts.csv")).unwrap();
    let column = |name: &str| table.lines().next().unwrap().split(',').position(|column| column == name).unwrap();
    let [x_m, confidence, id, seen] = ["x_m", "confidence", "id", "seen"].map(column);
    for row in table.lines().skip(1).map(|row| row.split(',').collect::<Vec<_>>()) {
        let number = |column: usize| row[column].parse::<f64>().unwrap();
        assert!(number(x_m).abs() < 0.2 && (0.0..=1.0).contains(&number(confidence)), "{row:?}");
        assert!(row[id].parse::<u32>().unwrap() < 1000 && row[seen].is_empty(), "{row:?}");
    }
}

/// The same recording, written by another program with chunks that are compressed with LZ4.
#[test]
fn a_recording_with_lz4_replays_to_its_contacts() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../data/recordings");
    let path = folder.join("disk12-lz4.mcap");
    let bytes = std::fs::read(&path).unwrap();
    assert!(bytes.windows(7).any(|bytes| bytes == b"\x03\0\0\0lz4"));
    let expected = contacts(&folder.join("disk12.mcap"));
    assert!(contacts(&path) == expected);
    // Repaired, it is a recording with Zstandard; truncated, it has the messages of its first chunks.
    let out = tempfile::tempdir().unwrap();
    let [cut, repaired] = ["cut.mcap", "repaired.mcap"].map(|name| out.path().join(name));
    let report = recover(&path, &repaired).unwrap();
    assert!(report.was_whole && report.frames as usize == expected.len(), "{report:?}");
    assert!(contacts(&repaired) == expected);
    std::fs::write(&cut, &bytes[..bytes.len() / 2]).unwrap();
    let some = contacts(&cut);
    assert!(some.len() > expected.len() / 4 && expected.starts_with(&some), "{} frames", some.len());
    // A damaged chunk is left out.
    let mut damaged = bytes.clone();
    let middle = damaged.len() / 2;
    damaged[middle] ^= 4;
    std::fs::write(&cut, damaged).unwrap();
    let report = recover(&cut, &out.path().join("rest.mcap")).unwrap();
    assert!(report.damaged.len() == 1 && report.frames > 0 && report.frames < expected.len() as u64, "{report:?}");
}

/// One place is damaged, of 1 bit to 100 kB. The chunks outside of it are found by their index in the whole file.
#[test]
fn two_hundred_damaged_places_cost_the_chunks_that_they_touch() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../data/recordings");
    let whole = std::fs::read(folder.join("disk12.mcap")).unwrap();
    let summary = mcap::Summary::read(&whole).unwrap().expect("an index");
    let chunks: Vec<(Range<usize>, Vec<Vec<u8>>)> = summary
        .chunk_indexes
        .iter()
        .map(|index| {
            let start = index.chunk_start_offset as usize;
            let frames = frames(summary.stream_chunk(&whole, index).unwrap());
            (start..start + index.chunk_length as usize, frames.collect())
        })
        .collect();
    let out = tempfile::tempdir().unwrap();
    let [damaged, repaired] = ["damaged.mcap", "repaired.mcap"].map(|name| out.path().join(name));
    let (mut lost, mut kept) = (0, 0);
    for seed in 0..200 {
        let mut rng = sample_rng(90, seed);
        let bits = (8e5f64.ln() * rng.random::<f64>()).exp() as usize;
        let length = bits.div_ceil(8);
        let start = rng.random_range(mcap::MAGIC.len()..whole.len() - length);
        let mut bytes = whole.clone();
        match bits {
            ..8 => bytes[start] ^= (0xff << (8 - bits)) as u8,
            _ => rng.fill(&mut bytes[start..start + length]),
        }
        std::fs::write(&damaged, &bytes).unwrap();
        let report = recover(&damaged, &repaired).unwrap_or_else(|error| panic!("{seed}, {start}+{length}: {error}"));
        let bytes = std::fs::read(&repaired).unwrap();
        let rest: HashSet<Vec<u8>> = frames(mcap::MessageStream::new(&bytes).unwrap()).collect();
        std::fs::remove_file(&repaired).unwrap();
        let is_touched = |range: &Range<usize>| range.start < start + length && start < range.end;
        for (range, frames) in &chunks {
            let here = frames.iter().filter(|frame| rest.contains(*frame)).count();
            let is_complete = is_touched(range) || here == frames.len();
            assert!(is_complete, "{seed}: {here} of {} frames of {range:?}, damaged {start}+{length}", frames.len());
            (kept, lost) = (kept + here, lost + frames.len() - here);
        }
        // What is not in a chunk is an index, which is written anew, or the description of the recording.
        let is_told = !report.was_whole || !chunks.iter().any(|(range, _)| is_touched(range));
        assert!(is_told, "{seed}: the damage at {start}+{length} is not told: {report:?}");
    }
    println!("{kept} frames recovered, {lost} in damaged chunks");
}

/// The device's own messages.
fn frames<'a>(messages: impl Iterator<Item = mcap::McapResult<mcap::Message<'a>>>) -> impl Iterator<Item = Vec<u8>> {
    let messages = messages.map(Result::unwrap).filter(|message| message.channel.topic.ends_with("dermis/wire"));
    messages.map(|message| message.data.into())
}

/// Two recordings joined to one file: the second one begins with its own state.
#[test]
fn joined_recordings_replay_as_they_do_alone() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../data/recordings");
    let bytes = std::fs::read(folder.join("disk12.mcap")).unwrap();
    let out = tempfile::tempdir().unwrap();
    let joined = out.path().join("joined.mcap");
    std::fs::write(&joined, bytes.repeat(2)).unwrap();
    let (alone, both) = (contacts(&folder.join("disk12.mcap")), contacts(&joined));
    assert!(alone.iter().any(|contacts| contacts.len() > 4));
    assert!(both == [alone.as_slice(), &alone].concat());

    // A recording of another skin is an error, after the frames of the first one.
    let other = out.path().join("other.mcap");
    let skin = synthetic::SyntheticSkin::shipped("skin16");
    let design_toml = dermis::design::SkinDesign::shipped_text("skin16").unwrap().into();
    let recorder = Recorder::create(&other, skin.reference, &Session { design_toml, ..Session::default() }).unwrap();
    recorder.finish().unwrap();
    std::fs::write(&joined, [bytes, std::fs::read(&other).unwrap()].concat()).unwrap();
    let mut replay = Replay::open(&joined, &dermis_learn::methods(), None).unwrap();
    let error = std::iter::from_fn(|| Some(replay.step())).find_map(Result::err).unwrap().to_string();
    assert!(error.contains("joined.mcap") && error.contains("another skin (`skin16`)"), "{error}");
}

/// The contacts of each frame, as JSON.
fn contacts(path: &Path) -> Vec<String> {
    let mut replay = Replay::open(path, &dermis_learn::methods(), None).unwrap();
    let steps = std::iter::from_fn(|| replay.step().unwrap());
    let frames = steps.filter_map(|replayed| match replayed {
        Replayed::Frame(frame) => Some(serde_json::to_string(&frame.result.contacts).unwrap()),
        Replayed::Command(_) => None,
    });
    frames.collect()
}
