//! Devices: connection, handshake, messages, and readings to ohm.
//!
//! ```
//! use dermis_live::device::Address;
//!
//! let address = Address::parse("serial:/dev/ttyACM0@115200")?;
//! assert_eq!(address, Address::Serial { port: "/dev/ttyACM0".into(), baud: 115_200 });
//! # Ok::<(), dermis_live::LiveError>(())
//! ```

mod clock;
mod handshake;
mod line;
mod meter;
mod scan;

pub use clock::DeviceClock;
pub use line::{Address, Line, PATIENCE, open};
pub use meter::Meter;
pub use scan::{Role, ScanTable, TooLarge};

use crate::LiveError;
use crate::device::handshake::{Handshake, send};
use dermis::pipeline::{Counts, FrameInput, Notice, Severity, Timestamp};
use dermis::skin::Skin;
use dermis_wire::{Arrival, Arrivals, Decoder, Frame, FrameFlags, Hello, Received, Status, ToDevice, ToHost};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// How a device is to be read.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct DeviceOptions {
    /// Frames a second; the device's own rate without it.
    pub rate_hz: Option<f64>,
}

/// What a device is known by.
#[derive(Debug, Clone, PartialEq)]
pub struct DeviceFacts {
    /// Its name.
    pub name: String,
    /// Its number.
    pub serial: u32,
    /// Frames a second that it sends.
    pub rate_hz: f64,
    /// Its hello as it came, which recordings keep.
    pub hello: Vec<u8>,
}

/// A device that is being read.
pub struct Device {
    address: String,
    line: Box<dyn Line>,
    decoder: Decoder<Vec<u8>>,
    buffer: Vec<u8>,
    facts: DeviceFacts,
    stream: Stream,
    notice: Option<Notice>,
    heard_at: Instant,
    /// When a frame came last, or frames were asked for.
    asked_at: Instant,
}

/// A frame as it was received.
#[derive(Debug, Clone, PartialEq)]
pub struct IncomingFrame {
    /// The frame, for the pipeline.
    pub input: FrameInput,
    /// When its last byte was received.
    pub received_at: Timestamp,
    /// The message of the device.
    pub message: Vec<u8>,
}

/// The frames of a device in order, from one connection to the next.
#[derive(Debug, Clone)]
pub struct Stream {
    skin: Skin,
    scan: Arc<ScanTable>,
    meter: Option<Meter>,
    arrivals: Arrivals,
    clock: DeviceClock,
    rate: Rate,
    boot: Option<u32>,
    /// Number of the newest frame, not wrapping round.
    newest: Option<u64>,
    /// Frames of self-tests among those that arrived.
    tests: u64,
    damaged: u64,
    reconnected: u64,
}

/// Frames a second, from the device's times of the last frames.
#[derive(Debug, Clone, Default)]
struct Rate {
    arrived: std::collections::VecDeque<Timestamp>,
}

/// A device that says nothing for so long is masked.
const SILENCE: Duration = Duration::from_secs(2);

/// A device that has sent no frame for so long is started again.
const START_AGAIN: Duration = Duration::from_secs(1);

/// Bytes that are read at once.
const READ_BYTES: usize = 1 << 16;

impl Rate {
    /// Frames over which the rate is told.
    const FRAMES: usize = 240;

    fn take(&mut self, at: Timestamp) -> f64 {
        if self.arrived.len() == Self::FRAMES {
            self.arrived.pop_front();
        }
        self.arrived.push_back(at);
        let span_s = self.arrived.front().map_or(0.0, |first| at.seconds_since(*first));
        if span_s > 0.0 { (self.arrived.len() - 1) as f64 / span_s } else { 0.0 }
    }
}

impl Stream {
    /// Without a frame yet.
    ///
    /// # Errors
    /// A protocol that is too large for the wire.
    pub fn new(skin: &Skin) -> Result<Self, TooLarge> {
        Ok(Stream {
            skin: skin.clone(),
            scan: Arc::new(ScanTable::new(&skin.design().protocol)?),
            meter: None,
            arrivals: Arrivals::default(),
            clock: DeviceClock::default(),
            rate: Rate::default(),
            boot: None,
            newest: None,
            tests: 0,
            damaged: 0,
            reconnected: 0,
        })
    }

    /// Counts since the start.
    pub fn counts(&self) -> Counts {
        Counts {
            frames: self.arrivals.received - self.tests,
            lost: self.arrivals.lost,
            repeated: self.arrivals.repeated,
            reordered: self.arrivals.reordered,
            damaged: self.damaged,
            reconnected: self.reconnected,
        }
    }

    /// The device says who it is.
    pub fn hello(&mut self, hello: &Hello<'_>) {
        if self.boot.replace(hello.boot).is_some_and(|boot| boot != hello.boot) {
            self.arrivals.restart();
            self.clock.restart();
        }
        self.meter = Some(Meter::new(hello, &self.scan, &self.skin.design().protocol));
    }

    /// The same, on a new connection: how the device's clock went meanwhile is not known.
    fn reconnected(mut self) -> Self {
        self.clock.restart();
        Stream { reconnected: self.reconnected + 1, ..self }
    }

    /// A device was met that said a hello, after it had sent a frame of test readings.
    pub(crate) fn met(&mut self, message: Vec<u8>, tested: Option<u32>) -> DeviceFacts {
        let (mut name, mut serial, mut rate_hz) = (String::new(), 0, 0.0);
        if let Ok(ToHost::Hello(hello)) = ToHost::parse(&message) {
            self.hello(&hello);
            (name, serial, rate_hz) = (hello.name.into(), hello.serial, f64::from(hello.rate_millihertz) * 1e-3);
        }
        tested.into_iter().for_each(|sequence| self.test(sequence));
        DeviceFacts { name, serial, rate_hz, hello: message }
    }

    /// A frame of test readings has used up a number, and is none.
    fn test(&mut self, sequence: u32) {
        if let Arrival::New { skipped } = self.arrivals.take(sequence) {
            self.newest = self.newest.map(|newest| newest + 1 + u64::from(skipped));
            self.tests += 1;
        }
    }

    /// A frame's message that came at some moment; `None` of one that is not new or not the skin's.
    pub fn frame(&mut self, frame: &Frame<'_>, message: &[u8], received_at: Timestamp) -> Option<IncomingFrame> {
        if frame.flags.has(FrameFlags::TEST) {
            self.test(frame.sequence);
            return None;
        }
        let meter = self.meter.as_ref()?;
        if !meter.takes(&frame.readings) {
            self.damaged += 1;
            return None;
        }
        let Arrival::New { skipped } = self.arrivals.take(frame.sequence) else { return None };
        let newest = self.newest.map_or(u64::from(frame.sequence), |newest| newest + 1 + u64::from(skipped));
        self.newest = Some(newest);
        let measured_at = self.clock.moment(frame.time_us, received_at);
        let input = FrameInput {
            sequence: newest,
            measured_at,
            measurement: meter.measure(frame.readings),
            counts: self.counts(),
            rate_hz: self.rate.take(measured_at),
        };
        Some(IncomingFrame { input, received_at, message: message.to_vec() })
    }
}

/// What a device says that concerns more than the stream of frames.
#[derive(Debug, Clone, PartialEq)]
pub enum Heard {
    /// A frame.
    Frame(Box<IncomingFrame>),
    /// How it is.
    Status(Status),
    /// Something that a person should know.
    Notice(Notice),
}

impl Device {
    /// Finds a device, checks that it is one for the skin, tells it what to read and starts it. `stream` goes on from a
    /// connection before.
    ///
    /// # Errors
    /// A device that cannot be reached, that is masked, that speaks something else or another version, or that is another
    /// skin's; the error says which and what to do.
    pub fn connect(
        address: &Address,
        skin: &Skin,
        options: DeviceOptions,
        stream: Option<Stream>,
    ) -> Result<Self, LiveError> {
        let mut line = open(address)?;
        let mut decoder = Decoder::new(vec![0; dermis_wire::packet_bytes(dermis_wire::LONGEST_MESSAGE)]);
        let mut stream = match stream {
            Some(stream) => stream.reconnected(),
            None => Stream::new(skin)?,
        };
        let scan = &stream.scan;
        let met = Handshake { address, line: line.as_mut(), decoder: &mut decoder, skin, scan, options }.meet()?;
        let facts = stream.met(met.hello, met.tested);
        let mut device = Device {
            address: address.to_string(),
            line,
            decoder,
            buffer: vec![0; READ_BYTES],
            facts,
            stream,
            notice: met.notice,
            heard_at: Instant::now(),
            asked_at: Instant::now(),
        };
        device.send(&ToDevice::Start)?;
        Ok(device)
    }

    /// What it is known by.
    pub fn facts(&self) -> &DeviceFacts {
        &self.facts
    }

    /// What is known of its frames, for the next connection.
    pub fn into_stream(self) -> Stream {
        self.stream
    }

    /// Sends it a message.
    ///
    /// # Errors
    /// A device that was lost.
    pub fn send(&mut self, message: &ToDevice<'_>) -> Result<(), LiveError> {
        let sent = send(self.line.as_mut(), message);
        sent.map_err(|error| LiveError::Lost { address: self.address.clone(), message: error.to_string() })
    }

    /// Listens for a moment and tells what came.
    ///
    /// # Errors
    /// A device that was lost or fell masked.
    pub fn listen(&mut self, mut tell: impl FnMut(Heard)) -> Result<(), LiveError> {
        self.notice.take().into_iter().for_each(|notice| tell(Heard::Notice(notice)));
        if self.asked_at.elapsed() > START_AGAIN {
            self.asked_at = Instant::now();
            self.send(&ToDevice::Start)?;
        }
        let lost = |message: String| LiveError::Lost { address: self.address.clone(), message };
        let Some(count) = self.line.receive(&mut self.buffer).map_err(|error| lost(error.to_string()))? else {
            if self.heard_at.elapsed() > SILENCE {
                return Err(lost(format!("it has been masked for {} s", SILENCE.as_secs())));
            }
            return Ok(());
        };
        self.heard_at = Instant::now();
        let received_at = crate::clock::now();
        let Device { decoder, buffer, stream, asked_at, .. } = self;
        decoder.feed(&buffer[..count], |received| {
            let Received::Message(message) = received else {
                stream.damaged += 1;
                return;
            };
            match ToHost::parse(message) {
                Ok(ToHost::Frame(frame)) => {
                    *asked_at = Instant::now();
                    let incoming = stream.frame(&frame, message, received_at);
                    incoming.into_iter().for_each(|incoming| tell(Heard::Frame(Box::new(incoming))));
                }
                Ok(ToHost::Status(status)) => tell(Heard::Status(status)),
                Ok(ToHost::Fault(fault)) => {
                    let text = format!("the device says: {}", fault.text);
                    tell(Heard::Notice(Notice { level: Severity::Error, text, at: received_at }));
                }
                Ok(ToHost::Hello(_)) => {}
                Err(_) => stream.damaged += 1,
            }
        });
        Ok(())
    }
}
