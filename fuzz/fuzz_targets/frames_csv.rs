#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| dermis_fuzz::fuzz_frames_csv(data));
