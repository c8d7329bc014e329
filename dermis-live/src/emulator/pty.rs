//! A pseudo terminal: a serial port without a wire.

use crate::emulator::Port;
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use rustix::termios::{OptionalActions, tcgetattr, tcsetattr};
use std::fs::File;
use std::path::PathBuf;

/// A pseudo terminal for an emulated device, and the path of its other end, which hosts open.
///
/// # Errors
/// A system that has none to give.
pub fn pseudo_terminal() -> std::io::Result<(Port, PathBuf)> {
    let device = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY)?;
    grantpt(&device)?;
    unlockpt(&device)?;
    let path = PathBuf::from(ptsname(&device, Vec::new())?.to_string_lossy().into_owned());
    // Bytes pass as they are before any host has opened it; while this end is open the other end keeps its settings.
    let host = File::options().read(true).write(true).open(&path)?;
    let mut settings = tcgetattr(&host)?;
    settings.make_raw();
    tcsetattr(&host, OptionalActions::Now, &settings)?;
    Ok((Port::Terminal { device: File::from(device), _host: host }, path))
}
