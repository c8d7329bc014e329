//! The firmware of a reader on this computer: `dermis_firmware` reads a digital twin slot by slot and serves hosts over
//! TCP, and the tables that its image for a chip needs.

mod front_end;
mod plan;
mod serve;

pub use plan::ReaderPlan;
pub use serve::{FirmwareDevice, FirmwareOptions};
