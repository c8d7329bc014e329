//! The ports of an emulated device, and its connections.

use crate::EmulateError;
use crate::emulator::Emulator;
use crate::emulator::host_session::{HostSession, SessionEnd};
use dermis::text::printable_lines;
use dermis_live::device::Address;
use std::io::{ErrorKind, Read, Write};
use std::net::{TcpListener, TcpStream};
use std::sync::Arc;
use std::time::Duration;

/// A port of the emulated device.
pub enum Port {
    /// Over TCP; one host at a time.
    Tcp(TcpListener),
    /// As a serial port.
    Serial(serial2::SerialPort),
    /// A pseudo terminal; the host end is kept open, so that the port outlives its hosts.
    #[cfg(unix)]
    Terminal {
        /// The device end.
        device: std::fs::File,
        /// The host end.
        _host: std::fs::File,
    },
}

impl Emulator {
    /// Serves hosts one after another until it is [stopped](Self::stop).
    ///
    /// # Errors
    /// A port failure; an internal failure of the twin.
    pub fn serve(&self, port: Port) -> Result<(), EmulateError> {
        let failing = FailsUnlessDone(self);
        let served = self.serve_port(port);
        if served.is_ok() {
            std::mem::forget(failing);
        }
        served
    }

    /// Serves on a free TCP port of this machine, on a thread of its own. Returns the address for hosts.
    ///
    /// # Errors
    /// No port or thread can be had.
    pub fn serve_locally(self: &Arc<Self>) -> Result<Address, EmulateError> {
        let broken = |error: std::io::Error| EmulateError::Given(format!("no port for the emulated device: {error}"));
        let listener = TcpListener::bind("127.0.0.1:0").map_err(broken)?;
        let address = Address::Tcp(listener.local_addr().map_err(broken)?.to_string());
        let serving = Arc::clone(self);
        let serve = move || {
            if let Err(error) = serving.serve(Port::Tcp(listener)) {
                let _ = writeln!(
                    std::io::stderr(),
                    "the emulated device has failed: {}",
                    printable_lines(&error.to_string())
                );
            }
        };
        std::thread::Builder::new().name("dermis-device".into()).spawn(serve).map_err(broken)?;
        Ok(address)
    }

    fn serve_port(&self, port: Port) -> Result<(), EmulateError> {
        let broken = |error: std::io::Error| EmulateError::Given(format!("the emulated device's port: {error}"));
        match port {
            Port::Serial(mut serial) => {
                serial.set_read_timeout(Duration::from_millis(1)).map_err(broken)?;
                while !self.is_stopped() {
                    self.converse(&mut serial)?;
                    std::thread::sleep(Duration::from_millis(20));
                }
                Ok(())
            }
            #[cfg(unix)]
            Port::Terminal { mut device, _host } => {
                while !self.is_stopped() {
                    self.converse(&mut device)?;
                    std::thread::sleep(Duration::from_millis(20));
                }
                Ok(())
            }
            Port::Tcp(listener) => {
                listener.set_nonblocking(true).map_err(broken)?;
                while !self.is_stopped() {
                    match listener.accept() {
                        Ok((mut stream, _)) => {
                            let ready = stream
                                .set_nonblocking(false)
                                .and_then(|()| stream.set_nodelay(true))
                                .and_then(|()| stream.set_read_timeout(Some(Duration::from_micros(200))))
                                .and_then(|()| stream.set_write_timeout(Some(Duration::from_secs(5))));
                            if ready.is_ok() && !self.is_unplugged(self.now_s()) {
                                self.converse(&mut stream)?;
                            }
                        }
                        Err(error) if error.kind() == ErrorKind::WouldBlock => {
                            self.wait_unplugged();
                            std::thread::sleep(Duration::from_millis(5));
                        }
                        Err(error) => return Err(broken(error)),
                    }
                }
                Ok(())
            }
        }
    }

    /// Waits while the device is unplugged; its time continues.
    fn wait_unplugged(&self) {
        if self.is_unplugged(self.now_s()) {
            let frame_s = 1.0 / (self.options().twin.electronics.frame_rate_hz * self.options().speed);
            std::thread::sleep(Duration::from_secs_f64(frame_s));
            self.set_next_index(self.next_index() + 1);
        }
    }

    /// Serves one host until it disconnects.
    fn converse(&self, line: &mut dyn Wire) -> Result<(), EmulateError> {
        match HostSession::new(self, line).run() {
            Ok(()) | Err(SessionEnd::Gone) => Ok(()),
            Err(SessionEnd::Failed(error)) => Err(*error),
        }
    }
}

/// Marks the emulator as failed when it is dropped, by an error or a panic.
struct FailsUnlessDone<'a>(&'a Emulator);

impl Drop for FailsUnlessDone<'_> {
    fn drop(&mut self) {
        self.0.fail_for_good();
    }
}

/// A connection as the device uses it: reading does not block.
pub(super) trait Wire {
    fn receive(&mut self, buffer: &mut [u8]) -> std::io::Result<usize>;
    fn say(&mut self, bytes: &[u8]) -> std::io::Result<()>;
}

fn nothing_yet(error: std::io::Error) -> std::io::Result<usize> {
    match error.kind() {
        ErrorKind::WouldBlock | ErrorKind::TimedOut | ErrorKind::Interrupted => Ok(0),
        _ => Err(error),
    }
}

impl Wire for TcpStream {
    fn receive(&mut self, buffer: &mut [u8]) -> std::io::Result<usize> {
        match self.read(buffer) {
            Ok(0) => Err(ErrorKind::UnexpectedEof.into()),
            Ok(count) => Ok(count),
            Err(error) => nothing_yet(error),
        }
    }

    fn say(&mut self, bytes: &[u8]) -> std::io::Result<()> {
        self.write_all(bytes)
    }
}

#[cfg(unix)]
impl Wire for std::fs::File {
    fn receive(&mut self, buffer: &mut [u8]) -> std::io::Result<usize> {
        use rustix::event::{PollFd, PollFlags, poll};
        let now = rustix::event::Timespec { tv_sec: 0, tv_nsec: 0 };
        let ready = poll(&mut [PollFd::new(&*self, PollFlags::IN)], Some(&now))?;
        if ready == 0 { Ok(0) } else { self.read(buffer).or_else(nothing_yet) }
    }

    fn say(&mut self, bytes: &[u8]) -> std::io::Result<()> {
        self.write_all(bytes)
    }
}

impl Wire for serial2::SerialPort {
    fn receive(&mut self, buffer: &mut [u8]) -> std::io::Result<usize> {
        serial2::SerialPort::read(self, buffer).or_else(nothing_yet)
    }

    fn say(&mut self, bytes: &[u8]) -> std::io::Result<()> {
        serial2::SerialPort::write_all(self, bytes)
    }
}
