//! `dermis emulate`: an emulated device with the wire protocol.

use crate::console::print;
use crate::emulated::EmulatorArguments;
use crate::failure::{Failure, Outcome};
use clap::Args;
use dermis::design::SkinDesign;
use dermis_emulate::emulator::Port;
use std::net::TcpListener;
use std::sync::Arc;

/// The arguments of `dermis emulate`.
#[derive(Debug, Args)]
pub struct Arguments {
    /// Design: the path of a file, or a shipped name.
    design: String,
    #[command(flatten)]
    emulator: EmulatorArguments,
    /// TCP address; port 0 selects a free port.
    #[arg(long, value_name = "HOST:PORT", default_value = "127.0.0.1:7420")]
    tcp: String,
    /// Run the firmware of a reader (dermis-firmware) in front of the twin. It reads slot by slot at its own times, with 1
    /// pC of charge per switch. The twin needs a converter of at most 16 bits.
    #[arg(long, conflicts_with_all = ["pty", "fault", "prerender"])]
    firmware: bool,
    /// Serve a serial port instead of TCP: a pseudo terminal, whose path is printed.
    #[arg(long, conflicts_with = "tcp")]
    pty: bool,
}

impl Arguments {
    /// Serves hosts until interrupted.
    pub fn run(self) -> Outcome {
        let design = SkinDesign::load(&self.design)?;
        if self.firmware {
            return self.run_firmware(&design);
        }
        let emulator = self.emulator.emulator(&design)?;
        let port = if self.pty { pseudo_terminal()? } else { listener(&self.tcp)? };
        let stopped = Arc::clone(&emulator);
        crate::console::on_interrupt(move || stopped.stop())?;
        print(&format!("{}\n", port.1))?;
        Ok(emulator.serve(port.0)?)
    }

    fn run_firmware(&self, design: &SkinDesign) -> Outcome {
        let device = self.emulator.firmware(design)?;
        let (listener, address) = bound(&self.tcp)?;
        let stopped = Arc::clone(&device);
        crate::console::on_interrupt(move || stopped.stop())?;
        print(&format!("{address}\n"))?;
        Ok(device.serve(listener)?)
    }
}

fn listener(address: &str) -> Outcome<(Port, String)> {
    let (listener, name) = bound(address)?;
    Ok((Port::Tcp(listener), name))
}

fn bound(address: &str) -> Outcome<(TcpListener, String)> {
    let listener = TcpListener::bind(address).and_then(|listener| Ok((listener.local_addr()?, listener)));
    let (bound, listener) = listener.map_err(|error| {
        let fix = "give another --tcp HOST:PORT; port 0 is any free one";
        Failure::given(format!("cannot listen at {address}: {error}"), Some(fix))
    })?;
    Ok((listener, format!("tcp:{bound}")))
}

#[cfg(unix)]
fn pseudo_terminal() -> Outcome<(Port, String)> {
    let failed = |error: std::io::Error| Failure::given(format!("no pseudo terminal can be had: {error}"), None);
    let (port, path) = dermis_emulate::emulator::pseudo_terminal().map_err(failed)?;
    Ok((port, format!("serial:{}", path.display())))
}

#[cfg(not(unix))]
fn pseudo_terminal() -> Outcome<(Port, String)> {
    Err(Failure::given("this system has no pseudo terminals", Some("use --tcp")))
}
