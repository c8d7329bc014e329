//! What the fuzz target of recordings calls; `dermis-live/tests/fuzz_mcap.rs` runs it on seeded mutations of good files.

use dermis_live::record::{self, Recorded, Recording};
use std::io::Cursor;
use std::path::Path;

/// The reader of recordings, and what mends them: what was mended is whole, and mending it again changes nothing.
pub fn fuzz_mcap(data: &[u8]) {
    let name = Path::new("fuzz.mcap");
    let length = data.len() as u64;
    if let Ok(recording) = Recording::from_reader(Box::new(Cursor::new(data.to_vec())), length, name) {
        for item in recording {
            match item {
                Ok(Recorded::Frame { message, .. }) => assert!(message.len() <= data.len()),
                Ok(Recorded::Event { .. }) => {}
                Err(error) => assert!(!error.to_string().is_empty()),
            }
        }
    }
    let mut whole = Vec::new();
    let Ok(first) = record::recover_into(data, length, name, &mut whole) else { return };
    let mut again = Vec::new();
    let second =
        record::recover_into(&whole[..], whole.len() as u64, name, &mut again).expect("what was mended is whole");
    assert!(second.was_whole && second.messages == first.messages, "{first:?} {second:?}");
    assert!(whole == again, "mending twice changes something");
}
