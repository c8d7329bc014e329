//! The function of the fuzz target of the page's messages; `dermis-emulate/tests/fuzz_page.rs` runs it on seeded mutations
//! of valid ones.

use dermis_live::ClientSession;

/// Any message of a page is executed, or refused with an error message.
pub fn ask(guest: &mut ClientSession, data: &[u8]) {
    // The WebSocket accepts only text.
    let Ok(text) = std::str::from_utf8(data) else { return };
    if let Err(why) = guest.ask(text) {
        assert!(!why.is_empty() && why.len() < 4 * data.len() + 1000, "{} bytes on {}", why.len(), data.len());
    }
}
