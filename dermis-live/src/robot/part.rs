//! A robot in several processes, one a limb, near its devices: contacts and states travel, frames stay.
//!
//! A part sends lines of JSON to whoever joins it: first its skins and the hashes of their designs, then what its state is told of
//! each skin, as in a recording.

use super::Incoming;
use super::recording::{Input, Line};
use crate::clock;
use crate::runtime::{self, POLL};
use dermis::pipeline::{Notice, Severity};
use dermis_robot::UnknownReason;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::io::{BufRead, BufReader, Read};
use std::net::{TcpStream, ToSocketAddrs};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// Pause between two attempts to reach a part.
const RETRY: Duration = Duration::from_millis(250);
/// A part that sends nothing for this time is connected anew: its computer may have been switched off.
const SILENCE: Duration = Duration::from_secs(2);
/// Longest line, bytes.
const LONGEST: u64 = 1 << 20;

/// The first line of a part.
#[derive(Debug, Serialize, Deserialize)]
pub(super) struct Greeting {
    /// The name of the robot.
    pub(super) robot: String,
    /// The SHA-256 of the design of each skin, hexadecimal.
    pub(super) skins: BTreeMap<String, String>,
}

/// A skin that is read by a part.
pub(super) struct Wanted {
    pub(super) index: usize,
    pub(super) name: String,
    /// The hash of its design.
    pub(super) design: String,
}

/// What follows a part.
pub(super) struct Follower<Take> {
    pub(super) address: String,
    pub(super) skins: Vec<Wanted>,
    pub(super) take: Take,
}

impl<Take: Fn(Incoming)> Follower<Take> {
    /// Follows the part until it is stopped.
    pub(super) fn run(&self, stopped: &AtomicBool) {
        let mut said = String::new();
        while !stopped.load(Ordering::Relaxed) {
            let ended = self.connect().and_then(|stream| self.listen(stream, stopped, &mut said));
            let Err(why) = ended else { return };
            for skin in &self.skins {
                (self.take)(Incoming::Part(
                    skin.index,
                    Input::Fault { skin: skin.name.clone(), reason: UnknownReason::Lost },
                ));
            }
            if why != said {
                self.notice(Severity::Error, format!("{why} (tried again until it answers)"));
                said = why;
            }
            std::thread::sleep(RETRY);
        }
    }

    fn notice(&self, level: Severity, text: String) {
        let text = format!("the robot at {}: {text}", self.address);
        (self.take)(Incoming::Notice(Notice { level, text, at: clock::now() }));
    }

    fn connect(&self) -> Result<TcpStream, String> {
        let failed =
            |error: std::io::Error| format!("cannot be reached: {error}; is `dermis robot run --share` running there?");
        let addresses = self.address.to_socket_addrs().map_err(failed)?;
        let mut last = std::io::Error::new(std::io::ErrorKind::NotFound, "it has no address");
        for address in addresses {
            let connected = TcpStream::connect_timeout(&address, SILENCE);
            match connected.and_then(|stream| stream.set_read_timeout(Some(POLL)).map(|()| stream)) {
                Ok(stream) => return Ok(stream),
                Err(error) => last = error,
            }
        }
        Err(failed(last))
    }

    /// Takes lines until there are no more, which is the error, or it is stopped.
    fn listen(&self, stream: TcpStream, stopped: &AtomicBool, said: &mut String) -> Result<(), String> {
        let mut lines = BufReader::new(stream);
        let (mut line, mut heard) = (Vec::new(), Instant::now());
        let mut known: Option<BTreeMap<&str, (usize, Option<u32>)>> = None;
        while !stopped.load(Ordering::Relaxed) {
            match (&mut lines).take(LONGEST - line.len() as u64).read_until(b'\n', &mut line) {
                Ok(0) => return Err("the line was closed at the other end".into()),
                Ok(_) => {}
                Err(error) if matches!(error.kind(), std::io::ErrorKind::WouldBlock | std::io::ErrorKind::TimedOut) => {
                }
                Err(error) => return Err(error.to_string()),
            }
            if line.last() != Some(&b'\n') {
                if line.len() as u64 == LONGEST {
                    return Err(format!("a line has more than {} MiB", LONGEST >> 20));
                }
                if heard.elapsed() > SILENCE {
                    return Err(format!("it has sent nothing for {:.0} s", heard.elapsed().as_secs_f64()));
                }
                continue;
            }
            heard = Instant::now();
            let wrong =
                |error: serde_json::Error| format!("what it sends is no line of `dermis robot run --share`: {error}");
            match &mut known {
                None => {
                    known = Some(self.greeted(&serde_json::from_slice(&line).map_err(wrong)?));
                    // A tunnel accepts a connection before the part does.
                    if !std::mem::take(said).is_empty() {
                        self.notice(Severity::Info, "it is connected again".into());
                    }
                }
                Some(known) => self.take(known, serde_json::from_slice::<Line>(&line).map_err(wrong)?.input),
            }
            line.clear();
        }
        Ok(())
    }

    /// The skins that the part reads with the same designs, by name, and the serial numbers of their devices.
    fn greeted(&self, greeting: &Greeting) -> BTreeMap<&str, (usize, Option<u32>)> {
        let mut known = BTreeMap::new();
        for Wanted { index, name, design } in &self.skins {
            match greeting.skins.get(name) {
                Some(other) if other == design => _ = known.insert(name.as_str(), (*index, None)),
                Some(_) => {
                    let text = format!("its skin `{name}` has another design: give both files the same one");
                    self.notice(Severity::Error, text);
                }
                None => {
                    let names = greeting.skins.keys().map(|name| format!("`{name}`")).collect::<Vec<_>>().join(", ");
                    self.notice(Severity::Error, format!("it has no skin `{name}`: it reads {names}"));
                }
            }
        }
        known
    }

    fn take(&self, known: &mut BTreeMap<&str, (usize, Option<u32>)>, input: Input) {
        let Some((index, device)) = input.skin().and_then(|skin| known.get_mut(skin)) else { return };
        match &input {
            // A device that was there before this connection was, or another one whose line was lost.
            Input::Known { skin, frame } => {
                let serial = frame.device_serial.unwrap_or(0);
                if device.replace(serial) != Some(serial) {
                    (self.take)(Incoming::Part(*index, Input::Connected { skin: skin.clone(), serial }));
                }
            }
            Input::Connected { serial, .. } => *device = Some(*serial),
            Input::Stale { .. } | Input::Fault { .. } => {}
            // What is of its own recording.
            _ => return,
        }
        (self.take)(Incoming::Part(*index, input));
    }
}

/// A thread that is stopped, and waited for, when this is dropped.
pub(super) struct StoppedThread {
    thread: Option<JoinHandle<()>>,
    is_stopped: Arc<AtomicBool>,
}

impl StoppedThread {
    pub(super) fn spawn(name: &str, run: impl FnOnce(&AtomicBool) + Send + 'static) -> Self {
        let is_stopped = Arc::new(AtomicBool::new(false));
        let stopped = Arc::clone(&is_stopped);
        StoppedThread { thread: Some(runtime::spawn(name, move || run(&stopped))), is_stopped }
    }
}

impl Drop for StoppedThread {
    fn drop(&mut self) {
        self.is_stopped.store(true, Ordering::Relaxed);
        // A thread that panicked has printed its message already.
        self.thread.take().map(JoinHandle::join);
    }
}
