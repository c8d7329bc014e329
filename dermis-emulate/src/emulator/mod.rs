//! A digital twin that implements the wire protocol: an emulated device for tests and for users without hardware.

mod device;
mod fault;
mod host_session;
mod port;
#[cfg(unix)]
mod pty;
mod script;
mod timing;

pub use device::{Emulator, EmulatorOptions, MAX_PRERENDERED};
pub use fault::{Fault, ReadingFault, TimedFault};
pub use port::Port;
#[cfg(unix)]
pub use pty::pseudo_terminal;
pub use script::{Place, Script, Stroke};
