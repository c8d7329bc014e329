//! Contacts as lines of JSON, for programs in any language.

use crate::LiveError;
use crate::runtime::LiveFrame;
use crate::runtime::{Event, LiveHandle};
use crate::runtime::{Mailbox, Popped};
use dermis::pipeline::{Timestamp, TrackedContact, Validity};
use serde::Serialize;
use std::io::{BufWriter, Write};
use std::net::{SocketAddr, TcpListener, ToSocketAddrs};
use std::num::NonZeroU32;
use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::Duration;

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

/// Lines that can wait for a reader.
const WAITING: usize = 256;
/// Programs that read lines at once, each on a thread; more connections are closed.
const MAX_READERS: usize = 64;

/// Subscribes to the frames from now on, for [`write_lines`]; if they are not read fast enough, the oldest are dropped.
pub fn lines(shared: &LiveHandle) -> Arc<Mailbox<Event>> {
    shared.subscribe_as("lines of JSON", WAITING)
}

/// Writes a line for each frame until the live skin stops or the reader disconnects.
///
/// # Errors
/// A writer that fails; a closed one is not an error.
pub fn write_lines(shared: &LiveHandle, mailbox: &Arc<Mailbox<Event>>, out: &mut dyn Write) -> std::io::Result<()> {
    let written = write_until_closed(shared, mailbox, out);
    shared.unsubscribe(mailbox);
    match written {
        Err(error) if matches!(error.kind(), std::io::ErrorKind::BrokenPipe | std::io::ErrorKind::ConnectionReset) => {
            Ok(())
        }
        written => written,
    }
}

fn write_until_closed(shared: &LiveHandle, mailbox: &Mailbox<Event>, out: &mut dyn Write) -> std::io::Result<()> {
    let frame_id = &shared.skin().design().frame_id();
    loop {
        match mailbox.take(Duration::from_secs(1)) {
            Popped::Item(Event::Frame(frame) | Event::Stale(frame)) => {
                let line = FrameLine { skipped: shared.skipped(), ..FrameLine::new(&frame, frame_id) };
                let mut line = serde_json::to_vec(&line)?;
                line.push(b'\n');
                out.write_all(&line)?;
                out.flush()?;
            }
            Popped::Item(_) | Popped::TimedOut => {}
            Popped::Closed => return Ok(()),
        }
    }
}

/// Sends lines to every program on this machine that connects, each on a separate thread.
///
/// # Errors
/// An address that is in use, or that other machines can reach, because there is no authentication.
pub fn serve_lines(shared: &Arc<LiveHandle>, address: &str) -> Result<(SocketAddr, JoinHandle<()>), LiveError> {
    let failed = |error: std::io::Error| {
        let fix = match error.kind() {
            std::io::ErrorKind::AddrInUse => "another program listens there: take another port, or 0 for any",
            std::io::ErrorKind::AddrNotAvailable => "that is no address of this machine",
            _ => "write --jsonl tcp:HOST:PORT, as in tcp:127.0.0.1:7430",
        };
        LiveError::Given(format!("cannot send lines of JSON at {address}: {error}; {fix}"))
    };
    let addresses: Vec<SocketAddr> = address.to_socket_addrs().map_err(failed)?.collect();
    if addresses.iter().any(|address| !address.ip().is_loopback()) {
        let fix = "write tcp:127.0.0.1:PORT, and let other machines come through a tunnel: ssh -L PORT:127.0.0.1:PORT";
        let message =
            format!("{address} can be reached from other machines, and lines of JSON ask for no token: {fix}");
        return Err(LiveError::Given(message));
    }
    let listener = TcpListener::bind(addresses.as_slice()).map_err(failed)?;
    let bound = listener.local_addr().map_err(failed)?;
    listener.set_nonblocking(true).map_err(failed)?;
    let shared = Arc::clone(shared);
    let readers = Arc::new(());
    let accept = move || {
        while !shared.is_stopped() {
            let Ok((stream, _)) = listener.accept() else {
                std::thread::sleep(Duration::from_millis(20));
                continue;
            };
            // A reader that reads nothing for this time is disconnected.
            let ready = stream
                .set_nonblocking(false)
                .and_then(|()| stream.set_nodelay(true))
                .and_then(|()| stream.set_write_timeout(Some(Duration::from_secs(10))));
            // One count is of this thread.
            if ready.is_ok() && Arc::strong_count(&readers) <= MAX_READERS {
                let reader = Arc::clone(&readers);
                let shared = Arc::clone(&shared);
                // A reader that disconnects or is too slow is not an error.
                let mailbox = lines(&shared);
                std::thread::spawn(move || {
                    // A reader that has gone, or does not read, ends the thread; nobody waits for the reason.
                    let _ = write_lines(&shared, &mailbox, &mut BufWriter::new(stream));
                    drop(reader);
                });
            }
        }
    };
    let thread = std::thread::Builder::new().name("dermis-jsonl".into()).spawn(accept).map_err(failed)?;
    Ok((bound, thread))
}
