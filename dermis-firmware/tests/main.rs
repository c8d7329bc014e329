//! The integration tests in one program: it is linked once, and one test computes while another waits.

mod conversation;
mod fuzz_device;
mod no_std;
mod parts;
