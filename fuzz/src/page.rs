//! What the fuzz target of the page's messages calls; `dermis-live/tests/fuzz_page.rs` runs it on seeded mutations of good ones.

use dermis_live::ClientSession;

/// Whatever a page says is done, or refused in words.
pub fn ask(guest: &mut ClientSession, data: &[u8]) {
    // The WebSocket hands on text alone.
    let Ok(text) = std::str::from_utf8(data) else { return };
    if let Err(why) = guest.ask(text) {
        assert!(!why.is_empty() && why.len() < 4 * data.len() + 1000, "{} bytes on {}", why.len(), data.len());
    }
}
