//! The live skin: from an instrument's bytes to contacts, seen, recorded and published.

mod alarm;
mod baseline;
pub mod device;
pub mod emulator;
mod error;
mod health;
mod live;
mod mailbox;
mod meter;
mod moment;
mod processor;
mod report;
mod scan;
mod skin;

pub use error::LiveError;
pub use live::{Event, Live, LiveOptions, Shared};
pub use mailbox::{Mailbox, Taken};
pub use meter::{Measures, Meter};
pub use moment::Moment;
pub use processor::{Command, Incoming, Processor, Rebuilding, Rebuilt, Settings, State, Zone};
pub use report::{Counts, ElectrodeHealth, ElectrodeState, Health, Level, LiveContact, LiveFrame, Notice};
pub use scan::{Role, ScanTable, TooLarge};
pub use skin::{LiveSkin, NamedMethod};
