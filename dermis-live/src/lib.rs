//! The live skin: from an instrument's bytes to contacts, seen, recorded and published.

pub mod clock;
mod control;
#[cfg(feature = "ros2")]
pub mod dds;
pub mod device;
pub mod emulator;
mod error;
pub mod jsonl;
mod live;
mod mailbox;
mod meter;
pub mod record;
pub mod replay;
mod report;
pub mod ros;
mod scan;
pub mod server;
pub mod sink;

pub use control::{ClientSession, Control, RecordingOptions, Request};
pub use error::LiveError;
pub use live::{Event, Live, LiveHandle, LiveOptions};
pub use mailbox::{Mailbox, Taken};
pub use meter::Meter;
pub use report::LiveFrame;
pub use scan::{Role, ScanTable, TooLarge};

#[cfg(test)]
extern crate self as dermis_live;
/// Frames to test with, shared with the tests beside the crate.
#[cfg(test)]
#[path = "../tests/synthetic/mod.rs"]
mod synthetic;
