//! The integration tests in one program: it is linked once, and one test computes while another waits.

mod fuzz_mcap;
mod interpreter;
mod old_recording;
mod peers;
mod synthetic;
