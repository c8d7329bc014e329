//! A device: polls its parts, and keeps its state across hosts.

use crate::board::{Gone, Link, System};
use crate::instrument::Instrument;
use crate::outbox::Outbox;
use crate::scanner::Scanner;
use crate::session::Session;
use crate::table::{Tables, TimedSlot};
use dermis_wire::{Decoder, Fault, Frame, Hello, Status, ToDevice};

/// The memory of a device whose largest frame has a given number of slots.
#[derive(Debug)]
pub struct Memory<'a> {
    /// The scan table in use and the one that arrives, of this many slots each.
    pub tables: [&'a mut [TimedSlot]; 2],
    /// Test readings, of the same number.
    pub readings: &'a mut [i16],
    /// Packets on their way: at least [`Memory::outbox_bytes`].
    pub outbox: &'a mut [u8],
}

impl Memory<'_> {
    /// Room for two frames and any answer, bytes.
    pub const fn outbox_bytes(slot_count: usize) -> usize {
        2 * Frame::packet_bytes(slot_count, 2) + Status::PACKET_BYTES + longest_answer(slot_count)
    }
}

/// Longest answer to one message of the host, bytes.
pub(crate) const fn longest_answer(slot_count: usize) -> usize {
    let test = Frame::packet_bytes(slot_count, 2) + Status::PACKET_BYTES;
    let text = if Hello::PACKET_BYTES > Fault::PACKET_BYTES { Hello::PACKET_BYTES } else { Fault::PACKET_BYTES };
    if test > text { test } else { text }
}

/// Bytes that are read from the link at once.
const INBOX_BYTES: usize = 64;

/// A device between power-up and power-down.
#[derive(Debug)]
pub struct Device<'a> {
    session: Session<'a>,
    decoder: Decoder<[u8; ToDevice::PACKET_BYTES]>,
    inbox: [u8; INBOX_BYTES],
    /// The bytes of the inbox that are to be decoded.
    arrived: core::ops::Range<usize>,
    connected: bool,
}

impl<'a> Device<'a> {
    /// A device at power-up: stopped, with the scan table of its instrument.
    pub fn new(instrument: Instrument<'a>, memory: Memory<'a>) -> Self {
        let tables = Tables::new(memory.tables, &instrument);
        let session = Session::new(instrument, tables, memory.readings, Outbox::new(memory.outbox));
        Device {
            session,
            decoder: Decoder::new([0; ToDevice::PACKET_BYTES]),
            inbox: [0; INBOX_BYTES],
            arrived: 0..0,
            connected: false,
        }
    }

    /// Whether frames are being sent.
    pub fn is_running(&self) -> bool {
        self.session.is_running()
    }

    /// Sends what the link takes, takes a frame of the scanner, and answers at most one message of the host. The main
    /// loop of a board calls this again and again.
    pub fn poll(&mut self, scanner: &mut impl Scanner, link: &mut impl Link, system: &mut impl System) {
        system.feed_watchdog();
        let connected = link.connected();
        if connected && !self.connected {
            self.session.greet(scanner.limits());
        }
        let is_lost = connected && self.converse(scanner, link, system).is_err();
        if is_lost || (!connected && self.connected) {
            self.disconnect(scanner);
        }
        // A host that connects after a lost one is greeted.
        self.connected = connected && !is_lost;
    }

    fn converse(
        &mut self,
        scanner: &mut impl Scanner,
        link: &mut impl Link,
        system: &mut impl System,
    ) -> Result<(), Gone> {
        self.session.outbox.send(link)?;
        self.session.take_frame(scanner, system);
        if self.session.has_room_for_answer() {
            self.answer_one(scanner, link, system)?;
        }
        self.session.status_if_due(system);
        self.session.outbox.send(link)
    }

    /// Decodes bytes up to the end of the next packet.
    fn answer_one(
        &mut self,
        scanner: &mut impl Scanner,
        link: &mut impl Link,
        system: &mut impl System,
    ) -> Result<(), Gone> {
        if self.arrived.is_empty() {
            self.arrived = 0..link.receive(&mut self.inbox)?.min(INBOX_BYTES);
        }
        let bytes = &self.inbox[self.arrived.clone()];
        let packet = bytes.iter().position(|&byte| byte == 0).map_or(bytes.len(), |zero| zero + 1);
        let session = &mut self.session;
        self.decoder.feed(&bytes[..packet], |received| session.answer(received, scanner, system));
        self.arrived.start += packet;
        Ok(())
    }

    /// Stops, and forgets what the host had begun; scan table and rate remain.
    fn disconnect(&mut self, scanner: &mut impl Scanner) {
        self.session.stop(scanner);
        self.session.outbox.clear();
        self.decoder.reset();
        self.arrived = 0..0;
    }
}
