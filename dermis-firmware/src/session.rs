//! Commands of the host and their answers, frames and statuses.

use crate::board::System;
use crate::device::longest_answer;
use crate::instrument::Instrument;
use crate::outbox::Outbox;
use crate::scanner::{HardwareFault, Limits, Scanned, Scanner, plan};
use crate::table::{TableFault, Tables};
use crate::timing::{carried_millihertz, highest_rate_millihertz, period_ns};
use core::fmt::Write;
use dermis_wire::{
    Fault, FaultCode, Frame, FrameFlags, Hello, Readings, Received, ScanPart, Status, ToDevice, ToHost, VERSION,
    test_reading,
};

/// Interval of statuses, us.
const STATUS_US: u64 = 1_000_000;

/// A started scanner without a frame for this long, and for four periods, has failed, us.
const STALLED_US: u64 = 1_000_000;

/// Room for the text of a fault, bytes.
const TEXT_BYTES: usize = 128;

/// State of a device, and the answers to its host.
#[derive(Debug)]
pub(crate) struct Session<'a> {
    instrument: Instrument<'a>,
    tables: Tables<'a>,
    test_readings: &'a mut [i16],
    pub outbox: Outbox<'a>,
    /// The requested rate; a table that needs more time lowers it.
    asked_millihertz: u32,
    running: Option<Running>,
    /// Number of the next frame.
    sequence: u32,
    dropped: u32,
    damaged: u32,
}

/// Between start and stop.
#[derive(Debug, Clone, Copy)]
struct Running {
    /// Slots of a frame; the host may send another table meanwhile.
    slot_count: usize,
    period_us: u64,
    frame_us: u64,
    status_us: u64,
    /// Whether frames were dropped since the last one that was sent.
    overrun: bool,
}

impl<'a> Session<'a> {
    pub fn new(
        instrument: Instrument<'a>,
        tables: Tables<'a>,
        test_readings: &'a mut [i16],
        outbox: Outbox<'a>,
    ) -> Self {
        Session {
            asked_millihertz: instrument.rate_millihertz,
            instrument,
            tables,
            test_readings,
            outbox,
            running: None,
            sequence: 0,
            dropped: 0,
            damaged: 0,
        }
    }

    pub fn is_running(&self) -> bool {
        self.running.is_some()
    }

    /// Slots of the largest frame that is sent before the next answer.
    fn slot_count(&self) -> usize {
        self.running.map_or(0, |running| running.slot_count).max(self.tables.complete().len())
    }

    pub fn has_room_for_answer(&self) -> bool {
        self.outbox.room() >= longest_answer(self.slot_count())
    }

    fn highest_millihertz(&self, limits: Limits) -> u32 {
        highest_rate_millihertz(self.tables.complete(), limits, self.instrument.baud)
    }

    /// The rate from the next start on.
    fn rate_millihertz(&self, limits: Limits) -> u32 {
        self.asked_millihertz.min(self.highest_millihertz(limits))
    }

    /// Answers a message, or counts a damaged one.
    pub fn answer(&mut self, received: Received<'_>, scanner: &mut impl Scanner, system: &mut impl System) {
        let Received::Message(message) = received else {
            self.damaged = self.damaged.wrapping_add(1);
            return;
        };
        match ToDevice::parse(message) {
            Err(_) => self.refuse(FaultCode::UnknownMessage, "this message is unknown"),
            Ok(ToDevice::Identify) => self.greet(scanner.limits()),
            Ok(ToDevice::Start) => self.start(scanner, system.now_us()),
            Ok(ToDevice::Stop) => self.stop(scanner),
            Ok(ToDevice::Scan(part)) => self.scan(&part),
            Ok(ToDevice::Rate(rate_millihertz)) => self.rate(rate_millihertz, scanner.limits()),
            Ok(ToDevice::SelfTest) => self.self_test(system),
        }
    }

    fn say(&mut self, message: &ToHost<'_>) {
        // `has_room_for_answer` holds before a message is answered.
        let _ = self.outbox.put(|out| message.encode(out));
    }

    fn refuse(&mut self, code: FaultCode, text: &str) {
        self.say(&ToHost::Fault(Fault { code, text }));
    }

    /// Sends the hello.
    pub fn greet(&mut self, limits: Limits) {
        let instrument = self.instrument;
        self.say(&ToHost::Hello(Hello {
            version: VERSION,
            reading_bytes: 2,
            design_sha256: instrument.design_sha256,
            electrode_count: instrument.electrode_count,
            slot_count: self.tables.complete().len() as u16,
            reference_ohm: instrument.reference_ohm,
            source_v: instrument.source_v,
            volts_per_count: instrument.volts_per_count,
            full_scale: instrument.full_scale.into(),
            rate_millihertz: self.rate_millihertz(limits),
            highest_rate_millihertz: self.highest_millihertz(limits),
            baud: instrument.baud,
            serial: instrument.serial,
            boot: instrument.boot,
            name: instrument.name,
        }));
    }

    fn start(&mut self, scanner: &mut impl Scanner, now_us: u64) {
        if self.running.is_some() {
            return;
        }
        let (limits, slots) = (scanner.limits(), self.tables.complete());
        if slots.is_empty() {
            return self.refuse(FaultCode::ScanTable, "there is no scan table to start with");
        }
        let period_ns = period_ns(self.rate_millihertz(limits));
        let Some(plan) = plan(slots, limits, period_ns) else { return self.refuse_rate(limits) };
        let slot_count = slots.len();
        match scanner.start(&plan, now_us) {
            Err(HardwareFault(text)) => self.refuse(FaultCode::Hardware, text),
            Ok(()) => {
                let period_us = period_ns / 1000;
                let (frame_us, status_us) = (now_us, now_us);
                self.running = Some(Running { slot_count, period_us, frame_us, status_us, overrun: false });
            }
        }
    }

    pub fn stop(&mut self, scanner: &mut impl Scanner) {
        if self.running.take().is_some() {
            scanner.stop();
        }
    }

    fn scan(&mut self, part: &ScanPart<'_>) {
        let mut text = heapless::String::<TEXT_BYTES>::new();
        // A text that does not fit is cut.
        let _ = match self.tables.take(part, &self.instrument) {
            Ok(_) => return,
            Err(TableFault::Empty) => write!(text, "a scan table has at least one slot"),
            Err(TableFault::TooMany { total, most }) => {
                write!(text, "{total} slots are too many: there is memory for {most}")
            }
            Err(TableFault::OutOfOrder { first, next }) => {
                write!(text, "a part from slot {first} on came where slot {next} was next")
            }
            Err(TableFault::NoElectrode { slot }) => {
                let count = self.instrument.electrode_count;
                write!(text, "slot {slot} names an electrode that does not exist: there are {count}")
            }
        };
        self.refuse(FaultCode::ScanTable, &text);
    }

    fn rate(&mut self, rate_millihertz: u32, limits: Limits) {
        if (1..=self.highest_millihertz(limits)).contains(&rate_millihertz) {
            self.asked_millihertz = rate_millihertz;
        } else {
            self.refuse_rate(limits);
        }
    }

    /// States the highest rate, and what limits it.
    fn refuse_rate(&mut self, limits: Limits) {
        let (slots, most) = (self.tables.complete(), self.highest_millihertz(limits));
        let baud = self.instrument.baud;
        let by_line = baud != 0 && u64::from(most) == carried_millihertz(slots.len(), baud);
        let longest_ns = slots.iter().map(|timed| timed.wait_ns).max().unwrap_or(0);
        let mut text = heapless::String::<TEXT_BYTES>::new();
        let _ = write!(text, "at most {}.{:03} frames a second: ", most / 1000, most % 1000);
        let _ = match by_line {
            true => write!(text, "the line carries {baud} bits a second"),
            false => {
                write!(text, "{} slots settle in up to {}.{:03} us", slots.len(), longest_ns / 1000, longest_ns % 1000)
            }
        };
        self.refuse(if by_line { FaultCode::Line } else { FaultCode::Rate }, &text);
    }

    fn self_test(&mut self, system: &mut impl System) {
        let count = self.tables.complete().len();
        if count == 0 {
            return self.refuse(FaultCode::ScanTable, "there is no scan table to test with");
        }
        let Some(readings) = self.test_readings.get_mut(..count) else {
            return self.refuse(FaultCode::Hardware, "the memory of the test is smaller than the scan table");
        };
        readings.iter_mut().zip(0..).for_each(|(reading, slot)| *reading = test_reading(slot));
        let (sequence, time_us, flags) = (self.sequence, system.now_us(), FrameFlags::TEST);
        let frame = Frame { sequence, time_us, flags, readings: Readings::I16(readings) };
        let _ = self.outbox.put(|out| ToHost::Frame(frame).encode(out));
        self.sequence = self.sequence.wrapping_add(1);
        self.status(system);
    }

    fn status(&mut self, system: &mut impl System) {
        self.say(&ToHost::Status(Status {
            uptime_ms: (system.now_us() / 1000) as u32,
            frames: self.sequence,
            dropped: self.dropped,
            damaged: self.damaged,
            temperature_cc: system.temperature_cc(),
            supply_mv: system.supply_mv(),
        }));
    }

    /// Sends a status once per second while started, if there is room beside an answer.
    pub fn status_if_due(&mut self, system: &mut impl System) {
        let now_us = system.now_us();
        let is_due = self.running.is_some_and(|running| now_us.saturating_sub(running.status_us) >= STATUS_US);
        if is_due && self.outbox.room() >= Status::PACKET_BYTES + longest_answer(self.slot_count()) {
            self.running.iter_mut().for_each(|running| running.status_us = now_us);
            self.status(system);
        }
    }

    /// Takes the next frame of the scanner; a scanner that has failed is stopped.
    pub fn take_frame(&mut self, scanner: &mut impl Scanner, system: &mut impl System) {
        let Some(running) = self.running else { return };
        let now_us = system.now_us();
        let silent_us = now_us.saturating_sub(running.frame_us);
        let failed = match scanner.poll(now_us) {
            Ok(Some(scanned)) => return self.frame(&scanned, now_us),
            Ok(None) if silent_us <= STALLED_US.max(4 * running.period_us) => return,
            Ok(None) => "the scanner has stopped",
            Err(HardwareFault(text)) => text,
        };
        self.stop(scanner);
        // Kept for the host: without room it sees no frames, and starts again.
        if self.has_room_for_answer() {
            self.refuse(FaultCode::Hardware, failed);
        }
    }

    fn frame(&mut self, scanned: &Scanned<'_>, now_us: u64) {
        let Some(running) = &mut self.running else { return };
        running.frame_us = now_us;
        running.overrun |= scanned.missed > 0;
        self.dropped = self.dropped.wrapping_add(scanned.missed);
        let sequence = self.sequence.wrapping_add(scanned.missed);
        self.sequence = sequence.wrapping_add(1);
        let flags = flags(scanned.readings, self.instrument.full_scale, running.overrun);
        let readings = Readings::I16(scanned.readings);
        let room = Frame::packet_bytes(readings.len(), 2) + longest_answer(running.slot_count);
        // An answer always finds room, however slow the line is.
        let sent = self.outbox.room() >= room && {
            let frame = Frame { sequence, time_us: scanned.time_us, flags, readings };
            self.outbox.put(|out| ToHost::Frame(frame).encode(out)).is_ok()
        };
        running.overrun = !sent;
        self.dropped = self.dropped.wrapping_add(u32::from(!sent));
    }
}

fn flags(readings: &[i16], full_scale: u16, overrun: bool) -> FrameFlags {
    let full = i32::from(full_scale);
    let is_out = |&reading: &i16| i32::from(reading) >= full || i32::from(reading) < -full;
    let mut flags = FrameFlags::default();
    if readings.iter().any(is_out) {
        flags = flags.and(FrameFlags::SATURATED);
    }
    if overrun { flags.and(FrameFlags::OVERRUN) } else { flags }
}
