//! The live skin: from an instrument's bytes to contacts, seen, recorded and published.

mod baseline;
mod control;
#[cfg(feature = "ros2")]
pub mod dds;
pub mod device;
mod drift;
pub mod emulator;
mod error;
mod health;
pub mod jsonl;
mod live;
mod mailbox;
mod meter;
mod pipeline;
mod rebuild;
pub mod record;
pub mod replay;
mod report;
pub mod ros;
mod scan;
pub mod server;
mod settings;
pub mod sink;
mod skin;
mod state;
mod timestamp;
mod touch_detector;
mod untouched;

pub use control::{ClientSession, Control, RecordingOptions, Request};
pub use error::LiveError;
pub use live::{Event, Live, LiveHandle, LiveOptions};
pub use mailbox::{Mailbox, Taken};
pub use meter::{Measures, Meter};
pub use pipeline::{Incoming, Pipeline};
pub use rebuild::{Rebuilding, Rebuilt};
pub use report::{Counts, ElectrodeHealth, ElectrodeState, Health, LiveContact, LiveFrame, Notice, Severity};
pub use scan::{Role, ScanTable, TooLarge};
pub use settings::{Command, Settings, Zone};
pub use skin::{LiveSkin, NamedMethod};
pub use state::State;
pub use timestamp::Timestamp;

#[cfg(test)]
extern crate self as dermis_live;
/// Frames to test with, shared with the tests beside the crate.
#[cfg(test)]
#[path = "../tests/synthetic/mod.rs"]
mod synthetic;
