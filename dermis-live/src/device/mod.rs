//! A device: found, asked who it is, told what to read, and listened to.

mod clock;
mod line;

pub use clock::DeviceClock;
pub use line::{Address, Line, PATIENCE, open};

use crate::LiveError;
use crate::meter::Meter;
use crate::moment::Moment;
use crate::processor::Incoming;
use crate::report::{Counts, Level, Notice};
use crate::skin::LiveSkin;
use dermis_wire::{Arrival, Arrivals, Decoder, Frame, Hello, Received, Status, ToDevice, ToHost, VERSION};
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
    heard_at: Instant,
}

/// What is known of the frames of a device, from one connection to the next.
#[derive(Debug, Clone, Default)]
pub struct Stream {
    meter: Option<Meter>,
    arrivals: Arrivals,
    clock: DeviceClock,
    rate: Rate,
    boot: Option<u32>,
    /// Number of the newest frame, not wrapping round.
    newest: Option<u64>,
    damaged: u64,
    reconnected: u64,
}

/// Frames a second, from the device's times of the last frames.
#[derive(Debug, Clone, Default)]
struct Rate {
    arrived: std::collections::VecDeque<Moment>,
}

/// A device that says nothing for so long is silent.
const SILENCE: Duration = Duration::from_secs(2);

/// Bytes that are read at once.
const READ_BYTES: usize = 1 << 16;

impl Rate {
    /// Frames over which the rate is told.
    const FRAMES: usize = 240;

    fn take(&mut self, at: Moment) -> f64 {
        if self.arrived.len() == Self::FRAMES {
            self.arrived.pop_front();
        }
        self.arrived.push_back(at);
        let span_s = self.arrived.front().map_or(0.0, |first| at.seconds_since(*first));
        if span_s > 0.0 { (self.arrived.len() - 1) as f64 / span_s } else { 0.0 }
    }
}

impl Stream {
    /// Counts since the start.
    pub fn counts(&self) -> Counts {
        Counts {
            frames: self.arrivals.received,
            lost: self.arrivals.lost,
            repeated: self.arrivals.repeated,
            reordered: self.arrivals.reordered,
            damaged: self.damaged,
            reconnected: self.reconnected,
        }
    }

    /// The device says who it is.
    pub fn hello(&mut self, hello: &Hello<'_>, skin: &LiveSkin) {
        if self.boot.replace(hello.boot).is_some_and(|boot| boot != hello.boot) {
            self.arrivals.restart();
            self.clock.restart();
        }
        self.meter = Some(Meter::new(hello, &skin.scan, &skin.design.protocol));
    }

    /// A frame's message that came at some moment; `None` of one that is not new or not the skin's.
    pub fn frame(&mut self, frame: &Frame<'_>, message: &[u8], received_at: Moment) -> Option<Incoming> {
        let meter = self.meter.as_ref()?;
        if frame.readings.len() != meter.slot_count() {
            self.damaged += 1;
            return None;
        }
        let Arrival::New { skipped } = self.arrivals.take(frame.sequence) else { return None };
        let newest = self.newest.map_or(u64::from(frame.sequence), |newest| newest + 1 + u64::from(skipped));
        self.newest = Some(newest);
        let measured_at = self.clock.moment(frame.time_us, received_at);
        Some(Incoming {
            sequence: newest,
            measured_at,
            received_at,
            measures: meter.measure(frame.readings),
            message: message.to_vec(),
            counts: self.counts(),
            rate_hz: self.rate.take(measured_at),
        })
    }
}

/// What a device says that concerns more than the stream of frames.
#[derive(Debug, Clone, PartialEq)]
pub enum Heard {
    /// A frame.
    Frame(Box<Incoming>),
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
    /// A device that cannot be reached, that is silent, that speaks something else or another version, or that is another
    /// skin's; the error says which and what to do.
    pub fn connect(
        address: &Address,
        skin: &LiveSkin,
        options: DeviceOptions,
        stream: Option<Stream>,
    ) -> Result<Self, LiveError> {
        let mut line = open(address)?;
        let mut decoder = Decoder::new(vec![0; dermis_wire::packet_bytes(dermis_wire::LONGEST_MESSAGE)]);
        let named = address.to_string();
        let lost = |error: std::io::Error| LiveError::Lost { address: named.clone(), message: error.to_string() };
        send(line.as_mut(), &ToDevice::Stop).map_err(lost)?;
        send(line.as_mut(), &ToDevice::Identify).map_err(lost)?;
        let hello = await_hello(line.as_mut(), &mut decoder, &named)?;
        let mut device = Device {
            facts: DeviceFacts { name: String::new(), serial: 0, rate_hz: 0.0, hello: hello.clone() },
            address: named,
            line,
            decoder,
            buffer: vec![0; READ_BYTES],
            stream: stream
                .map_or_else(Stream::default, |stream| Stream { reconnected: stream.reconnected + 1, ..stream }),
            heard_at: Instant::now(),
        };
        device.greet(&hello, address, skin, options)?;
        Ok(device)
    }

    /// Checks a hello and starts the device.
    fn greet(
        &mut self,
        message: &[u8],
        address: &Address,
        skin: &LiveSkin,
        options: DeviceOptions,
    ) -> Result<(), LiveError> {
        let refused = |message: String| LiveError::Refused { address: address.to_string(), message };
        let Ok(ToHost::Hello(hello)) = ToHost::parse(message) else {
            return Err(refused("its hello cannot be read".into()));
        };
        check(&hello, address, skin, options).map_err(refused)?;
        self.stream.hello(&hello, skin);
        self.facts.name = hello.name.into();
        self.facts.serial = hello.serial;
        let rate_mhz = options.rate_hz.map_or(hello.rate_mhz, |rate_hz| (rate_hz * 1e3).round() as u32);
        self.facts.rate_hz = f64::from(rate_mhz) * 1e-3;
        for part in skin.scan.parts() {
            self.send(&ToDevice::Scan(part))?;
        }
        self.send(&ToDevice::Rate(rate_mhz))?;
        self.send(&ToDevice::Start)
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
    /// A device that was lost or fell silent.
    pub fn listen(&mut self, mut tell: impl FnMut(Heard)) -> Result<(), LiveError> {
        let lost = |message: String| LiveError::Lost { address: self.address.clone(), message };
        let Some(count) = self.line.receive(&mut self.buffer).map_err(|error| lost(error.to_string()))? else {
            if self.heard_at.elapsed() > SILENCE {
                return Err(lost(format!("it has been silent for {} s", SILENCE.as_secs())));
            }
            return Ok(());
        };
        self.heard_at = Instant::now();
        let received_at = Moment::now();
        let Device { decoder, buffer, stream, .. } = self;
        decoder.feed(&buffer[..count], |received| {
            let Received::Message(message) = received else {
                stream.damaged += 1;
                return;
            };
            match ToHost::parse(message) {
                Ok(ToHost::Frame(frame)) => {
                    let incoming = stream.frame(&frame, message, received_at);
                    incoming.into_iter().for_each(|incoming| tell(Heard::Frame(Box::new(incoming))));
                }
                Ok(ToHost::Status(status)) => tell(Heard::Status(status)),
                Ok(ToHost::Fault(fault)) => {
                    let text = format!("the device says: {}", fault.text);
                    tell(Heard::Notice(Notice { level: Level::Error, text, at: received_at }));
                }
                Ok(ToHost::Hello(_)) => {}
                Err(_) => stream.damaged += 1,
            }
        });
        Ok(())
    }
}

fn send(line: &mut dyn Line, message: &ToDevice<'_>) -> std::io::Result<()> {
    let mut packet = [0; ToDevice::PACKET_BYTES];
    let length = message.encode(&mut packet).map_err(std::io::Error::other)?;
    line.send(&packet[..length])
}

/// Waits for the hello of a device, whatever else comes before it.
fn await_hello(line: &mut dyn Line, decoder: &mut Decoder<Vec<u8>>, address: &str) -> Result<Vec<u8>, LiveError> {
    let begun = Instant::now();
    let mut buffer = vec![0; READ_BYTES];
    let (mut bytes, mut hello, mut other_version) = (0, None, None);
    while begun.elapsed() < SILENCE {
        let received = line.receive(&mut buffer);
        let lost = |error: std::io::Error| LiveError::Lost { address: address.into(), message: error.to_string() };
        let Some(count) = received.map_err(lost)? else { continue };
        bytes += count;
        decoder.feed(&buffer[..count], |received| {
            let Received::Message(message) = received else { return };
            match Hello::version_of(message) {
                Some(VERSION) => hello = Some(message.to_vec()),
                Some(version) => other_version = Some(version),
                None => {}
            }
        });
        if let Some(hello) = hello {
            return Ok(hello);
        }
        if let Some(version) = other_version {
            let message = format!(
                "it speaks version {version} of the protocol, this program version {VERSION}: update the older one"
            );
            return Err(LiveError::Refused { address: address.into(), message });
        }
    }
    let message = match bytes {
        0 => "nothing came in 2 s: is it on, and is this its port?".to_string(),
        bytes => format!(
            "{bytes} bytes came in 2 s and no hello among them: wrong speed of the line, or something else's port"
        ),
    };
    Err(LiveError::Unreachable { address: address.into(), message })
}

/// Refuses what is not a device for the skin.
fn check(hello: &Hello<'_>, address: &Address, skin: &LiveSkin, options: DeviceOptions) -> Result<(), String> {
    let design = &skin.design;
    if usize::from(hello.electrode_count) != design.electrodes.len() {
        let (device, skin) = (hello.electrode_count, design.electrodes.len());
        return Err(format!("it is a skin of {device} electrodes, but `{}` has {skin}", design.name));
    }
    if hello.design_sha256 != design.sha256() {
        let short = |hash: &[u8; 32]| hash[..4].iter().map(|byte| format!("{byte:02x}")).collect::<String>();
        return Err(format!(
            "it is another skin than `{}` (its design's hash begins with {}, this one's with {}): give the design that its \
             firmware was made for (`dermis scan-table`)",
            design.name,
            short(&hello.design_sha256),
            short(&design.sha256())
        ));
    }
    let scales = [hello.reference_ohm, hello.source_v].into_iter().chain(hello.volts_per_count);
    if let Some(wrong) = scales.into_iter().find(|value| !(value.is_finite() && *value > 0.0)) {
        return Err(format!(
            "its hello states a scale of {wrong}: resistor, source and volts a count must be positive"
        ));
    }
    let rate_mhz = options.rate_hz.map_or(f64::from(hello.rate_mhz), |rate_hz| rate_hz * 1e3);
    if !(rate_mhz >= 1.0 && rate_mhz <= f64::from(hello.highest_rate_mhz)) {
        let (asked, most) = (rate_mhz * 1e-3, f64::from(hello.highest_rate_mhz) * 1e-3);
        return Err(format!("{asked} frames a second are asked for, but it takes at most {most}"));
    }
    let bytes =
        dermis_wire::bytes_per_second(skin.scan.slots().len(), usize::from(hello.reading_bytes), rate_mhz as u32);
    let baud = match address {
        Address::Serial { baud, .. } if hello.baud != 0 => (*baud).min(hello.baud),
        _ => return Ok(()),
    };
    let needed = dermis_wire::smallest_baud(bytes);
    match needed {
        Ok(needed) if needed <= baud => Ok(()),
        Ok(needed) => Err(format!(
            "a line of {baud} bits a second is too slow for {} readings {} times a second: the smallest that does is {needed}",
            skin.scan.slots().len(),
            rate_mhz * 1e-3
        )),
        Err(needed) => {
            Err(format!("its frames need {needed} bits a second, more than serial lines have: ask for a lower rate"))
        }
    }
}
