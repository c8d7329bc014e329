//! Devices: connection, handshake, messages, and conversion of readings to ohm.
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
mod rows;
mod scan;

use clock::DeviceClock;
pub use line::{Address, Line, PATIENCE, open};
use meter::Meter;
pub(crate) use rows::RowMessage;
pub use scan::{Role, ScanTable, TooLarge};

use crate::LiveError;
use crate::device::handshake::{Handshake, send};
use crate::device::rows::RowReader;

use dermis::pipeline::{Counts, FrameInput, Measurement, Notice, Severity, Timestamp};
use dermis::skin::Skin;
use dermis::text::printable;
use dermis_wire::{
    Arrival, Arrivals, Decoder, FaultCode, Frame, FrameFlags, Hello, Received, Status, ToDevice, ToHost,
};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Options for reading a device.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct DeviceOptions {
    /// Frame rate; `None` for the device's own. Of rows of values, the rate of those without times.
    pub rate_hz: Option<f64>,
    /// Rows of values are differences from the untouched skin.
    pub difference: bool,
    /// The times of frames follow the device's clock alone, from the first frame on: for a device in a simulator that is
    /// slower than real time. Without effect on rows of values.
    pub device_time: bool,
}

/// The facts of a device.
#[derive(Debug, Clone, PartialEq)]
pub struct DeviceFacts {
    /// Its name.
    pub name: String,
    /// Its serial number.
    pub serial: u32,
    /// Frames per second that it sends.
    pub rate_hz: f64,
    /// Its hello as received; recordings store it.
    pub hello: Vec<u8>,
}

/// A connected device.
pub struct Device {
    address: String,
    line: Box<dyn Line>,
    decoder: Decoder<Vec<u8>>,
    buffer: Vec<u8>,
    facts: DeviceFacts,
    stream: Stream,
    notice: Option<Notice>,
    /// Faults of the clock that were reported, and when.
    reported_clock: (u64, Option<Instant>),
    refusals: Refusals,
    heard_at: Instant,
    /// When the last frame was received, or frames were last requested; `None` before the first request.
    asked_at: Option<Instant>,
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

/// The frames of a device in order, across reconnections.
#[derive(Debug, Clone)]
pub struct Stream {
    skin: Skin,
    scan: Arc<ScanTable>,
    meter: Option<Meter>,
    arrivals: Arrivals,
    clock: DeviceClock,
    rate: Rate,
    /// Frames per second that the device states.
    nominal_rate_hz: Option<f64>,
    boot: Option<u32>,
    /// Number of the newest frame, without wrap-around.
    newest: Option<u64>,
    /// Self-test frames among those that arrived.
    tests: u64,
    damaged: u64,
    reconnected: u64,
}

/// Frames per second, from the device times of the last frames.
#[derive(Debug, Clone, Default)]
struct Rate {
    arrived: std::collections::VecDeque<Timestamp>,
}

/// A device that sends nothing for this time is lost.
const SILENCE: Duration = Duration::from_secs(2);

/// A device that has sent no frame for this time is started again.
const START_AGAIN: Duration = Duration::from_secs(1);

/// Interval between two reports of a faulty clock.
const CLOCK_REPORT: Duration = Duration::from_secs(10);

/// What has arrived when a frame was used last, or when it was reported that none is.
#[derive(Debug)]
struct Refusals {
    counts: Counts,
    tests: u64,
    at: Instant,
    /// Time until the next report.
    interval: Duration,
}

impl Refusals {
    fn of(stream: &Stream) -> Self {
        Refusals { counts: stream.counts(), tests: stream.tests, at: Instant::now(), interval: NONE_USED }
    }
}

/// Time with messages and without a frame that can be used after which people are told.
const NONE_USED: Duration = Duration::from_secs(2);

/// Size of the read buffer.
const READ_BYTES: usize = 1 << 16;

impl Rate {
    /// Frames over which the rate is averaged.
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
    /// A stream without a frame yet.
    ///
    /// # Errors
    /// A protocol that exceeds the limits of the wire format.
    pub fn new(skin: &Skin) -> Result<Self, TooLarge> {
        Ok(Stream {
            skin: skin.clone(),
            scan: Arc::new(ScanTable::new(&skin.design().protocol)?),
            meter: None,
            arrivals: Arrivals::default(),
            clock: DeviceClock::default(),
            rate: Rate::default(),
            nominal_rate_hz: None,
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
            clock_faults: self.clock.faults(),
        }
    }

    /// Processes the hello of the device.
    pub fn hello(&mut self, hello: &Hello<'_>) {
        if self.boot.replace(hello.boot).is_some_and(|boot| boot != hello.boot) {
            self.arrivals.restart();
            self.clock.restart();
        }
        self.nominal_rate_hz = Some(f64::from(hello.rate_millihertz) * 1e-3);
        self.meter = Some(Meter::new(hello, &self.scan, &self.skin.design().protocol));
    }

    /// The same stream after a reconnection: the relation of the device's clock is no longer known.
    fn reconnected(mut self) -> Self {
        self.clock.restart();
        Stream { reconnected: self.reconnected + 1, ..self }
    }

    /// Processes the result of a handshake: the last hello, and the sequence number of the self-test frame.
    pub(crate) fn connect(&mut self, message: Vec<u8>, tested: Option<u32>) -> DeviceFacts {
        let (mut name, mut serial, mut rate_hz) = (String::new(), 0, 0.0);
        if let Ok(ToHost::Hello(hello)) = ToHost::parse(&message) {
            self.hello(&hello);
            (name, serial, rate_hz) =
                (printable(hello.name).into_owned(), hello.serial, f64::from(hello.rate_millihertz) * 1e-3);
        }
        tested.into_iter().for_each(|sequence| self.test(sequence));
        DeviceFacts { name, serial, rate_hz, hello: message }
    }

    /// Counts a self-test frame, which uses a sequence number but is not part of the stream.
    fn test(&mut self, sequence: u32) {
        if let Arrival::New { skipped } = self.arrivals.take(sequence) {
            self.newest = self.newest.map(|newest| newest + 1 + u64::from(skipped));
            self.tests += 1;
        }
    }

    /// Converts a received frame; `None` for a frame that is not new or does not match the skin.
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
        let measurement = meter.measure(frame.readings);
        let newest = self.arrived(frame.sequence)?;
        let measured_at = self.clock.moment(frame.time_us, received_at);
        let input = self.input(newest, measured_at, measurement);
        Some(IncomingFrame { input, received_at, message: message.to_vec() })
    }

    /// The number, without wrap-around, of a frame that arrives; `None` if it is not new.
    fn arrived(&mut self, sequence: u32) -> Option<u64> {
        let Arrival::New { skipped } = self.arrivals.take(sequence) else { return None };
        let newest = self.newest.map_or(u64::from(sequence), |newest| newest + 1 + u64::from(skipped));
        self.newest = Some(newest);
        Some(newest)
    }

    /// The input of a frame that has arrived.
    fn input(&mut self, sequence: u64, measured_at: Timestamp, measurement: Measurement) -> FrameInput {
        let (counts, nominal_rate_hz) = (self.counts(), self.nominal_rate_hz);
        FrameInput { sequence, measured_at, measurement, counts, rate_hz: self.rate.take(measured_at), nominal_rate_hz }
    }
}

/// A received message, beyond the handshake.
#[derive(Debug, Clone, PartialEq)]
pub enum DeviceEvent {
    /// A frame.
    Frame(Box<IncomingFrame>),
    /// The device's status.
    Status(Status),
    /// A notice for the user.
    Notice(Notice),
}

/// A connection to a device or to an instrument that sends rows of values.
pub(crate) enum Connection {
    /// A device with the wire protocol.
    Device(Box<Device>),
    /// Rows of values.
    Rows(Box<RowReader>),
}

impl Connection {
    /// Opens a connection; `stream` continues the stream of an earlier one.
    pub(crate) fn open(
        address: &Address,
        skin: &Skin,
        options: DeviceOptions,
        stream: Option<Stream>,
    ) -> Result<Self, LiveError> {
        let Address::Csv(from) = address else {
            return Ok(Connection::Device(Box::new(Device::connect(address, skin, options, stream)?)));
        };
        let stream = stream.map_or_else(|| Stream::new(skin), |stream| Ok(stream.reconnected()))?;
        Ok(Connection::Rows(Box::new(RowReader::connect(address, from, skin, options, stream)?)))
    }

    pub(crate) fn facts(&self) -> &DeviceFacts {
        match self {
            Connection::Device(device) => device.facts(),
            Connection::Rows(rows) => rows.facts(),
        }
    }

    pub(crate) fn listen(&mut self, publish: impl FnMut(DeviceEvent)) -> Result<(), LiveError> {
        match self {
            Connection::Device(device) => device.listen(publish),
            Connection::Rows(rows) => rows.listen(publish),
        }
    }

    /// Ends the connection; the state of its stream, for the next one.
    pub(crate) fn close(self) -> Stream {
        match self {
            Connection::Device(mut device) => {
                // A device that is gone needs no stop.
                let _ = device.send(&ToDevice::Stop);
                device.into_stream()
            }
            Connection::Rows(rows) => rows.into_stream(),
        }
    }
}

impl Device {
    /// Connects to a device, checks that it matches the skin and configures it. `stream` continues the stream of an
    /// earlier connection. The device sends frames from the first call of [`listen`](Self::listen) on.
    ///
    /// # Errors
    /// A device that cannot be reached, does not answer, uses another protocol or version, or belongs to another skin;
    /// the error states the cause and the fix.
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
        let connected = Handshake { address, line: line.as_mut(), decoder: &mut decoder, skin, scan, options }.run()?;
        stream.clock.is_free = options.device_time;
        let facts = stream.connect(connected.hello, connected.tested);
        Ok(Device {
            address: address.to_string(),
            line,
            decoder,
            buffer: vec![0; READ_BYTES],
            facts,
            refusals: Refusals::of(&stream),
            stream,
            notice: connected.notice,
            reported_clock: (0, None),
            heard_at: Instant::now(),
            asked_at: None,
        })
    }

    /// The facts of the device.
    pub fn facts(&self) -> &DeviceFacts {
        &self.facts
    }

    /// The state of its stream, for the next connection.
    pub(crate) fn into_stream(self) -> Stream {
        self.stream
    }

    /// Sends a message to it.
    ///
    /// # Errors
    /// A device that was lost.
    pub(crate) fn send(&mut self, message: &ToDevice<'_>) -> Result<(), LiveError> {
        let sent = send(self.line.as_mut(), message);
        sent.map_err(|error| LiveError::Lost { address: self.address.clone(), message: error.to_string() })
    }

    /// The report of new faults of the device's clock, at most every ten seconds.
    fn clock_report(&mut self) -> Option<String> {
        let (reported, at) = &mut self.reported_clock;
        let faults = self.stream.clock.faults();
        let is_due = faults > *reported && at.is_none_or(|at| at.elapsed() > CLOCK_REPORT);
        is_due.then(|| {
            (*reported, *at) = (faults, Some(Instant::now()));
            "the clock of the device stands still, was set or is too slow: frames have the time of their arrival".into()
        })
    }

    /// The report of messages while none of them is a frame that can be used.
    fn refusal_report(&mut self) -> Option<String> {
        let (counts, tests) = (self.stream.counts(), self.stream.tests);
        let Refusals { counts: before, tests: tests_before, at, interval } = &mut self.refusals;
        let used = |counts: &Counts| counts.frames - counts.reordered;
        if used(&counts) > used(before) {
            self.refusals = Refusals::of(&self.stream);
            return None;
        }
        let parts = [
            (counts.damaged - before.damaged, "damaged or of another length than this skin's"),
            (counts.repeated - before.repeated, "with the number of one before"),
            (counts.reordered - before.reordered, "older than one before"),
            (tests - *tests_before, "marked as self-tests"),
        ];
        if at.elapsed() < *interval || parts.iter().all(|(count, _)| *count == 0) {
            return None;
        }
        (*at, *interval) = (Instant::now(), CLOCK_REPORT);
        let parts = parts.iter().filter(|(count, _)| *count > 0).map(|(count, what)| format!("{count} {what}"));
        let parts = parts.collect::<Vec<_>>().join(", ");
        Some(format!("messages arrive, but no frame that can be used: {parts}. Check the firmware and the line"))
    }

    /// Reads for a short time and passes the received messages on.
    ///
    /// # Errors
    /// A device that was lost or stopped answering.
    pub fn listen(&mut self, mut publish: impl FnMut(DeviceEvent)) -> Result<(), LiveError> {
        self.notice.take().into_iter().for_each(|notice| publish(DeviceEvent::Notice(notice)));
        if self.asked_at.is_none_or(|at| at.elapsed() > START_AGAIN) {
            let now = Instant::now();
            if self.asked_at.replace(now).is_none() {
                self.heard_at = now;
            }
            self.send(&ToDevice::Start)?;
        }
        let lost = |message: String| LiveError::Lost { address: self.address.clone(), message };
        let Some(count) = self.line.receive(&mut self.buffer).map_err(|error| lost(error.to_string()))? else {
            if self.heard_at.elapsed() > SILENCE {
                return Err(lost(format!("it has sent nothing for {} s", SILENCE.as_secs())));
            }
            return Ok(());
        };
        self.heard_at = Instant::now();
        let received_at = crate::clock::now();
        if let Some(text) = self.clock_report() {
            publish(DeviceEvent::Notice(Notice { level: Severity::Warning, text, at: received_at }));
        }
        let Device { decoder, buffer, stream, asked_at, facts, .. } = self;
        let mut restarted = None;
        decoder.feed(&buffer[..count], |received| {
            let Received::Message(message) = received else {
                stream.damaged += 1;
                return;
            };
            match ToHost::parse(message) {
                Ok(ToHost::Frame(frame)) => {
                    *asked_at = Some(Instant::now());
                    let incoming = stream.frame(&frame, message, received_at);
                    incoming.into_iter().for_each(|incoming| publish(DeviceEvent::Frame(Box::new(incoming))));
                }
                Ok(ToHost::Status(status)) => publish(DeviceEvent::Status(status)),
                // Scan tables are accepted in the handshake: one that is missing now was lost with the power.
                Ok(ToHost::Fault(fault)) if fault.code == FaultCode::ScanTable => {
                    restarted = Some(format!("it says: {}", printable(fault.text)));
                }
                Ok(ToHost::Fault(fault)) => {
                    let text = format!("the device says: {}", printable(fault.text));
                    publish(DeviceEvent::Notice(Notice { level: Severity::Error, text, at: received_at }));
                }
                Ok(ToHost::Hello(_)) if message != facts.hello => {
                    restarted = Some(
                        "its hello is not that of before: it was restarted, or another one is in its place".into(),
                    );
                }
                Ok(ToHost::Hello(_)) => {}
                Err(_) => stream.damaged += 1,
            }
        });
        if let Some(message) = restarted {
            return Err(LiveError::Lost { address: self.address.clone(), message });
        }
        if let Some(text) = self.refusal_report() {
            publish(DeviceEvent::Notice(Notice { level: Severity::Warning, text, at: received_at }));
        }
        Ok(())
    }
}
