//! A twin that speaks the wire protocol: a device for whoever has none, and for tests.

mod device;
mod fault;
#[cfg(unix)]
mod pty;
mod script;

pub use device::{Emulator, EmulatorOptions, Port};
pub use fault::{Fault, TimedFault};
#[cfg(unix)]
pub use pty::pseudo_terminal;
pub use script::{NAMED, Place, Script, Stroke};
