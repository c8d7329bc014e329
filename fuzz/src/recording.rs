//! The functions of the fuzz target of recordings; `dermis-live/tests/fuzz_mcap.rs` runs them on seeded mutations of
//! valid files.

use dermis_live::recording::{self as record, Recorded, Recording};
use std::io::Cursor;
use std::path::Path;

const NAME: &str = "fuzz.mcap";

/// The reader of recordings, and their repair.
#[allow(dead_code, reason = "the ordinary tests call the parts")]
pub fn fuzz_mcap(data: &[u8]) {
    read(data);
    repair(data);
}

/// Any content of a recording gives a frame, an event or an error.
pub fn read(data: &[u8]) {
    let input = Box::new(Cursor::new(data.to_vec()));
    let Ok(recording) = Recording::from_reader(input, data.len() as u64, Path::new(NAME)) else { return };
    for item in recording {
        match item {
            Ok(Recorded::Frame { .. } | Recorded::Event { .. } | Recorded::Session(_)) => {}
            Err(error) => assert!(!error.to_string().is_empty()),
        }
    }
}

/// A repaired recording is complete, and a second repair changes nothing.
pub fn repair(data: &[u8]) {
    let name = Path::new(NAME);
    let mut whole = Vec::new();
    let Ok(first) = record::recover_into(data, data.len() as u64, name, &mut whole) else { return };
    let mut again = Vec::new();
    let length = whole.len() as u64;
    let second = record::recover_into(&whole[..], length, name, &mut again).expect("a repaired recording is whole");
    assert!(second.was_whole && second.messages == first.messages, "{first:?} {second:?}");
    assert!(whole == again, "a second repair changes something");
}
