//! The session of the emulated device with one host.

use crate::EmulateError;
use crate::emulator::Emulator;
use crate::emulator::fault::Fault;
use crate::emulator::port::Wire;
use dermis_sim::random::sample_rng;
use dermis_wire::{
    Decoder, Fault as WireFault, FaultCode, Frame, FrameFlags, Hello, Received, ScanPart, Slot, Status, ToDevice,
    ToHost, test_reading,
};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use std::time::{Duration, Instant};

/// A frame that is later than this, in the device's time if that is slower, is skipped.
const MAX_LATE: Duration = Duration::from_millis(250);
/// Interval of status messages, us of the device's time.
const STATUS_US: f64 = 1e6;

/// Why a session ended.
pub(super) enum SessionEnd {
    /// The host disconnected.
    Gone,
    /// The device failed.
    Failed(Box<EmulateError>),
}

impl From<std::io::Error> for SessionEnd {
    fn from(_: std::io::Error) -> Self {
        SessionEnd::Gone
    }
}

impl From<EmulateError> for SessionEnd {
    fn from(error: EmulateError) -> Self {
        SessionEnd::Failed(Box::new(error))
    }
}

/// A session with one host.
pub(super) struct HostSession<'a> {
    emulator: &'a Emulator,
    line: &'a mut dyn Wire,
    decoder: Decoder<[u8; ToDevice::PACKET_BYTES]>,
    /// The parts received so far of a scan table.
    begun: Option<Vec<Slot>>,
    running: bool,
    /// Real time of the first frame after the start, and its number.
    began: (Instant, u64),
    dropped: u32,
    damaged: u32,
    /// The device's time of the last status, us.
    status_at_us: f64,
    packet: Vec<u8>,
    rng: ChaCha8Rng,
}

/// The random stream of damaged bytes.
const BYTES_STREAM: u64 = u64::MAX - 17;

impl<'a> HostSession<'a> {
    pub(super) fn new(emulator: &'a Emulator, line: &'a mut dyn Wire) -> Self {
        let slot_count = emulator.slots().len();
        HostSession {
            decoder: Decoder::new([0; ToDevice::PACKET_BYTES]),
            begun: None,
            running: false,
            began: (Instant::now(), 0),
            dropped: 0,
            damaged: 0,
            status_at_us: emulator.timing().time_us(emulator.next_index()),
            packet: vec![0; Frame::packet_bytes(slot_count, 4).max(Hello::PACKET_BYTES).max(WireFault::PACKET_BYTES)],
            rng: sample_rng(emulator.options().seed, BYTES_STREAM),
            emulator,
            line,
        }
    }

    pub(super) fn run(&mut self) -> Result<(), SessionEnd> {
        self.greet()?;
        let mut buffer = [0; 4096];
        while !self.emulator.is_stopped() {
            let count = if self.running { self.peek(&mut buffer)? } else { self.line.receive(&mut buffer)? };
            if count > 0 {
                self.answer(&buffer[..count])?;
            }
            if self.running {
                self.send_due()?;
            } else {
                std::thread::sleep(Duration::from_millis(1));
            }
        }
        Ok(())
    }

    /// While frames are sent, commands are read only a hundred times per second, because reading costs time.
    fn peek(&mut self, buffer: &mut [u8]) -> Result<usize, SessionEnd> {
        let every = (f64::from(self.emulator.timing().rate_millihertz()) * 1e-5).ceil() as u64;
        let next = self.emulator.next_index();
        if next.is_multiple_of(every.max(1)) { Ok(self.line.receive(buffer)?) } else { Ok(0) }
    }

    fn greet(&mut self) -> Result<(), SessionEnd> {
        let packet = self.emulator.hello_packet(self.emulator.timing().asked_millihertz());
        Ok(self.line.say(&packet)?)
    }

    fn say(&mut self, message: &ToHost<'_>) -> Result<(), SessionEnd> {
        let length = message.encode(&mut self.packet).map_err(no_room)?;
        Ok(self.line.say(&self.packet[..length])?)
    }

    fn answer(&mut self, bytes: &[u8]) -> Result<(), SessionEnd> {
        let mut messages: Vec<Option<Vec<u8>>> = Vec::new();
        self.decoder.feed(bytes, |received| {
            messages.push(match received {
                Received::Message(message) => Some(message.to_vec()),
                Received::Damaged => None,
            });
        });
        for message in messages {
            match message.as_deref().map(ToDevice::parse) {
                None => self.damaged += 1,
                Some(Err(_)) => self.refuse(FaultCode::UnknownMessage, "this message is unknown")?,
                Some(Ok(command)) => self.execute(&command)?,
            }
        }
        Ok(())
    }

    fn refuse(&mut self, code: FaultCode, text: &str) -> Result<(), SessionEnd> {
        self.say(&ToHost::Fault(WireFault { code, text }))
    }

    fn execute(&mut self, command: &ToDevice<'_>) -> Result<(), SessionEnd> {
        match command {
            ToDevice::Identify => self.greet()?,
            ToDevice::Stop => self.running = false,
            ToDevice::Start if self.running => {}
            ToDevice::Start => self.start(),
            ToDevice::Scan(part) => self.scan(part)?,
            ToDevice::Rate(rate_millihertz) => {
                let most = self.emulator.highest_rate_millihertz();
                if (1..=most).contains(rate_millihertz) {
                    self.emulator.timing().ask(*rate_millihertz);
                } else {
                    self.refuse(FaultCode::Rate, &format!("at most {} frames a second", f64::from(most) * 1e-3))?;
                }
            }
            ToDevice::SelfTest => self.self_test()?,
        }
        Ok(())
    }

    fn self_test(&mut self) -> Result<(), SessionEnd> {
        let index = self.emulator.next_index();
        let readings: Vec<i32> =
            (0..self.emulator.slots().len()).map(|slot| test_reading(slot as u16).into()).collect();
        let stamp = self.stamp(index);
        let written = self.emulator.write_frame(stamp, &readings, FrameFlags::TEST, &mut self.packet);
        let length = written.map_err(no_room)?;
        self.emulator.set_next_index(index + 1);
        self.line.say(&self.packet[..length])?;
        self.status()
    }

    fn start(&mut self) {
        let index = self.emulator.next_index();
        self.emulator.timing().start(index);
        self.running = true;
        self.began = (Instant::now(), index);
    }

    /// Processes a part of a scan table. Only the table of its own skin, which is set at power-up, is accepted.
    fn scan(&mut self, part: &ScanPart<'_>) -> Result<(), SessionEnd> {
        let mut slots = if part.first == 0 { Vec::new() } else { self.begun.take().unwrap_or_default() };
        let own = self.emulator.slots();
        if slots.len() != usize::from(part.first) {
            let text = format!("a part from slot {} on came where slot {} was next", part.first, slots.len());
            return self.refuse(FaultCode::ScanTable, &text);
        }
        slots.extend(part.slots.iter());
        let differs = |slot: usize| slots.get(slot) != own.get(slot);
        if usize::from(part.total) != own.len() || (0..slots.len()).any(differs) {
            let text = format!("this device reads the {} slots of its own skin alone", own.len());
            return self.refuse(FaultCode::ScanTable, &text);
        }
        self.begun = (slots.len() < own.len()).then_some(slots);
        Ok(())
    }

    fn stamp(&self, index: u64) -> (u32, u64) {
        let time_s = index as f64 / self.emulator.options().twin.electronics.frame_rate_hz;
        let time_us = self.emulator.timing().time_us(index);
        (index as u32, self.emulator.clock_us(time_s, time_us))
    }

    /// Waits until the next frame is due and sends it.
    fn send_due(&mut self) -> Result<(), SessionEnd> {
        let emulator = self.emulator;
        let index = emulator.next_index();
        let frame_s = 1e3 / f64::from(emulator.timing().rate_millihertz()) / emulator.options().speed;
        let mut flags = FrameFlags::default();
        if !emulator.options().unpaced {
            let due = self.began.0 + Duration::from_secs_f64((index - self.began.1) as f64 * frame_s);
            match due.checked_duration_since(Instant::now()) {
                Some(wait) => std::thread::sleep(wait),
                None if due.elapsed() > MAX_LATE.div_f64(emulator.options().speed.min(1.0)) => {
                    // The twin is too slow: late frames are skipped, as an instrument does on a slow line.
                    let skipped = (due.elapsed().as_secs_f64() / frame_s) as u64;
                    self.dropped = self.dropped.wrapping_add(skipped as u32);
                    emulator.set_next_index(index + skipped);
                    emulator.is_slow(f64::from(emulator.timing().rate_millihertz()) * 1e-3);
                    flags = FrameFlags::OVERRUN;
                }
                None => {}
            }
        }
        let index = if flags == FrameFlags::OVERRUN { emulator.next_index() } else { index };
        let time_s = index as f64 / emulator.options().twin.electronics.frame_rate_hz;
        emulator.fail(time_s)?;
        if emulator.is_unplugged(time_s) {
            return Err(SessionEnd::Gone);
        }
        if !emulator.is_silent(time_s) {
            let counts = emulator.counts(index)?;
            self.send_frame(index, time_s, counts, flags)?;
        }
        emulator.set_next_index(index + 1);
        let time_us = emulator.timing().time_us(index + 1);
        if time_us - self.status_at_us >= STATUS_US {
            self.status_at_us = time_us;
            self.status()?;
        }
        Ok(())
    }

    fn send_frame(&mut self, index: u64, time_s: f64, counts: Vec<i32>, flags: FrameFlags) -> Result<(), SessionEnd> {
        let emulator = self.emulator;
        let stamp = self.stamp(index);
        let written = emulator.write_frame(stamp, &counts, flags, &mut self.packet);
        let length = written.map_err(no_room)?;
        let share = emulator.felt(time_s, |fault| match fault {
            Fault::Bytes { share, for_s } => Some((*share, *for_s)),
            _ => None,
        });
        if share > 0.0 && self.rng.random::<f64>() < share {
            let hurt = damaged(&self.packet[..length], &mut self.rng);
            return Ok(self.line.say(&hurt)?);
        }
        Ok(self.line.say(&self.packet[..length])?)
    }

    fn status(&mut self) -> Result<(), SessionEnd> {
        let (frames, time_us) = self.stamp(self.emulator.next_index());
        self.say(&ToHost::Status(Status {
            uptime_ms: (time_us / 1000) as u32,
            frames,
            dropped: self.dropped,
            damaged: self.damaged,
            temperature_cc: 2500,
            supply_mv: 5000,
        }))
    }
}

/// No message is longer than the buffer.
fn no_room(error: dermis_wire::NoRoom) -> std::io::Error {
    std::io::Error::other(error.to_string())
}

/// A packet with random damage: a byte changed, cut short, doubled, or noise before it.
fn damaged(packet: &[u8], rng: &mut ChaCha8Rng) -> Vec<u8> {
    let mut bytes = packet.to_vec();
    let inside = 1 + rng.random_range(0..packet.len() - 2);
    match rng.random_range(0..4) {
        0 => bytes[inside] ^= 1 << rng.random_range(0..8),
        1 => bytes.truncate(inside),
        2 => bytes.extend_from_slice(packet),
        _ => {
            let noise: Vec<u8> = (0..rng.random_range(1..40)).map(|_| rng.random()).collect();
            bytes.splice(0..0, noise);
        }
    }
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::emulator::{EmulatorOptions, Script};
    use dermis::design::SkinDesign;
    use dermis_sim::twin::TwinOptions;

    /// A connection that stores what the device sends.
    struct Said(Vec<u8>);

    impl Wire for Said {
        fn receive(&mut self, _: &mut [u8]) -> std::io::Result<usize> {
            Ok(0)
        }

        fn say(&mut self, bytes: &[u8]) -> std::io::Result<()> {
            self.0.extend_from_slice(bytes);
            Ok(())
        }
    }

    #[test]
    fn a_rate_holds_from_the_next_start_on_and_time_does_not_jump() {
        let options = EmulatorOptions {
            twin: TwinOptions::shipped("lab").unwrap(),
            seed: 1,
            script: Script::default(),
            faults: Vec::new(),
            speed: 1.0,
            prerendered: 0,
            unpaced: true,
        };
        let emulator = Emulator::new(&SkinDesign::shipped("skin16").unwrap(), options).unwrap();
        let mut said = Said(Vec::new());
        let mut talk = HostSession::new(&emulator, &mut said);
        let send = |talk: &mut HostSession<'_>| (0..3).for_each(|_| assert!(talk.send_due().is_ok()));
        let execute = |talk: &mut HostSession<'_>, command| assert!(talk.execute(&command).is_ok());
        execute(&mut talk, ToDevice::Start);
        send(&mut talk);
        execute(&mut talk, ToDevice::Rate(60_000));
        let began = talk.began;
        execute(&mut talk, ToDevice::Start);
        assert_eq!(talk.began, began, "it is started already");
        send(&mut talk);
        execute(&mut talk, ToDevice::Stop);
        execute(&mut talk, ToDevice::Start);
        send(&mut talk);
        // The next host finds the rate that the previous one set.
        assert!(HostSession::new(&emulator, &mut said).greet().is_ok());

        let (mut times_us, mut rate_millihertz) = (Vec::new(), 0);
        let mut decoder = Decoder::new(vec![0; 4096]);
        decoder.feed(&said.0, |received| {
            let Received::Message(message) = received else { return };
            match ToHost::parse(message).unwrap() {
                ToHost::Frame(frame) => times_us.push(frame.time_us),
                ToHost::Hello(hello) => rate_millihertz = hello.rate_millihertz,
                _ => {}
            }
        });
        assert_eq!(times_us, [0, 8333, 16_666, 25_000, 33_333, 41_666, 50_000, 66_666, 83_333]);
        assert_eq!(rate_millihertz, 60_000);
    }
}
