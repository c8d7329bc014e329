//! A twin that speaks the wire protocol: a device for whoever has none, and for tests.

mod device;
mod fault;
mod script;

pub use device::{Emulator, EmulatorOptions, Port};
pub use fault::{Fault, TimedFault};
pub use script::{NAMED, Place, Script, Stroke};
