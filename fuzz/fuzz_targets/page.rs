//! Messages of a web page to a live skin with an emulated device.

#![no_main]

#[path = "../../dermis-emulate/tests/page/mod.rs"]
mod live;
#[path = "../src/page.rs"]
mod page;

use dermis_live::{Control, ClientSession, Live};
use std::sync::{Arc, LazyLock};

/// One live skin for all runs; its recordings are in a folder that is kept until the process ends.
static SKIN: LazyLock<(Live, Arc<Control>, tempfile::TempDir)> = LazyLock::new(|| {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let (live, control) = live::live(folder.path());
    (live, control, folder)
});

libfuzzer_sys::fuzz_target!(|data: &[u8]| {
    let mut guest = ClientSession::new(Arc::clone(&SKIN.1));
    data.split(|&byte| byte == b'\n').for_each(|message| page::ask(&mut guest, message));
});
