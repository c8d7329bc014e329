//! Handshake with a device: its identity, its configuration, and a test of its readings.

use crate::device::line::{Address, Line};
use crate::device::{DeviceOptions, READ_BYTES, SILENCE};
use crate::device::{Role, ScanTable};
use crate::{DeviceIdentity, LiveError};
use dermis::pipeline::{Notice, Severity};
use dermis::skin::Skin;
use dermis::text::{counted, hexadecimal, printable};
use dermis_wire::{
    Decoder, Fault, FaultCode, Frame, FrameFlags, Hello, Received, ScanPart, Slot, ToDevice, ToHost, VERSION,
    test_reading,
};
use std::time::{Duration, Instant};

/// The result of a handshake; the device is ready to start.
pub(super) struct Connected {
    /// Its hello, after the configuration.
    pub hello: Vec<u8>,
    /// A notice for the user.
    pub notice: Option<Notice>,
    /// The sequence number of its self-test frame.
    pub tested: Option<u32>,
}

/// A handshake in progress.
pub(super) struct Handshake<'a> {
    pub address: &'a Address,
    pub line: &'a mut dyn Line,
    pub decoder: &'a mut Decoder<Vec<u8>>,
    pub skin: &'a Skin,
    pub scan: &'a ScanTable,
    pub options: DeviceOptions,
}

/// Time to wait for an answer, in addition to the transmission time, before the request is repeated.
const ANSWER: Duration = Duration::from_millis(500);

/// Bits per byte on a serial line.
const BITS: f64 = 10.0;

impl Handshake<'_> {
    /// Requests the device's identity, configures and tests it, and requests its identity again.
    ///
    /// # Errors
    /// A device that does not answer, uses another protocol or version, belongs to another skin, rejects the scan table
    /// or the rate, or sends wrong test readings.
    pub(super) fn run(mut self) -> Result<Connected, LiveError> {
        let first = self.hello()?;
        let hello = self.checked(&first)?;
        let asked = self.options.rate_hz.map_or(hello.rate_millihertz, |rate_hz| (rate_hz * 1e3).round() as u32);
        let baud = hello.baud;
        let begun = Instant::now();
        let mut said =
            "it said hello, but answered neither scan table nor self-test: is its firmware stuck?".to_string();
        // At least two attempts, even on a slow line.
        for attempt in 0.. {
            if attempt >= 2 && begun.elapsed() >= SILENCE {
                break;
            }
            // Each attempt requests one self-test, which a device need not support.
            let answers = self.settle(asked, baud, attempt + 1)?;
            let Some(hello) = answers.hello else { continue };
            let now = self.checked(&hello)?;
            let slots = self.scan.slots().len();
            if (usize::from(now.slot_count), now.rate_millihertz) == (slots, asked) {
                let notice = answers.tested.is_none().then(untested);
                return Ok(Connected { hello, notice, tested: answers.tested });
            }
            said = format!(
                "it was asked to send {slots} readings {} times a second, and says that it will send {} {} times a second",
                f64::from(asked) * 1e-3,
                now.slot_count,
                f64::from(now.rate_millihertz) * 1e-3
            );
        }
        Err(self.refused(said))
    }

    fn refused(&self, message: String) -> LiveError {
        LiveError::Refused { address: self.address.to_string(), message, identity: None }
    }

    fn lost(&self, message: &std::io::Error) -> LiveError {
        LiveError::Lost { address: self.address.to_string(), message: message.to_string() }
    }

    fn send(&mut self, message: &ToDevice<'_>) -> Result<(), LiveError> {
        send(self.line, message).map_err(|error| self.lost(&error))
    }

    fn checked<'m>(&self, message: &'m [u8]) -> Result<Hello<'m>, LiveError> {
        let Ok(ToHost::Hello(hello)) = ToHost::parse(message) else {
            return Err(self.refused("its hello cannot be read".into()));
        };
        check(&hello, self.address, self.skin, self.scan.slots().len(), self.options).map_err(|message| {
            LiveError::Refused {
                address: self.address.to_string(),
                message,
                // Of the right skin nothing else is asked.
                identity: (hello.design_sha256 != self.skin.design().sha256())
                    .then_some(DeviceIdentity { design_sha256: hello.design_sha256, serial: hello.serial }),
            }
        })?;
        Ok(hello)
    }

    /// Waits for the hello of a device and ignores everything before it.
    fn hello(&mut self) -> Result<Vec<u8>, LiveError> {
        let begun = Instant::now();
        let mut asked_at = None::<Instant>;
        let mut buffer = vec![0; READ_BYTES];
        let (mut bytes, mut hello, mut other_version) = (0, None, None);
        while begun.elapsed() < SILENCE {
            if asked_at.is_none_or(|asked_at| asked_at.elapsed() >= ANSWER) {
                // A peer that closed the connection may have sent data before; these data identify it.
                let _ = self.send(&ToDevice::Stop).and_then(|()| self.send(&ToDevice::Identify));
                asked_at = Some(Instant::now());
            }
            let count = match self.line.receive(&mut buffer) {
                Ok(count) => count.unwrap_or(0),
                Err(error) if bytes == 0 => return Err(self.lost(&error)),
                // A peer that sent data and closed the connection is not a device.
                Err(_) => break,
            };
            bytes += count;
            self.decoder.feed(&buffer[..count], |received| {
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
                let mine = "update the older one";
                return Err(self.refused(format!(
                    "it speaks version {version} of the protocol, this program version {VERSION}: {mine}"
                )));
            }
        }
        Err(LiveError::Unreachable { address: self.address.to_string(), message: no_hello(bytes, self.address) })
    }

    /// Sends the scan table and the rate, requests a self-test, and requests the identity again. The answers arrive in
    /// that order.
    ///
    /// The device may report at most `tests` messages as unknown.
    fn settle(&mut self, rate_millihertz: u32, baud: u32, tests: usize) -> Result<Answers, LiveError> {
        let scan = self.scan;
        for part in scan.parts() {
            self.send(&ToDevice::Scan(part))?;
        }
        self.send(&ToDevice::Rate(rate_millihertz))?;
        self.send(&ToDevice::SelfTest)?;
        self.send(&ToDevice::Identify)?;
        let patience = ANSWER + on_line(scan.slots().len(), baud);
        let mut answers = Answers::default();
        let mut buffer = vec![0; READ_BYTES];
        let begun = Instant::now();
        while answers.hello.is_none() && begun.elapsed() < patience {
            let received = self.line.receive(&mut buffer).map_err(|error| self.lost(&error))?;
            let Some(count) = received else { continue };
            self.decoder.feed(&buffer[..count], |received| {
                if let Received::Message(message) = received {
                    answers.take(message, scan);
                }
            });
            if let Some(why) = answers.refusal(tests) {
                return Err(self.refused(why));
            }
        }
        Ok(answers)
    }
}

/// Transmission time of the scan table and of the test readings on a serial line.
fn on_line(slot_count: usize, baud: u32) -> Duration {
    let part_bytes = dermis_wire::packet_bytes(7 + ScanPart::MAX * Slot::BYTES);
    let bytes = slot_count.div_ceil(ScanPart::MAX) * part_bytes + Frame::packet_bytes(slot_count, 4);
    match baud {
        0 => Duration::ZERO,
        baud => Duration::from_secs_f64(bytes as f64 * BITS / f64::from(baud)),
    }
}

/// The answers of a device to its configuration, the self-test and the request for its identity.
#[derive(Default)]
struct Answers {
    /// A request that it rejects.
    fault: Option<String>,
    /// Messages that it does not support.
    unknown: Vec<String>,
    /// Sequence number of the test frame, and what is wrong with its readings.
    tested: Option<u32>,
    wrong: Option<String>,
    /// The hello that follows these answers.
    hello: Option<Vec<u8>>,
}

impl Answers {
    fn take(&mut self, message: &[u8], scan: &ScanTable) {
        match ToHost::parse(message) {
            Ok(ToHost::Fault(Fault { code: FaultCode::UnknownMessage, text })) => {
                self.unknown.push(printable(text).into_owned())
            }
            Ok(ToHost::Fault(fault)) => self.fault = Some(printable(fault.text).into_owned()),
            Ok(ToHost::Frame(frame)) if frame.flags.has(FrameFlags::TEST) => {
                self.tested = Some(frame.sequence);
                self.wrong = wrong_reading(&frame, scan);
            }
            // An earlier hello answers an earlier request.
            Ok(ToHost::Hello(_)) if self.tested.is_some() || !self.unknown.is_empty() => {
                self.hello = Some(message.to_vec());
            }
            _ => {}
        }
    }

    /// Why the device cannot be used, if so, after this number of self-test requests.
    fn refusal(&self, tests: usize) -> Option<String> {
        if let Some(text) = &self.fault {
            return Some(format!("it says: {text}"));
        }
        // It need not support the self-test; if it does, the unknown message is another one.
        let other = self.unknown.len() > if self.tested.is_some() { 0 } else { tests };
        if let (Some(text), true) = (self.unknown.first(), other) {
            return Some(format!("it does not know the scan table or the rate: {text}; update its firmware"));
        }
        self.wrong.clone()
    }
}

fn untested() -> Notice {
    let text = "the device knows no self-test: whether its readings come through as they are is not known".into();
    Notice { level: Severity::Info, text, at: crate::clock::now() }
}

/// Describes a wrong reading of a self-test.
fn wrong_reading(frame: &Frame<'_>, scan: &ScanTable) -> Option<String> {
    let roles = scan.roles();
    if frame.readings.len() != roles.len() {
        return Some(format!(
            "its self-test has {}, the scan table {}",
            counted(frame.readings.len(), "reading"),
            roles.len()
        ));
    }
    let expected = |slot: usize| i32::from(test_reading(slot as u16));
    let is_wrong = |&(slot, reading): &(usize, i32)| reading != expected(slot);
    let wrong: Vec<(usize, i32)> = frame.readings.iter().enumerate().filter(is_wrong).collect();
    let &(slot, reading) = wrong.first()?;
    let reads = match roles[slot] {
        Role::Current(drive) => format!("the current of drive {drive}"),
        Role::Channel(channel) => format!("channel {channel}"),
    };
    Some(format!(
        "its self-test is wrong in slot {slot} ({reads}): {reading} in place of {}, and so are {} of {} readings: its firmware \
         must send them as they are, low byte first",
        expected(slot),
        wrong.len(),
        roles.len()
    ))
}

/// Sends a message.
pub(super) fn send(line: &mut dyn Line, message: &ToDevice<'_>) -> std::io::Result<()> {
    let mut packet = [0; ToDevice::PACKET_BYTES];
    let length = message.encode(&mut packet).map_err(std::io::Error::other)?;
    line.send(&packet[..length])
}

/// Explains why no hello was received, and the fix.
fn no_hello(bytes: usize, address: &Address) -> String {
    match (bytes, address) {
        (0, _) => "nothing came in 2 s: is it on, is this its port, does no other program read it?".into(),
        (bytes, Address::Serial { baud, .. }) => format!(
            "{} came and no hello among them: is {baud} bits a second the speed of its line (write serial:PATH@BAUD), \
             is this its port?",
            counted(bytes, "byte")
        ),
        (bytes, _) => {
            let bytes = counted(bytes, "byte");
            format!("{bytes} came and no hello among them: something else speaks there; is the port right?")
        }
    }
}

/// Rejects a device that does not match the skin.
fn check(
    hello: &Hello<'_>,
    address: &Address,
    skin: &Skin,
    slot_count: usize,
    options: DeviceOptions,
) -> Result<(), String> {
    let design = skin.design();
    if usize::from(hello.electrode_count) != design.electrodes.len() {
        let (device, skin) = (hello.electrode_count, design.electrodes.len());
        return Err(format!("it is a skin of {device} electrodes, but `{}` has {skin}", design.name));
    }
    if hello.design_sha256 != design.sha256() {
        let short = |hash: &[u8; 32]| hexadecimal(&hash[..4]);
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
    if hello.full_scale == 0 {
        return Err("its hello states a full scale of 0 counts: it must be the highest reading".into());
    }
    if hello.rate_millihertz == 0 && options.rate_hz.is_none() {
        return Err(
            "its hello states a rate of 0: it must be that at which it sends frames, or give one with --rate".into()
        );
    }
    let rate_millihertz = options.rate_hz.map_or(f64::from(hello.rate_millihertz), |rate_hz| rate_hz * 1e3);
    if !(rate_millihertz >= 1.0 && rate_millihertz <= f64::from(hello.highest_rate_millihertz)) {
        let (asked, most) = (rate_millihertz * 1e-3, f64::from(hello.highest_rate_millihertz) * 1e-3);
        return Err(format!("{asked} frames a second are asked for, but it takes at most {most}"));
    }
    let bytes = dermis_wire::bytes_per_second(slot_count, usize::from(hello.reading_bytes), rate_millihertz as u32);
    let baud = match address {
        Address::Serial { baud, .. } if hello.baud != 0 => (*baud).min(hello.baud),
        _ => return Ok(()),
    };
    let needed = dermis_wire::smallest_baud(bytes);
    match needed {
        Ok(needed) if needed <= baud => Ok(()),
        Ok(needed) => Err(format!(
            "a line of {baud} bits a second is too slow for {} readings {} times a second: the smallest that does is {needed}",
            slot_count,
            rate_millihertz * 1e-3
        )),
        Err(needed) => {
            Err(format!("its frames need {needed} bits a second, more than serial lines have: ask for a lower rate"))
        }
    }
}
