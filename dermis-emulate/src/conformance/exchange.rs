//! Requests to a device under test, and its answers.

use dermis_live::LiveError;
use dermis_live::device::{Address, Line, open};
use dermis_wire::{Decoder, LONGEST_MESSAGE, Received, ToDevice, ToHost, encode, packet_bytes};
use std::time::{Duration, Instant};

/// Longest time in which silence is checked: a device that goes on sends several frames in it.
const LISTEN: Duration = Duration::from_millis(500);

/// A connection to a device under test.
pub(super) struct Exchange {
    address: Address,
    line: Box<dyn Line>,
    decoder: Decoder<Vec<u8>>,
    /// Messages that have arrived and were not taken, oldest first.
    arrived: std::collections::VecDeque<Vec<u8>>,
    patience: Duration,
    /// Packets that were damaged on arrival.
    pub(super) damaged: u64,
}

impl Exchange {
    /// Connects.
    ///
    /// # Errors
    /// A device that cannot be reached.
    pub(super) fn connect(address: &Address, patience: Duration) -> Result<Self, LiveError> {
        Ok(Exchange {
            line: open(address)?,
            address: address.clone(),
            decoder: Decoder::new(vec![0; packet_bytes(LONGEST_MESSAGE)]),
            arrived: std::collections::VecDeque::new(),
            patience,
            damaged: 0,
        })
    }

    fn lost(&self, error: &std::io::Error) -> LiveError {
        LiveError::Lost { address: self.address.to_string(), message: error.to_string() }
    }

    /// Sends a message.
    pub(super) fn send(&mut self, message: &ToDevice<'_>) -> Result<(), LiveError> {
        let mut packet = [0; ToDevice::PACKET_BYTES];
        let length = message.encode(&mut packet).expect("the packet fits into the bytes that it takes at most");
        self.send_bytes(&packet[..length])
    }

    /// Sends the packet of any message, known or not.
    pub(super) fn send_message(&mut self, message: &[u8]) -> Result<(), LiveError> {
        let mut packet = vec![0; packet_bytes(message.len())];
        let length = encode(message, &mut packet).expect("the packet fits into the bytes that it takes at most");
        self.send_bytes(&packet[..length])
    }

    /// Sends bytes as they are.
    pub(super) fn send_bytes(&mut self, bytes: &[u8]) -> Result<(), LiveError> {
        self.line.send(bytes).map_err(|error| self.lost(&error))
    }

    fn receive(&mut self) -> Result<(), LiveError> {
        let mut buffer = vec![0; 1 << 16];
        let Some(count) = self.line.receive(&mut buffer).map_err(|error| self.lost(&error))? else { return Ok(()) };
        let (arrived, damaged) = (&mut self.arrived, &mut self.damaged);
        self.decoder.feed(&buffer[..count], |received| match received {
            Received::Message(message) => arrived.push_back(message.to_vec()),
            Received::Damaged => *damaged += 1,
        });
        Ok(())
    }

    /// The next message; `None` if none comes in time.
    pub(super) fn next(&mut self) -> Result<Option<Vec<u8>>, LiveError> {
        let begun = Instant::now();
        while self.arrived.is_empty() && begun.elapsed() < self.patience {
            self.receive()?;
        }
        Ok(self.arrived.pop_front())
    }

    /// Discards messages up to one that is sought and returns it; `None` if it does not come within ten times the
    /// patience of an answer.
    pub(super) fn seek(&mut self, is_sought: impl Fn(&ToHost<'_>) -> bool) -> Result<Option<Vec<u8>>, LiveError> {
        let begun = Instant::now();
        while begun.elapsed() < 10 * self.patience {
            let Some(message) = self.next()? else { return Ok(None) };
            if ToHost::parse(&message).is_ok_and(|parsed| is_sought(&parsed)) {
                return Ok(Some(message));
            }
        }
        Ok(None)
    }

    /// Forgets packets that were damaged until now.
    pub(super) fn forgive(&mut self) {
        self.damaged = 0;
    }

    /// What arrives in the time of an answer, or in [`LISTEN`] if that is shorter.
    pub(super) fn listen(&mut self) -> Result<Vec<Vec<u8>>, LiveError> {
        let begun = Instant::now();
        while begun.elapsed() < self.patience.min(LISTEN) {
            self.receive()?;
        }
        Ok(self.arrived.drain(..).collect())
    }
}
