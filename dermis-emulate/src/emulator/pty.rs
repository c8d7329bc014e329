//! A pseudo terminal: a serial port without hardware.

use crate::emulator::Port;
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use rustix::termios::{OptionalActions, tcgetattr, tcsetattr};
use std::fs::File;
use std::path::PathBuf;

/// Creates a pseudo terminal for an emulated device, with the path that hosts open.
///
/// # Errors
/// A system without a free pseudo terminal.
pub fn pseudo_terminal() -> std::io::Result<(Port, PathBuf)> {
    let device = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY)?;
    grantpt(&device)?;
    unlockpt(&device)?;
    let path = PathBuf::from(ptsname(&device, Vec::new())?.to_string_lossy().into_owned());
    // Raw mode is set before any host opens the port; the settings persist while this end is open.
    let host = File::options().read(true).write(true).open(&path)?;
    let mut settings = tcgetattr(&host)?;
    settings.make_raw();
    tcsetattr(&host, OptionalActions::Now, &settings)?;
    Ok((Port::Terminal { device: File::from(device), _host: host }, path))
}
