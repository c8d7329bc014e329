//! A heartbeat for a watchdog: a UDP datagram for each frame whose contacts can be relied on.
//!
//! A robot that wants to stop when its skin fails stops when no datagram has arrived for some frames. None is sent while
//! frames are invalid or stale, and none if this program, the network or the machine fails. This is no safety function:
//! no safety rating is claimed.
//!
//! ```no_run
//! # fn example(shared: &std::sync::Arc<dermis_live::LiveHandle>) -> Result<(), dermis_live::LiveError> {
//! let thread = dermis_live::sinks::watchdog::send(shared, "192.168.1.5:7440")?;
//! # Ok(())
//! # }
//! ```

use crate::LiveError;
use crate::runtime::{Event, LiveFrame, LiveHandle, Popped};
use serde::Serialize;
use std::net::{SocketAddr, ToSocketAddrs, UdpSocket};
use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::Duration;

/// The contents of a datagram, as JSON.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct Heartbeat {
    /// Number of the frame since the device was powered up.
    pub(crate) sequence: u64,
    /// `ok` or `degraded`.
    pub(crate) validity: &'static str,
    /// Whether there is a contact.
    pub(crate) touched: bool,
}

impl Heartbeat {
    /// The heartbeat of a frame; `None` if its contacts cannot be relied on.
    pub(crate) fn of(frame: &LiveFrame) -> Option<Self> {
        let result = &frame.result;
        let touched = result.touched.filter(|_| result.validity.is_usable())?;
        Some(Heartbeat { sequence: result.sequence, validity: result.validity.name(), touched })
    }
}

/// Frames that can wait: a late heartbeat is of no use.
const WAITING: usize = 2;

/// A socket that sends to `HOST:PORT`.
///
/// # Errors
/// An address that cannot be resolved; a socket that cannot be opened.
pub fn socket(address: &str) -> Result<UdpSocket, LiveError> {
    let failed = |why: &dyn std::fmt::Display| {
        LiveError::Given(format!("no watchdog at `{address}`: {why}; write HOST:PORT, as in 192.168.1.5:7440"))
    };
    let to = address.to_socket_addrs().map_err(|error| failed(&error))?.next();
    let to = to.ok_or_else(|| failed(&"the name has no address"))?;
    let any = if to.is_ipv4() { SocketAddr::from(([0; 4], 0)) } else { SocketAddr::from(([0u16; 8], 0)) };
    let socket = UdpSocket::bind(any).and_then(|socket| socket.connect(to).map(|()| socket));
    let socket = socket.map_err(|error| failed(&error))?;
    socket.set_nonblocking(true).map_err(|error| failed(&error))?;
    Ok(socket)
}

/// Sends heartbeats to `HOST:PORT` until the skin is no longer read. Datagrams that cannot be sent are dropped.
///
/// # Errors
/// An address that cannot be resolved; a socket that cannot be opened.
pub fn send(shared: &Arc<LiveHandle>, address: &str) -> Result<JoinHandle<()>, LiveError> {
    let socket = socket(address)?;
    let (shared, mailbox) = (Arc::clone(shared), shared.subscribe_as("the watchdog", WAITING));
    let run = move || {
        loop {
            match mailbox.take(Duration::from_secs(1)) {
                Popped::Item(Event::Frame(frame)) => {
                    if let Some(heartbeat) = Heartbeat::of(&frame) {
                        let datagram = serde_json::to_vec(&heartbeat).expect("a heartbeat is JSON");
                        // Without a datagram the watchdog stops the robot, as it should.
                        let _ = socket.send(&datagram);
                    }
                }
                Popped::Item(_) | Popped::TimedOut => {}
                Popped::Closed => break,
            }
        }
        shared.unsubscribe(&mailbox);
    };
    let thread = std::thread::Builder::new().name("dermis-watchdog".into()).spawn(run);
    thread.map_err(|error| LiveError::Given(format!("no thread for the watchdog: {error}")))
}
