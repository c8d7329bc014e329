//! The live skin: from an instrument's bytes to contacts, seen, recorded and published.

mod moment;
mod report;

pub use moment::Moment;
pub use report::{Counts, ElectrodeHealth, ElectrodeState, Health, Level, LiveContact, LiveFrame, Notice};
