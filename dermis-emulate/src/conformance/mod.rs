//! Conformance of a device with the wire protocol: one conversation, checked step by step against
//! `docs/wire-protocol.md`, and a transcript of it. Two devices with the same skin and the same readings have the same
//! transcript, whatever runs them.

mod conversation;
mod exchange;
mod readings;
mod transcript;

pub use conversation::{Conformance, ConformanceOptions, check_device};
pub use readings::write_readings;
