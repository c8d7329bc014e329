//! Input and output around [`dermis::pipeline`]: devices, recordings, ROS 2, JSON lines, the viewer.

#![warn(unreachable_pub)]
#![cfg_attr(
    not(all(feature = "convert", feature = "viewer")),
    allow(dead_code, unused_imports, reason = "some functions are for tables or for the page alone")
)]

pub mod clock;
pub mod device;
mod error;
pub mod guide;
pub mod recording;
pub mod robot;
pub mod runtime;
pub mod sinks;

pub use device::ScanTable;
pub use error::{DeviceIdentity, LiveError};
pub use runtime::{
    ClientSession, Control, Event, Latency, Live, LiveFrame, LiveHandle, LiveOptions, LiveStatistics, LiveSummary,
    Mailbox, Popped, Pressable, RecordingOptions,
};

#[cfg(test)]
extern crate self as dermis_live;
/// Synthetic frames, shared with the tests of the crate.
#[allow(unreachable_pub)]
#[cfg(test)]
#[path = "../tests/synthetic/mod.rs"]
mod synthetic;
