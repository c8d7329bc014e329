//! A connection to a device: TCP or a serial port.

use crate::LiveError;
use serial2::IntoSettings;
use std::io::{ErrorKind, Read, Write};
use std::net::{TcpStream, ToSocketAddrs};
use std::sync::mpsc::{Receiver, RecvTimeoutError, sync_channel};
use std::time::Duration;

/// Address of a device.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Address {
    /// A host and a port.
    Tcp(String),
    /// A serial port and its baud rate.
    Serial {
        /// The port's path or name.
        port: String,
        /// Its baud rate, bits per second.
        baud: u32,
    },
    /// Standard input.
    Stdin,
    /// Rows of values as text, from another address.
    Csv(Box<Address>),
}

/// The default baud rate; USB devices ignore it.
const USUAL_BAUD: u32 = 4_000_000;

impl Address {
    /// Parses `tcp:HOST:PORT`, `serial:PATH` or `serial:PATH@BAUD`, each also after `csv:`, and `csv:-`.
    ///
    /// # Errors
    /// Any other text.
    pub fn parse(text: &str) -> Result<Self, LiveError> {
        match text.split_once(':') {
            Some(("tcp", address)) if address.contains(':') => {
                let port = address.rsplit_once(':').and_then(|(_, port)| port.parse::<u16>().ok());
                let wrong = || LiveError::Given(format!("`{text}`: the port is a number from 1 to 65535"));
                port.filter(|port| *port > 0).map(|_| Address::Tcp(address.into())).ok_or_else(wrong)
            }
            Some(("tcp", _)) => Err(LiveError::Given(format!("`{text}` names no port: write tcp:HOST:PORT"))),
            Some(("serial", rest)) if !rest.is_empty() => {
                let (port, baud) = match rest.rsplit_once('@') {
                    None => (rest, USUAL_BAUD),
                    Some((port, baud)) => {
                        let baud = baud.parse().ok().filter(|baud| *baud > 0);
                        let wrong = || {
                            LiveError::Given(format!(
                                "`{text}`: the speed after @ must be bits a second, as in serial:/dev/ttyACM0@4000000"
                            ))
                        };
                        (port, baud.ok_or_else(wrong)?)
                    }
                };
                Ok(Address::Serial { port: port.into(), baud })
            }
            Some(("csv", "-")) => Ok(Address::Csv(Box::new(Address::Stdin))),
            Some(("csv", rest)) if !rest.starts_with("csv:") => Ok(Address::Csv(Box::new(Address::parse(rest)?))),
            _ => Err(LiveError::Given(format!(
                "`{text}` is no device: write tcp:HOST:PORT or serial:PATH[@BAUD]; for rows of values csv:- (standard input), \
                 csv:tcp:HOST:PORT or csv:serial:PATH[@BAUD]"
            ))),
        }
    }
}

impl Address {
    /// Whether what is sent waits until it is read: standard input may be a file.
    pub(crate) fn is_patient(&self) -> bool {
        matches!(self, Address::Csv(from) if **from == Address::Stdin)
    }
}

impl std::fmt::Display for Address {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Address::Tcp(address) => write!(formatter, "tcp:{address}"),
            Address::Serial { port, baud } => write!(formatter, "serial:{port}@{baud}"),
            Address::Stdin => write!(formatter, "-"),
            Address::Csv(from) => write!(formatter, "csv:{from}"),
        }
    }
}

/// A connection to a device. Reading times out after [`PATIENCE`].
pub trait Line: Send {
    /// Received bytes; `None` after a timeout.
    ///
    /// # Errors
    /// A broken or closed connection.
    fn receive(&mut self, buffer: &mut [u8]) -> std::io::Result<Option<usize>>;

    /// Sends bytes.
    ///
    /// # Errors
    /// A broken or closed connection.
    fn send(&mut self, bytes: &[u8]) -> std::io::Result<()>;
}

/// Timeout of one read.
pub const PATIENCE: Duration = Duration::from_millis(50);

/// Timeout of a connection attempt.
const CONNECT: Duration = Duration::from_secs(3);

/// Opens the connection to a device.
///
/// # Errors
/// A device that cannot be reached; the error states the fix.
pub fn open(address: &Address) -> Result<Box<dyn Line>, LiveError> {
    let failed = |Unopened { message, is_absent }| match is_absent {
        true => LiveError::Absent { address: address.to_string(), message },
        false => LiveError::Unreachable { address: address.to_string(), message },
    };
    match address {
        Address::Tcp(host) => Ok(Box::new(open_tcp(host).map_err(failed)?)),
        Address::Serial { port, baud } => Ok(Box::new(open_serial(port, *baud).map_err(failed)?)),
        Address::Stdin => Ok(Box::new(Stdin::open().map_err(|message| failed(message.into()))?)),
        Address::Csv(from) => open(from),
    }
}

/// A connection that was not made.
struct Unopened {
    /// Why, and the fix.
    message: String,
    /// Whether the device may come later.
    is_absent: bool,
}

impl From<String> for Unopened {
    fn from(message: String) -> Self {
        Unopened { message, is_absent: false }
    }
}

fn open_tcp(host: &str) -> Result<TcpStream, Unopened> {
    let addresses = host.to_socket_addrs().map_err(|error| format!("{error}; write tcp:HOST:PORT"))?;
    let mut last = Unopened::from("no such host".to_string());
    for address in addresses {
        match TcpStream::connect_timeout(&address, CONNECT) {
            Ok(stream) => {
                // Deliver a frame as soon as it is complete.
                let set = stream.set_nodelay(true).and_then(|()| stream.set_read_timeout(Some(PATIENCE)));
                return set.map(|()| stream).map_err(|error| error.to_string().into());
            }
            Err(error) if error.kind() == ErrorKind::ConnectionRefused => {
                let message = "nobody listens there: is the device on, is the port right?".into();
                last = Unopened { message, is_absent: true };
            }
            Err(error) => {
                last = Unopened { message: error.to_string(), is_absent: is_away(error.kind()) };
            }
        }
    }
    Err(last)
}

/// Whether a host does not answer, as one that is switched off.
fn is_away(kind: ErrorKind) -> bool {
    matches!(kind, ErrorKind::TimedOut | ErrorKind::HostUnreachable | ErrorKind::NetworkUnreachable)
}

fn open_serial(port: &str, baud: u32) -> Result<serial2::SerialPort, Unopened> {
    let opened = || {
        // The port's settings are changed only after it is locked.
        let mut opened = serial2::SerialPort::open(port, serial2::KeepSettings)?;
        own(&opened)?;
        let mut settings = opened.get_configuration()?;
        baud.apply_to_settings(&mut settings)?;
        opened.set_configuration(&settings)?;
        opened.set_read_timeout(PATIENCE)?;
        Ok(opened)
    };
    opened().map_err(|error| Unopened {
        message: unopened(&error, port, baud),
        is_absent: error.kind() == ErrorKind::NotFound,
    })
}

/// Locks a port for this program until it is closed: with two readers, each would receive only some of the bytes.
/// Unlike the exclusive mode of the port (TIOCEXCL), a lock also applies to the superuser and is released with its
/// process.
#[cfg(unix)]
fn own(port: &serial2::SerialPort) -> std::io::Result<()> {
    use rustix::fs::{FlockOperation, flock};
    flock(port, FlockOperation::NonBlockingLockExclusive).map_err(|error| match error {
        rustix::io::Errno::WOULDBLOCK => ErrorKind::ResourceBusy.into(),
        other => other.into(),
    })
}

/// On other systems a port has one program at a time anyway.
#[cfg(not(unix))]
fn own(_: &serial2::SerialPort) -> std::io::Result<()> {
    Ok(())
}

/// Explains why a port could not be opened, and the fix.
fn unopened(error: &std::io::Error, port: &str, baud: u32) -> String {
    match error.kind() {
        ErrorKind::NotFound => format!("there is no port {port}: {}", ports()),
        ErrorKind::PermissionDenied => format!(
            "no permission to open {port}: on Linux ports belong to the group `dialout`: `sudo usermod -aG dialout $USER`, then \
             log in again"
        ),
        ErrorKind::ResourceBusy => format!("{port} is in use by another program: close that"),
        _ => format!("{error} ({port} at {baud} bits a second)"),
    }
}

/// The available ports, as a fix.
fn ports() -> String {
    match serial2::SerialPort::available_ports() {
        Ok(ports) if !ports.is_empty() => {
            let names: Vec<String> = ports.iter().map(|port| port.display().to_string()).collect();
            format!("available: {}", names.join(", "))
        }
        _ => "no serial port is available".into(),
    }
}

fn in_time(read: std::io::Result<usize>) -> std::io::Result<Option<usize>> {
    match read {
        Ok(0) => Err(std::io::Error::new(ErrorKind::UnexpectedEof, "the line was closed at the other end")),
        Ok(count) => Ok(Some(count)),
        Err(error) if matches!(error.kind(), ErrorKind::TimedOut | ErrorKind::WouldBlock | ErrorKind::Interrupted) => {
            Ok(None)
        }
        Err(error) => Err(error),
    }
}

impl Line for TcpStream {
    fn receive(&mut self, buffer: &mut [u8]) -> std::io::Result<Option<usize>> {
        in_time(self.read(buffer))
    }

    fn send(&mut self, bytes: &[u8]) -> std::io::Result<()> {
        self.write_all(bytes)
    }
}

impl Line for serial2::SerialPort {
    fn receive(&mut self, buffer: &mut [u8]) -> std::io::Result<Option<usize>> {
        in_time(serial2::SerialPort::read(self, buffer))
    }

    fn send(&mut self, bytes: &[u8]) -> std::io::Result<()> {
        serial2::SerialPort::write_all(self, bytes)
    }
}

/// Pieces of standard input that wait to be read.
const PIECES: usize = 4;

/// Standard input, read by a thread, as it has no timeout.
struct Stdin {
    pieces: Receiver<Vec<u8>>,
    /// The rest of the last piece.
    rest: Vec<u8>,
}

impl Stdin {
    fn open() -> Result<Self, String> {
        let (sender, pieces) = sync_channel(PIECES);
        let read = move || {
            let mut buffer = vec![0; 1 << 14];
            let mut input = std::io::stdin().lock();
            // An error ends the input, as its end does.
            while let Ok(count @ 1..) = input.read(&mut buffer) {
                if sender.send(buffer[..count].to_vec()).is_err() {
                    return;
                }
            }
        };
        let thread = std::thread::Builder::new().name("dermis-stdin".into()).spawn(read);
        thread.map(|_| Stdin { pieces, rest: Vec::new() }).map_err(|error| error.to_string())
    }
}

impl Line for Stdin {
    fn receive(&mut self, buffer: &mut [u8]) -> std::io::Result<Option<usize>> {
        if self.rest.is_empty() {
            self.rest = match self.pieces.recv_timeout(PATIENCE) {
                Ok(piece) => piece,
                Err(RecvTimeoutError::Timeout) => return Ok(None),
                Err(RecvTimeoutError::Disconnected) => return Err(ErrorKind::UnexpectedEof.into()),
            };
        }
        let count = self.rest.len().min(buffer.len());
        buffer[..count].copy_from_slice(&self.rest[..count]);
        self.rest.drain(..count);
        Ok(Some(count))
    }

    fn send(&mut self, _: &[u8]) -> std::io::Result<()> {
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn addresses_are_parsed_and_printed() {
        assert_eq!(Address::parse("tcp:localhost:7001").unwrap(), Address::Tcp("localhost:7001".into()));
        let serial = Address::parse("serial:/dev/ttyACM0@115200").unwrap();
        assert_eq!(serial, Address::Serial { port: "/dev/ttyACM0".into(), baud: 115_200 });
        assert_eq!(serial.to_string(), "serial:/dev/ttyACM0@115200");
        let rows = Address::parse("csv:serial:/dev/ttyACM0@115200").unwrap();
        assert_eq!(rows, Address::Csv(Box::new(serial)));
        assert_eq!(rows.to_string(), "csv:serial:/dev/ttyACM0@115200");
        assert_eq!(Address::parse("csv:-").unwrap().to_string(), "csv:-");
        for wrong in ["", "tcp:", "tcp:host", "serial:", "serial:/dev/x@fast", "udp:host:1", "csv:", "csv:csv:-", "-"] {
            assert!(Address::parse(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn a_port_that_cannot_be_opened_says_what_to_do() {
        let why = |kind: ErrorKind| unopened(&kind.into(), "/dev/ttyACM0", 115_200);
        let denied = why(ErrorKind::PermissionDenied);
        assert!(denied.contains("/dev/ttyACM0") && denied.contains("sudo usermod -aG dialout"), "{denied}");
        assert!(why(ErrorKind::ResourceBusy).contains("in use by another program"));
        assert!(why(ErrorKind::NotFound).contains("there is no port /dev/ttyACM0"));
        assert!(why(ErrorKind::InvalidInput).contains("115200 bits a second"));
    }

    #[test]
    fn a_port_that_is_not_there_is_named() {
        let error = open(&Address::parse("serial:/dev/nothing").unwrap()).err().unwrap().to_string();
        assert!(error.contains("/dev/nothing"), "{error}");
        let error = open(&Address::parse("tcp:127.0.0.1:1").unwrap()).err().unwrap().to_string();
        assert!(error.contains("nobody listens"), "{error}");
    }
}
