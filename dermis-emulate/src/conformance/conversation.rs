//! The conversation: its steps, what each expects, and what was wrong.

use super::exchange::Exchange;
use super::transcript::Transcript;
use dermis::design::SkinDesign;
use dermis::files::sha256;
use dermis::finding::{Finding, FindingKind};
use dermis::text::{hexadecimal, printable};
use dermis_live::LiveError;
use dermis_live::device::{Address, ScanTable};
use dermis_wire::{Fault, FaultCode, Frame, FrameFlags, Hello, ScanPart, Slot, Slots, ToDevice, ToHost, VERSION};
use serde::Serialize;
use std::time::{Duration, Instant};

/// Options of the conversation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ConformanceOptions {
    /// Frames to read.
    pub frames: usize,
    /// Frame rate; `None` for the device's own.
    pub rate_hz: Option<f64>,
    /// Time to wait for an answer.
    pub patience: Duration,
}

/// The result of a conversation.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Conformance {
    /// The name of the device.
    pub device: String,
    /// The names of the steps that were taken, in order. After one with a finding no others follow.
    pub steps: Vec<&'static str>,
    /// How the device departs from the protocol; empty for one that conforms.
    pub findings: Vec<Finding>,
    /// Frames that arrived, and frames that did not.
    pub frames: usize,
    /// Missing frames among them.
    pub lost: u64,
    /// Frames per second by the device's clock.
    pub rate_hz: Option<f64>,
    /// SHA-256 of the transcript.
    pub transcript_sha256: String,
    /// The transcript.
    #[serde(skip)]
    pub transcript: String,
    /// The readings of the frames, counts.
    #[serde(skip)]
    pub readings: Vec<Vec<i32>>,
}

/// Talks to a device and checks its answers.
///
/// # Errors
/// A device that cannot be reached or was lost; a design too large for the wire.
pub fn check_device(
    design: &SkinDesign,
    address: &Address,
    options: ConformanceOptions,
) -> Result<Conformance, LiveError> {
    let scan = ScanTable::new(&design.protocol)?;
    let mut talk = Conversation {
        design,
        scan: &scan,
        options,
        exchange: Exchange::connect(address, options.patience)?,
        transcript: Transcript::default(),
        device: String::new(),
        highest_millihertz: 0,
        rate_millihertz: 0,
        readings: Vec::new(),
        times_us: Vec::new(),
        lost: 0,
    };
    let (mut steps, mut findings) = (Vec::new(), Vec::new());
    for (name, step) in STEPS {
        steps.push(name);
        match step(&mut talk, name) {
            Ok(()) => {}
            Err(Problem::Wrong(evidence)) => {
                let found = Finding::new(FindingKind::WireProtocol, f64::NAN, evidence, FIX);
                findings.push(Finding { step: Some(name), ..found });
                // What follows would fail for the same reason.
                break;
            }
            Err(Problem::Live(error)) => return Err(*error),
        }
    }
    // The device is left stopped.
    let _ = talk.exchange.send(&ToDevice::Stop);
    Ok(talk.result(steps, findings))
}

/// What to do about a device that departs from the protocol.
const FIX: &str = "compare its firmware with docs/wire-protocol.md";

type StepFunction = fn(&mut Conversation<'_>, &'static str) -> Result<(), Problem>;

/// The steps in their order. Answers come in the order of the requests.
const STEPS: [(&str, StepFunction); 10] = [
    ("identify", |talk, step| talk.identify(step)),
    ("unknown messages", |talk, step| talk.unknown(step)),
    ("damaged packets", |talk, step| talk.damaged(step)),
    ("impossible rates", |talk, step| talk.impossible_rates(step)),
    ("impossible scan tables", |talk, step| talk.impossible_tables(step)),
    ("scan table and rate", |talk, step| talk.configure(step)),
    ("self-test", |talk, step| talk.self_test(step)),
    ("start and frames", |talk, step| talk.frames(step)),
    ("self-test between frames", |talk, step| talk.test_while_started(step)),
    ("stop", |talk, step| talk.stop(step)),
];

enum Problem {
    /// The device does not conform.
    Wrong(String),
    Live(Box<LiveError>),
}

impl From<LiveError> for Problem {
    fn from(error: LiveError) -> Self {
        Problem::Live(Box::new(error))
    }
}

fn wrong(text: impl Into<String>) -> Problem {
    Problem::Wrong(text.into())
}

struct Conversation<'a> {
    design: &'a SkinDesign,
    scan: &'a ScanTable,
    options: ConformanceOptions,
    exchange: Exchange,
    transcript: Transcript,
    device: String,
    highest_millihertz: u32,
    rate_millihertz: u32,
    readings: Vec<Vec<i32>>,
    times_us: Vec<u64>,
    lost: u64,
}

impl Conversation<'_> {
    fn result(self, steps: Vec<&'static str>, findings: Vec<Finding>) -> Conformance {
        let rate_hz = match self.times_us[..] {
            [first, .., last] if last > first => Some((self.times_us.len() - 1) as f64 / (last - first) as f64 * 1e6),
            _ => None,
        };
        let transcript = self.transcript.into_text();
        Conformance {
            device: self.device,
            steps,
            findings,
            frames: self.readings.len(),
            lost: self.lost,
            rate_hz,
            transcript_sha256: hexadecimal(&sha256(transcript.as_bytes())),
            transcript,
            readings: self.readings,
        }
    }

    fn next(&mut self, expected: &str) -> Result<Vec<u8>, Problem> {
        self.exchange
            .next()?
            .ok_or_else(|| wrong(format!("no {expected} came within {} ms", self.options.patience.as_millis())))
    }

    /// The next message must be a hello; it is checked.
    fn hello(&mut self, step: &str, configured: bool) -> Result<(), Problem> {
        let message = self.next("hello")?;
        if let Some(version) = Hello::version_of(&message).filter(|version| *version != VERSION) {
            return Err(wrong(format!("it speaks version {version} of the protocol, this program {VERSION}")));
        }
        let Ok(ToHost::Hello(hello)) = ToHost::parse(&message) else { return Err(unexpected("a hello", &message)) };
        self.check_hello(&hello, configured)?;
        self.device = printable(hello.name).into_owned();
        self.highest_millihertz = hello.highest_rate_millihertz;
        self.rate_millihertz = hello.rate_millihertz;
        self.transcript.add(step, &ToHost::Hello(hello), configured);
        Ok(())
    }

    fn check_hello(&self, hello: &Hello<'_>, configured: bool) -> Result<(), Problem> {
        let (electrodes, slots) = (self.design.electrodes.len(), self.scan.slots().len());
        if hello.design_sha256 != self.design.sha256() || usize::from(hello.electrode_count) != electrodes {
            return Err(wrong(format!("its hello is that of another skin than `{}`", self.design.name)));
        }
        let scales = [hello.reference_ohm, hello.source_v].into_iter().chain(hello.volts_per_count);
        if scales.into_iter().any(|scale| !(scale.is_finite() && scale > 0.0)) || hello.full_scale == 0 {
            return Err(wrong("a scale in its hello is not positive"));
        }
        if hello.rate_millihertz > hello.highest_rate_millihertz {
            return Err(wrong("the rate in its hello is above its highest rate"));
        }
        let asked = self.asked_millihertz();
        if configured && (usize::from(hello.slot_count) != slots || hello.rate_millihertz != asked) {
            return Err(wrong(format!(
                "its hello states {} slots and {} mHz, not the {slots} slots and {asked} mHz that it was given",
                hello.slot_count, hello.rate_millihertz
            )));
        }
        Ok(())
    }

    /// The next message must be a fault of this kind.
    fn fault(&mut self, step: &str, codes: &[FaultCode]) -> Result<(), Problem> {
        let message = self.next("fault")?;
        match ToHost::parse(&message) {
            Ok(ToHost::Fault(fault)) if codes.contains(&fault.code) => {
                self.transcript.add(step, &ToHost::Fault(Fault { code: codes[0], ..fault }), false);
                Ok(())
            }
            _ => Err(unexpected(&format!("fault {}", u8::from(codes[0])), &message)),
        }
    }

    fn asked_millihertz(&self) -> u32 {
        self.options.rate_hz.map_or(self.rate_millihertz, |rate_hz| (rate_hz * 1e3).round() as u32)
    }

    /// Stops the device and discards what was on its way: answers come in the order of the requests, so the refusal of an
    /// impossible rate ends it, however busy the computer is.
    fn settle(&mut self) -> Result<(), Problem> {
        self.exchange.send(&ToDevice::Stop)?;
        self.exchange.send(&ToDevice::Rate(0))?;
        let refuses = |message: &ToHost<'_>| matches!(message, ToHost::Fault(fault) if matches!(fault.code, FaultCode::Rate | FaultCode::Line));
        match self.exchange.seek(refuses)? {
            Some(_) => Ok(()),
            None => Err(wrong("no fault came for a rate of zero, which was asked for after a stop")),
        }
    }

    fn identify(&mut self, step: &'static str) -> Result<(), Problem> {
        // What the device has sent before may be anything.
        self.exchange.listen()?;
        self.settle()?;
        self.exchange.forgive();
        self.exchange.send(&ToDevice::Identify)?;
        self.hello(step, false)
    }

    fn unknown(&mut self, step: &'static str) -> Result<(), Problem> {
        // An unknown kind, a start with a byte too many, an empty message, a rate with a byte too few.
        for message in [&[0x99][..], &[0x82, 0], &[], &[0x85, 1, 0, 0]] {
            self.exchange.send_message(message)?;
        }
        for _ in 0..4 {
            self.fault(step, &[FaultCode::UnknownMessage])?;
        }
        Ok(())
    }

    fn damaged(&mut self, step: &'static str) -> Result<(), Problem> {
        let mut packet = [0; ToDevice::PACKET_BYTES];
        let length = ToDevice::Start.encode(&mut packet).expect("the packet fits");
        packet[2] ^= 0x40;
        self.exchange.send_bytes(&packet[..length])?;
        // Noise, longer than any message, and half a packet.
        self.exchange.send_bytes(&[0x55; 2 * ToDevice::PACKET_BYTES])?;
        self.exchange.send_bytes(&packet[..length / 2])?;
        self.exchange.send(&ToDevice::Identify)?;
        self.hello(step, false)
    }

    fn impossible_rates(&mut self, step: &'static str) -> Result<(), Problem> {
        let too_high = self.highest_millihertz.checked_add(1);
        for rate_millihertz in [Some(0), too_high].into_iter().flatten() {
            self.exchange.send(&ToDevice::Rate(rate_millihertz))?;
            self.fault(step, &[FaultCode::Rate, FaultCode::Line])?;
        }
        Ok(())
    }

    fn impossible_tables(&mut self, step: &'static str) -> Result<(), Problem> {
        let slots = self.scan.slots();
        let total = slots.len() as u16;
        let absent = self.design.electrodes.len() as u16;
        let wrong_slot = [Slot { source: absent, ..slots[0] }];
        let first = slots.len().min(2);
        let parts = [
            // No slots at all; a second part without the first; an electrode that does not exist; its continuation.
            ScanPart { first: 0, total: 0, slots: Slots::Given(&[]) },
            ScanPart { first: 1, total, slots: Slots::Given(&slots[1..first]) },
            ScanPart { first: 0, total, slots: Slots::Given(&wrong_slot) },
            ScanPart { first: 1, total, slots: Slots::Given(&slots[1..first]) },
        ];
        for part in parts {
            self.exchange.send(&ToDevice::Scan(part))?;
            self.fault(step, &[FaultCode::ScanTable])?;
        }
        self.exchange.send(&ToDevice::Identify)?;
        self.hello(step, false)
    }

    fn configure(&mut self, step: &'static str) -> Result<(), Problem> {
        let scan = self.scan;
        for part in scan.parts() {
            self.exchange.send(&ToDevice::Scan(part))?;
        }
        let rate_millihertz = self.asked_millihertz();
        self.exchange.send(&ToDevice::Rate(rate_millihertz))?;
        self.exchange.send(&ToDevice::Identify)?;
        self.rate_millihertz = rate_millihertz;
        self.hello(step, true)
    }

    fn self_test(&mut self, step: &'static str) -> Result<(), Problem> {
        self.exchange.send(&ToDevice::SelfTest)?;
        let message = self.next("test frame")?;
        let Ok(ToHost::Frame(frame)) = ToHost::parse(&message) else {
            return Err(unexpected("a test frame", &message));
        };
        self.check_test(&frame)?;
        self.transcript.add(step, &ToHost::Frame(frame), true);
        let message = self.next("status")?;
        match ToHost::parse(&message) {
            Ok(ToHost::Status(status)) if status.damaged == 0 => {
                Err(wrong("its status counts no damaged packets, but it was sent some"))
            }
            Ok(ToHost::Status(status)) => {
                self.transcript.add(step, &ToHost::Status(status), true);
                Ok(())
            }
            _ => Err(unexpected("a status", &message)),
        }
    }

    fn check_test(&self, frame: &Frame<'_>) -> Result<(), Problem> {
        let slots = self.scan.slots().len();
        let is_right = |(slot, reading): (usize, i32)| reading == i32::from(dermis_wire::test_reading(slot as u16));
        if !frame.flags.has(FrameFlags::TEST) || frame.readings.len() != slots {
            return Err(wrong(format!(
                "its test frame has {} readings, not {slots}, or no test flag",
                frame.readings.len()
            )));
        }
        match frame.readings.iter().enumerate().position(|reading| !is_right(reading)) {
            Some(slot) => Err(wrong(format!("its test reading in slot {slot} is wrong"))),
            None => Ok(()),
        }
    }

    fn frames(&mut self, step: &'static str) -> Result<(), Problem> {
        self.exchange.send(&ToDevice::Start)?;
        // While started it has no effect.
        self.exchange.send(&ToDevice::Start)?;
        let mut expected = None::<u32>;
        let mut statuses = 0;
        while self.readings.len() < self.options.frames {
            let message = self.next("frame")?;
            match ToHost::parse(&message) {
                Ok(ToHost::Status(_)) => statuses += 1,
                Ok(ToHost::Frame(frame)) => {
                    let missing = expected.map_or(0, |expected| frame.sequence.wrapping_sub(expected));
                    self.lost += u64::from(missing);
                    expected = Some(frame.sequence.wrapping_add(1));
                    self.check_frame(&frame)?;
                    self.times_us.push(frame.time_us);
                    self.readings.push(frame.readings.iter().collect());
                    self.transcript.add(step, &ToHost::Frame(frame), true);
                }
                _ => return Err(unexpected("a frame", &message)),
            }
        }
        self.check_pace(statuses)
    }

    fn check_frame(&self, frame: &Frame<'_>) -> Result<(), Problem> {
        if frame.readings.len() != self.scan.slots().len() || frame.flags.has(FrameFlags::TEST) {
            return Err(wrong(format!("frame {} is no frame of the scan table", frame.sequence)));
        }
        match self.times_us.last() {
            Some(last) if frame.time_us <= *last => {
                Err(wrong(format!("the time of frame {} is not after that of the frame before", frame.sequence)))
            }
            _ => Ok(()),
        }
    }

    fn check_pace(&self, statuses: usize) -> Result<(), Problem> {
        let [first, .., last] = self.times_us[..] else { return Ok(()) };
        let (count, period_us) = ((self.times_us.len() - 1) as f64, 1e9 / f64::from(self.rate_millihertz));
        let mean_us = (last - first) as f64 / (count + self.lost as f64);
        // A quartz is good to 0.01 %; times are whole microseconds.
        if (mean_us / period_us - 1.0).abs() > 1e-3 + 2.0 / (last - first) as f64 {
            return Err(wrong(format!("its frames are {mean_us:.1} us apart, not {period_us:.1}")));
        }
        let seconds = (last - first) as f64 * 1e-6;
        if seconds > 3.0 && (statuses as f64) < 0.5 * seconds {
            return Err(wrong(format!("{statuses} statuses came in {seconds:.1} s: about one per second is due")));
        }
        if self.lost > 0 {
            return Err(wrong(format!(
                "{} frames are missing between {} that arrived",
                self.lost,
                self.times_us.len()
            )));
        }
        Ok(())
    }

    fn test_while_started(&mut self, step: &'static str) -> Result<(), Problem> {
        self.exchange.send(&ToDevice::SelfTest)?;
        self.exchange.send(&ToDevice::Identify)?;
        let (mut tested, mut followed) = (false, false);
        let begun = Instant::now();
        while begun.elapsed() < 10 * self.options.patience {
            let message = self.next("test frame between frames")?;
            match ToHost::parse(&message) {
                Ok(ToHost::Frame(frame)) if frame.flags.has(FrameFlags::TEST) => {
                    self.check_test(&frame)?;
                    tested = true;
                }
                Ok(ToHost::Frame(_)) if followed => return Ok(()),
                Ok(ToHost::Hello(hello)) if tested => {
                    self.check_hello(&hello, true)?;
                    self.transcript.add(step, &ToHost::Hello(hello), true);
                    followed = true;
                }
                Ok(ToHost::Frame(_) | ToHost::Status(_)) => {}
                _ => return Err(unexpected("a test frame, a status and a hello, in this order", &message)),
            }
        }
        Err(wrong("many messages came, but no test frame, hello and frame in this order"))
    }

    fn stop(&mut self, step: &'static str) -> Result<(), Problem> {
        self.settle()?;
        let late = self.exchange.listen()?;
        if let Some(message) = late.first() {
            return Err(unexpected("silence after the stop", message));
        }
        self.exchange.send(&ToDevice::Identify)?;
        self.hello(step, true)?;
        match self.exchange.damaged {
            0 => Ok(()),
            damaged => Err(wrong(format!("{damaged} of its packets were damaged"))),
        }
    }
}

/// A message that came in place of another.
fn unexpected(expected: &str, message: &[u8]) -> Problem {
    let came = match ToHost::parse(message) {
        Ok(ToHost::Hello(_)) => "a hello".into(),
        Ok(ToHost::Frame(frame)) => format!("frame {}", frame.sequence),
        Ok(ToHost::Status(_)) => "a status".into(),
        Ok(ToHost::Fault(fault)) => format!("fault {} ({})", u8::from(fault.code), printable(fault.text)),
        Err(unknown) => unknown.to_string(),
    };
    wrong(format!("expected {expected}, but {came} came"))
}
