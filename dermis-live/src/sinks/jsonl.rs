//! Contacts as lines of JSON, for programs in any language.

use crate::LiveError;
use crate::runtime::LiveFrame;
use crate::runtime::{self, Event, LiveHandle, Mailbox, Popped};
use dermis::pipeline::{Timestamp, TrackedContact, Validity};
use serde::Serialize;
use std::io::Write;
use std::net::{SocketAddr, TcpListener, ToSocketAddrs};
use std::num::NonZeroU32;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// One frame as a line of JSON. Lengths in m, forces in N, times in nanoseconds since 1970; unknown values are `null`.
#[derive(Debug, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[cfg_attr(feature = "schema", schemars(title = "Dermis live frame"))]
pub struct FrameLine<'a> {
    /// Number of the frame since the device was powered up.
    pub(crate) sequence: u64,
    /// When its first reading was taken.
    pub(crate) measured_at: Timestamp,
    /// When its last byte was received.
    pub(crate) received_at: Timestamp,
    /// When its contacts were computed.
    pub(crate) output_at: Timestamp,
    /// The coordinate frame of the positions.
    pub(crate) frame_id: &'a str,
    /// Whether the contacts can be relied on.
    pub(crate) validity: &'a Validity,
    /// Whether there is a contact; `null` if that is unknown, as the frame is invalid or stale.
    pub(crate) touched: Option<bool>,
    /// The contacts, the oldest first.
    pub(crate) contacts: &'a [TrackedContact],
    /// Electrodes that are loose or open, by index.
    pub(crate) bad_electrodes: Vec<usize>,
    /// Serial number of the device; `null` if it has none.
    pub(crate) device_serial: Option<NonZeroU32>,
    /// Frames received per second.
    pub(crate) rate_hz: f64,
    /// Lost frames since the start.
    pub(crate) lost: u64,
    /// Received frames that were not processed because they arrived too fast, since the start.
    pub(crate) skipped: u64,
}

impl<'a> FrameLine<'a> {
    /// The line of a frame.
    pub fn new(frame: &'a LiveFrame, frame_id: &'a str) -> Self {
        let result = &frame.result;
        let electrodes = &result.health.electrodes;
        FrameLine {
            sequence: result.sequence,
            measured_at: result.measured_at,
            received_at: frame.received_at,
            output_at: frame.output_at,
            frame_id,
            validity: &result.validity,
            touched: result.touched,
            contacts: &result.contacts,
            bad_electrodes: (0..electrodes.len()).filter(|&index| electrodes[index].state.is_bad()).collect(),
            device_serial: result.health.device_serial,
            rate_hz: result.health.rate_hz,
            lost: result.health.counts.lost,
            skipped: 0,
        }
    }

    /// Its JSON schema.
    #[cfg(feature = "schema")]
    pub fn json_schema() -> serde_json::Value {
        schemars::schema_for!(FrameLine<'static>).to_value()
    }
}

/// The name of this sink in reports of dropped events.
const LINES: &str = "lines of JSON";
/// Lines that can wait for a reader.
const WAITING: usize = 256;
/// Programs that read lines at once, each on a thread; more connections are closed.
const MAX_READERS: usize = 64;
/// Time for the last lines.
const LAST_LINES: Duration = Duration::from_secs(1);
/// A reader that reads nothing for this time is disconnected.
const PATIENCE: Duration = Duration::from_secs(10);

/// Subscribes to the frames from now on, for [`write_lines`]; if they are not read fast enough, the oldest are dropped.
pub fn lines(shared: &LiveHandle) -> Arc<Mailbox<Event>> {
    shared.subscribe_as(LINES, WAITING)
}

/// Writes a line for each frame until the live skin stops or the reader disconnects.
///
/// # Errors
/// A writer that fails; a closed one is not an error.
pub fn write_lines(shared: &LiveHandle, mailbox: &Arc<Mailbox<Event>>, out: &mut dyn Write) -> std::io::Result<()> {
    let write = |frame: &FrameLine<'_>| out.write_all(&line(frame)?).and_then(|()| out.flush());
    let written = for_each_frame(shared, mailbox, write);
    shared.unsubscribe(mailbox);
    match written {
        Err(error) if matches!(error.kind(), std::io::ErrorKind::BrokenPipe | std::io::ErrorKind::ConnectionReset) => {
            Ok(())
        }
        written => written,
    }
}

fn for_each_frame(
    shared: &LiveHandle,
    mailbox: &Mailbox<Event>,
    mut take: impl FnMut(&FrameLine<'_>) -> std::io::Result<()>,
) -> std::io::Result<()> {
    let frame_id = &shared.skin().design().frame_id();
    loop {
        match mailbox.take(Duration::from_secs(1)) {
            Popped::Item(Event::Frame(frame) | Event::Stale(frame)) => {
                take(&FrameLine { skipped: shared.skipped(), ..FrameLine::new(&frame, frame_id) })?;
            }
            Popped::Item(_) | Popped::TimedOut => {}
            Popped::Closed => return Ok(()),
        }
    }
}

/// A value as a line.
///
/// # Errors
/// A value that JSON cannot represent.
pub fn line(value: &impl Serialize) -> serde_json::Result<Vec<u8>> {
    let mut line = serde_json::to_vec(value)?;
    line.push(b'\n');
    Ok(line)
}

/// Sends lines of the skin to every program on this machine that connects, until the skin is no longer read.
///
/// # Errors
/// Those of [`LineServer::start`].
pub fn serve_lines(shared: &Arc<LiveHandle>, address: &str) -> Result<(SocketAddr, JoinHandle<()>), LiveError> {
    let server = LineServer::start(address)?;
    let (bound, shared, mailbox) = (server.address(), Arc::clone(shared), lines(shared));
    let run = move || {
        let sent = for_each_frame(&shared, &mailbox, |frame| {
            if server.readers() > 0 {
                shared.add_dropped(LINES, server.send(&line(frame)?));
            }
            Ok(())
        });
        shared.unsubscribe(&mailbox);
        // Sending does not fail, and a frame is JSON.
        debug_assert!(sent.is_ok());
    };
    Ok((bound, runtime::spawn("dermis-jsonl", run)))
}

/// Lines that wait for a reader.
type Queue = Arc<Mailbox<Arc<[u8]>>>;

/// The lines that wait for each reader.
#[derive(Debug, Clone, Default)]
struct Readers(Arc<Mutex<Vec<Queue>>>);

impl Readers {
    fn lock(&self) -> MutexGuard<'_, Vec<Queue>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Sends lines to every program on this machine that connects, each on a thread of its own. A reader that is too slow loses the
/// oldest lines, and one that reads nothing for ten seconds is disconnected.
///
/// ```
/// use dermis_live::sinks::jsonl::LineServer;
/// use std::io::{BufRead, BufReader};
/// use std::net::TcpStream;
///
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// let server = LineServer::start("127.0.0.1:0")?;
/// let reader = BufReader::new(TcpStream::connect(server.address())?);
/// while server.readers() == 0 {
///     std::thread::yield_now();
/// }
/// server.send(b"a line\n");
/// assert_eq!(reader.lines().next().transpose()?.as_deref(), Some("a line"));
/// # Ok(())
/// # }
/// ```
#[derive(Debug)]
pub struct LineServer {
    address: SocketAddr,
    readers: Readers,
    is_stopped: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl LineServer {
    /// Listens at `HOST:PORT`; port 0 is any free one.
    ///
    /// # Errors
    /// An address that is in use, or that other machines can reach, because there is no authentication.
    pub fn start(address: &str) -> Result<Self, LiveError> {
        Self::with_greeting("--jsonl tcp:", address, Vec::new())
    }

    /// The same with a first line for everyone who connects; `option` comes before the address in errors.
    pub(crate) fn with_greeting(option: &str, address: &str, greeting: Vec<u8>) -> Result<Self, LiveError> {
        let failed = |error: std::io::Error| {
            let fix = match error.kind() {
                std::io::ErrorKind::AddrInUse => {
                    "another program listens there: take another port, or 0 for any".into()
                }
                std::io::ErrorKind::AddrNotAvailable => "that is no address of this machine".into(),
                _ => format!("write {option}HOST:PORT, as in {option}127.0.0.1:7430"),
            };
            LiveError::Given(format!("cannot send lines of JSON at {address}: {error}; {fix}"))
        };
        let addresses: Vec<SocketAddr> = address.to_socket_addrs().map_err(failed)?.collect();
        if addresses.iter().any(|address| !address.ip().is_loopback()) {
            let fix = format!(
                "write {option}127.0.0.1:PORT, and let other machines come through a tunnel: ssh -L PORT:127.0.0.1:PORT"
            );
            let message =
                format!("{address} can be reached from other machines, and lines of JSON ask for no token: {fix}");
            return Err(LiveError::Given(message));
        }
        let listener = TcpListener::bind(addresses.as_slice()).map_err(failed)?;
        let bound = listener.local_addr().map_err(failed)?;
        listener.set_nonblocking(true).map_err(failed)?;
        let (readers, is_stopped) = (Readers::default(), Arc::new(AtomicBool::new(false)));
        let (known, stopped) = (readers.clone(), Arc::clone(&is_stopped));
        let thread = runtime::spawn("dermis-lines", move || accept(&listener, &greeting.into(), &known, &stopped));
        Ok(LineServer { address: bound, readers, is_stopped, thread: Some(thread) })
    }

    /// Where it listens.
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// The number of programs that are connected.
    pub fn readers(&self) -> usize {
        self.readers.lock().len()
    }

    /// Sends a line, which ends with a line break. Never blocks; returns the number of readers that lost an older line.
    pub fn send(&self, line: &[u8]) -> u64 {
        let readers = self.readers.lock();
        let dropped = || readers.iter().map(|reader| reader.dropped()).sum::<u64>();
        let (line, before): (Arc<[u8]>, u64) = (line.into(), dropped());
        readers.iter().for_each(|reader| reader.put(Arc::clone(&line)));
        dropped() - before
    }
}

impl Drop for LineServer {
    /// Readers get what waits for them, if they take it within a second, and the end.
    fn drop(&mut self) {
        self.is_stopped.store(true, Ordering::Relaxed);
        // A thread that panicked has printed its message already.
        self.thread.take().map(JoinHandle::join);
        self.readers.lock().iter().for_each(|reader| reader.close());
        let begun = Instant::now();
        while self.readers() > 0 && begun.elapsed() < LAST_LINES {
            std::thread::sleep(Duration::from_millis(5));
        }
    }
}

/// Accepts readers until the server stops.
fn accept(listener: &TcpListener, greeting: &Arc<[u8]>, readers: &Readers, is_stopped: &AtomicBool) {
    while !is_stopped.load(Ordering::Relaxed) {
        let Ok((stream, _)) = listener.accept() else {
            std::thread::sleep(Duration::from_millis(20));
            continue;
        };
        let ready = stream
            .set_nonblocking(false)
            .and_then(|()| stream.set_nodelay(true))
            .and_then(|()| stream.set_write_timeout(Some(PATIENCE)));
        if ready.is_err() || readers.lock().len() >= MAX_READERS {
            continue;
        }
        let (mailbox, known) = (Arc::new(Mailbox::new(WAITING)), readers.clone());
        mailbox.put(Arc::clone(greeting));
        readers.lock().push(Arc::clone(&mailbox));
        runtime::spawn("dermis-reader", move || {
            let mut stream = stream;
            loop {
                match mailbox.take(Duration::from_secs(1)) {
                    Popped::Item(line) if stream.write_all(&line).is_err() => break,
                    Popped::Item(_) | Popped::TimedOut => {}
                    Popped::Closed => break,
                }
            }
            known.lock().retain(|reader| !Arc::ptr_eq(reader, &mailbox));
        });
    }
}
