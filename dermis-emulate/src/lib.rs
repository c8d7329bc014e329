//! Emulated devices: a digital twin behind the wire protocol, the firmware of a reader on this computer, fault campaigns,
//! and the conformance of devices.

#![warn(unreachable_pub)]

pub mod campaign;
pub mod conformance;
pub mod emulator;
mod error;
pub mod firmware;
pub mod offline;
pub mod robot;

pub use error::EmulateError;
