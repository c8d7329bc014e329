//! Bytes of a host to a reader's firmware, over a line that is unplugged at any moment.

#![no_main]

#[path = "../src/firmware.rs"]
mod firmware;

libfuzzer_sys::fuzz_target!(|data: &[u8]| firmware::fuzz_firmware(data));
